"""Sigmas that include what the model doesn't explain: against dense likelihoods, against the estimator itself, and against truth."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.arrays import Array, frozen, triangle_of
from massprop_cli.base.rigidbody import MOMENTS
from massprop_cli.conclude.discrepancy import PlainFits
from massprop_cli.conclude.discrepancy import discrepancy as told_of
from massprop_cli.diagnosis.preprocessing import ready
from massprop_cli.estimate import discrepancy, offline
from massprop_cli.estimate.phases import as_stated
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.flow import Analysis
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.model.geometry import WrenchChanges, channel_changes
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from tests import faulty
from tests.flown import RANDOM, fly

USUAL = {"thrust": 0.05, "position": 0.005, "direction": float(np.radians(1))}


def drawn(seed: int, s: float, noise: float, columns: int = 40, rows: int = 200) -> tuple[Array, Array]:
    """Columns and what was measured, of errors of size s beside noise."""
    rng = np.random.default_rng(seed)
    design = rng.standard_normal((rows, columns)) * np.geomspace(20.0, 0.05, columns)
    return design, design @ (s * rng.standard_normal(columns)) + noise * rng.standard_normal(rows)


@pytest.mark.parametrize(("s", "noise"), [(0.0, 1.0), (0.5, 1.0), (2.0, 1.0), (1.0, 3.0)])
def test_scale_and_noise_are_where_the_likelihood_of_all_measurements_is_largest(s: float, noise: float) -> None:
    """Of a dense covariance σ² 1 + s² A Aᵀ, by its eigenvectors, on a grid of its own."""
    for seed in range(4):
        design, measured = drawn(seed, s, noise)
        found = discrepancy._likeliest(triangle_of(np.column_stack([design, measured])), len(measured))

        own, axes = np.linalg.eigh(design @ design.T)
        along = (measured @ axes) ** 2

        def cost(scale: float, sigma: float, own: Array = own, along: Array = along) -> float:
            variances = sigma**2 + scale**2 * own
            return float((np.log(variances) + along / variances).sum())

        least = min(cost(scale, sigma) for scale in np.append(0.0, np.geomspace(0.02, 20, 40)) for sigma in np.geomspace(1, 8, 40))
        assert cost(*found) < least + 0.5


def test_what_stands_out_is_freed_and_nothing_else() -> None:
    for seed in range(6):
        design, measured = drawn(seed, 0.0, 1.0)
        corner = triangle_of(np.column_stack([design, measured]))
        assert discrepancy._scales(corner, len(measured))[2] == []
        corner = triangle_of(np.column_stack([design, measured + 8 * design[:, 20]]))
        assert discrepancy._scales(corner, len(measured))[2] == [20]


@cache
def flown() -> tuple[Log, Vehicle]:
    flight = fly("free-flyer", *RANDOM, seeds=(11,))
    return flight.log(0), flight.vehicle


def test_errors_of_jets_are_what_the_estimator_finds_where_they_are_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    """With s = 1 and no scatter it is the estimate beside uncertain jets: these are unknowns of the regression there."""
    log, vehicle = flown()
    begun = ready(log, VehicleSource(vehicle, "", ""), lambda *_: None)
    plain = as_stated(begun.samples, begun.phases, begun.stated, begun.consider)
    (phase, cycles), fit = begun.phases[0], plain.fits[0]
    assert fit is not None
    assert fit.history.reference is not None
    pushes = channel_changes(vehicle.jets, vehicle.jet_wrench, USUAL)
    monkeypatch.setattr(discrepancy, "_scales", lambda *_: (1.0, 1.0, []))
    own, open_ended = plain.used.in_phase(phase), np.full(len(pushes.channels), -np.inf)
    found = discrepancy.error_fit(
        begun.samples, cycles, fit.history.reference, own, Consider(pushes=pushes), np.ones(len(pushes.channels)), open_ended
    )
    sigmas = {"thrust_sigma": USUAL["thrust"], "position_sigma_m": USUAL["position"], "direction_sigma_rad": USUAL["direction"]}
    stated = faulty.stated(vehicle, *(f"jets.{i}.{key}={size}" for i in range(len(vehicle.jets)) for key, size in sigmas.items()))
    other = ready(log, VehicleSource(stated, "", ""), lambda *_: None)
    beside = offline.fit(other.samples, cycles, phase, fit.history.reference, _noisy(own, stated), other.consider, passes=1).history
    covariance = found.covariance - _scattered(found)
    own_sigmas = np.sqrt(np.diag(covariance))
    values, full = quantities(Parameters(found.mean[None], covariance[None], (own_sigmas / found.mean)[None, MOMENTS]), own)
    np.testing.assert_allclose(np.sqrt(np.diag(full[0])), beside.sigmas[-1], rtol=0.02)
    assert (np.abs(values[0] - beside.values[-1]) < 0.1 * beside.sigmas[-1]).all()


def test_an_error_beyond_what_is_physical_is_none() -> None:
    """As if it had never been a column; one in the range changes nothing."""
    log, vehicle = flown()
    begun = ready(log, VehicleSource(faulty.pushing(vehicle, {vehicle.jets[0].name: 1.2}), "", ""), lambda *_: None)
    plain = as_stated(begun.samples, begun.phases, begun.stated, begun.consider)
    fit = plain.fits[0]
    assert fit is not None
    assert fit.history.reference is not None
    pushes = channel_changes(vehicle.jets, vehicle.jet_wrench, {"thrust": USUAL["thrust"], "position": 0.0, "direction": 0.0})
    others = WrenchChanges(pushes.channels[1:], pushes.wrench[1:], pushes.kinds[1:])
    own, reference, cycles = plain.used.in_phase(begun.phases[0][0]), fit.history.reference, begun.phases[0][1]

    def fitted(changes: WrenchChanges, least: float) -> discrepancy.ErrorFit:
        usual, bounds = np.ones(len(changes.channels)), np.full(len(changes.channels), -np.inf)
        bounds[0] = least
        return discrepancy.error_fit(begun.samples, cycles, reference, own, Consider(pushes=changes), usual, bounds)

    whole, bounded, without = fitted(pushes, -np.inf), fitted(pushes, 0.0), fitted(others, -np.inf)
    assert whole.errors[0] == pytest.approx(-(1 - 1 / 1.2) / USUAL["thrust"], rel=0.1)
    np.testing.assert_allclose(fitted(pushes, whole.errors[0]).mean, whole.mean, rtol=1e-12)
    np.testing.assert_allclose(bounded.errors[1:], without.errors, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(bounded.mean, without.mean, rtol=1e-9)


def _noisy(used: Resolved, stated: Vehicle) -> Resolved:
    return used.model_copy(update={"jets": stated.jets})


def _scattered(found: discrepancy.ErrorFit) -> Array:
    """Its diagonal alone is asked for."""
    return np.diag(found.scatter)


def examined(log: Log, vehicle: Vehicle) -> Analysis:
    return flow.examine(log, VehicleSource(vehicle, "", ""))


def test_a_log_that_fits_has_the_sigmas_of_its_noise() -> None:
    assert examined(*flown()).discrepancies == (None,)


def growing(log: Log, vehicle: Vehicle) -> tuple[Log, Vehicle]:
    """All thrust grows by a quarter over the log, beside what is logged, and is stated right in the mean."""
    part = np.linspace(1.0, 0.8, log.cycles)[:, None]
    mean = float((log.command * part).sum() / log.command.sum())
    keys = [f"jets.{i}.force_n={[x / mean for x in jet.force_n]}" for i, jet in enumerate(vehicle.jets)]
    return replace(log, command=frozen(log.command * part)), faulty.stated(vehicle, *keys)


@pytest.mark.seeds
@pytest.mark.thorough
def test_thrust_that_grows_is_what_the_log_behaves_like() -> None:
    found = examined(*growing(*flown()))
    (told,) = found.discrepancies
    assert told is not None
    (percent,) = (float(said.split(": ")[1].removesuffix(" %")) for said in told.behaves_like if said.startswith("change of all thrust"))
    assert 18 < percent < 28
    assert found.notices[0].code == "model-discrepancy"
    assert "others may do the same" in found.notices[0].message


@pytest.mark.seeds
@pytest.mark.thorough
def test_errors_are_found_with_their_sign_and_size() -> None:
    """Each by itself, IMU axes turned by a quarter about Z; a jet's beside the one that fires with it."""
    log, vehicle = flown()
    lasting, turn, push = log.interval_s[:, None], log.delta_theta_imu_rad, log.delta_v_imu_m_s
    weak = f"jets.0.force_n={[x / 0.9 for x in vehicle.jets[0].force_n]}"
    for name, expected, wrong in (
        ("scale of the gyro along each of its axes (X)", 3.0, (replace(log, delta_theta_imu_rad=turn * np.array([1.03, 1, 1])), vehicle)),
        ("bias of the gyro (Z)", 0.01, (replace(log, delta_theta_imu_rad=turn + np.array([0, 0, 0.01]) * lasting), vehicle)),
        ("bias of the accelerometer (Y)", 0.05, (replace(log, delta_v_imu_m_s=push + np.array([0.05, 0, 0]) * lasting), vehicle)),
        ("thrust (roll_p1)", -10.0, (log, faulty.stated(vehicle, weak))),
    ):
        begun = ready(wrong[0], VehicleSource(wrong[1], "", ""), lambda *_: None)
        plain = as_stated(begun.samples, begun.phases, begun.stated, begun.consider)
        assert plain.fits[0] is not None
        history = plain.fits[0].history
        fits = PlainFits(plain.used, (history.reference,), begun.consider, plain.left)
        found = told_of(begun.samples, begun.timing, plain.used, history, fits, 0)
        assert found is not None
        (said,) = found.behaves_like
        assert said.startswith(f"{name}: ")
        assert float(said.split(": ")[1].split()[0]) == pytest.approx(expected, rel=0.4)


def beyond(log: Log, rng: np.random.Generator) -> list[Log]:
    """Logs with something that no error parameter describes."""
    steps = np.repeat(rng.uniform(0.85, 1.0, 8), -(-log.cycles // 8))[: log.cycles, None]
    scatter = np.clip(0.95 + 0.02 * rng.standard_normal(log.command.shape), 0.6, 1.0)
    some = np.isin(np.arange(log.cycles), rng.choice(log.cycles, log.cycles // 40, replace=False))[:, None]
    rate = log.delta_theta_imu_rad
    crossed = rate + 0.02 * np.roll(rate, 1, axis=1)
    commands = [log.command * part / (log.command * part).sum() * log.command.sum() for part in (steps, scatter)]
    return [
        *(replace(log, command=frozen(np.minimum(one, 0.05))) for one in commands),
        replace(log, command=frozen(np.where(some, 0.0, log.command))),
        replace(log, delta_theta_imu_rad=frozen(crossed)),
    ]


@pytest.mark.seeds
@pytest.mark.thorough
def test_sigmas_cover_what_nobody_foresaw() -> None:
    """Four logs; of commands that are lost values are too large by that part, which is 2.5 %."""
    off, wide = list[Array](), 0
    flight = fly("free-flyer", *RANDOM, seeds=(21,))
    for log in beyond(flight.log(0), np.random.default_rng(21)):
        found = examined(log, flight.vehicle)
        conclusion = found.conclusions[0]
        wide += found.discrepancies[0] is not None
        off.append(np.abs(conclusion.values - flight.truth[0][-1]) / conclusion.sigmas)
    z = np.concatenate(off)
    z = z[np.isfinite(z)]
    assert wide >= 2
    assert (z < 1.96).mean() > 0.9
    assert (z > 4).mean() < 0.02


@pytest.mark.parametrize("part", [0.9, 0.3])
def test_an_error_is_held_against_what_may_physically_be(part: float) -> None:
    """A jet of 90 % is a third of a prior sigma off; one of 30 % is beyond two, which refutes what is stated, however small all else is."""
    log, vehicle = flown()
    stated = faulty.stated(vehicle, f"jets.12.force_n={[x / part for x in vehicle.jets[12].force_n]}")
    begun = ready(log, VehicleSource(stated, "", ""), lambda *_: None)
    plain = as_stated(begun.samples, begun.phases, begun.stated, begun.consider)
    (fit,) = plain.fits
    assert fit is not None
    fits = PlainFits(plain.used, (fit.history.reference,), begun.consider, plain.left)
    told = told_of(begun.samples, begun.timing, plain.used, fit.history, fits, 0)
    assert told is not None
    assert told.scale < discrepancy.MOST
    assert any(said.startswith("thrust (divert_xp)") for said in told.behaves_like)
    assert told.largest_impulse_error == pytest.approx(1 / 3, rel=0.5) or part < 0.5  # far from what is stated it is no longer linear
    assert told.refuted is (part < 0.5)
