"""Initial bodies of hypothesis fits, by plain regression of motion on commands."""

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array, BoolArray
from massprop_cli.base.rigidbody import cross_matrix
from massprop_cli.diagnosis.coefficients import Model
from massprop_cli.diagnosis.hypothesis import Hypothesis
from massprop_cli.diagnosis.kernelfits import PackedTriangles
from massprop_cli.diagnosis.precession import PER_AXIS
from massprop_cli.estimate.whitening import ReducedLeastSquares

LEAST, FARTHEST = 0.03, 0.3
"""Limits of an initial body: least over largest principal response; CG offset over √(trace I / m)."""


def initial_bodies(
    model: Model,
    sensors: tuple[ReducedLeastSquares, ReducedLeastSquares],
    regressed: dict[tuple[object, ...], Array],
    packed: PackedTriangles | None,
    hypotheses: Sequence[Hypothesis],
    trusting: bool = False,
) -> tuple[Array, Array]:
    """(H, nx) initial x, and (H, 10) sizes of θ, by the kernel if ``packed``, else in NumPy.

    Suspected channels have free responses, unless ``trusting``. ``regressed`` is a cache.
    """
    x = np.repeat(model.stated[None], len(hypotheses), 0)
    for row, one in zip(x, hypotheses, strict=True):
        for entry, value in one.initial_values.items():
            row[entry] = value
    keys = [(sensors[0].triangle.shape[1], one.initial_items, () if trusting else one.suspects) for one in hypotheses]
    new = {key: i for i, key in enumerate(keys) if key not in regressed}
    if new:
        suspects = np.zeros((len(new), len(model.force)), np.uint8)
        for row, (_, _, suspected) in zip(suspects, new, strict=True):
            row[list(suspected)] = 1
        which = list(new.values())
        new_regressions = _regressions(model, sensors, x[which], suspects != 0) if packed is None else packed.regressed(x[which], suspects)
        regressed.update(zip(new, new_regressions, strict=True))
    regressions_of = np.array([regressed[key] for key in keys])
    return _bodies(model, x, hypotheses, regressions_of) if packed is None else packed.initial(x, regressions_of)


def _bodies(model: Model, x: Array, hypotheses: Sequence[Hypothesis], regressions: Array) -> tuple[Array, Array]:
    """Complete x by initial bodies from regressions; also return the sizes of θ."""
    response, force_response = regressions[:, :6].swapaxes(1, 2), regressions[:, 6:].swapaxes(1, 2)
    turns = [
        model.mounting @ (np.exp(x[:, model.place(f"{name}_scale")])[:, :, None] * model.mounting.T) @ np.stack(base)
        for name, base in (("gyro", [one.gyro for one in hypotheses]), ("accel", [one.accelerometer for one in hypotheses]))
    ]
    rate_response = np.linalg.solve(turns[0], response)
    principal, axes = np.linalg.eigh((rate_response[..., :3] + rate_response[..., :3].swapaxes(1, 2)) / 2)
    top = np.maximum(np.abs(principal).max(1), 1e-12)
    inverse = (axes * np.maximum(principal, LEAST * top[:, None])[:, None]) @ axes.swapaxes(1, 2)
    lever = np.linalg.solve(inverse, rate_response[..., 3:])
    vector = -np.stack([lever[:, i, j] - lever[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1) / 2
    mean_mu = np.trace(np.linalg.solve(turns[1], force_response), axis1=1, axis2=2) / 3
    mu = np.maximum(np.maximum(mean_mu, LEAST * np.abs(force_response).max((1, 2))), 1e-9)
    size = np.sqrt(np.trace(np.linalg.inv(inverse), axis1=1, axis2=2) * mu)
    if model.bearing is not None:  # first moment instead of the CG
        vector, size = vector / model.gravity, size / mu
    length = np.maximum(np.linalg.norm(vector, axis=1), 1e-12)
    moment = vector * np.minimum(1.0, FARTHEST * size / length)[:, None]
    x[:, :10] = np.concatenate([inverse[:, *np.triu_indices(3)], moment, mu[:, None]], 1)
    return x, np.concatenate([np.repeat(top[:, None], 6, 1), np.repeat(size[:, None], 3, 1), mu[:, None]], 1)


def _regressions(model: Model, sensors: tuple[ReducedLeastSquares, ReducedLeastSquares], x: Array, suspects: BoolArray) -> Array:
    """(N, 9, 3) regressions for x (N, nx), with free responses of ``suspects`` (N, C)."""
    return np.stack([_regression(model, sensors, *each) for each in zip(x, suspects, strict=True)])


def _regression(model: Model, sensors: tuple[ReducedLeastSquares, ReducedLeastSquares], x: Array, suspects: BoolArray) -> Array:
    """(9, 3): growth of the rate by unit torques, and by forces or the vertical; specific force by unit forces; each (3, 3)."""
    (gyro, accelerometer), unit = sensors, np.eye(sensors[0].triangle.shape[1])
    torque, force = model.wrench(x)
    centre = np.zeros(3) if model.bearing is None else model.bearing
    channels, products = unit[model.places["channels"]], unit[model.places["products"]]
    about = torque - np.cross(centre, force)
    precession = (
        unit[model.places["precession"]].reshape(-1, PER_AXIS, len(unit))[:, :3]
        if "precession" in model.places
        else unit[:0].reshape(0, 3, len(unit))
    )
    by_torque, by_force = about.T @ channels, force.T @ channels
    for column, axis in zip(precession[~suspects[model.thrusting :]], about[model.thrusting :][~suspects[model.thrusting :]], strict=True):
        by_torque = by_torque - cross_matrix(axis) @ column
    gravity = unit[model.places["up"]] if model.bearing is not None else unit[:0]
    force_or_weight = gravity if model.bearing is not None else by_force
    suspected = [channels[suspects], *precession[suspects[model.thrusting :]]]
    others = [*suspected, products]
    known = ~(np.concatenate(suspected) != 0).any(0)
    growth = _regressed(gyro, known, [by_torque, force_or_weight], others)[:6]
    return np.concatenate([growth, _regressed(accelerometer, known, [by_force, by_torque], [*others, gravity])[:3]])


def _regressed(sensor: ReducedLeastSquares, known: BoolArray, sums: Sequence[Array], others: Sequence[Array]) -> Array:
    """Coefficients (…, 3) of sums over the ``known`` columns, and of other combinations; without dependent ones.

    A column within rounding of its parts, or a combination of those before it, has coefficient 0.
    """
    sizes = np.linalg.norm(sensor.triangle, axis=0)
    least = [np.full(len(part), np.linalg.norm(part * sizes)) for part in sums]
    least += [np.linalg.norm(sensor.triangle @ part.T, axis=0) for part in others]
    columns = sensor.triangle @ np.concatenate([*(part * known for part in sums), *others]).T
    basis, kept = np.zeros((len(columns), 0)), []
    for i, (column_now, whole) in enumerate(zip(columns.T, np.concatenate(least), strict=True)):
        remainder = column_now - basis @ (basis.T @ column_now)
        remainder -= basis @ (basis.T @ remainder)
        size = float(np.linalg.norm(remainder))
        if size > ROUNDING * whole:
            basis = np.column_stack([basis, remainder / size])
            kept.append(i)
    coefficients = np.zeros((columns.shape[1], 3))
    coefficients[kept] = np.linalg.solve(basis.T @ columns[:, kept], basis.T @ sensor.measured)
    return coefficients
