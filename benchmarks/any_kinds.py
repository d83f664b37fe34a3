"""What a flight of any vehicle is changed to: an object docks, something is left open, or something isn't as the vehicle file says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array

Data = dict[str, Any]


class Kind(NamedTuple):
    """One of them."""

    what: str
    change: Callable[[Data, np.random.Generator], None]
    said: frozenset[str] = frozenset()
    """Codes of warnings that are due, or may be; any other is a false alarm."""
    free: bool = False
    """Of bodies in free flight alone."""


def drawn_between(draw: np.random.Generator, least: float, most: float) -> float:
    """Evenly in the logarithm."""
    return float(np.exp(draw.uniform(np.log(least), np.log(most))))


def turned(draw: np.random.Generator) -> Array:
    """(3, 3) any rotation."""
    found: Array = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    found *= np.sign(np.linalg.det(found))
    return found


def _docks(data: Data, draw: np.random.Generator) -> None:
    """An object of a fifth to three times the mass, beside the vehicle; then the plan once more."""
    truth, cycles, period = data["truth"], data["duration_cycles"], data["vehicle"]["cycle"]["period_s"]
    mass, size = truth["mass"] * drawn_between(draw, 0.2, 3), (truth["ixx"] / truth["mass"]) ** 0.5
    squares, axes, away = 1.5 * (size * draw.uniform(0.5, 1.5, 3)) ** 2, turned(draw), draw.normal(size=3)
    inertia = axes @ np.diag(mass / 3 * (squares.sum() - squares)) @ axes.T
    centre = np.array([truth[name] for name in ("cg_x", "cg_y", "cg_z")]) + away * size * draw.uniform(1, 2.5) / np.linalg.norm(away)
    data["docked"] = dict(zip(QUANTITIES, (*inertia[np.triu_indices(3)], *centre, mass), strict=True))
    data["plan"] += [part | {key: part[key] + cycles for key in ("start_cycle", "end_cycle")} for part in data["plan"]]
    data["duration_cycles"] = 2 * cycles
    moving = {key: draw.normal(size=3) * 0.01 for key in ("docked_rate_rad_s", "docked_velocity_m_s")} if draw.random() < 0.5 else {}
    data["events"] = [{"kind": "dock", "cycle": cycles} | moving]
    data["vehicle"]["phases"] = [
        {"name": "single", "start_s": 0.0, "end_s": cycles * period},
        {"name": "combined", "start_s": (cycles + 2) * period, "end_s": 2 * cycles * period},
    ]


def _noise_open(data: Data, _: np.random.Generator) -> None:
    imu = data["vehicle"]["imu"]
    data["sensors"] |= {key: imu.pop(key) for key in ("gyro_noise_rad_s", "accel_noise_m_s2")}


def _noise_low(data: Data, _: np.random.Generator) -> None:
    data["sensors"] |= {key: 1.25 * data["vehicle"]["imu"][key] for key in ("gyro_noise_rad_s", "accel_noise_m_s2")}


def _coarse(data: Data, draw: np.random.Generator) -> None:
    imu, period = data["vehicle"]["imu"], data["vehicle"]["cycle"]["period_s"]
    gyro, accel = imu["gyro_noise_rad_s"] * period, imu["accel_noise_m_s2"] * period
    data["sensors"] |= {"gyro_quantum_rad": gyro * draw.uniform(0.1, 1), "accel_quantum_m_s": accel * draw.uniform(0.1, 1)}


def _delay_open(data: Data, _: np.random.Generator) -> None:
    cycle = data["vehicle"]["cycle"]
    data["actuators"] = data.get("actuators", {}) | {"delay_cycles": cycle["command_delay_cycles"]}
    cycle["command_delay_cycles"] = "auto"


def _thrust_off(data: Data, draw: np.random.Generator) -> None:
    data["actuators"] = data.get("actuators", {}) | {"scale": 1 + 0.03 * draw.normal()}
    data["vehicle"]["thrust"]["scale_sigma"] = 0.03


def _torque(data: Data, draw: np.random.Generator) -> None:
    """White, wandering, steady or periodic, of a thousandth to three hundredths of what the vehicle can."""
    vehicle = data["vehicle"]
    vehicle["environment"].pop("disturbance_torque_n_m", None)
    if "jets" in vehicle:
        full = np.abs([np.cross(jet["position_m"], jet["force_n"]) for jet in vehicle["jets"]]).sum(0) / 2
    else:
        full = np.asarray(data["actuators"]["max_torque_n_m"])
    kind, size = str(draw.choice(["torque_n_m", "walk_n_m", "constant_n_m", "periodic_n_m"])), full.min() * drawn_between(draw, 1e-3, 3e-2)
    level = {"torque_n_m": size, "walk_n_m": size / 20}
    data["disturbance"] = {kind: level.get(kind, size * draw.normal(size=3))}


SIZED = frozenset({"disturbance-torque", "gyro-misfit", "accelerometer-misfit", "model-misfit", "cause-unknown"})
"""Codes of noise that was found larger than stated, whatever made it."""
KINDS = {
    "docking": Kind("an object docks halfway", _docks, frozenset({"no-docked-object"}), free=True),
    "noise-open": Kind("noise levels are left open", _noise_open, frozenset({"noise-estimated"})),
    "noise-low": Kind("noise is 1.25 times what is stated", _noise_low, SIZED),
    "coarse": Kind("counts of 0.1 to 1 sigma of the noise", _coarse, SIZED),
    "delay-open": Kind("the delay is left open", _delay_open),
    "thrust-off": Kind("thrust is off by 3 %, stated", _thrust_off),
    "torque": Kind("a torque that nobody stated", _torque, SIZED | {"steady-torque"}),
}
