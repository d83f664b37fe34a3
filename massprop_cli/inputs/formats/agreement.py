"""Whether a mapped log's gyro and accelerometer agree with its logged attitude; names other axes, or a unit, that make them agree."""

from itertools import permutations, product
from pathlib import Path

import numpy as np

from massprop_cli.base.arrays import Array, IntArray, median
from massprop_cli.base.errors import InputError
from massprop_cli.base.quaternion import rotation_vector, turns_between
from massprop_cli.inputs.formats.clocks import GAP
from massprop_cli.inputs.formats.resample import into_body
from massprop_cli.inputs.formats.units import DEG, G
from massprop_cli.inputs.tablefile import Made
from massprop_cli.inputs.vehicle import Vehicle

_STRETCHES, _LEAST = 400, 12
"""Turns are compared over so many stretches, ..."""
_NEAR, _FAR = 0.1, 0.35
"""... fewer until it turns as far in each as this, rad (rms), since a camera's attitudes are noisy; more where a sum of increments is no
turn any longer."""
_APART, _TOGETHER = 0.5, 0.2
"""Parts of the turn by which gyro and attitude may differ, and must agree once they are put right."""
_OFF, _SURE, _LONGER = 0.03, 5.0, 4
"""A gyro's scale may be off by so much, or by so many of its sigmas; over stretches so many times as long, where there are enough, since an
attitude that was smoothed or came late turns otherwise in what is fast alone."""


def check(path: Path, made: Made, vehicle: Vehicle, theta_imu: Array, force_imu: Array, attitude: Array | None) -> None:
    """:class:`InputError` where gyro (n, 3) rad, accelerometer (n, 3) m/s² and attitude (n, 4) contradict each other."""
    if made.heading and vehicle.environment.kind != "planar":
        raise InputError(
            f"{path}: [attitude] of {made.map} is only a heading, which a planar table needs, but environment.kind is "
            f'"{vehicle.environment.kind}"; map quaternions, or state kind = "planar" if the vehicle is on a table'
        )
    rows = np.flatnonzero([] if attitude is None else np.isfinite(attitude[:, 0]))
    if attitude is None or len(rows) < 2:
        return
    body = np.array(vehicle.imu.body_from_imu)
    attitude, angle = attitude[rows], np.cumsum(theta_imu @ body.T, 0)[rows]

    def turns(edges: IntArray) -> tuple[Array, Array]:
        """By gyro and attitude in each segment without a gap: across one the sum of increments is no turn."""
        length = np.diff(rows[edges])
        whole = length <= GAP * median(length)
        return np.diff(angle[edges], axis=0)[whole], rotation_vector(turns_between(attitude[edges]))[whole]

    edges = _edges(len(rows), _STRETCHES)
    while _rms(turns(edges)[1]) < _NEAR and len(edges) > 2 * _LEAST:
        edges = _edges(len(rows), len(edges) // 2)
    while _rms(turns(edges)[1]) > _FAR and 2 * len(edges) < len(rows):
        edges = _edges(len(rows), 2 * len(edges))
    turned, wanted = turns(edges)
    varied = _rms(turned - turned.mean(0))  # without a drift
    if made.heading and _rms(wanted) < _NEAR / 2 <= varied * _TOGETHER:
        raise InputError(
            f"{path}: the gyro turns by {varied:.3g} rad where the heading turns by {_rms(wanted):.3g} rad (rms); is this "
            f"the vehicle's heading, and is its unit right? Correct [attitude] or [gyro] of {made.map}"
        )
    _compare(path, made, "gyro", turned, wanted, _NEAR / 2, {"as it is": 1.0, "deg": DEG, "rad": 1 / DEG})
    if _rms(wanted) >= _NEAR / 2:
        _check_scale(path, made, *turns(edges[::_LONGER] if len(edges) > _LONGER * _LEAST else edges))
    if vehicle.pivoted and force_imu.any(0).all():
        up = into_body(np.broadcast_to([0.0, 0.0, vehicle.environment.gravity_m_s2], (len(attitude), 3)), attitude)
        _compare(path, made, "accelerometer", force_imu[rows] @ body.T, up, 1.0, {"as it is": 1.0, "g": G, "m/s^2": 1 / G})


def _edges(rows: int, count: int) -> IntArray:
    """Rows at which so many segments begin and end."""
    return np.unique(np.linspace(0, rows - 1, count + 1).astype(int))


def _compare(path: Path, made: Made, key: str, measured: Array, wanted: Array, least: float, factors: dict[str, float]) -> None:
    """Refuse what differs by half of itself."""
    size = _rms(wanted)
    if size < least:
        return

    def apart(turn: Array) -> float:
        return _rms(measured @ turn.T - wanted) / size

    now = apart(np.eye(3))
    if now < _APART:
        return
    tried = [(apart(factor * turn), axes, unit) for turn, axes in _all_axes() for unit, factor in factors.items()]
    best, axes, unit = min(tried)
    if best < _TOGETHER:
        wrong = [f"axes = {list(axes)} beyond those it has"] * (axes != ("x", "y", "z")) + [f"unit = {unit!r}"] * (factors[unit] != 1.0)
        problem = (
            f"it agrees with {' and '.join(wrong)}: correct that under [{key}], or the attitude's own axes, turns and world ([attitude])"
        )
    elif apart(-np.eye(3)) < _TOGETHER:
        problem = (
            f"it agrees with the opposite sign: state scale = -1.0 under [{key}], or correct the attitude's turns and world ([attitude])"
        )
    else:
        problem = (
            f"no order of axes and no unit corrects this; check order, turns, world and the unit of a heading ([attitude]), and [{key}]"
        )
    raise InputError(
        f"{path}: [{key}] of {made.map} and the logged attitude contradict each other by {now:.2g} of the attitude signal; {problem}"
    )


def _check_scale(path: Path, made: Made, turned: Array, wanted: Array) -> None:
    """Refuse a gyro that turns surely farther than the attitude, or less far."""
    scale, sigma = _scale(turned, wanted)
    if abs(scale - 1) > max(_OFF, _SURE * sigma):
        raise InputError(
            f"{path}: [gyro] of {made.map} turns {scale:.4g} ± {sigma:.1g} times as far as the logged attitude; correct unit or scale "
            f"under [gyro] (scale = {1 / scale:.4g} beyond what it has makes them agree), or how its values and clock are stated"
        )


def _scale(turned: Array, wanted: Array) -> tuple[float, float]:
    """How many times as far as the attitude (m, 3) a gyro's integral (m, 3) turns, and its sigma, beside a steady drift and turned axes.

    Least squares of the one on the other and of the other on the one enclose it; the nearer to 1 counts.
    """
    if len(turned) < _LEAST:
        return 1.0, np.inf
    turned, wanted = turned - turned.mean(0), wanted - wanted.mean(0)
    left, _, right = np.linalg.svd(wanted.T @ turned)
    turned = turned @ (left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right).T
    least, sigma = _part(turned, wanted)
    part, of_part = _part(wanted, turned)
    if part < _SURE * of_part or least < _SURE * sigma:
        return 1.0, np.inf  # a steady turn is a drift's, and what is left of it noise
    if least > 1:
        return least, sigma
    return (1 / part, of_part / part**2) if part > 1 else (1.0, sigma)


def _part(of: Array, by: Array) -> tuple[float, float]:
    """The factor of one of two (m, 3) that is nearest to the other, and its sigma, which each row's own misfit makes."""
    size = float((by**2).sum())
    part = float((of * by).sum()) / size
    misfit = (by * (of - part * by)).sum(1) * (len(of) / (len(of) - 4)) ** 0.5
    return part, float(np.sqrt((misfit**2).sum())) / size


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).mean(0).sum()))


def _all_axes() -> list[tuple[Array, tuple[str, ...]]]:
    """The 24 right-angled turns, and how a map writes each."""
    found: list[tuple[Array, tuple[str, ...]]] = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(turn) > 0:
            found.append((turn, tuple(("-" if sign < 0 else "") + "xyz"[axis] for axis, sign in zip(order, signs, strict=True))))
    return found
