"""What acts on the body, against the equation of motion of the whole about the bearing, which plant.py does not use."""

from __future__ import annotations

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import cross_matrix, lever_arm, tensor, times
from massprop_cli.model.plant import BearingBody, FreeBody, Motion, Reference

CG = np.array([0.012, -0.02, 0.03])
MU = 1 / 25.0
INERTIA = tensor(np.array([0.62, 0.04, -0.07, 2.8, 0.11, 2.5]))
BODY = Reference(INERTIA, CG, MU)


def motion(rate_dot: Array | None = None) -> Motion:
    """Fast, tilted, pushed hard: every term matters."""
    rng = np.random.default_rng(2)
    up = rng.normal(0, 1, (3, 4, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    wrench, rate, guess = rng.normal(0, 2, (3, 4, 6)), rng.normal(0, 1, (3, 4, 3)), rng.normal(0, 2, (3, 4, 3))
    return Motion(wrench, rate, guess if rate_dot is None else rate_dot, up, np.zeros_like(rate))


def force_at_centre(plant: FreeBody | BearingBody, moving: Motion) -> Array:
    """(K, B, 3) specific force: of a free body's CG F/m; of a bearing, that slides level under body and base, with gravity."""
    force = moving.wrench[..., 3:]
    if isinstance(plant, FreeBody):
        return MU * force
    level = np.eye(3) - moving.up[..., :, None] * moving.up[..., None, :]
    swung = (1 / MU - plant.bearing_mass) * lever_arm(moving.rate, moving.rate_dot, CG - plant.bearing)
    found: Array = times(level, MU * (force - swung)) + plant.gravity * moving.up
    return found


def test_on_a_bearing_base_and_body_share_the_momentum_that_the_jets_give() -> None:
    """Body and base together: level forces are the jets' alone, and the vertical one holds the weight."""
    plant = BearingBody(np.array([0.005, 0.01, -0.004]), 5.0, 9.80665)
    moving = motion()
    rotating, offset = 20.0, CG - plant.bearing
    force = force_at_centre(plant, moving)
    level = np.eye(3) - moving.up[..., :, None] * moving.up[..., None, :]
    at_bearing = times(level, force)  # acceleration: gravity is vertical
    at_cg = at_bearing + lever_arm(moving.rate, moving.rate_dot, offset)
    whole = rotating * times(level, at_cg) + plant.bearing_mass * at_bearing
    np.testing.assert_allclose(whole, times(level, moving.wrench[..., 3:]), atol=1e-12)
    np.testing.assert_allclose((force * moving.up).sum(-1), plant.gravity, rtol=1e-12)


def moment_about_cg(plant: FreeBody | BearingBody, moving: Motion) -> Array:
    """(K, B, 3) jets' and bearing's together, the bearing's force from the acceleration of the CG."""
    moment = times(np.hstack([np.eye(3), -cross_matrix(CG)]), moving.wrench)
    if isinstance(plant, FreeBody):
        return moment
    rotating = 1 / MU - plant.bearing_mass
    felt = force_at_centre(plant, moving) + lever_arm(moving.rate, moving.rate_dot, CG - plant.bearing)
    reaction = rotating * felt - moving.wrench[..., 3:]
    found: Array = moment + np.cross(plant.bearing - CG, reaction)
    return found


def test_a_free_body_turns_about_its_cg() -> None:
    moving, plant = motion(), FreeBody()
    np.testing.assert_allclose(
        times(plant.jet_moment(BODY), moving.wrench), moving.wrench[..., :3] - np.cross(CG, moving.wrench[..., 3:]), rtol=1e-14
    )
