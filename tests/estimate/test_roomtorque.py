"""A steady torque that stands still in the room, against motion that is integrated apart (tests/anypedestal.py)."""

import numpy as np
import pytest

from massprop_cli import ABOUT_PIVOT, flow
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.verdict import Conclusion
from massprop_cli.flow import Analysis
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anypedestal


def _flown(seed: int, kind: anypedestal.Kind, part: float) -> tuple[anypedestal.Tables, anypedestal.Flown, Array]:
    """Two tables, and a torque of such a ``part`` of what brings their largest moment of inertia to 1 rad/s within 1 s."""
    rng = np.random.default_rng(seed)
    own = anypedestal.tables(rng, 2)
    along = rng.normal(size=(2, 3))
    room = part * own.about_pivot[:, 0, 0, None] * along / np.linalg.norm(along, axis=1, keepdims=True)
    return own, anypedestal.fly(rng, own, kind, 0.05, 30.0, room=room), room


def _examined(own: anypedestal.Tables, body: int, flown: anypedestal.Flown, room: Array | None, noise: float) -> Analysis:
    used = anypedestal.vehicle_of(own, body, flown, mass={"value": float(own.mass[body]), "sigma": 1e-3 * float(own.mass[body])})
    if room is not None:
        environment = {**used.environment.model_dump(), "room_torque_n_m": tuple(room[body])}
        used = Vehicle.model_validate({**used.model_dump(exclude_unset=True), "environment": environment})
    log = anypedestal.log_of(np.random.default_rng(body), own, body, flown, used, noise)
    return flow.examine(log, VehicleSource(used, "", ""))


def _deviations(own: anypedestal.Tables, body: int, conclusion: Conclusion) -> Array:
    about = conclusion.about_pivot
    values, sigmas = (np.array([getattr(about[name], part) for name in ABOUT_PIVOT]) for part in ("value", "sigma"))
    found: Array = (values - own.nine[body]) / sigmas
    return found


@pytest.mark.parametrize(
    "kind", [pytest.param("jets", marks=[pytest.mark.thorough, pytest.mark.seeds]), pytest.param("wheels", marks=pytest.mark.thorough)]
)
def test_without_noise_a_stated_torque_leaves_nothing(kind: anypedestal.Kind) -> None:
    own, flown, room = _flown(3, kind, 0.003)
    for body in range(2):
        found = _examined(own, body, flown, room, 0.0)
        assert np.abs(_deviations(own, body, found.conclusions[0])).max() < 0.1
        assert not found.faults


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize("kind", ["jets", "wheels"])
def test_an_unstated_torque_is_named_and_its_remedy_is_right(kind: anypedestal.Kind) -> None:
    own, flown, _ = _flown(5, kind, 0.01)
    for body in range(2):
        found = _examined(own, body, flown, None, 1.0)
        assert [fault.notice.code for fault in found.faults] == ["room-torque"]
        (answer,) = found.mended
        assert np.abs(_deviations(own, body, answer.conclusions[0])).max() < 4
