"""Post-fit residuals: measured rate and specific force less those predicted from the commands and the final values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.estimate.innovationsahead import unexpected
from massprop_cli.estimate.nuisance import Taken, ordered
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.triangle import Run
from massprop_cli.model.plant import Reference


class Residual(NamedTuple):
    """Of K cycles: rate x y z [rad/s], specific force x y z [m/s²], body axes. NaN where nothing was expected, or measured."""

    value: Array
    """(K, 6) measured less predicted."""
    sigma: Array
    """(K, 6) one standard deviation that is expected of it."""

    @staticmethod
    def empty(count: int) -> Residual:
        """Of so many cycles, whose numbers are anything yet."""
        return Residual(spill.empty(count, 6), spill.empty(count, 6))


def coefficients(regression: Regression, reference: Reference) -> Array:
    """(N,) φ of a reference."""
    phi_map = regression.phi_map
    phi, _ = phi_map.coefficients(phi_map.plant.theta(reference))
    if reference.response is not None:
        phi[: 3 * phi_map.plant.channels] = reference.response.ravel()
    return phi


def residual(regression: Regression, before: Run, taken: Taken, phi: Array) -> Residual:
    """Of a block that was taken in after ``before``, by the coefficients ``phi`` (N,).

    With the coefficients φ known, ``w + W φ = E b + white noise`` in the unknown beginnings b alone: first rate, biases, tilt. Each cycle
    is predicted with b as the cycles before it tell it. So where nothing disturbs the body, the prediction is the motion that the commands
    cause from the phase's first moment on, and a wrong value shows as a growing gap.
    """
    phi_map, free = regression.phi_map, regression.free
    known = before.triangle[:free], ordered(taken.white, phi_map.size, free).reshape(*taken.white.shape[:2], -1)
    triangle, each = (
        np.concatenate([rows[..., :free], (rows[..., free + phi_map.size] - rows[..., free : free + phi_map.size] @ phi)[..., None]], -1)
        for rows in known
    )
    left, spread = unexpected(triangle, each)
    left, spread, root = left[:, :6], spread[:, :6, :6], taken.root[:, :6, :6]  # without a logged attitude, which comes after them
    value = np.einsum("kij,kj->ki", root, left)
    sigma = np.sqrt(((root @ spread) ** 2).sum(2))
    if before.state is None:
        value[0], sigma[0] = np.nan, np.nan
    ignored = regression.samples.part(slice(before.at, before.at + len(each))).executed.ignored
    value[ignored], sigma[ignored] = np.nan, np.nan
    return Residual(value, sigma)
