"""What a weighed mass and known inertia make of properties about a pivot."""

import numpy as np
import pytest

from massprop_cli import INERTIA
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import elements, spread
from massprop_cli.estimate.pivot import about_cg
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Parameters
from massprop_cli.inputs.vehicle import Vehicle
from tests import flight

MASS, ARM = 12.0, np.array([0.02, -0.01, -0.58])
CG_INERTIA = elements(np.array([[0.41, 0.01, -0.02], [0.01, 0.37, 0.03], [-0.02, 0.03, 0.44]]))
ABOUT = np.concatenate([CG_INERTIA + MASS * elements(spread(ARM)), MASS * ARM])
"""Hung 0.6 m below a joint."""
ROOT = np.random.default_rng(3).normal(size=(9, 9)) * 1e-5 * np.abs(ABOUT)[:, None]


def hung() -> Vehicle:
    known = {name: {"value": float(value), "sigma": 0.004} for name, value in zip(INERTIA, CG_INERTIA, strict=True)}
    return flight.vehicle(
        environment={"kind": "pedestal", "bearing_position_m": [0.0, 0.0, 0.6]}, known={**known, "mass": {"value": MASS, "sigma": 0.005}}
    )


def told(factor: float) -> tuple[Array, Array]:
    """(1, 10) state parameters and covariance of a swing that is fitted about a body ``factor`` times as large: it tells ratios alone."""
    about = factor * ABOUT
    covariance = factor**2 * (ROOT @ ROOT.T) + 1e4 * np.outer(about, about)
    mean, by_mass = np.append(about, 1 / MASS), np.ones(10)
    mean[6:9], by_mass[6:9] = np.array([0.0, 0.0, 0.6]) + about[6:] / MASS, 1 / MASS
    whole = np.zeros((10, 10))
    whole[:9, :9] = covariance * np.outer(by_mass[:9], by_mass[:9])
    return mean[None], whole[None]


@pytest.mark.parametrize("factor", [0.01, 0.06, 30.0])
def test_what_a_swing_tells_of_ratios_is_as_certain_about_a_body_of_any_size(factor: float) -> None:
    """A body hung from a joint was fitted about one of a twentieth of its size, and its sigmas were those of that."""
    expected, found = (quantities(Parameters(*told(size), np.zeros((1, 3))), hung()) for size in (1.0, factor))
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-4)
    np.testing.assert_allclose(np.diag(found[1][0]), np.diag(expected[1][0]), rtol=0.02)
    np.testing.assert_array_equal(found[1][0], found[1][0].T)
    truth = np.concatenate([CG_INERTIA, np.array([0.0, 0.0, 0.6]) + ARM, [MASS]])
    assert (np.abs(found[0][0] - truth) < 0.1 * np.sqrt(np.diag(found[1][0]))).all()


def test_where_a_body_swings_alike_about_two_points_of_a_line_its_sigmas_reach_both() -> None:
    """Kater's pendulum: without the moment along the line I = s a − s² b has two solutions, and known to a tenth it hardly tells which."""
    known = {name: one.value for name, one in hung().known.items() if name != "mass"}
    faint: dict[str, object] = {name: {"value": value, "sigma": 0.2 if name == "izz" else 0.05} for name, value in known.items()}
    found = about_cg(
        *told(1.0), hung().model_copy(update={"known": flight.vehicle(known={**faint, "mass": {"value": MASS, "sigma": 0.005}}).known})
    )
    certain = about_cg(*told(1.0), hung())
    assert certain.by_mass[0][8, 8] < 1e-6
    assert np.sqrt(found.by_mass[0][8, 8]) > 0.1
