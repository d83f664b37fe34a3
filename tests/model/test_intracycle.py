"""The vertical within a cycle of a body that turns fast, by rotations that scipy makes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from massprop_cli.model.intracycle import _rotated


def test_the_vertical_turns_as_a_rotation_turns_it() -> None:
    """To 12 micrometres a metre, where a body turns by 15 degrees a cycle; to second order 3 mm."""
    rng = np.random.default_rng(1)
    up = Rotation.random(7, random_state=1).apply([0.0, 0.0, 1.0])
    angle = rng.normal(size=(7, 5, 3))
    angle *= np.radians(15) / np.linalg.norm(angle, axis=2, keepdims=True)
    found = _rotated(up, angle)
    for k in range(7):
        for b in range(5):
            np.testing.assert_allclose(found[k, b], Rotation.from_rotvec(angle[k, b]).inv().apply(up[k]), atol=1.2e-5)
