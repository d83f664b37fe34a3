"""Test of a mapped log's gyro and accelerometer against its logged attitude; finds the axes or unit that make them agree."""

from itertools import permutations, product
from pathlib import Path

import numpy as np

from massprop_cli.base.arrays import Array, IntArray, median
from massprop_cli.base.errors import InputError
from massprop_cli.base.quaternion import rotation_vector, turns_between
from massprop_cli.inputs.formats.clocks import GAP
from massprop_cli.inputs.formats.resample import into_body
from massprop_cli.inputs.formats.units import DEG, G
from massprop_cli.inputs.tablefile import MapConversion
from massprop_cli.inputs.vehicle import Vehicle

_SEGMENTS, _MIN_SEGMENTS = 400, 12
"""Number of segments over which rotations are compared, and minimum number; ..."""
_MIN_RAD, _MAX_RAD = 0.1, 0.35
"""... fewer segments until the rms rotation per segment reaches the first value, rad (camera attitudes are noisy); more above the second,
because a sum of increments is then not a rotation."""
_CONTRADICTS, _AGREES = 0.5, 0.2
"""Relative difference of gyro and attitude above which they contradict each other, and below which a correction makes them agree."""
_SCALE_ERROR, _SIGMAS, _LONGER = 0.03, 5.0, 4
"""Largest error of the gyro's scale: relative, and in sigmas. Length ratio of its segments: latency of attitude distorts fast rotations."""


def check(path: Path, made: MapConversion, vehicle: Vehicle, theta_imu: Array, force_imu: Array, attitude: Array | None) -> None:
    """Raise :class:`InputError` if gyro (n, 3), rad, or accelerometer (n, 3), m/s², contradicts the attitude (n, 4), quaternions."""
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
        """Rotations by gyro and attitude in each segment without a gap, because increments across a gap are incomplete."""
        length = np.diff(rows[edges])
        whole = length <= GAP * median(length)
        return np.diff(angle[edges], axis=0)[whole], rotation_vector(turns_between(attitude[edges]))[whole]

    edges = _edges(len(rows), _SEGMENTS)
    while _rms(turns(edges)[1]) < _MIN_RAD and len(edges) > 2 * _MIN_SEGMENTS:
        edges = _edges(len(rows), len(edges) // 2)
    while _rms(turns(edges)[1]) > _MAX_RAD and 2 * len(edges) < len(rows):
        edges = _edges(len(rows), 2 * len(edges))
    turned, wanted = turns(edges)
    varied = _rms(turned - turned.mean(0))  # without the bias
    if made.heading and _rms(wanted) < _MIN_RAD / 2 <= varied * _AGREES:
        raise InputError(
            f"{path}: the gyro turns by {varied:.3g} rad where the heading turns by {_rms(wanted):.3g} rad (rms); is this "
            f"the vehicle's heading, and is its unit right? Correct [attitude] or [gyro] of {made.map}"
        )
    _compare(path, made, "gyro", turned, wanted, _MIN_RAD / 2, {"as it is": 1.0, "deg": DEG, "rad": 1 / DEG})
    if _rms(wanted) >= _MIN_RAD / 2:
        _check_scale(path, made, *turns(edges[::_LONGER] if len(edges) > _LONGER * _MIN_SEGMENTS else edges))
    if vehicle.pivoted and force_imu.any(0).all():
        up = into_body(np.broadcast_to([0.0, 0.0, vehicle.environment.gravity_m_s2], (len(attitude), 3)), attitude)
        _compare(path, made, "accelerometer", force_imu[rows] @ body.T, up, 1.0, {"as it is": 1.0, "g": G, "m/s^2": 1 / G})


def _edges(rows: int, count: int) -> IntArray:
    """Rows at the edges of ``count`` segments."""
    return np.unique(np.linspace(0, rows - 1, count + 1).astype(int))


def _compare(path: Path, made: MapConversion, key: str, measured: Array, wanted: Array, least: float, factors: dict[str, float]) -> None:
    """Raise :class:`InputError` if ``measured`` differs from ``wanted`` by half of it, with the axes or unit that correct it."""
    size = _rms(wanted)
    if size < least:
        return

    def difference(turn: Array) -> float:
        return _rms(measured @ turn.T - wanted) / size

    now = difference(np.eye(3))
    if now < _CONTRADICTS:
        return
    tried = [(difference(factor * turn), axes, unit) for turn, axes in _all_axes() for unit, factor in factors.items()]
    best, axes, unit = min(tried)
    if best < _AGREES:
        wrong = [f"axes = {list(axes)} beyond those it has"] * (axes != ("x", "y", "z")) + [f"unit = {unit!r}"] * (factors[unit] != 1.0)
        problem = (
            f"it agrees with {' and '.join(wrong)}: correct that under [{key}], or the attitude's own axes, turns and world ([attitude])"
        )
    elif difference(-np.eye(3)) < _AGREES:
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


def _check_scale(path: Path, made: MapConversion, turned: Array, wanted: Array) -> None:
    """Raise :class:`InputError` if the gyro's scale against the attitude differs significantly from 1."""
    scale, sigma = _scale(turned, wanted)
    if abs(scale - 1) > max(_SCALE_ERROR, _SIGMAS * sigma):
        raise InputError(
            f"{path}: [gyro] of {made.map} turns {scale:.4g} ± {sigma:.1g} times as far as the logged attitude; correct unit or scale "
            f"under [gyro] (scale = {1 / scale:.4g} beyond what it has makes them agree), or how its values and clock are stated"
        )


def _scale(turned: Array, wanted: Array) -> tuple[float, float]:
    """Ratio of the gyro's rotation (m, 3) to the attitude's, and its sigma, without bias and misalignment.

    Errors in both variables: regressions of each on the other enclose the ratio, and the value nearer to 1 is used.
    """
    if len(turned) < _MIN_SEGMENTS:
        return 1.0, np.inf
    turned, wanted = turned - turned.mean(0), wanted - wanted.mean(0)
    left, _, right = np.linalg.svd(wanted.T @ turned)
    turned = turned @ (left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right).T
    least, sigma = _factor(turned, wanted)
    part, of_part = _factor(wanted, turned)
    if part < _SIGMAS * of_part or least < _SIGMAS * sigma:
        return 1.0, np.inf  # a constant rate is removed with the bias, and noise remains
    if least > 1:
        return least, sigma
    return (1 / part, of_part / part**2) if part > 1 else (1.0, sigma)


def _factor(of: Array, by: Array) -> tuple[float, float]:
    """Least-squares factor of ``by`` (m, 3) that gives ``of`` (m, 3), and its sigma from the rows' residuals."""
    size = float((by**2).sum())
    part = float((of * by).sum()) / size
    residual = (by * (of - part * by)).sum(1) * (len(of) / (len(of) - 4)) ** 0.5
    return part, float(np.sqrt((residual**2).sum())) / size


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).mean(0).sum()))


def _all_axes() -> list[tuple[Array, tuple[str, ...]]]:
    """The 24 right-angled rotations, with the axes that a map states for each."""
    found: list[tuple[Array, tuple[str, ...]]] = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        turn = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(turn) > 0:
            found.append((turn, tuple(("-" if sign < 0 else "") + "xyz"[axis] for axis, sign in zip(order, signs, strict=True))))
    return found
