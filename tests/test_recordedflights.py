"""Flights of a real quadrotor, of which no model explains everything, beside what the literature knows of its type."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import job
from massprop_cli.combine import flow
from massprop_cli.flow import Analysis
from massprop_cli.result import build
from massprop_cli.result.read import Recorded
from tests.combine.test_incommon import campaign
from tests.recording import SAMPLES

pytestmark = [pytest.mark.thorough, pytest.mark.seeds]
LITERATURE = {"ixx": 1.66e-5, "iyy": 1.67e-5, "izz": 2.93e-5, "mass": 0.0319}
"""kg m², kg."""


@cache
def flight(name: str, *assignments: str) -> Analysis:
    """What is found in it."""
    return job.of_file(SAMPLES / "crazyflie" / f"{name}.parquet", None, assignments).analysis


def test_settings_given_back_reproduce_the_fit() -> None:
    """Also where a first pass found disturbances: what it found stands in the settings, and is then no discrepancy any more."""
    first = build.result(flight("yaw"))
    assert first.provenance.settings["environment.disturbance_walk_n_m"]
    again = build.result(flight("yaw", *(f"{key}={json.dumps(value)}" for key, value in first.provenance.settings.items())))
    for one, other in zip(again.phases, first.phases, strict=True):
        assert one.innovations == other.innovations
    assert again.provenance.settings == first.provenance.settings


def test_each_agrees_with_what_is_known_of_the_vehicle() -> None:
    """Nothing that was not moved is converged."""
    yaw, thrust, roll_pitch = (flight(name).conclusions[0].estimates for name in ("yaw", "thrust", "roll-pitch"))
    for estimates, name, sigmas, percent in (
        (yaw, "mass", 2.0, 10),
        (thrust, "mass", 2.5, 15),
        (roll_pitch, "mass", 2.5, 15),
        (roll_pitch, "ixx", 2.5, 25),
        (roll_pitch, "iyy", 2.5, 25),
    ):
        value, sigma = estimates[name].value, estimates[name].sigma
        assert value is not None
        assert sigma is not None
        assert abs(value - LITERATURE[name]) < sigmas * sigma
        assert 0.02 < sigma / LITERATURE[name] < percent / 100
    assert roll_pitch["izz"].verdict == yaw["izz"].verdict == "not_excited"
    for name in ("ixx", "iyy", "izz", "ixy", "cg_z"):
        assert thrust[name].verdict == "not_excited"
    assert "disturbance-torque" in [notice.code for notice in flight("roll-pitch").notices]


def test_nominal_values_never_enter_anything() -> None:
    without, beside = flight("yaw"), flight("yaw", "nominal.mass=1.0", "nominal.ixx=1.0", "nominal.izz=3e-6")
    assert without.vehicle.nominal.ixx is None
    assert without.notices == beside.notices
    for one, other in zip(without.histories, beside.histories, strict=True):
        np.testing.assert_array_equal(one.values, other.values)
        np.testing.assert_array_equal(one.sigmas, other.sigmas)


def test_all_together_are_no_better_than_the_thrust() -> None:
    """Each tells its own axes, and doubts its thrust by 3 to 8 %; what it shows of its jets is the same in all.

    No body fits all: they are added as they are, with what each doubts in its sigmas.
    """
    flights = [Recorded(Path(f"/{name}/result.json"), build.result(flight(name)), {}) for name in ("roll-pitch", "thrust", "yaw")]
    mean = campaign(flights, scale_sigma=0.05)["mass"]
    assert mean.logs == 3
    assert mean.value is not None
    assert mean.sigma is not None
    assert mean.shared is not None
    assert abs(mean.value - LITERATURE["mass"]) < 2 * mean.sigma
    assert mean.shared > 0.05 * mean.value
    assert mean.sigma < 0.15 * mean.value
    assert np.sqrt(mean.sigma**2 - mean.shared**2) < 0.02 * mean.value, "noise and what nothing explains average out"
    assert (mean.p_value or 0.0) > 1e-3

    combined = flow.together(flights).phases[0].estimates
    assert not [name for name, item in combined.items() if item.verdict == "contradicted"]
    for name, literature in LITERATURE.items():
        value, sigma = combined[name].value, combined[name].sigma
        assert value is not None
        assert sigma is not None
        assert abs(value - literature) < 2 * sigma
    assert (combined["ixx"].sigma or 1.0) < (flight("roll-pitch").conclusions[0].estimates["ixx"].sigma or 0.0), "the best single flight's"
