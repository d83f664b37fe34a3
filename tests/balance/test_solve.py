"""Moves, swings and refined masses, against sums over point masses, textbook pendulums and a least-squares fit that are made apart."""

from typing import Any

import numpy as np
import pytest

from massprop_cli.balance import solve
from massprop_cli.balance.solve import Hanging
from massprop_cli.base.arrays import Array
from massprop_cli.inputs.ballast import Ballast

GRAVITY = 9.80665


def table(ballast: list[Ballast], moment: Array, sigma: float = 1e-6, inertia: Array | None = None) -> Hanging:
    masses = np.array([one.mass_kg or 0.0 for one in ballast])
    spread = [sigma] * 3 + [one.mass_sigma_kg * one.slides for one in ballast]
    body = np.diag([0.3, 0.4, 0.5]) if inertia is None else inertia
    return Hanging(moment, body, masses, np.diag(np.square(spread)), np.array([0.01, -0.02, 0.03]), GRAVITY, np.array([0.0, 0.0, 1.0]))


def slide(name: str, axis: Any, mass: float = 0.3, room: float = 0.05, **more: Any) -> Ballast:
    stated = {"name": name, "mass_kg": mass, "axis": axis, "position_m": [0.1, 0.2, -0.1], "travel_m": [-room, room], **more}
    return Ballast.model_validate(stated)


def drawn(rng: np.random.Generator) -> list[Ballast]:
    """Two to seven of them, in any direction; some are trays."""
    slides = [
        slide(f"s{n}", rng.normal(size=3).tolist(), float(rng.uniform(0.05, 0.5)), float(rng.uniform(0.01, 0.1)), mass_sigma_kg=1e-3)
        for n in range(int(rng.integers(1, 5)))
    ]
    trays = [
        Ballast.model_validate(
            {"name": f"t{n}", "position_m": rng.uniform(-0.3, 0.3, 3).tolist(), "max_mass_kg": 0.05, "mass_sigma_kg": 1e-4}
        )
        for n in range(int(rng.integers(1, 4)))
    ]
    return [*slides, *trays]


def test_nothing_within_the_bounds_comes_nearer_and_few_ballasts_change() -> None:
    """The gradient of a bounded least-squares problem points out of the bounds (Karush, Kuhn, Tucker); a vertex has three free changes."""
    rng, reached = np.random.default_rng(1), 0
    for _ in range(80):
        ballast = drawn(rng)
        hanging = table(ballast, rng.normal(0, 0.01, 3))
        matrix, room = solve.effects(hanging, ballast), np.array([one.room for one in ballast])
        short = -hanging.moment
        change = solve.changes(matrix, room, short, np.ones(3), np.ones(len(ballast)))
        span = room[:, 1] - room[:, 0]
        low, high = change <= room[:, 0] + 1e-9 * span, change >= room[:, 1] - 1e-9 * span
        assert (change >= room[:, 0] - 1e-12).all()
        assert (change <= room[:, 1] + 1e-12).all()
        left = short - matrix @ change
        slope = (matrix * span).T @ left / np.abs(matrix * span).max()
        assert (np.abs(slope[~low & ~high]) < 1e-7 * np.linalg.norm(short)).all()
        assert (slope[low] < 1e-7 * np.linalg.norm(short)).all()
        assert (slope[high] > -1e-7 * np.linalg.norm(short)).all()
        assert (~low & ~high & (np.abs(change) > 1e-9 * span)).sum() <= 3
        reached += bool(np.linalg.norm(left) < 1e-9)
    assert 8 < reached < 72


def test_of_two_that_could_one_slides_and_no_weight_is_added_where_a_slide_will_do() -> None:
    tray = Ballast.model_validate({"name": "tray", "position_m": [0.21, -0.02, 0.03], "max_mass_kg": 0.2})
    ballast = [slide("long", [1, 0, 0], room=0.2), slide("short", [2, 0, 0], room=0.02), tray]
    hanging = table(ballast, np.array([-0.004, 0.0, 0.0]))
    cost = np.array([1.0, 1.0, solve.ADDING])
    change = solve.changes(solve.effects(hanging, ballast), np.array([one.room for one in ballast]), -hanging.moment, np.ones(3), cost)
    assert change == pytest.approx([0.004 / 0.3, 0.0, 0.0])


def test_a_moved_table_is_the_sum_of_its_points() -> None:
    """Moment and inertia about the pivot of a body and six ballasts, by sums over points before and after."""
    rng = np.random.default_rng(2)
    ballast = drawn(rng) + drawn(rng)
    hanging = table(ballast, rng.normal(0, 0.01, 3))
    change = np.array([rng.uniform(*one.room) for one in ballast])
    moment, inertia = hanging.moment.copy(), hanging.inertia.copy()
    for one, by in zip(ballast, change, strict=True):
        at = np.array(one.position_m) - hanging.pivot
        points = (
            [(by, at)]
            if one.mass_kg is None
            else [(-one.mass_kg, at), (one.mass_kg, at + by * np.array(one.axis) / np.linalg.norm(one.axis or 1))]
        )
        for mass, r in points:
            moment += mass * r
            inertia += mass * (r @ r * np.eye(3) - np.outer(r, r))
    moved = solve.moved(hanging, ballast, change)
    assert moved.moment == pytest.approx(moment, rel=1e-12, abs=1e-15)
    assert moved.inertia == pytest.approx(inertia, rel=1e-12, abs=1e-15)


def test_the_remainder_scatters_as_its_covariance_says() -> None:
    rng = np.random.default_rng(3)
    ballast = [
        slide("x", [1, 0.2, 0], mass_sigma_kg=2e-3, position_sigma_m=2e-4),
        Ballast.model_validate(
            {"name": "t", "position_m": [0.2, 0.1, 0], "max_mass_kg": 1, "mass_sigma_kg": 1e-3, "position_sigma_m": 1e-3}
        ),
    ]
    hanging, change = table(ballast, np.zeros(3), 2e-4), np.array([0.04, 0.2])
    count = 40_000
    mass, at = 0.3 + 2e-3 * rng.normal(size=count), 0.04 + 2e-4 * rng.normal(size=count)
    added, place = 0.2 + 1e-3 * rng.normal(size=count), np.array([0.2, 0.1, 0.0]) - hanging.pivot + 1e-3 * rng.normal(size=(count, 3))
    axis = np.array([1, 0.2, 0]) / np.hypot(1, 0.2)
    # a slide that reads wrongly by this has moved by as much more
    left = 2e-4 * rng.normal(size=(count, 3)) + (mass * at)[:, None] * axis + added[:, None] * place
    moved = solve.moved(hanging, ballast, change)
    assert np.cov(left.T) == pytest.approx(moved.covariance[:3, :3], abs=0.02 * np.trace(moved.covariance[:3, :3]))


def test_a_table_swings_as_a_compound_pendulum() -> None:
    """T = 2π √(I / (m g d)) about each level principal axis; what is above its pivot does not swing."""
    hanging = table([], np.array([0.0, 0.0, -12.0 * 0.002]))
    slow, fast = solve.periods(hanging) or (0, 0)
    assert slow == pytest.approx(2 * np.pi * np.sqrt(0.4 / (12.0 * GRAVITY * 0.002)))
    assert fast == pytest.approx(2 * np.pi * np.sqrt(0.3 / (12.0 * GRAVITY * 0.002)))
    assert solve.below_for(hanging, slow) == pytest.approx(12.0 * 0.002)
    assert solve.periods(table([], np.array([0.001, 0.0, 1e-6]))) is None


@pytest.mark.parametrize("scale_sigma", [0.0, 0.02])
def test_what_moved_is_the_least_squares_fit_of_both_logs(scale_sigma: float) -> None:
    """Unknown κ of the second log, masses and the thrust's error, whitened and stacked: nine or ten equations and their residual."""
    rng = np.random.default_rng(4)
    ballast = [slide("a", [1, 0, 0], mass_sigma_kg=2e-3), slide("b", [0, 1, 1], mass_sigma_kg=1e-3)]
    change, root = np.array([0.03, -0.02]), [np.tril(rng.normal(size=(3, 3))) * 1e-5 for _ in range(2)]
    step = np.column_stack([one.direction * by for one, by in zip(ballast, change, strict=True)])
    kappa = [np.array([2e-3, -4e-3, -0.01]), np.array([1.1e-2, -8e-3, -0.014])]
    both = []
    for moment, own in zip(kappa, root, strict=True):
        hanging = table(ballast, moment)
        spread = hanging.covariance.copy()
        spread[:3, :3] = own @ own.T + scale_sigma**2 * np.outer(moment, moment)
        both.append(Hanging(moment, hanging.inertia, hanging.masses, spread, hanging.pivot, GRAVITY, hanging.up))
    found = solve.compared(both[0], both[1], ballast, change, scale_sigma)
    e = int(scale_sigma > 0)
    first = np.hstack([np.eye(3), -step, -kappa[0][:, None]])[:, : 5 + e]
    second = np.hstack([np.eye(3), np.zeros((3, 2)), -kappa[1][:, None]])[:, : 5 + e]
    prior = np.eye(6)[3 : 5 + e, : 5 + e] / np.array([2e-3, 1e-3, scale_sigma or 1.0])[: 2 + e, None]
    rows = np.vstack([np.linalg.solve(root[0], first), np.linalg.solve(root[1], second), prior])
    seen = np.concatenate(
        [np.linalg.solve(r, k) for r, k in zip(root, kappa, strict=True)] + [np.array([0.3 / 2e-3, 0.3 / 1e-3, 0.0])[: 2 + e]]
    )
    x, residual = np.linalg.lstsq(rows, seen)[:2]
    sigma = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    assert found.chi_square == pytest.approx(residual[0], rel=1e-6)
    assert found.hanging.moment == pytest.approx(x[:3], rel=1e-8)
    assert found.masses == pytest.approx(x[3:5], rel=1e-8)
    assert found.sigmas == pytest.approx(sigma[3:5], rel=1e-6)
    assert found.scale == pytest.approx((1 + x[5], sigma[5]) if e else (1.0, 0.0), rel=1e-6)
