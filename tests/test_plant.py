"""What acts on the body: derivatives against differences, both environments."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.arrays import Array
from massprop_cli.dynamics import lever_arm, tensor
from massprop_cli.plant import BearingBody, FreeBody, Motion, Plant, Reference

CG = np.array([0.012, -0.02, 0.03])
MU = 1 / 25.0
INERTIA = tensor(np.array([0.62, 0.04, -0.07, 2.8, 0.11, 2.5]))


def motion() -> Motion:
    """Fast, tilted, pushed hard: every term matters. The motion is given, whatever the body."""
    rng = np.random.default_rng(2)
    up = rng.normal(0, 1, (3, 4, 3))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    return Motion(rng.normal(0, 2, (3, 4, 6)), rng.normal(0, 1, (3, 4, 3)), rng.normal(0, 2, (3, 4, 3)), up)


def moment(plant: Plant, cg: Array, mu: float) -> Array:
    reference, moving = Reference(INERTIA, cg, mu), motion()
    direct: Array = np.einsum("ij,kbj->kbi", plant.jet_moment(reference), moving.wrench)
    return direct + plant.reaction_moment(reference, moving)


def felt(plant: Plant, cg: Array, mu: float) -> Array:
    """Specific force at O."""
    reference, moving = Reference(INERTIA, cg, mu), motion()
    force, _ = plant.force(reference, moving)
    return force + lever_arm(moving.rate, moving.rate_dot, -plant.centre(reference))


@pytest.mark.parametrize("plant", [FreeBody(), BearingBody(np.array([0.005, 0.01, -0.004]), 5.0, 9.80665)], ids=["free", "air_bearing"])
def test_slopes_of_moment_and_specific_force_are_those_of_differences(plant: Plant) -> None:
    reference = Reference(INERTIA, CG, MU)
    slopes = plant.moment_slopes(reference, motion()), plant.force(reference, motion())[1]
    for function, slope in zip((moment, felt), slopes, strict=True):
        for i in range(3):
            step = 1e-6 * np.eye(3)[i]
            difference = (function(plant, CG + step, MU) - function(plant, CG - step, MU)) / 2e-6
            np.testing.assert_allclose(slope[..., i], difference, rtol=0, atol=1e-7 * np.abs(slope).max())
        difference = (function(plant, CG, MU + 1e-7) - function(plant, CG, MU - 1e-7)) / 2e-7
        np.testing.assert_allclose(slope[..., 3], difference, rtol=0, atol=1e-6 * np.abs(slope).max())
