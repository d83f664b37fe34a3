from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import tensor
from massprop_cli.model.layout import Layout
from massprop_cli.model.observability import excitation, observable
from massprop_cli.model.plant import Reference
from tests import flight

BODY = Reference(tensor(flight.TRUTH[:6]), flight.TRUTH[6:9], 1 / flight.TRUTH[9])
TORQUES, FORCES = np.eye(6)[:3], np.eye(6)[3:]


def unobservable(capability: Array, method: str = "default", kind: str = "free") -> set[str]:
    seen = observable(capability, BODY, flight.vehicle(kind, estimator={"method": method}))
    return {name for name, visible in zip(QUANTITIES, seen, strict=True) if not visible}


def test_a_vehicle_that_can_push_and_turn_every_way_shows_everything() -> None:
    for kind in ("free", "air_bearing"):
        for method in ("default", "thesis"):
            assert unobservable(np.eye(6), method, kind) == set()


def test_cg_along_the_only_divert_axis_is_hidden_from_torque_but_not_from_the_accelerometer() -> None:
    """Thesis, simulation 1: with diverts along Y alone cg_y can't be observed; its specific force shows it all the same."""
    along_y = np.vstack([TORQUES, FORCES[1:2]])
    assert unobservable(along_y, "thesis") == {"cg_y"}
    assert unobservable(along_y, "default") == set()


def test_wheels_alone_never_show_the_mass() -> None:
    assert unobservable(TORQUES) == {"mass"}
    assert unobservable(TORQUES, "thesis") == {"mass", "cg_x", "cg_y", "cg_z"}


def test_the_bearings_reaction_shows_all_three_cg_coordinates() -> None:
    assert unobservable(np.vstack([TORQUES, FORCES[:1]]), "thesis", "air_bearing") == set()


def test_a_vehicle_without_actuators_shows_neither_scale() -> None:
    found = unobservable(np.zeros((0, 6)))
    assert {"mass", "ixx", "iyy", "izz"} <= found


@pytest.mark.parametrize("axis", [0, 2])
def test_a_channel_is_drowned_by_an_unmodelled_disturbance_and_by_nothing_else(axis: int) -> None:
    flown = flight.standard("free")
    clean = flown.samples(np.random.default_rng(0))
    share, drowned = excitation(clean, slice(2, 320), BODY, flown.resolved)
    assert not drowned.any()
    np.testing.assert_allclose(share.sum(1), 1, atol=1e-12)
    assert share[0].argmax() == 0  # ixx: mostly from the roll rate
    assert share[9].argmax() >= 3  # mass: from the accelerometer
    wander = np.zeros((320, 3))
    wander[:, axis] = 0.05 * np.cumsum(np.random.default_rng(1).standard_normal(320)) * flight.CYCLE
    moved = flight.Flight(flown.used, flown.on, flown.delta_theta + np.cumsum(wander, 0) * flight.CYCLE, flown.delta_v)
    _, drowned = excitation(moved.samples(np.random.default_rng(0)), slice(2, 320), BODY, flown.resolved)
    assert drowned[axis]


def test_states_are_added_only_where_they_are_asked_for() -> None:
    samples = flight.standard("free").samples()
    assert Layout.of(samples, flight.vehicle()).size == 13
    asked = flight.vehicle(imu={"gyro_bias_sigma_rad_s": 1e-3, "accel_bias_sigma_m_s2": 0.1}, environment={"disturbance_walk_n_m": 0.1})
    assert Layout.of(samples, asked).size == 22
    assert Layout.of(samples, flight.vehicle("air_bearing")).size == 16
