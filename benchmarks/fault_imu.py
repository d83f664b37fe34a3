"""Faults of gyro, accelerometer and their mounting."""

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from fault_named import Drawn, Due, Fault, Number, due
from fault_thrust import Random, turned, unit
from fault_vehicles import INCREMENTS, Case, Subject

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.imurecords import saturation

GRAVITY = 9.80665
SPIKED = 0.005
"""Part of the rows that have a spike."""
Sensor = Literal["gyro", "accel"]
LONG = {"gyro": "gyro", "accel": "accelerometer"}


def columns(case: Case, sensor: Sensor) -> Array:
    """(n, 3) increments of a sensor."""
    found: Array = getattr(case.log, INCREMENTS[sensor])
    return found


def with_columns(case: Case, sensor: Sensor, increments: Array) -> Case:
    """The case with other increments of a sensor."""
    return case.logging(**{INCREMENTS[sensor]: increments})


def noise(subject: Subject, sensor: Sensor) -> float:
    """One sigma of the sensor's mean over a cycle."""
    imu = subject.vehicle.imu
    return float((imu.gyro_noise_rad_s if sensor == "gyro" else imu.accel_noise_m_s2) or 0.0)


def _units(s: Subject, _: Random, sensor: Sensor, factor: float, word: str, what: str) -> Drawn:
    return Drawn(with_columns(s.clean, sensor, columns(s.clean, sensor) * factor), due(f"{sensor}-units", word), what)


def _scale(s: Subject, rng: Random, sensor: Sensor, part: float, one: bool) -> Drawn:
    factor = 1 + part * float(rng.choice([-1, 1]))
    axis = int(rng.integers(3))
    scale = np.where(np.arange(3) == axis, factor, 1.0) if one else np.full(3, factor)
    wrong = with_columns(s.clean, sensor, columns(s.clean, sensor) * scale)
    return Drawn(wrong, due(f"{sensor}-scale"), f"{sensor} gives {factor:g} of {'IMU axis ' + 'xyz'[axis] if one else 'all axes'}")


def _bias(s: Subject, rng: Random, sensor: Sensor) -> Drawn:
    size = rng.uniform(0.01, 0.02) if sensor == "gyro" else rng.uniform(0.05, 0.1)
    bias = size * unit(rng)
    wrong = with_columns(s.clean, sensor, columns(s.clean, sensor) + bias * s.clean.log.interval_s[:, None])
    return Drawn(wrong, due(f"{sensor}-bias"), f"{sensor} bias {np.round(bias, 5).tolist()} in IMU axes")


def _filter(s: Subject, rng: Random, sensor: Sensor) -> Drawn:
    cycles = rng.uniform(1.0, 2.0)
    part = 1 - np.exp(-1 / (cycles * s.clean.log.records_per_cycle))
    increments = columns(s.clean, sensor)
    found, now = np.empty_like(increments), increments[0]
    for k, increment in enumerate(increments):
        now = now + part * (increment - now)
        found[k] = now
    return Drawn(with_columns(s.clean, sensor, found), due(f"{sensor}-filter"), f"{sensor} low-passed, {cycles:.2f} cycles")


def _saturated(s: Subject, rng: Random, sensor: Sensor, stated: bool) -> Drawn | None:
    if sensor == "accel" and s.vehicle.on_air_bearing:
        return None  # gravity alone would fill the range
    seen = columns(s.clean, sensor) / s.clean.log.interval_s[:, None]
    limit = float(rng.uniform(0.45, 0.6) * np.abs(seen).max())
    clipped = np.clip(seen, -limit, limit)
    wrong = with_columns(s.clean, sensor, clipped * s.clean.log.interval_s[:, None])
    if stated:
        wrong = wrong.stating(f"imu.{'gyro_range_rad_s' if sensor == 'gyro' else 'accel_range_m_s2'}={limit}")
        read = (columns(wrong, "gyro"), columns(wrong, "accel"), wrong.log.interval_s)
        wrong = replace(wrong, log=replace(wrong.log, notices=tuple(saturation(wrong.vehicle, *read))))
    return Drawn(wrong, due(f"{LONG[sensor]}-saturated"), f"{sensor} clipped at {limit:.4g}")


def _gyro_sign(s: Subject, rng: Random) -> Drawn:
    axis = int(rng.integers(3))
    sign = np.where(np.arange(3) == axis, -1.0, 1.0)
    wrong = with_columns(s.clean, "gyro", columns(s.clean, "gyro") * sign)
    return Drawn(wrong, (Due(("imu-mounting", "gyro-sign", "gyro-scale")),), f"gyro reversed about IMU axis {'xyz'[axis]}")


def _outliers(s: Subject, rng: Random, sensor: Sensor) -> Drawn:
    log, increments = s.clean.log, columns(s.clean, sensor).copy()
    rows = rng.choice(np.arange(1, log.rows), max(3, round(SPIKED * log.rows)), replace=False)
    record = noise(s, sensor) * np.sqrt(log.records_per_cycle) * log.interval_s[rows]
    spikes = rng.choice([-1, 1], len(rows)) * rng.uniform(50, 200, len(rows)) * record
    increments[rows, rng.integers(0, 3, len(rows))] += spikes
    return Drawn(with_columns(s.clean, sensor, increments), due("outliers"), f"{sensor} spikes in rows {sorted(rows.tolist())}")


def mounted(subject: Subject, case: Case, turn: Array) -> Case:
    """The vehicle file has the IMU turned by (3, 3) ``turn``, IMU axes."""
    stated = np.array(subject.vehicle.imu.body_from_imu) @ turn
    return case.stating(f"imu.body_from_imu={[[float(x) for x in row] for row in stated]}")


def rotation(axis: Array, degrees: float) -> Array:
    """(3, 3) rotation about a unit vector."""
    return np.stack([turned(column, axis, degrees) for column in np.eye(3)], 1)


def right_angle(rng: Random) -> Array:
    """(3, 3) a quarter or half turn about one axis."""
    return np.round(rotation(np.eye(3)[int(rng.integers(3))], float(rng.choice([90, 180, 270]))))


def _transposed(s: Subject, _: Random) -> Drawn | None:
    stated = np.array(s.vehicle.imu.body_from_imu)
    if np.abs(stated - stated.T).max() < 1e-9:
        return None
    return Drawn(mounted(s, s.clean, stated.T @ stated.T), due("imu-mounting"), "imu.body_from_imu transposed")


def _tilted(s: Subject, rng: Random, degrees: float) -> Drawn:
    words = (Number(degrees, 0.15 * degrees),)
    return Drawn(mounted(s, s.clean, rotation(unit(rng), degrees)), due("imu-mounting", *words), f"IMU tilted by {degrees:g} degrees")


def _swapped(s: Subject, rng: Random) -> Drawn:
    order = np.arange(3)
    pair = rng.choice(3, 2, replace=False)
    order[pair] = order[pair[::-1]]
    wrong = s.clean.logging(**{name: getattr(s.clean.log, name)[:, order] for name in INCREMENTS.values()})
    return Drawn(wrong, due("imu-mounting"), f"IMU axes {'xyz'[pair[0]]} and {'xyz'[pair[1]]} swapped")


def _placed(s: Subject, rng: Random, metres: float) -> Drawn:
    stated = np.array(s.vehicle.imu.position_m) + metres * unit(rng)
    return Drawn(s.clean.stating(f"imu.position_m={stated.tolist()}"), due("imu-position"), f"IMU {metres * 1000:g} mm out of place")


def _quieter(s: Subject, rng: Random) -> Drawn:
    """The stated noise is too small; any other cause named is wrong."""
    factor = rng.uniform(1.2, 1.8)
    gyro, accel = noise(s, "gyro") / factor, noise(s, "accel") / factor
    return Drawn(
        s.clean.stating(f"imu.gyro_noise_rad_s={gyro}", f"imu.accel_noise_m_s2={accel}"), (), f"noise {factor:.3g} times as large as stated"
    )


def in_degrees(case: Case) -> Case:
    """The case with gyro columns in degrees."""
    return with_columns(case, "gyro", np.degrees(columns(case, "gyro")))


RIGHT_ANGLES = "IMU turned by right angles"
IMU = (
    Fault("gyro-degrees", "gyro in degrees", partial(_units, sensor="gyro", factor=180 / np.pi, word="degrees", what="gyro in degrees")),
    Fault(
        "gyro-twice",
        "gyro turned into radians twice",
        partial(_units, sensor="gyro", factor=np.pi / 180, word="twice", what="gyro in radians twice"),
    ),
    Fault("gyro-scale", "gyro scale off by 2 %, all axes", partial(_scale, sensor="gyro", part=0.02, one=False)),
    Fault("gyro-scale-one", "gyro scale off by 5 %, one axis", partial(_scale, sensor="gyro", part=0.05, one=True)),
    Fault("gyro-bias", "gyro bias of 0.01 to 0.02 rad/s", partial(_bias, sensor="gyro")),
    Fault("gyro-filter", "gyro low-passed by 1 to 2 cycles", partial(_filter, sensor="gyro")),
    Fault("gyro-range", "gyro saturated, range stated", partial(_saturated, sensor="gyro", stated=True)),
    Fault("gyro-clipped", "gyro saturated, range not stated", partial(_saturated, sensor="gyro", stated=False)),
    Fault("gyro-sign", "gyro reversed about one axis", _gyro_sign),
    Fault("gyro-spikes", "gyro spikes in 0.5 % of the rows", partial(_outliers, sensor="gyro")),
    Fault("accel-g", "accelerometer in g", partial(_units, sensor="accel", factor=1 / GRAVITY, word="in g", what="accelerometer in g")),
    Fault("accel-scale", "accelerometer scale off by 3 %, all axes", partial(_scale, sensor="accel", part=0.03, one=False)),
    Fault("accel-scale-one", "accelerometer scale off by 5 %, one axis", partial(_scale, sensor="accel", part=0.05, one=True)),
    Fault("accel-bias", "accelerometer bias of 0.05 to 0.1 m/s²", partial(_bias, sensor="accel")),
    Fault("accel-filter", "accelerometer low-passed by 1 to 2 cycles", partial(_filter, sensor="accel")),
    Fault("accel-clipped", "accelerometer saturated, range not stated", partial(_saturated, sensor="accel", stated=False)),
    Fault("accel-spikes", "accelerometer spikes in 0.5 % of the rows", partial(_outliers, sensor="accel")),
    Fault("noise-low", "noise stated 1.2 to 1.8 times too small: no other cause is due", _quieter),
    Fault("imu-transposed", "IMU mounting transposed", _transposed),
    Fault("imu-right-angle", RIGHT_ANGLES, lambda s, rng: Drawn(mounted(s, s.clean, right_angle(rng)), due("imu-mounting"), RIGHT_ANGLES)),
    Fault("imu-swapped", "two IMU axes swapped", _swapped),
    Fault("imu-2deg", "IMU tilted by 2°", partial(_tilted, degrees=2.0)),
    Fault("imu-10deg", "IMU tilted by 10°", partial(_tilted, degrees=10.0)),
    Fault("imu-30deg", "IMU tilted by 30°", partial(_tilted, degrees=30.0)),
    Fault("imu-20mm", "IMU 20 mm out of place", partial(_placed, metres=0.02)),
    Fault("imu-100mm", "IMU 100 mm out of place", partial(_placed, metres=0.1)),
)
