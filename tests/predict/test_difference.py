"""The test itself, on pairs of results that are drawn from known covariances."""

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.predict.difference import compared
from massprop_cli.result.schema import PhaseItem, VehicleInfo
from tests import recorded

BODY = np.array([2.0, 0.05, -0.1, 3.0, 0.08, 2.5, 0.02, -0.01, 0.03, 40.0])
NOISE = np.diag((np.abs(BODY) * 1e-4) ** 2) + 1e-9 * np.outer(BODY, BODY)
"""Of a log by itself."""


def vehicle(scale_sigma: float = 0.0) -> VehicleInfo:
    return recorded.result().vehicle.model_copy(update={"thrust_scale_sigma": scale_sigma})


def phase(values: Array, covariance: Array, known: dict[str, tuple[float, float]] | None = None) -> PhaseItem:
    items = {
        name: {"value": value if np.isfinite(value) else None, "sigma": float(np.sqrt(variance))}
        for name, value, variance in zip(QUANTITIES, values.tolist(), np.diag(covariance), strict=True)
    }
    told = np.isfinite(values)
    matrix = np.where(told[:, None] & told, covariance, np.nan).astype(object)
    matrix[~(told[:, None] & told)] = None
    return PhaseItem.model_validate(recorded.phase("all", **items) | {"covariance": matrix.tolist(), "known": known or {}})


def weighed(values: Array, covariance: Array, mass: float, sigma: float) -> tuple[Array, Array]:
    """Conditioned on the mass: the textbook's Kalman update."""
    gain = covariance[:, 9] / (covariance[9, 9] + sigma**2)
    return values + gain * (mass - values[9]), covariance - np.outer(gain, covariance[9])


def drawn(rng: np.random.Generator, scale: float, weighs: float | None, both: bool) -> tuple[float, int]:
    """Chi-square of a pair with the thrust wrong by one draw for both, and a weighed mass wrong by one draw for one or both."""
    turned = np.where(np.isin(np.arange(10), [6, 7, 8]), 0.0, 1.0)
    kappa, error = scale * rng.normal(), (weighs or 0.0) * rng.normal()
    sides = []
    for number in range(2):
        noise = (1.0, 2.5)[number] * NOISE
        values: Array = BODY + np.linalg.cholesky(noise) @ rng.normal(size=10) - kappa * turned * BODY
        along, known = turned * values, {}
        covariance: Array = noise + scale**2 * np.outer(along, along)
        if weighs is not None and (both or number == 0):
            known = {"mass": (BODY[9] + error, weighs)}
            values, covariance = weighed(values, covariance, BODY[9] + error, weighs)
        sides.append((vehicle(scale), phase(values, covariance, known)))
    found = compared(sides[0], sides[1])
    return found.chi_square, found.freedom


@pytest.mark.parametrize(
    ("scale", "weighs", "both"),
    [
        (0.02, None, False),
        (0.02, 0.01, True),
        *(
            pytest.param(*one, marks=pytest.mark.thorough)
            for one in ((0.0, None, False), (0.02, 0.01, False), (0.0, 0.001, True), (0.0, 0.001, False))
        ),
    ],
)
def test_chi_square_has_its_degrees_of_freedom(scale: float, weighs: float | None, both: bool) -> None:
    """What both share is in neither's favour: mean and variance are those of a chi-square, whatever is shared."""
    rng = np.random.default_rng(5)
    found = np.array([drawn(rng, scale, weighs, both) for _ in range(400)])
    assert (found[:, 1] >= (9 if both else 10)).all()  # a mass that is weighed once for both is hardly told by either
    assert (found[:, 0] - found[:, 1]).mean() == pytest.approx(0, abs=4 * np.sqrt(20 / 400))
    assert found[:, 0].var() == pytest.approx(20, rel=0.3)


def test_what_both_assume_alike_counts_for_nothing() -> None:
    """Where neither log tells the mass, it is that which both assume, with the very same error."""
    covariance = NOISE.copy()
    covariance[9], covariance[:, 9] = 0.0, 0.0
    covariance[9, 9] = 0.04**2
    sides = [(vehicle(), phase(BODY, covariance, {"mass": (40.0, 0.04)})) for _ in range(2)]
    found = compared(sides[0], sides[1])
    assert found.freedom == 9
    assert found.sigma[9] == pytest.approx(0.0, abs=1e-9)
    assert found.chi_square == 0.0


def test_what_one_alone_gives_is_not_tested() -> None:
    """A log without some of the inertia is tested in the rest of it."""
    partly = BODY.copy()
    partly[[1, 2, 9]] = np.nan
    found = compared((vehicle(), phase(BODY, NOISE)), (vehicle(), phase(partly, NOISE)))
    assert found.freedom == 7
    assert found.chi_square == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(found.difference[[1, 2, 9]]).all()
