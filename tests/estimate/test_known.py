"""What is known from elsewhere, against the log and against matter."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from massprop_cli import CG, INERTIA, QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.conclude.contradict import known_value_contradiction
from massprop_cli.estimate.history import History
from massprop_cli.estimate.known import DENSEST, contradicted_values, heaviest_body
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.vehicle import Phase
from tests import flight

MEAN = np.append(flight.TRUTH[:9], 1 / flight.TRUTH[9])


def of(relative: float) -> Array:
    """A covariance in which 1/m has this relative sigma, and all else is known well."""
    return np.diag(np.append(1e-3 * np.ones(9), relative * MEAN[9]) ** 2)


def test_no_body_has_less_inertia_than_a_ball_of_the_densest_matter() -> None:
    """Oracle: the ball's radius from its mass, and 2/5 m R² thrice for the trace."""
    bound = heaviest_body(Parameters.of(MEAN[None], 1e-12 * of(0.01)[None]), flight.vehicle())
    radius = (bound / (4 / 3 * np.pi * DENSEST)) ** (1 / 3)
    assert 3 * 2 / 5 * bound * radius**2 == pytest.approx(MEAN[0] + MEAN[3] + MEAN[5], rel=1e-6)


@pytest.mark.parametrize(
    ("mass", "relative", "wrong"),
    [(22.0, 0.01, False), (30.0, 0.01, True), (22.0, 2.0, False), (200.0, 2.0, False), (1e25, 2.0, True), (1e-3, 2.0, True)],
)
def test_a_known_mass_must_be_that_of_a_body_even_where_the_log_does_not_tell_it(mass: float, relative: float, wrong: bool) -> None:
    """Where 1/m is known to 200 % alone, 22 to 200 kg are as good as each other; 1 g and 1e25 kg are not."""
    vehicle = flight.vehicle(known={"mass": {"value": mass, "sigma": 1e-4 * mass}})
    against, notices = contradicted_values(Parameters.of(MEAN[None], of(relative)[None]), vehicle, "all")
    assert [*against] == ["mass"] * wrong
    assert [notice.code for notice in notices] == ["known-mismatch"] * wrong
    assert all(f"known.mass = {mass:g}" in notice.message for notice in notices)


def test_what_is_stated_to_drift_is_known_when_its_phase_begins() -> None:
    """Weighed to 1 g, then for 100 s a walk of 0.02 kg per root second: 0.2 kg by the end, and what doesn't drift as it was."""
    known = {"mass": {"value": 22.0, "sigma": 1e-3}, "cg_x": {"value": 0.01, "sigma": 1e-4}}
    vehicle = flight.vehicle(known=known, drift={"mass": 0.02})
    during = vehicle.in_phase(Phase(name="all", start_s=20.0, end_s=120.0)).known
    assert during["mass"].sigma == pytest.approx(np.hypot(1e-3, 0.2))
    assert (during["mass"].value, during["cg_x"].sigma) == (22.0, 1e-4)


@pytest.mark.parametrize(("kind", "offset"), [("free", False), ("air_bearing", True), ("pedestal", True)])
def test_a_wrong_known_mass_leaves_no_cg_on_a_bearing(kind: str, offset: bool) -> None:
    """Gravity tells mass times offset there; in free flight torque over force tells the CG, whatever the mass."""
    none = np.zeros(10)
    said = {"mass": "phase all: known.mass = 30 is 9 sigmas from the estimate of the log alone"}
    history = SimpleNamespace(contradicted=said, values=none[None], sigmas=none[None] + 1, bare=(none, np.eye(10)))
    found = known_value_contradiction(cast("History", history), flight.vehicle(environment={"kind": kind}))
    assert found is not None
    assert [bool(found.affected[QUANTITIES.index(name)]) for name in CG] == [offset] * 3
    assert all(found.affected[QUANTITIES.index(name)] for name in (*INERTIA, "mass"))
