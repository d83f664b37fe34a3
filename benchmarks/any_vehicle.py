"""What an estimate is worth on vehicles that nobody chose: drawn at random, flown without a fault, and estimated.

    python benchmarks/any_vehicle.py > docs/any-vehicle.md

Each number is a vehicle of its own, 8 cm to 2.5 m and a tenth of a kilogram to a tonne: jets in pairs, at the corners, or none but a
wrench; in free flight or on a bearing, with its mass weighed or not; cycles of 10 to 100 ms, delays, ramps, an IMU turned and out of place
with noise of 5 to 500 microrad/s and 1 to 30 mm/s² in a cycle's mean; biases, pulse errors, disturbance torques and an uncertain thrust
here and there. All that is uncertain is stated in its vehicle file, so no log has a fault, and whatever is warned of is a false alarm.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from typing import Any

import numpy as np
from commit import commit

from massprop_cli import QUANTITIES, __version__, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate

FAR = 4.0
"""Sigmas beyond which a value is wrong."""


def drawn_between(draw: np.random.Generator, least: float, most: float) -> float:
    """Evenly in the logarithm."""
    return float(np.exp(draw.uniform(np.log(least), np.log(most))))


def turned(draw: np.random.Generator) -> Array:
    """(3, 3) any rotation."""
    found: Array = np.linalg.qr(draw.normal(size=(3, 3)))[0]
    found *= np.sign(np.linalg.det(found))
    return found


def jets(draw: np.random.Generator, size: float, torque: Array, force: float) -> list[tuple[Array, Array]]:
    """Places and forces: pairs about and along each axis, or three at each corner, pointing not quite along the axes."""
    unit = np.eye(3)
    if draw.random() < 0.55:
        axes = turned(draw) if draw.random() < 0.3 else unit
        pairs = [
            (side * size * unit[(i + 1) % 3], sign * side * torque[i] / 2 / size * unit[(i + 2) % 3])
            for i in range(3)
            for sign in (1, -1)
            for side in (1, -1)
        ]
        along = [(np.zeros(3), sign * force * unit[i]) for i in range(3) for sign in (1, -1)]
        return [(axes @ place, axes @ push) for place, push in (*pairs, *along)]
    corners = [np.array([x, y, z]) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
    return [
        (size * corner * draw.uniform(0.8, 1.2, 3), -corner[i] * force / 4 * unit[i] + draw.normal(size=3) * force / 40)
        for corner in corners
        for i in range(3)
    ]


def plan(draw: np.random.Generator, cycles: int, bearing: bool) -> list[dict[str, Any]]:
    """Each axis alone, rest, each push or a closed loop, all together."""
    part, every = cycles // 8, int(draw.choice([4, 5, 8]))

    def segment(motion: str, axes: tuple[str, ...], first: int, last: int, **more: Any) -> dict[str, Any]:
        pulses = {"every_cycles": every, "max_cycles": every - 1} if motion == "random" else {}
        named = {"axes": list(axes)} if axes else {}
        return {"motion": motion, **named, "start_cycle": first * part, "end_cycle": cycles if last == 8 else last * part, **pulses, **more}

    turns, pushes = ("roll", "pitch", "yaw"), ("x", "y", "z")
    found = [segment("random", (axis,), i, i + 1) for i, axis in enumerate(turns)] + [segment("hold", (), 3, 4)]
    if bearing:
        found.append(segment("random", turns, 4, 8, closed_loop=True))
        return found + ([segment("steady", ("y",), 5, 6)] if draw.random() < 0.5 else [])
    found += [segment("random", (axis,), 4 + i, 5 + i) for i, axis in enumerate(pushes)]
    return [*found, segment("hold", (), 4, 7), segment("random", turns + pushes, 7, 8)]


def scenario_of(number: int) -> tuple[dict[str, Any], bool]:
    """A vehicle and its flight; whether it is on a bearing."""
    draw = np.random.default_rng(number)
    size, period, cycles = drawn_between(draw, 0.08, 2.5), float(draw.choice([0.01, 0.02, 0.05, 0.1])), int(draw.choice([400, 600, 900]))
    mass, bearing, wrench = drawn_between(draw, 1, 400) * size / 0.5, bool(draw.random() < 0.35), bool(draw.random() < 0.2)
    squares = (size * draw.uniform(0.5, 1.5, 3)) ** 2
    axes = turned(draw) if draw.random() < 0.5 else np.eye(3)
    inertia = axes @ np.diag(mass / 3 * (squares.sum() - squares) * draw.uniform(0.7, 1.0)) @ axes.T
    alpha = drawn_between(draw, 0.03, 0.4)
    push, torque = alpha * size * drawn_between(draw, 0.3, 2), np.diag(inertia) * alpha
    centre = draw.normal(size=3) * 0.1 * size * (draw.random() < 0.5) if bearing else np.zeros(3)
    away = draw.normal(size=3) * (3e-4 if bearing else 0.05) * size
    away *= min(1.0, 0.3 * torque.min() / (mass * 9.81 * float(np.linalg.norm(away)))) if bearing else 1.0
    truth = dict(zip(QUANTITIES, (*inertia[np.triu_indices(3)], *(centre + away), mass), strict=True))
    stiffness = min(0.06 / period, 1.0) ** 2
    imu: dict[str, Any] = {
        "position_m": draw.normal(size=3) * 0.3 * size,
        "gyro_noise_rad_s": drawn_between(draw, 5e-6, 5e-4),
        "accel_noise_m_s2": drawn_between(draw, 1e-3, 3e-2),
    }
    sensors: dict[str, Any] = {"records_per_cycle": int(draw.choice([1, 2, 5])), "log_attitude": bool(bearing and draw.random() < 0.3)}
    if draw.random() < 0.5:
        imu["body_from_imu"] = turned(draw)
    if draw.random() < 0.3:
        imu["gyro_bias_sigma_rad_s"] = min(drawn_between(draw, 1e-5, 1e-3), 0.1 / (cycles * period) if bearing else 1.0)
        sensors["gyro_bias_rad_s"] = draw.normal(size=3) * imu["gyro_bias_sigma_rad_s"]
    if draw.random() < 0.3:
        imu["accel_bias_sigma_m_s2"] = drawn_between(draw, 1e-3, 2e-2)
        sensors["accel_bias_m_s2"] = draw.normal(size=3) * imu["accel_bias_sigma_m_s2"]
    environment: dict[str, Any] = {"kind": "air_bearing" if bearing else "free"}
    vehicle: dict[str, Any] = {"schema": 1, "name": f"vehicle {number}", "imu": imu, "environment": environment}
    vehicle["cycle"] = {"period_s": period, "command_delay_cycles": float(draw.choice([0, 0.5, 1, 1.3, 2, 3]))}
    vehicle["thrust"] = {"scale_sigma": 0.02 * (draw.random() < 0.25), "pulse_sigma": 0.01 * (draw.random() < 0.2)}
    if draw.random() < 0.2:
        environment["disturbance_torque_n_m"] = torque.min() * drawn_between(draw, 1e-3, 3e-2)
    if bearing:
        environment |= {"bearing_position_m": centre, "bearing_mass_kg": mass * float(draw.choice([0.0, 0.1]))}
        if draw.random() < 0.5:
            vehicle["known"] = {"mass": {"value": mass * (1 + 1e-3 * draw.normal()), "sigma": 1e-3 * mass}}
    found = {"schema": 1, "name": f"vehicle-{number}", "duration_cycles": cycles, "truth": truth, "sensors": sensors, "vehicle": vehicle}
    found["control"] = {"rate_gain_n_m_s": 1.4 * stiffness**0.5 * np.diag(inertia), "attitude_gain_n_m": stiffness * np.diag(inertia)}
    if wrench:
        found["actuators"] = {"max_torque_n_m": torque, "max_force_n": [mass * push] * 3}
    else:
        ramp = period * float(draw.choice([0, 0.05, 0.2]))
        vehicle["cycle"]["pwm_tick_s"] = period / 20
        vehicle["jets"] = [
            {"name": f"jet_{i}", "position_m": place, "force_n": force, "rise_s": ramp, "fall_s": ramp}
            for i, (place, force) in enumerate(jets(draw, size, torque, mass * push))
        ]
    return found | {"plan": plan(draw, cycles, bearing)}, bearing


def estimated(number: int) -> tuple[bool, flow.Analysis, Array]:
    """Of one vehicle: whether it is on a bearing, what is said of its log, and the truth."""
    data, bearing = scenario_of(number)
    plain = json.loads(json.dumps(data, default=np.ndarray.tolist))
    source = scenario.ScenarioSource(scenario.Scenario.model_validate(plain), str(data["name"]))
    flight = simulate.fly(source, [number])
    return bearing, flow.examine(flight.log(0), VehicleSource(flight.vehicle, "", "")), source.scenario.truth.values


def main() -> None:
    """The page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    errors: dict[bool, list[float]] = {False: [], True: []}
    verdicts, codes, far, unflown, flagged = Counter[str](), Counter[str](), list[str](), 0, 0
    for number in range(asked.first, asked.first + asked.vehicles):
        try:
            bearing, found, truth = estimated(number)
        except InputError:
            unflown += 1  # it turned over, or left the bearing's range
            continue
        estimates = found.conclusions[0].estimates
        codes.update({notice.code for notice in found.notices})
        flagged += bool(found.notices)
        for (name, estimate), true in zip(estimates.items(), truth, strict=True):
            verdicts[estimate.verdict] += 1
            if estimate.verdict in ("converged", "not_converged") and estimate.value is not None and estimate.sigma:
                errors[bearing].append((estimate.value - true) / estimate.sigma)
                if abs(errors[bearing][-1]) > FAR:
                    far.append(f"vehicle {number}, {name}: {errors[bearing][-1]:+.1f} sigma")
    flown = asked.vehicles - unflown
    print("# Vehicles that nobody chose\n")
    print(f"Made by `python benchmarks/any_vehicle.py > docs/any-vehicle.md` at commit {commit()} (massprop {__version__}).\n")
    print((__doc__ or "").partition("docs/any-vehicle.md\n\n")[2])
    print("z is the error over the claimed sigma, of every value called converged or not_converged.\n")
    print(f"| | values | z rms | 95 % covers | beyond {FAR:g} sigma |\n|---|--:|--:|--:|--:|")
    for bearing, label in ((False, "free flight"), (True, "air bearing")):
        z = np.abs(errors[bearing])
        print(f"| {label} | {len(z)} | {np.sqrt((z**2).mean()):.2f} | {100 * (z < 1.96).mean():.1f} % | {int((z > FAR).sum())} |")
    print(f"\nOf {flown} logs {flagged} have a warning: {', '.join(f'{code} {count}' for code, count in codes.most_common()) or 'none'}.")
    print(f"Verdicts: {', '.join(f'{verdict} {count}' for verdict, count in verdicts.most_common())}. Not flown: {unflown}.")
    print("".join(f"\n- {line}" for line in far))


if __name__ == "__main__":
    main()
