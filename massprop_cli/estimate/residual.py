"""Post-fit residuals: measured rate and specific force less those predicted from the commands and the final values."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from massprop_cli.base import spill
from massprop_cli.base.arrays import Array
from massprop_cli.estimate.innovations import sequential_innovations
from massprop_cli.estimate.nuisance import Whitened
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.triangle import Run
from massprop_cli.model.plant import Reference


class Residual(NamedTuple):
    """Residuals of K cycles: rate [rad/s] and specific force [m/s²], body axes; NaN where there is no prediction or no reading."""

    value: Array
    """(K, 6) measured minus predicted."""
    sigma: Array
    """(K, 6) predicted sigma."""

    @staticmethod
    def empty(count: int) -> Residual:
        """Uninitialised residuals of ``count`` cycles."""
        return Residual(spill.empty(count, 6), spill.empty(count, 6))


def coefficients(regression: Regression, reference: Reference) -> Array:
    """(N,) φ of a reference; Φ is the reference's own where it has one."""
    phi_map = regression.phi_map
    phi, _ = phi_map.coefficients(phi_map.plant.theta(reference))
    if reference.response is not None:
        phi[: 3 * phi_map.plant.channels] = reference.response.ravel()
    return phi


def residual(regression: Regression, before: Run, whitened: Whitened, phi: Array) -> Residual:
    """Residuals of a block processed after ``before``, with the coefficients ``phi`` (N,).

    For a known φ, ``w + W φ = E b + white noise`` depends on the initial states b alone: rate, biases, tilt. Each cycle is predicted with
    the b that the cycles before it give. Without process noise, the prediction is the motion that the commands cause from the phase's
    start. Wrong mass properties then show as a growing residual.
    """
    phi_map, unknowns = regression.phi_map, regression.unknowns
    end = unknowns + phi_map.size
    rows = regression.ordered(whitened).reshape(*whitened.innovations.shape[:2], -1)
    triangle, block = (
        np.concatenate([part[..., :unknowns], (part[..., end] - part[..., unknowns:end] @ phi)[..., None]], -1)
        for part in (before.triangle[:unknowns], rows)
    )
    innovations, spread = sequential_innovations(triangle, block)
    # the logged attitude follows the first six
    innovations, spread, root = innovations[:, :6], spread[:, :6, :6], whitened.root[:, :6, :6]
    value = np.einsum("kij,kj->ki", root, innovations)
    sigma = np.sqrt(((root @ spread) ** 2).sum(2))
    if before.state is None:
        value[0], sigma[0] = np.nan, np.nan
    ignored = regression.samples.part(slice(before.at, before.at + len(block))).executed.ignored
    value[ignored], sigma[ignored] = np.nan, np.nan
    return Residual(value, sigma)
