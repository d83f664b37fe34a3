"""Initial bodies of the fits of hypotheses, by plain regression of motion on commands."""

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
"""A body to begin with: its least principal response over the largest, and its CG's offset over √(trace I / m)."""


def begun(
    model: Model,
    told: tuple[ReducedLeastSquares, ReducedLeastSquares],
    regressed: dict[tuple[object, ...], Array],
    posed: PackedTriangles | None,
    supposed: Sequence[Hypothesis],
    trusting: bool = False,
) -> tuple[Array, Array]:
    """(H, nx) x, and (H, 10) the sizes of θ, of hypotheses as they are ``posed`` to the kernel; None: in NumPy.

    Suspected channels have a response of their own but for one who is ``trusting`` them. ``regressed`` remembers what was found.
    """
    x = np.repeat(model.stated[None], len(supposed), 0)
    for own, one in zip(x, supposed, strict=True):
        for entry, value in one.start.items():
            own[entry] = value
    keys = [(told[0].triangle.shape[1], one.begins, () if trusting else one.suspects) for one in supposed]
    new = {key: i for i, key in enumerate(keys) if key not in regressed}
    if new:
        suspects = np.zeros((len(new), len(model.force)), np.uint8)
        for own, (_, _, suspected) in zip(suspects, new, strict=True):
            own[list(suspected)] = 1
        which = list(new.values())
        plain = _plain(model, told, x[which], suspects != 0) if posed is None else posed.plain(x[which], suspects)
        regressed.update(zip(new, plain, strict=True))
    each = np.array([regressed[key] for key in keys])
    return _bodies(model, x, supposed, each) if posed is None else posed.begun(x, each)


def _bodies(model: Model, x: Array, supposed: Sequence[Hypothesis], plain: Array) -> tuple[Array, Array]:
    """Each x with the body that plain regression makes, and the sizes of its entries."""
    response, felt = plain[:, :6].swapaxes(1, 2), plain[:, 6:].swapaxes(1, 2)
    turns = [
        model.mounting @ (np.exp(x[:, model.place(f"{name}_scale")])[:, :, None] * model.mounting.T) @ np.stack(base)
        for name, base in (("gyro", [one.gyro for one in supposed]), ("accel", [one.accelerometer for one in supposed]))
    ]
    turned = np.linalg.solve(turns[0], response)
    principal, axes = np.linalg.eigh((turned[..., :3] + turned[..., :3].swapaxes(1, 2)) / 2)
    top = np.maximum(np.abs(principal).max(1), 1e-12)
    inverse = (axes * np.maximum(principal, LEAST * top[:, None])[:, None]) @ axes.swapaxes(1, 2)
    lever = np.linalg.solve(inverse, turned[..., 3:])
    vector = -np.stack([lever[:, i, j] - lever[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], 1) / 2
    along = np.trace(np.linalg.solve(turns[1], felt), axis1=1, axis2=2) / 3
    mu = np.maximum(np.maximum(along, LEAST * np.abs(felt).max((1, 2))), 1e-9)
    size = np.sqrt(np.trace(np.linalg.inv(inverse), axis1=1, axis2=2) * mu)
    if model.bearing is not None:  # the first moment instead of the CG
        vector, size = vector / model.gravity, size / mu
    length = np.maximum(np.linalg.norm(vector, axis=1), 1e-12)
    moment = vector * np.minimum(1.0, FARTHEST * size / length)[:, None]
    x[:, :10] = np.concatenate([inverse[:, *np.triu_indices(3)], moment, mu[:, None]], 1)
    return x, np.concatenate([np.repeat(top[:, None], 6, 1), np.repeat(size[:, None], 3, 1), mu[:, None]], 1)


def _plain(model: Model, told: tuple[ReducedLeastSquares, ReducedLeastSquares], x: Array, suspects: BoolArray) -> Array:
    """(N, 9, 3) of each x (N, nx), where ``suspects`` (N, C) have a response of their own."""
    return np.stack([_each(model, told, *each) for each in zip(x, suspects, strict=True)])


def _each(model: Model, told: tuple[ReducedLeastSquares, ReducedLeastSquares], x: Array, suspects: BoolArray) -> Array:
    """(9, 3) growth of the rate by unit torques, and by forces or the vertical; specific force by unit forces; each (3, 3)."""
    (turned, pushed), unit = told, np.eye(told[0].triangle.shape[1])
    torque, force = model.wrench(x)
    centre = np.zeros(3) if model.bearing is None else model.bearing
    channels, products = unit[model.places["channels"]], unit[model.places["products"]]
    about = torque - np.cross(centre, force)
    precession = (
        unit[model.places["precession"]].reshape(-1, PER_AXIS, len(unit))[:, :3]
        if "precession" in model.places
        else unit[:0].reshape(0, 3, len(unit))
    )
    turning, pushing = about.T @ channels, force.T @ channels
    for column, own in zip(precession[~suspects[model.thrusting :]], about[model.thrusting :][~suspects[model.thrusting :]], strict=True):
        turning = turning - cross_matrix(own) @ column
    gravity = unit[model.places["up"]] if model.bearing is not None else unit[:0]
    by = gravity if model.bearing is not None else pushing
    suspected = [channels[suspects], *precession[suspects[model.thrusting :]]]
    beside = [*suspected, products]
    known = ~(np.concatenate(suspected) != 0).any(0)
    growth = _regressed(turned, known, [turning, by], beside)[:6]
    return np.concatenate([growth, _regressed(pushed, known, [pushing, turning], [*beside, gravity])[:3]])


def _regressed(told: ReducedLeastSquares, known: BoolArray, sums: Sequence[Array], others: Sequence[Array]) -> Array:
    """Coefficients (…, 3) of combinations of columns, all else nothing: of sums over the ``known`` ones, and others.

    A column that those before it are the sum of has none, nor one that is nothing beside its parts.
    """
    sizes = np.linalg.norm(told.triangle, axis=0)
    least = [np.full(len(part), np.linalg.norm(part * sizes)) for part in sums]
    least += [np.linalg.norm(told.triangle @ part.T, axis=0) for part in others]
    columns = told.triangle @ np.concatenate([*(part * known for part in sums), *others]).T
    basis, kept = np.zeros((len(columns), 0)), []
    for i, (own, whole) in enumerate(zip(columns.T, np.concatenate(least), strict=True)):
        left = own - basis @ (basis.T @ own)
        left -= basis @ (basis.T @ left)
        size = float(np.linalg.norm(left))
        if size > ROUNDING * whole:
            basis = np.column_stack([basis, left / size])
            kept.append(i)
    found = np.zeros((columns.shape[1], 3))
    found[kept] = np.linalg.solve(basis.T @ columns[:, kept], basis.T @ told.measured)
    return found
