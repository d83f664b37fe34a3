"""Attitude control by a body: the law that its gains make, what an offset CG does without and with it, and what a bad one is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.testbed import simulate
from massprop_cli.testbed.conditions import Control
from massprop_cli.testbed.onboard import gains
from massprop_cli.testbed.scenario import Scenario, ScenarioSource
from tests import flight

FREQUENCY, DAMPING = 0.4, 0.7
INERTIA, CG_Y = np.array([0.9, 2.7, 2.4]), 0.1
BODY = {"ixx": 0.9, "iyy": 2.7, "izz": 2.4, "cg_y": CG_Y, "mass": 22.0}
CYCLES = 400
HOLD = {"motion": "hold", "start_cycle": 0, "end_cycle": CYCLES}
PUSH = {"motion": "steady", "axes": ["x"], "force_n": 0.5, "start_cycle": 0, "end_cycle": CYCLES}


def still(delay: float, **changes: Any) -> ScenarioSource:
    """Perfect sensors."""
    return ScenarioSource(
        Scenario.model_validate(
            {
                "schema": 1,
                "duration_cycles": CYCLES,
                "vehicle": flight.vehicle("free", delay, nominal={"ixx": 0.9, "iyy": 2.7, "izz": 2.4}),
                "truth": BODY,
                "sensors": {"gyro_noise_rad_s": 0.0, "accel_noise_m_s2": 0.0},
                "plan": [HOLD],
                "control": by("truth"),
            }
            | changes
        ),
        "still",
    )


def by(model: str) -> dict[str, Any]:
    return {"model": model, "natural_frequency_rad_s": FREQUENCY, "damping": DAMPING}


def angles(flown: simulate.SimulatedFlight) -> Array:
    """(K N + 1, 3) small angles from the start, rad."""
    return 2 * flown.attitude_wxyz[0, :, 1:]


def test_gains_make_each_axis_the_oscillator_that_is_asked_for() -> None:
    """Roots of I s² + D s + K/2, half since the law takes sin of half the angle."""
    values = np.array([[3.0, 0.1, 0.2, 14.0, 0.3, 15.0, 0.4, -0.1, 0.05, 52.0]])
    own = gains(Control.model_validate(by("truth")), values)
    for inertia, rate, attitude in zip(values[0, [0, 3, 5]], own.rate[:, 0], own.attitude[:, 0], strict=True):
        roots = np.roots([inertia, rate, attitude / 2])
        assert np.allclose(np.abs(roots), FREQUENCY, rtol=1e-12)
        assert np.allclose(-roots.real / np.abs(roots), DAMPING, rtol=1e-12)
    assert own.cg[:, 0] == pytest.approx(values[0, 6:9])


def test_a_known_body_flies_as_the_analytic_gains_do_to_the_last_bit() -> None:
    body = {name: value for name, value in BODY.items() if name != "cg_y"}
    stated = {
        "inertia_kg_m2": INERTIA.tolist(),
        "rate_gain_n_m_s": (2 * DAMPING * FREQUENCY * INERTIA).tolist(),
        "attitude_gain_n_m": (2 * FREQUENCY**2 * INERTIA).tolist(),
    }
    plan = [motion | {"end_cycle": 100} for motion in (HOLD, PUSH)]
    turning = {"duration_cycles": 100, "truth": body, "initial": {"rate_rad_s": [0.02, -0.03, 0.01]}, "plan": plan}
    flights = [simulate.fly(still(1.0, control=control, **turning), [1]) for control in (stated, by("truth"), by("nominal"))]
    for other in flights[1:]:
        assert np.array_equal(flights[0].issued, other.issued)
        assert np.array_equal(flights[0].delta_theta_rad, other.delta_theta_rad)
    assert flights[0].modelled.shape == (1, 0, 10)
    assert (flights[1].modelled[0] == flights[1].truth[0, 0]).all()


def test_a_disturbed_vehicle_swings_as_that_oscillator() -> None:
    """Rates from 10 mrad/s: θ = ω₀ exp(−ζ w t) sin(w_d t) / w_d, later by the control's half cycle and its differenced rate."""
    flown = simulate.fly(still(0.0, initial={"rate_rad_s": [0.01, 0.01, 0.01]}, truth={**BODY, "cg_y": 0.0}), [1])
    time = np.arange(CYCLES + 1) * flight.CYCLE
    damped = FREQUENCY * np.sqrt(1 - DAMPING**2)
    expected = 0.01 * np.exp(-DAMPING * FREQUENCY * time) * np.sin(damped * time) / damped
    assert np.abs(angles(flown) - expected[:, None]).max() < 0.04 * expected.max()


def test_an_offset_push_is_met_by_its_torque_where_the_cg_is_known_and_by_an_angle_where_not() -> None:
    """Without: the angle at which K/2 of it is c × F = −c_y F about Z. With: none but what a cycle's pulse swings."""
    unknown, known = (angles(simulate.fly(still(1.0, control=by(model), plan=[HOLD, PUSH]), [1])) for model in ("nominal", "truth"))
    settled = CG_Y * 0.5 / (FREQUENCY**2 * INERTIA[2])
    assert unknown[-1, 2] == pytest.approx(settled, rel=0.01)
    assert np.abs(known).max() < 0.01 * settled


def test_the_truth_is_that_of_the_moment() -> None:
    docks = {"docked": {"ixx": 1.0, "iyy": 1.0, "izz": 1.0, "mass": 5.0, "cg_x": 0.5}, "events": [{"kind": "dock", "cycle": 60}]}
    flown = simulate.fly(still(1.0, duration_cycles=120, plan=[HOLD | {"end_cycle": 120}], **docks), [1, 2])
    assert (flown.modelled[:, :60] == np.array([BODY.get(name, 0.0) for name in QUANTITIES])).all()
    assert (flown.modelled[:, 60:] == flown.truth[:, -1:]).all()


@pytest.mark.parametrize(
    ("control", "said"),
    [
        ({"model": "estimate"}, "give damping and natural_frequency_rad_s"),
        ({"rate_gain_n_m_s": [1.0, 1.0, 1.0]}, "without a model gains are stated: give attitude_gain_n_m"),
        (by("truth") | {"rate_gain_n_m_s": [1.0, 1.0, 1.0]}, 'rate_gain_n_m_s has no meaning beside model = "truth"; drop it'),
        (
            {"rate_gain_n_m_s": [1.0] * 3, "attitude_gain_n_m": [1.0] * 3, "damping": 0.7},
            "damping belongs to a model; drop it, or give model",
        ),
        (by("guess"), "'nominal', 'estimate' or 'truth'"),
        (by("truth") | {"damping": 0.0}, "greater than"),
    ],
)
def test_control_that_is_not_whole_says_what_to_do(control: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        Control.model_validate(control)


def test_a_model_wants_a_nominal_body_and_free_flight() -> None:
    bare = flight.vehicle("free", 1.0)
    for model in ("nominal", "estimate"):
        with pytest.raises(ValidationError, match=f'"{model}" begins with the nominal body: give vehicle.nominal.ixx'):
            still(1.0, vehicle=bare, control=by(model))
    assert still(1.0, vehicle=bare, control=by("truth"))
    with pytest.raises(ValidationError, match=r"control\.model is for free flight"):
        still(1.0, vehicle=flight.vehicle("air_bearing", 1.0), truth=BODY | {"mass": 25.0})


def test_an_estimate_wants_an_estimator() -> None:
    with pytest.raises(InputError, match=r'still: control.model = "estimate" needs an estimator aboard; use massprop simulate'):
        simulate.fly(still(1.0, control=by("estimate")), [1])
