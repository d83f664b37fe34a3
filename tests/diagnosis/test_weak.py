"""Logs in which hardly anything shows: no cause is named where nothing is wrong."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from massprop_cli.testbed import scenario, simulate
from tests import faulty
from tests.diagnosis.test_screening import look_of

THOROUGH = pytest.mark.thorough
SCENARIOS = json.loads((Path(__file__).parent.parent / "data" / "weak.json").read_text())
"""``untold``, ``unbalanced``: on a bearing, where the vertical hardly moves, so that regression finds a CG metres away. ``no mass``: the
accelerometer's noise wants a mass below none. ``feedback``: with no delay, and commanded by what the noise of the gyro makes the controller
do. ``torque``: a white torque is stated, beside which the rates walk by no more than the gyro's noise, but slowly."""


def each(*thorough: str) -> pytest.MarkDecorator:
    """Each of these logs."""
    return pytest.mark.parametrize("name", [pytest.param(name, marks=THOROUGH if name in thorough else ()) for name in SCENARIOS])


@cache
def flown(name: str) -> simulate.SimulatedFlight:
    data = SCENARIOS[name]
    source = scenario.ScenarioSource(scenario.Scenario.model_validate(data), name)
    return simulate.fly(source, [data["seed"]])


@pytest.mark.seeds
@pytest.mark.thorough
@each("unbalanced")
def test_what_a_clean_log_leaves_of_the_free_coefficients_is_chance(name: str) -> None:
    """It was 2 to 20,000 times pure error, and more where the CG is untold; a turned IMU, a jet or a steady torque explained it."""
    screening = look_of(flown(name).log(0), flown(name).vehicle)
    assert screening.misfit < 1 + 6 * np.sqrt(2 / screening.degrees_of_freedom)


@pytest.mark.seeds
@pytest.mark.thorough
@each("unbalanced", "untold")
def test_no_cause_is_named(name: str) -> None:
    assert faulty.examined(flown(name).log(0), flown(name).vehicle).notices == ()
