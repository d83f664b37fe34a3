"""What an estimate is worth on vehicles that nobody chose: drawn at random, flown without a fault, and estimated.

    python benchmarks/any_vehicle.py > docs/any-vehicle.md
    python benchmarks/any_vehicle.py --kind noise-low --vehicles 70

Each number is a vehicle of its own, 8 cm to 2.5 m and a tenth of a kilogram to a tonne: jets in pairs, at the corners, or none but a
wrench; in free flight or on a bearing, with its mass weighed or not; cycles of 10 to 100 ms, delays, ramps, an IMU turned and out of place
with noise of 5 to 500 microrad/s and 1 to 30 mm/s² in a cycle's mean; biases, pulse errors, disturbance torques and an uncertain thrust
here and there. All that is uncertain is stated in its vehicle file, so no log has a fault, and whatever is warned of is a false alarm.
"""

import json
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from any_kinds import KINDS, Kind, drawn_between, turned
from scores import covered, rms_of
from script import commit, counted

from massprop_cli import QUANTITIES, __version__, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.verdict import Estimate
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.testbed import scenario, simulate

FAR = 4.0
"""Sigmas beyond which a value is wrong."""


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
    """Commands on each axis alone, a pause, forces or a closed loop, then all axes together."""
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
    """A random vehicle and its flight, and whether it is on a bearing."""
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


def source_of(data: dict[str, Any]) -> scenario.ScenarioSource:
    """The scenario as if read from a file."""
    return scenario.ScenarioSource(scenario.Scenario.model_validate_json(_json(data)), str(data["name"]))


def _json(data: dict[str, Any]) -> str:
    return json.dumps(data, default=np.ndarray.tolist)


class Flown(NamedTuple):
    """What massprop reports on one log: estimates and truth of each body, and warnings."""

    bearing: bool
    bodies: list[tuple[dict[str, Estimate], Array]]
    notices: tuple[Notice, ...]
    causal: Array
    """(n,) errors over sigmas of all values that were given on the way, but of quantities that are contradicted in the end."""


def estimated(number: int, kind: Kind | None = None) -> Flown | None:
    """The outcome of one random vehicle's flight; None where it cannot be flown."""
    data, bearing = scenario_of(number)
    if kind is not None and kind.free and bearing:
        return None
    if kind is not None:
        kind.change(data, np.random.default_rng(number + 777_000))
    stated = data.pop("stated", None)
    source = source_of(data)
    try:
        flight = simulate.fly(source, [number])
        vehicle = flight.vehicle if stated is None else Vehicle.model_validate_json(_json(stated))
        found = flow.examine(flight.log(0), VehicleSource(vehicle, "", ""))
    except InputError:
        return None  # it turned over, or left the bearing's range
    bodies = [(conclusion.estimates, truth) for conclusion, truth in zip(found.conclusions, flight.truth[0], strict=True)]
    if found.docked is not None and source.scenario.docked is not None:
        bodies.append((found.docked.estimates, source.scenario.docked.values))
    causal = []
    for history, conclusion, truth in zip(found.histories, found.conclusions, flight.truth[0], strict=True):
        held = [estimate.verdict != "contradicted" for estimate in conclusion.estimates.values()]
        with np.errstate(invalid="ignore"):
            causal.append(((history.values - truth) / history.sigmas)[:, held])
    return Flown(bearing, bodies, found.notices, np.concatenate([z[np.isfinite(z)] for z in causal]))


class Tally:
    """Counts over many logs."""

    def __init__(self, said: frozenset[str] = frozenset()) -> None:
        self.said = said
        self.errors: dict[bool, list[float]] = {False: [], True: []}
        self.verdicts, self.codes = Counter[str](), Counter[str]()
        self.far: list[str] = []
        self.flown = self.unflown = self.flagged = 0
        self.given = self.wrong = self.absurd = self.covered = 0
        """Values on the way: all, beyond :data:`FAR` and twice that, and within the 95 % interval."""
        self.astray: list[str] = []

    def add(self, number: int, flown: Flown | None) -> None:
        """Count one more log."""
        if flown is None:
            self.unflown += 1
            return
        self.flown += 1
        beyond = {notice.code for notice in flown.notices} - self.said
        self.codes.update(beyond)
        self.flagged += bool(beyond)
        z = np.abs(flown.causal)
        absurd = int((z > 2 * FAR).sum())
        self.given, self.wrong, self.absurd = self.given + len(z), self.wrong + int((z > FAR).sum()), self.absurd + absurd
        self.covered += int((z < 1.96).sum())
        self.astray += [f"vehicle {number}: {absurd} of {len(z)}, the worst {z.max():.3g} sigma"] if absurd else []
        for estimates, truth in flown.bodies:
            for (name, estimate), true in zip(estimates.items(), truth, strict=True):
                self._value(number, name, estimate, float(true), flown.bearing)

    def _value(self, number: int, name: str, estimate: Estimate, true: float, bearing: bool) -> None:
        self.verdicts[estimate.verdict] += 1
        if estimate.verdict in ("converged", "not_converged") and estimate.value is not None and estimate.sigma:
            self.errors[bearing].append((estimate.value - true) / estimate.sigma)
            if abs(self.errors[bearing][-1]) > FAR:
                self.far.append(f"vehicle {number}, {name}: {self.errors[bearing][-1]:+.1f} sigma")

    def row(self, label: str, bearing: bool | None) -> str:
        """A row of the table."""
        z = np.abs([*(self.errors[False] if not bearing else ()), *(self.errors[True] if bearing is not False else ())])
        return f"{label} | {len(z)} | {rms_of(z)} | {covered(z)} | {int((z > FAR).sum())} |"

    @property
    def way(self) -> str:
        """Coverage of the values before the end of each log."""
        wrong, absurd, covered = (100 * count / max(self.given, 1) for count in (self.wrong, self.absurd, self.covered))
        far, farther = f"{wrong:.3f} % beyond {FAR:g} sigma", f"{absurd:.3f} % beyond {2 * FAR:g}"
        return f"{self.given:,} values: {far}, {farther}; 95 % covers {covered:.1f} %"

    @property
    def alarms(self) -> str:
        """Warnings that the kind of flight does not explain."""
        return ", ".join(f"{code} {count}" for code, count in self.codes.most_common()) or "none"


def tally(numbers: range, kind: Kind | None = None) -> Tally:
    """Counts over these vehicles."""
    found = Tally(kind.said if kind else frozenset())
    for number in numbers:
        found.add(number, estimated(number, kind))
    return found


def main() -> None:
    """Print the page, or the row of one kind."""
    parser = counted(__doc__, vehicles=300, first=0)
    parser.add_argument("--each", type=int, default=70, help="vehicles of each kind of flight")
    parser.add_argument("--kind", choices=KINDS, help="of this kind alone")
    asked = parser.parse_args()
    numbers = range(asked.first, asked.first + asked.vehicles)
    if asked.kind:
        print(_row(asked.kind, tally(numbers, KINDS[asked.kind])))
        return
    found = tally(numbers)
    print("# Vehicles that nobody chose\n")
    print(f"Made by `python benchmarks/any_vehicle.py > docs/any-vehicle.md` at commit {commit()} (massprop {__version__}).\n")
    print((__doc__ or "").partition("--vehicles 70\n\n")[2])
    print("z is the error over the claimed sigma, of every value called converged or not_converged.\n")
    print(f"| | values | z rms | 95 % covers | beyond {FAR:g} sigma |\n|---|--:|--:|--:|--:|")
    for bearing, label in ((False, "free flight"), (True, "air bearing")):
        print(f"| {found.row(label, bearing)}")
    print(f"\nOf {found.flown} logs {found.flagged} have a warning: {found.alarms}.")
    print(f"Verdicts: {', '.join(f'{verdict} {count}' for verdict, count in found.verdicts.most_common())}. Not flown: {found.unflown}.")
    print("".join(f"\n- {line}" for line in found.far))
    print(f"\nOn the way, at all cycles, of what isn't contradicted in the end, {found.way}. Farther than {2 * FAR:g} sigma:\n")
    print("".join(f"- {line}\n" for line in found.astray))
    print(f"\n## Flown otherwise\n\nThe first {asked.each} of them, with one thing changed; of docking those in free flight.\n")
    print(
        f"| | logs | values | z rms | 95 % covers | beyond {FAR:g} sigma | warnings that are not due | on the way |\n"
        "|---|--:|--:|--:|--:|--:|---|---|"
    )
    for name in KINDS:
        print(_row(name, tally(range(asked.first, asked.first + asked.each), KINDS[name])), flush=True)


def _row(name: str, found: Tally) -> str:
    far = f"; {'; '.join(found.far)}" if found.far else ""
    return f"| {found.row(f'{name}: {KINDS[name].what} | {found.flown}', None)} {found.alarms}{far} | {found.way} |"


if __name__ == "__main__":
    main()
