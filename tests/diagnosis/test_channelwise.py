"""Free coefficients: that they take in all a log says, and whiten what disturbs it."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import tensor
from massprop_cli.diagnosis import channelwise
from massprop_cli.diagnosis.design import Case, Design, Designs
from massprop_cli.diagnosis.verticals import verticals, verticals_by_errors
from massprop_cli.estimate import whitening
from massprop_cli.estimate.whitening import Disturbance
from massprop_cli.kernel import Kernel, kernel
from massprop_cli.model.plant import Reference, plant_of
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import compensate
from massprop_cli.prepare.timing import Timing
from tests import flight

DELAY = Timing(2.0, 0.0)
GYRO = 1e-3


def design(rng: np.random.Generator, walk: float, white: float, cycles: int = 600) -> tuple[Design, Array]:
    """A rate driven by two columns, a torque that wanders and one that is white, in units of the gyro's noise; and what drives it."""
    columns = rng.choice([0.0, 1.0], (cycles - 1, 2), p=[0.7, 0.3])
    truth = GYRO * rng.standard_normal((2, 3)) * 5
    torque = np.cumsum(walk * GYRO * rng.standard_normal((cycles - 1, 3)), 0) + white * GYRO * rng.standard_normal((cycles - 1, 3))
    rate = np.vstack([np.zeros(3), np.cumsum(columns @ truth + torque, 0)]) + GYRO * rng.standard_normal((cycles, 3))
    places = {"channels": slice(0, 2)}
    used = np.ones((cycles, 2), dtype=bool)
    none = np.zeros((cycles, 2))
    still, acted = np.zeros((cycles, 3)), (none, none, none)
    measured = (rate, still, 0.05, np.eye(3), used, (15.0, 30.0), acted, 0.05 * np.arange(cycles), np.full(cycles, 0.05))
    return Design(places, np.arange(2), columns, np.zeros((cycles, 2)), *measured), truth


@pytest.mark.parametrize(("walk", "white"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.3), (0.03, 0.3)])
def test_coefficients_beside_a_disturbance_are_as_certain_as_they_are_said_to_be(walk: float, white: float) -> None:
    z, left = [], []
    for seed in range(40):
        made, truth = design(np.random.default_rng(seed), walk, white)
        told, _ = whitening.whitened(made.driven, GYRO**2, [])
        variance = told.left.mean() / told.spare
        root = np.linalg.inv(told.triangle) * np.sqrt(variance)
        z.append((root @ (told.triangle @ truth - told.measured) / np.sqrt(variance)) / np.sqrt((root**2).sum(1))[:, None])
        left.append(variance / GYRO**2)
    # 240 deviates: their root mean square scatters by 5 %; levels are tried in decades, so that it may be some more
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.25)
    assert 0.6 < np.mean(left) < 1.6


@pytest.mark.parametrize("coupling", [0.0, 0.05])
@pytest.mark.parametrize(("walk", "white"), [(0.0, 1.0), (0.1, 0.0), (0.1, 1.0), (0.3, 0.3)])
def test_the_likeliest_disturbance_is_that_of_a_grid(walk: float, white: float, coupling: float) -> None:
    """A torque that wanders and is white besides; what the grid's best has more of likelihood is what a factor of ten costs."""
    for seed in range(5):
        made = design(np.random.default_rng(seed), walk, float(np.hypot(white, np.sqrt(coupling))))[0].driven._replace(coupling=coupling)
        _, (found,) = whitening.whitened(made, GYRO**2, [])
        levels = [0.0, *np.logspace(-6, 1, 15)]
        grid = whitening.whitened_fits(made, [found, *(Disturbance(w, q) for w in levels for q in levels)])
        assert grid[0].cost < min(one.cost for one in grid[1:]) + 25


def test_a_filter_on_columns_is_the_same_as_least_squares_with_the_full_covariance() -> None:
    made, _ = design(np.random.default_rng(1), 0.1, 0.5, cycles=60)
    (beside,) = whitening.whitened_fits(made.driven._replace(coupling=0.0), [Disturbance(white=0.25, walk=0.01)])
    told = beside.fit
    found = np.linalg.solve(told.triangle, told.measured)
    # the rate's own noise, steps summed once, a wandering torque summed twice
    once = np.tril(np.ones((60, 59)), -1)
    twice = once @ np.tril(np.ones((59, 59)), -1)
    covariance = np.eye(60) + 0.25 * once @ once.T + 0.01 * twice @ twice.T
    columns = np.column_stack([np.ones(60), np.arange(60), once @ made.growth])
    weighted = np.linalg.solve(np.linalg.cholesky(covariance), np.column_stack([columns, made.rate]))
    oracle = np.linalg.lstsq(weighted[:, :-3], weighted[:, -3:], rcond=None)[0][2:]
    np.testing.assert_allclose(found, oracle, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("twice", [False, True])
def test_levels_are_compared_by_the_restricted_likelihood(twice: bool) -> None:
    """By dense matrices (Patterson & Thompson 1971), of noise levels free for each axis; a column that stands twice counts once."""
    made, _ = design(np.random.default_rng(5), 0.0, 0.5, cycles=60)
    levels = (0.0, 0.25, 4.0)
    once = np.tril(np.ones((60, 59)), -1)
    expected = []
    for white in levels:
        covariance = np.eye(60) + white * once @ once.T
        began, columns = np.linalg.solve(np.linalg.cholesky(covariance), np.ones((60, 1))), once @ made.growth
        own, measured = np.split(np.linalg.solve(np.linalg.cholesky(covariance), np.hstack([columns, made.rate])), [2], 1)
        whole = np.hstack([began, own])
        left = measured - whole @ np.linalg.lstsq(whole, measured, rcond=None)[0]
        among = np.linalg.slogdet(whole.T @ whole)[1] - np.linalg.slogdet(began.T @ began)[1]
        spare = 57 - 2 * twice
        volume = np.linalg.slogdet(covariance)[1]
        expected.append((spare * np.log((left**2).sum(0) / spare)).sum() + 3 * (volume + among) + 3 * np.log(60) * (white > 0))
    growth = np.hstack([made.growth, made.growth]) if twice else made.growth
    found = whitening.whitened_fits(made.driven._replace(growth=growth, coupling=0.0), [Disturbance(white, 0.0) for white in levels])
    # of a column that stands twice rounding leaves a direction of the noise
    np.testing.assert_allclose(np.diff([one.cost for one in found]), np.diff(expected), atol=12.0 if twice else 1e-6)
    assert np.argmin([one.cost for one in found]) == np.argmin(expected) == 1


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_products_say_of_levels_what_dense_matrices_do(kind: str) -> None:
    """Of all columns of a flight, some of which are sums of others; a torque that walks begins as the steady one that is among them."""
    flown = flight.standard(kind)
    made = Designs().of(flown.log(np.random.default_rng(2)), flown.resolved, DELAY, slice(2, 320))
    count, driven = len(made.rate), made.driven._replace(coupling=0.0, walking=0.0)
    levels = [Disturbance(1e-4, walk) for walk in (0.0, 1e-6, 1e-2, 1.0, 10.0)] + [Disturbance(white, 0.0) for white in (1e-6, 1.0)]
    (none,) = whitening.whitened_fits(driven, levels[:1])
    distinct = whitening._distinct(none.fit.triangle)
    assert distinct.sum() > 40
    once = np.tril(np.ones((count, count - 1)), -1)
    twice = once @ np.tril(np.ones((count - 1, count - 1)), -1)
    whole = np.column_stack([np.ones(count), once @ made.growth[:, distinct]])
    expected = []
    for white, walk in levels:
        root = np.linalg.cholesky(np.eye(count) + white * once @ once.T + walk * twice @ twice.T)
        columns, measured = np.linalg.solve(root, whole), np.linalg.solve(root, made.rate)
        basis, triangle = np.linalg.qr(columns)  # least squares by singular values would drop what is small beside the largest column
        left = measured - basis @ (basis.T @ measured)
        spare = count - whole.shape[1]
        among = 2 * np.log(np.abs(np.diag(triangle)[1:])).sum() + 2 * np.log(np.diag(root)).sum()
        price = 3 * np.log(count) * ((white > 0) + (walk > 0))
        expected.append((spare * np.log((left**2).sum(0) / spare)).sum() + 3 * among + price)
    found = whitening.by_products(whitening.orthogonal(driven, none.fit.triangle, distinct), levels)
    # columns of which some are nearly sums of others have a condition of 1e8, and products its square: rounding leaves 1e-4 to 0.02
    np.testing.assert_allclose(np.diff(found), np.diff(expected), atol=0.1)
    assert np.argmin(found[:5]) == 0  # no torque walks
    # by a factorisation what stands twice leaves directions of the noise, whose sizes are rounding's: another CPU's kernels give others, up
    # to 85 apart; what tells the levels apart is several times that
    by_factors = [one.cost for one in whitening.whitened_fits(driven, levels, distinct)]
    np.testing.assert_allclose(np.diff(by_factors), np.diff(found), atol=150.0)
    assert np.argmin(by_factors[:5]) == 0


@pytest.mark.skipif(kernel().library is None, reason="no compiled kernel")
@pytest.mark.parametrize("held", [False, True])
def test_the_kernel_makes_white_what_numpy_does(held: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(4)
    rates = whitening.Driven(
        rng.standard_normal((299, 20)), rng.standard_normal((300, 3)), rng.random(300) > 0.02, 1e-3, held, scattered=rng.random(300)
    )
    tried = [Disturbance(1e-3, walk) for walk in (0.0, 1e-6, 1e-2)]
    compiled = whitening._innovations(rates, tried)
    monkeypatch.setattr(whitening, "kernel", lambda: Kernel(None, "none"))
    for one, other in zip(compiled, whitening._innovations(rates, tried), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


def test_commands_that_are_executed_once_make_the_columns_that_they_make_anew() -> None:
    """Of jets that are stronger, then slower too, after those as stated."""
    flown, designs = flight.standard("free"), Designs()
    log, piece, jets = flown.log(), slice(2, 320), flown.used.jets
    stronger = tuple(jet.model_copy(update={"force_n": tuple(1.1 * f for f in jet.force_n)}) for jet in jets)
    slower = tuple(jet.model_copy(update={"rise_s": jet.rise_s + 0.004}) for jet in stronger)
    for own in (jets, stronger, slower):
        vehicle = Resolved.model_construct(**{**dict(flown.resolved), "jets": own})
        kept, anew = designs.of(log, vehicle, DELAY, piece), Designs().of(log, vehicle, DELAY, piece)
        np.testing.assert_array_equal(kept.growth, anew.growth)
        np.testing.assert_array_equal(kept.mean, anew.mean)


def test_a_logs_own_motion_leaves_nothing_but_noise() -> None:
    for kind in ("free", "air_bearing"):
        flown = flight.standard(kind)
        free = channelwise.free_response(Case(flown.log(np.random.default_rng(2)), flown.resolved, DELAY), slice(2, 320))
        ratio = free.variance / np.repeat([1e-4, 0.02], 3) ** 2
        assert 0.75 < ratio.min() < ratio.max() < 1.3


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_a_body_that_turns_far_within_a_cycle_leaves_nothing_but_noise_with_its_own_motion_there(kind: str) -> None:
    """The rate within a cycle is no straight line where jets fire for a part of it: at 0.15 rad a cycle that shows."""
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    flown = flight.fly(flight.vehicle(kind), flight.pulses(320), truth, rate=np.array([1.0, 2.0, 1.2]))
    log = flown.log(np.random.default_rng(2), gyro=2e-6)
    theta = plant_of(flown.used).theta(Reference(tensor(truth[:6]), truth[6:9], 1 / truth[9]))
    plain, about = (channelwise.free_response(Case(log, flown.resolved, DELAY), slice(2, 320), theta=given) for given in (None, theta))
    plainly, exactly = (np.sqrt(free.gyro.left / free.gyro.spare) / 2e-6 for free in (plain, about))
    assert plainly.max() > 5
    assert exactly.max() < 1.3


@pytest.mark.parametrize("scale", [0.1, 0.002])
def test_the_noise_of_rates_is_not_explained_by_what_it_makes_of_the_vertical(scale: float) -> None:
    """Of a balanced body that hardly moves: the vertical within its cycles differs from what a gyro's errors make of it by noise alone."""
    truth, noise = flight.ON_BEARING * np.where(np.isin(np.arange(10), (6, 7, 8)), 0.01, 1.0), 1e-3
    flown = flight.fly(flight.vehicle("air_bearing", jets=flight.jets(scale)), flight.pulses(320), truth)
    theta = plant_of(flown.used).theta(Reference(tensor(truth[:6]), truth[6:9], 1 / truth[9]))
    squares = []
    for seed in range(2, 8):
        case = Case(flown.log(np.random.default_rng(seed), gyro=noise), flown.resolved, DELAY)
        free = channelwise.free_response(case, slice(2, 320), theta=theta)
        squares.append(free.gyro.left / free.gyro.spare / noise**2)
    ratio = np.sqrt(np.mean(squares, 0))
    assert 0.85 < ratio.min() < ratio.max() < 1.15


@pytest.mark.parametrize("kind", ["free", "air_bearing"])
def test_columns_with_a_bodys_own_motion_stand_for_what_those_without_it_do(kind: str) -> None:
    """At a few hundredths of a radian a cycle they differ by little: of the force its level part, of products the motion within."""
    truth = flight.TRUTH if kind == "free" else flight.ON_BEARING
    flown = flight.standard(kind)
    theta = plant_of(flown.used).theta(Reference(tensor(truth[:6]), truth[6:9], 1 / truth[9]))
    log, piece = flown.log(), slice(2, 320)
    plain, about = Designs().of(log, flown.resolved, DELAY, piece), Designs().of(log, flown.resolved, DELAY, piece, theta)
    for name, place in plain.places.items():
        for one, other in ((plain.growth[:, place], about.growth[:, place]), (plain.mean[:, place], about.mean[:, place])):
            assert np.linalg.norm(other - one) <= 0.03 * np.linalg.norm(one), name


def test_the_vertical_moves_as_the_integrated_attitude_does() -> None:
    """Against the attitude of a gyro that has the error in it."""
    flown = flight.standard("air_bearing")
    samples = compensate(flown.aligned(), flown.used)
    moved = dict(verticals_by_errors(samples, flown.used))
    bias = 1e-5
    rate = samples.rate_rad_s + bias * np.array([0.0, 1.0, 0.0])
    (with_bias,) = verticals(rate[None], samples.executed.duration_s, samples.up_b[0])
    # what is integrated is less by the bias than what is measured
    np.testing.assert_allclose(-(with_bias - samples.up_b) / bias, moved["gyro_bias 1"], atol=1e-3 * np.abs(moved["gyro_bias 1"]).max())
    assert np.abs(np.einsum("ki,ki->k", moved["east"], samples.up_b)).max() < 1e-9


def test_too_short_a_log_is_refused() -> None:
    flown = flight.standard("free")
    with pytest.raises(InputError, match="too few for"):
        channelwise.free_response(Case(flown.log(), flown.resolved, DELAY), slice(2, 60))
