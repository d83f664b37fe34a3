"""What a flight of any vehicle is changed to: an object docks, something is left open, or something isn't as the vehicle file says."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.conclude.verdict import POSITIVE

Data = dict[str, Any]
"""A scenario; ``stated`` is its vehicle as the vehicle file has it, where that is not as it is flown."""


class Kind(NamedTuple):
    """A kind of change to a flight."""

    what: str
    change: Callable[[Data, np.random.Generator], None]
    said: frozenset[str] = frozenset()
    """Codes of warnings that are due, or may be; any other is a false alarm."""
    free: bool = False
    """Of bodies in free flight alone."""


def drawn_between(draw: np.random.Generator, least: float, most: float) -> float:
    """A number, uniform in its logarithm."""
    return float(np.exp(draw.uniform(np.log(least), np.log(most))))


def turned(draw: np.random.Generator) -> Array:
    """(3, 3) a random rotation."""
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


def _full(data: Data) -> float:
    """The largest torque that the vehicle can make about the axis where that is least."""
    if "jets" in data["vehicle"]:
        each = np.abs([np.cross(jet["position_m"], jet["force_n"]) for jet in data["vehicle"]["jets"]]).sum(0) / 2
    else:
        each = np.asarray(data["actuators"]["max_torque_n_m"])
    return float(each.min())


def _torque(data: Data, draw: np.random.Generator) -> None:
    """White, wandering, steady or periodic, of a thousandth to three hundredths of what the vehicle can."""
    vehicle = data["vehicle"]
    vehicle["environment"].pop("disturbance_torque_n_m", None)
    kind, size = str(draw.choice(["torque_n_m", "walk_n_m", "constant_n_m", "periodic_n_m"])), _full(data) * drawn_between(draw, 1e-3, 3e-2)
    level = {"torque_n_m": size, "walk_n_m": size / 20}
    data["disturbance"] = {kind: level.get(kind, size * draw.normal(size=3))}


def _known(data: Data, draw: np.random.Generator) -> None:
    """Some of the ten, each measured elsewhere to 0.1 to 30 % of its size; moments and the mass, which are none below zero, to 10 %."""
    truth, period = data["truth"], data["vehicle"]["cycle"]["period_s"]
    size = (truth["ixx"] / truth["mass"]) ** 0.5
    sizes = dict.fromkeys(QUANTITIES[:6], truth["ixx"]) | dict.fromkeys(QUANTITIES[6:9], 0.1 * size) | {"mass": truth["mass"]}
    known = data["vehicle"].get("known", {})
    for name in draw.permutation(QUANTITIES)[: draw.integers(1, 6)]:
        sigma = sizes[name] * drawn_between(draw, 1e-3, 0.1 if QUANTITIES.index(name) in POSITIVE else 0.3)
        known.setdefault(str(name), {"value": truth[name] + sigma * draw.normal(), "sigma": sigma})
    data["vehicle"]["phases"] = [{"name": "all", "start_s": 0.0, "end_s": data["duration_cycles"] * period, "known": known}]
    data["vehicle"].pop("known", None)


def _tumbles(data: Data, draw: np.random.Generator) -> None:
    data["initial"] = {"rate_rad_s": draw.normal(size=3) * drawn_between(draw, 0.02, 0.5)}


def _lasts(data: Data, _: np.random.Generator) -> None:
    """The plan flown six times in a row."""
    cycles = data["duration_cycles"]
    data["plan"] = [
        part | {key: part[key] + again * cycles for key in ("start_cycle", "end_cycle")} for again in range(6) for part in data["plan"]
    ]
    data["duration_cycles"] = 6 * cycles


def _timing(data: Data, draw: np.random.Generator) -> None:
    """Delay and lag differ from what is stated, within the stated sigmas of 0.1 and 0.05 cycles."""
    vehicle, period = data["vehicle"], data["vehicle"]["cycle"]["period_s"]
    delay, lag = vehicle["cycle"]["command_delay_cycles"], float(draw.uniform(0.3, 1.0))
    data["actuators"] = data.get("actuators", {}) | {
        "delay_cycles": max(delay + 0.1 * draw.normal(), 0.0) if delay else 0.0,
        "lag_s": (lag + 0.05 * draw.normal()) * period,
    }
    vehicle["cycle"]["command_delay_sigma_cycles"] = 0.1 if delay else 0.0
    vehicle["thrust"] |= {"lag_s": lag * period, "lag_sigma_s": 0.05 * period}


def _geometry(data: Data, draw: np.random.Generator) -> None:
    """Jets and IMU are not quite where and as the vehicle file says, but as uncertain as it says."""
    vehicle, truth = data["vehicle"], data["truth"]
    away = 0.01 * float((truth["ixx"] / truth["mass"]) ** 0.5)
    data["stated"] = stated = deepcopy(vehicle)
    for jet, own in zip(stated.get("jets", ()), vehicle.get("jets", ()), strict=True):
        jet |= {"thrust_sigma": 0.01, "position_sigma_m": away, "direction_sigma_rad": 0.01}
        own["position_m"] = np.asarray(own["position_m"]) + away * draw.normal(size=3)
        own["force_n"] = rotation(0.01 * draw.normal(size=3)) @ np.asarray(own["force_n"]) * (1 + 0.01 * draw.normal())
    stated["imu"] |= {"position_sigma_m": away, "mounting_sigma_rad": 0.003}
    turned_by = rotation(0.003 * draw.normal(size=3))
    vehicle["imu"] |= {
        "position_m": np.asarray(vehicle["imu"]["position_m"]) + away * draw.normal(size=3),
        "body_from_imu": turned_by @ np.asarray(vehicle["imu"].get("body_from_imu", np.eye(3))),
    }


def _drag(data: Data, draw: np.random.Generator) -> None:
    truth, seconds = data["truth"], data["duration_cycles"] * data["vehicle"]["cycle"]["period_s"]
    size = truth["ixx"] / seconds * drawn_between(draw, 0.01, 1.0)
    data["vehicle"]["environment"]["damping_sigma_n_m_s"] = size
    data["disturbance"] = data.get("disturbance", {}) | {"rate_n_m_s": np.abs(size * draw.normal(size=3))}


def _turns_only(data: Data, _: np.random.Generator) -> None:
    """No forces; the mass is weighed."""
    data["plan"] = [part for part in data["plan"] if not set(part.get("axes", ())) & {"x", "y", "z"}]
    mass = data["truth"]["mass"]
    data["vehicle"].setdefault("known", {"mass": {"value": mass, "sigma": 1e-3 * mass}})


def _table(data: Data, draw: np.random.Generator) -> None:
    """Yaw, x, y and all together on a table that is out of level by less than pushes it."""
    vehicle = data["vehicle"]
    vehicle["environment"] = {"kind": "planar"} | {
        key: value for key, value in vehicle["environment"].items() if key == "disturbance_torque_n_m"
    }
    part, every = data["duration_cycles"] // 4, int(draw.choice([4, 5, 8]))
    data["plan"] = [
        {"motion": "random", "axes": axes, "every_cycles": every, "max_cycles": every - 1, "start_cycle": i * part, "end_cycle": end * part}
        for i, (axes, end) in enumerate(((["yaw"], 1), (["x"], 2), (["y"], 3), (["x", "y", "yaw"], 4)))
    ]
    # what its weight makes of a slope is to be beside what pushes it
    alpha = float(np.abs(vehicle["jets"][-1]["force_n"]).max() if "jets" in vehicle else data["actuators"]["max_force_n"][0])
    slope = min(0.005, 0.1 * alpha / data["truth"]["mass"] / 9.81)
    vehicle["environment"]["table_tilt_sigma_rad"] = slope
    data["disturbance"] = {"table_tilt_rad": slope * draw.normal(size=2), "table_hold": draw.uniform(0.3, 1)}


def _pushed(data: Data, torque: float, force: float) -> None:
    """Forces so many times as large, at places that make torques so many times as large."""
    for jet in data["vehicle"].get("jets", ()):
        jet["force_n"], jet["position_m"] = np.asarray(jet["force_n"]) * force, np.asarray(jet["position_m"]) * (torque / force)
    actuators = data.get("actuators", {})
    for key, factor in (("max_torque_n_m", torque), ("max_force_n", force)):
        if key in actuators:
            actuators[key] = np.asarray(actuators[key]) * factor


def _balanced(data: Data, factor: float) -> None:
    """On a bearing, the CG so many times as far from it, that the weight doesn't beat the jets."""
    centre = np.asarray(data["vehicle"]["environment"].get("bearing_position_m", np.zeros(3)))
    if data["vehicle"]["environment"]["kind"] == "air_bearing":
        for i, name in enumerate(("cg_x", "cg_y", "cg_z")):
            data["truth"][name] = centre[i] + factor * (data["truth"][name] - centre[i])


def _weak(data: Data, draw: np.random.Generator) -> None:
    factor = 1 / drawn_between(draw, 10, 100)
    _pushed(data, factor, factor)
    _balanced(data, factor)


def _sharp(data: Data, _: np.random.Generator) -> None:
    for key in ("gyro_noise_rad_s", "accel_noise_m_s2"):
        data["vehicle"]["imu"][key] /= 100


def _resized(length: float, weight: float) -> Callable[[Data, np.random.Generator], None]:
    """The same vehicle of another length and mass, turned as fast; what is felt grows as its length."""

    def change(data: Data, _: np.random.Generator) -> None:
        vehicle, truth, area = data["vehicle"], data["truth"], weight * length**2
        imu, environment, sensors = vehicle["imu"], vehicle["environment"], data["sensors"]
        for name in QUANTITIES:
            truth[name] *= weight if name == "mass" else length if name.startswith("cg") else area
        _pushed(data, area, weight * length)
        for part, key, factor in (
            (imu, "position_m", length),
            (imu, "accel_noise_m_s2", length),
            (imu, "accel_bias_sigma_m_s2", length),
            (sensors, "accel_bias_m_s2", length),
            (environment, "disturbance_torque_n_m", area),
            (environment, "bearing_position_m", length),
            (environment, "bearing_mass_kg", weight),
            (data["control"], "rate_gain_n_m_s", area),
            (data["control"], "attitude_gain_n_m", area),
        ):
            if key in part:
                part[key] = np.asarray(part[key]) * factor
        for known in vehicle.get("known", {}).values():
            known |= {key: value * weight for key, value in known.items()}
        _balanced(data, min(length, 1.0))

    return change


def _slow_torque(data: Data, draw: np.random.Generator) -> None:
    environment = data["vehicle"]["environment"]
    environment.pop("disturbance_torque_n_m", None)
    environment["disturbance_walk_n_m"] = _full(data) * drawn_between(draw, 1e-4, 1e-2)


def _white_torque(data: Data, draw: np.random.Generator) -> None:
    data["vehicle"]["environment"]["disturbance_torque_n_m"] = _full(data) * drawn_between(draw, 0.03, 0.5)


def _biased(data: Data, draw: np.random.Generator) -> None:
    """Biases as large as those of an uncalibrated small IMU."""
    vehicle = data["vehicle"]
    seconds, bearing = data["duration_cycles"] * vehicle["cycle"]["period_s"], vehicle["environment"]["kind"] == "air_bearing"
    gyro, accel = min(drawn_between(draw, 1e-4, 1e-2), 0.1 / seconds if bearing else 1.0), drawn_between(draw, 1e-2, 0.3)
    vehicle["imu"] |= {"gyro_bias_sigma_rad_s": gyro, "accel_bias_sigma_m_s2": accel}
    data["sensors"] |= {"gyro_bias_rad_s": gyro * draw.normal(size=3), "accel_bias_m_s2": accel * draw.normal(size=3)}


def _fuel(data: Data, draw: np.random.Generator) -> None:
    """A thousandth to a twentieth of the mass or so is burnt, which is stated as drift; of what has no jets none is."""
    vehicle, seconds = data["vehicle"], data["duration_cycles"] * data["vehicle"]["cycle"]["period_s"]
    if "jets" not in vehicle:
        return
    # the plan fires each jet a tenth of the time or so
    impulse = 0.1 * seconds * float(np.linalg.norm([jet["force_n"] for jet in vehicle["jets"]], axis=1).sum())
    burnt = data["truth"]["mass"] * drawn_between(draw, 1e-3, 0.05)
    data["fuel"] = {"specific_impulse_s": impulse / burnt / 9.80665}
    vehicle["drift"] = {"mass": burnt / seconds**0.5}


def _uneven(data: Data, draw: np.random.Generator) -> None:
    data["vehicle"]["thrust"]["pulse_sigma"] = drawn_between(draw, 0.02, 0.2)


def _lag_open(data: Data, draw: np.random.Generator) -> None:
    data["actuators"] = data.get("actuators", {}) | {"lag_s": data["vehicle"]["cycle"]["period_s"] * drawn_between(draw, 0.2, 5)}
    data["vehicle"]["thrust"]["lag_s"] = "auto"


def _on_and_on(data: Data, draw: np.random.Generator) -> None:
    """Random roll commands, then one constant command at a time."""
    bearing, part = data["vehicle"]["environment"]["kind"] == "air_bearing", data["duration_cycles"] // 8
    axes = ("roll", "pitch", "yaw") if bearing else ("roll", "pitch", "yaw", "x", "y", "z")
    data["plan"] = [{"motion": "random", "axes": ["roll"], "every_cycles": 5, "max_cycles": 4, "start_cycle": 0, "end_cycle": part - 3}] + [
        {
            "motion": "steady",
            "axes": [str(draw.choice(axes))],
            "level": float(draw.uniform(-1, 1)),
            "start_cycle": i * part + 1,
            "end_cycle": (i + 1) * part - 3,
        }
        for i in range(1, 8)
    ]


def _calibrated(data: Data, draw: np.random.Generator) -> None:
    """Thrust that is stated to be a fifth uncertain, of a vehicle that was weighed."""
    data["actuators"] = data.get("actuators", {}) | {"scale": max(1 + 0.2 * draw.normal(), 0.4)}
    data["vehicle"]["thrust"]["scale_sigma"] = 0.2
    mass = data["truth"]["mass"]
    data["vehicle"].setdefault("known", {})["mass"] = {"value": mass * (1 + 1e-3 * draw.normal()), "sigma": 1e-3 * mass}


def _far_out(data: Data, draw: np.random.Generator) -> None:
    """The CG is as far from O as the vehicle is large."""
    truth, away = data["truth"], draw.normal(size=3)
    away *= (truth["ixx"] / truth["mass"]) ** 0.5 * draw.uniform(0.3, 1.5) / np.linalg.norm(away)
    for i, name in enumerate(("cg_x", "cg_y", "cg_z")):
        truth[name] += float(away[i])


def _low_passed(data: Data, draw: np.random.Generator) -> None:
    """Gyro and accelerometer lag by 0.1 to 3 cycles, as stated."""
    period, imu = data["vehicle"]["cycle"]["period_s"], data["vehicle"]["imu"]
    imu |= {key: period * drawn_between(draw, 0.1, 3) for key in ("gyro_lag_s", "accel_lag_s")}


SIZED = frozenset({"disturbance-torque", "gyro-misfit", "accelerometer-misfit", "model-misfit", "cause-unknown"})
"""Codes of noise that was found larger than stated, whatever made it."""
KINDS = {
    "docking": Kind("an object docks halfway", _docks, frozenset({"no-docked-object"}), free=True),
    "noise-open": Kind("noise levels are left open", _noise_open, frozenset({"noise-estimated"})),
    "noise-low": Kind("noise is 1.25 times what is stated", _noise_low, SIZED),
    "coarse": Kind("counts of 0.1 to 1 sigma of the noise", _coarse, SIZED),
    "delay-open": Kind("the delay is left open", _delay_open),
    "thrust-off": Kind("thrust is off by 3 %, stated", _thrust_off),
    "known": Kind("some of the ten were measured elsewhere", _known),
    "tumbling": Kind("it tumbles when the log begins", _tumbles, free=True),
    "long": Kind("six times as long", _lasts, free=True),
    "timing": Kind("delay and lag are uncertain, stated", _timing),
    "geometry": Kind("jets and IMU are uncertain, stated", _geometry),
    "drag": Kind("drag of a size that is stated", _drag),
    "turns-only": Kind("nothing pushes it, the mass is weighed", _turns_only),
    "table": Kind("on a table out of level", _table, free=True),
    "weak": Kind("pushed by a tenth to a hundredth of that", _weak),
    "sharp": Kind("with an IMU a hundred times as sharp", _sharp),
    "large": Kind("20 times the length, 10,000 times the mass", _resized(20, 1e4)),
    "small": Kind("a tenth of the length, a ten thousandth of the mass", _resized(0.1, 1e-4)),
    "slow-torque": Kind("a slowly varying torque, stated", _slow_torque),
    "white-torque": Kind("a white torque of 3 to 50 % of its own, stated", _white_torque),
    "biased": Kind("gyro and accelerometer have large biases, stated", _biased),
    "fuel": Kind("it burns fuel, stated", _fuel),
    "uneven": Kind("pulses err by 2 to 20 %, stated", _uneven),
    "lag-open": Kind("the thrust's lag is left open", _lag_open),
    "on-and-on": Kind("turns and pushes that last", _on_and_on),
    "calibrated": Kind("thrust uncertain by a fifth, the mass weighed", _calibrated),
    "far-out": Kind("the CG as far out as the vehicle is large", _far_out, free=True),
    "low-passed": Kind("gyro and accelerometer lag, stated", _low_passed),
    "torque": Kind("a torque that nobody stated", _torque, SIZED | {"steady-torque"}),
}
