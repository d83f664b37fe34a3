"""What wheels hold and give, out of either column of a log."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.prepare.align import align
from tests.flown import fly

SHORT = ("duration_s=5", 'plan=[{motion="random", axes=["roll", "pitch", "yaw"], start_s=0, end_s=5}]')


def test_both_columns_tell_the_same_momentum() -> None:
    """A torque's holds the wheel's turning with the body, ``J a · ω``, which a speed's leaves to the body: with friction, to 1e-6 N m s."""
    friction = ("vehicle.wheels.0.viscous_friction_n_m_s=1e-4", "vehicle.wheels.1.coulomb_friction_n_m=0.005")
    found = {}
    for column in ("speed", "torque"):
        flown = fly("wheels", *SHORT, *friction, *(f"vehicle.wheels.{i}.column={column}" for i in range(3)))
        stored = align(flown.log(0), flown.vehicle, 2.0, 0.0).stored
        assert stored is not None
        found[column] = stored.mean.mean(1)
    rate = flown.rate_rad_s[0]
    axis = np.array([wheel.direction for wheel in flown.vehicle.wheels])
    own = 2e-3 * ((rate[1:] + rate[:-1]) / 2) @ axis.T
    apart = found["torque"] - found["speed"] - own
    assert np.abs(apart[3:]).max() < 1e-5
    assert np.abs(own).max() > 1e-4


@pytest.mark.parametrize("viscous", [0.0, 2e-5])
def test_friction_turns_with_the_speed_and_holds_a_wheel_that_rests(viscous: float) -> None:
    """Against steps of a ten-thousandth of each time; a friction that was taken once a cycle missed what reversals within it do."""
    wheel = Wheel.model_validate(
        {"name": "w", "axis": (1.0, 0.0, 0.0), "spin_inertia_kg_m2": 1e-3, "locked_in_inertia": True, "column": "torque"}
        | {"coulomb_friction_n_m": 1e-3, "viscous_friction_n_m_s": viscous}
    )
    rng, reversed_or_held = np.random.default_rng(0), 0
    for _ in range(20):
        begun, pulled, length_s = float(0.1 * rng.normal()), float(2 * rng.normal()), float(rng.uniform(0.02, 0.3))
        speed, step_s = begun, length_s / 10_000
        for _ in range(10_000):
            then = speed + step_s * (pulled - np.sign(speed or pulled * (abs(pulled) > 1)) - viscous / 1e-3 * speed)
            speed = 0.0 if then * speed < 0 or (speed == 0 and abs(pulled) <= 1) else then
        reversed_or_held += speed * begun <= 0
        assert wheel.rubbed(begun, pulled, length_s) == pytest.approx(speed, abs=1e-4)
    assert reversed_or_held > 5


def test_the_torque_on_a_wheel_is_its_momentums_growth_and_the_body_feels_the_opposite() -> None:
    flown = fly("wheels", *SHORT)
    aligned = align(flown.log(0), flown.vehicle, 2.0, 0.0)
    stored, speed = aligned.stored, np.stack([speed[0] for speed in flown.turning.values()], 1)
    assert stored is not None
    assert not aligned.usable[:2].any()  # before the first speed nothing is known, nor before the first command executes
    assert np.abs(aligned.channels.whole[1:] - 2e-3 * np.diff(speed, axis=0)).max() < 1e-12
    assert np.abs(stored.mean.mean(1)[1:] - 2e-3 * (speed[1:] + speed[:-1]) / 2).max() < 1e-12
    axis = np.array([wheel.direction for wheel in flown.vehicle.wheels])
    assert np.abs(aligned.whole[:, :3] + aligned.channels.whole @ axis).max() < 1e-12
    assert not aligned.whole[:, 3:].any()


def test_any_part_of_a_log_holds_what_the_whole_holds() -> None:
    for name in ("wheels", "wheels-and-jets"):
        flown = fly(name, "duration_s=4", "plan=[]", "vehicle.wheels.0.viscous_friction_n_m_s=1e-4")
        whole, part = align(flown.log(0), flown.vehicle, 2.0, 0.0), align(flown.log(0), flown.vehicle, 2.0, 0.0, slice(30, 60))
        assert whole.stored is not None
        assert part.stored is not None
        assert np.abs(whole.stored.mean[30:60] - part.stored.mean).max() < 1e-12
        assert np.abs(whole.rising[30:60] - part.rising).max() < 1e-14
