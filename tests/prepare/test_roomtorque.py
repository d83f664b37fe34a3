"""What a torque that stands still in the room does to a body that turns, against quadrature."""

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import quaternion_of, quaternion_product
from massprop_cli.prepare.compensate import with_torque
from massprop_cli.prepare.timing import Timing
from tests.flown import fly

TORQUE = np.array([0.02, -0.01, 0.015])


def _in_body(turn: Array, begun: Array, share: Array) -> Array:
    """(n, 3) after parts ``share`` (n,) of a turn, by Rodrigues' rotation: of the room's axes the other way round."""
    angle = np.linalg.norm(turn)
    axis = -turn / angle
    sine, cosine = np.sin(angle * share)[:, None], np.cos(angle * share)[:, None]
    found: Array = begun * cosine + np.cross(axis, begun) * sine + axis * (axis @ begun) * (1 - cosine)
    return found


@pytest.mark.thorough
@pytest.mark.parametrize(("angle", "most"), [(0.05, 1e-6), (0.3, 3e-4)])
def test_a_torque_that_stands_still_is_integrated_in_axes_that_turn(angle: float, most: float) -> None:
    """Every cycle by itself: an even turn of some length, another one in each; rising, falling and whole impulses, and those of bins."""
    flown = fly("free-flyer")
    aligned = Timing(0.0, 0.0).of(flown.log(0), flown.vehicle).executed.part(slice(10, 16))
    rng = np.random.default_rng(1)
    turns = rng.normal(size=(6, 3))
    turns *= angle / np.linalg.norm(turns, axis=1, keepdims=True)
    attitude = [quaternion_of(rng.normal(size=3))]
    for turn in turns:
        attitude.append(quaternion_product(attitude[-1], quaternion_of(turn)))
    found, mean = with_torque(aligned, np.array(attitude), TORQUE)
    bins = aligned.impulse_bins.shape[1]
    edge = np.linspace(0, 1, 400 * bins + 1)
    share, part_s = (edge[1:] + edge[:-1]) / 2, aligned.duration_s / (400 * bins)
    for k, turn in enumerate(turns):
        w, v = attitude[k][0], attitude[k][1:]
        begun = TORQUE + 2 * np.cross(-v, np.cross(-v, TORQUE) + w * TORQUE)
        acts = _in_body(turn, begun, share) * part_s[k]
        size = float(np.abs(acts).sum())
        for name, weight in (("rising", share), ("falling", 1 - share), ("whole", np.ones_like(share))):
            added = getattr(found, name)[k, :3] - getattr(aligned, name)[k, :3]
            np.testing.assert_allclose(added, weight @ acts, atol=most * size)
        np.testing.assert_allclose(mean[k] * aligned.duration_s[k], acts.sum(0), atol=most * size)
        each = (found.impulse_bins - aligned.impulse_bins)[k, :, :3]
        np.testing.assert_allclose(each, acts.reshape(bins, -1, 3).sum(1), atol=most * size)
        middle = (share.reshape(bins, -1) - (np.arange(bins)[:, None] + 0.5) / bins) * bins
        late = (found.skew_bins - aligned.skew_bins)[k, :, :3]
        np.testing.assert_allclose(late, (middle[..., None] * acts.reshape(bins, -1, 3)).sum(1), atol=most * size)
