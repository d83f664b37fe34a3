"""What a cause is called, where its numbers say that it is another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.errorparameters.parameter import FittedHypothesis
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.table import BY_NAME, ENTRIES, words_of
from massprop_cli.prepare.timing import Timing
from tests import flight


def finding(**errors: np.ndarray) -> FittedHypothesis:
    """Of errors, zero where none are given."""
    flown = flight.standard()
    setup = Setup(flown.log(), flown.used, Timing(2.0, 0.0))
    none = {name: np.zeros(BY_NAME[name].size) for name in ENTRIES}
    eye = np.eye(3)
    return FittedHypothesis((), (), none | errors, none, setup, setup, eye, (eye, eye), (eye, eye), 0.1, np.zeros(3))


def said(mass: float, inertia: float) -> str:
    return words_of("fuel-use", finding(mass_rate=np.array([mass]), inertia_rate=np.array([inertia])))[1]


@pytest.mark.parametrize(("mass", "inertia"), [(-0.05, -0.002), (-0.2, 0.004)])
def test_what_grows_lighter_uses_fuel(mass: float, inertia: float) -> None:
    assert said(mass, inertia).endswith("from the first to the last cycle; state [drift]")


@pytest.mark.parametrize(("mass", "inertia"), [(0.06, 0.05), (0.0, 0.05)])
def test_what_seems_to_grow_heavier_has_thrust_that_falls(mass: float, inertia: float) -> None:
    assert "more likely the thrust falls, like the pressure of a tank that empties" in said(mass, inertia)


@pytest.mark.parametrize(
    ("sensor", "errors", "words"),
    [
        ((), ("gyro_turn", "accel_turn"), "imu.body_from_imu is "),
        (("gyro",), ("gyro_turn",), "only the gyro's axes are tilted, by 5.73 degrees; calibrate the gyro"),
        (("accelerometer",), ("accel_turn",), "only the accelerometer's axes are tilted, by 5.73 degrees; calibrate the accelerometer"),
    ],
)
def test_a_turn_is_of_the_imu_or_of_one_sensor(sensor: tuple[str, ...], errors: tuple[str, ...], words: str) -> None:
    found = finding(**dict.fromkeys(errors, np.array([0.1, 0.0, 0.0])))
    assert words_of("imu-mounting", replace(found, subject=sensor))[1].startswith(words)


def test_a_ramp_says_what_a_valve_does_and_what_each_pulse_gives() -> None:
    cycle_s = flight.standard().used.cycle.period_s
    late = words_of("thrust-rise", finding(rise=np.array([0.1])))[1]
    assert late.startswith(f"thrust takes {200 * cycle_s:.3g} ms longer to rise than rise_s states")
    assert late.endswith("later: each pulse gives less impulse; correct it")
    assert words_of("thrust-rise", finding(rise=np.array([0.1]), fall=np.array([0.1])))[1].endswith(
        "than rise_s and fall_s state; correct them"
    )
    both = words_of("thrust-rise", finding(rise=np.array([0.1]), fall=np.array([0.05])))[1]
    assert f"{200 * cycle_s:.3g} ms longer to rise than rise_s states, and {100 * cycle_s:.3g} ms longer to fall than fall_s states" in both


def test_a_commanded_component_has_the_scale_of_its_column_as_its_remedy() -> None:
    """Where the vehicle file has no jets, too."""
    found = finding(thrust=np.array([0.0, 0.25]))
    commanded = found.stated._replace(
        log=replace(found.stated.log, command_kind="wrench"), vehicle=found.stated.vehicle.model_copy(update={"jets": ()})
    )
    found = replace(found, subject=("ty",), names=("tx", "ty"), stated=commanded, corrected=commanded)
    code, words = words_of("thrust-scale", found)
    assert code == "thrust-scale"
    assert words == "ty gives +1.25 times the stated thrust, unlike the others; correct the scale under [columns]"


@pytest.mark.parametrize(("subject", "words"), [((), "gyro reads 1.0101 "), (("y",), "gyro's y axis reads 1.0513 ")])
def test_a_scale_is_that_of_the_axes_that_it_is_said_of(subject: tuple[str, ...], words: str) -> None:
    """Of two hypotheses about one sensor, each says its own."""
    found = replace(finding(gyro_scale=np.array([0.01, 0.05, 0.01])), subject=subject)
    assert f"the {words}" in words_of("gyro-scale", found)[1]
