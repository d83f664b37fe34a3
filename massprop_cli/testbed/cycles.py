"""Simulation of one or a few control cycles at a time, from commands to IMU increments."""

from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.errors import InputError
from massprop_cli.testbed import exchange, imu, mission, truth
from massprop_cli.testbed.actuators import Actuators
from massprop_cli.testbed.environment import dynamics_in
from massprop_cli.testbed.exchanger import Setting
from massprop_cli.testbed.motion import Bodies, CycleMotion, Dynamics, Wrench, compose, compose_all, quaternions, rotation_vectors, to_world
from massprop_cli.testbed.onboard import Onboard, RunningOf, nominal
from massprop_cli.testbed.rotors import Rotors
from massprop_cli.testbed.scenario import Scenario, ScenarioSource

BINS = 20
"""Minimum number of bins in a cycle."""
FINE = 100
"""Minimum number of bins with a sampled or filtered IMU, because a pulse that ends within a bin is spread over it."""
AHEAD = 512
"""Number of cycles, over all members, executed at once in open loop."""
TOGETHER = 8
"""Number of cycles integrated as one if no cycle affects the commands or the body of the next."""
STREAMS = ("plan", "pulses", "gyro", "accelerometer", "disturbance", "attitude")
"""Independent random streams, so that switching one off does not change the others."""


@dataclass(frozen=True)
class MemberChange:
    """Changes of individual members from the scenario, for sensitivities."""

    bodies: Bodies
    """Body of each member instead of the scenario's."""
    rate: Array
    """(3, S) change of the body rate, rad/s."""
    damping: Array | float = 0.0
    """(3, S) change of the damping about each axis, N m s."""
    thrust: Array | float = 1.0
    """(S,) factor on all thrust issued from then on."""


class Cycles:
    """State of a simulation with S members, K cycles of N records, body axes; call :meth:`fly` for successive cycles."""

    def __init__(
        self,
        source: ScenarioSource,
        seeds: Sequence[int],
        issued: Array | None,
        changes: Mapping[int, MemberChange],
        running: RunningOf | None = None,
        fine: bool = True,
    ) -> None:
        """Arguments as in :func:`massprop_cli.testbed.simulate.fly`."""
        self.source, self.seeds, self.changes = source, seeds, changes
        scenario = self.scenario = source.scenario
        rngs = self.rngs = {name: [np.random.default_rng([seed, i]) for seed in seeds] for i, name in enumerate(STREAMS)}
        self.members, self.period = len(seeds), scenario.vehicle.cycle.period_s
        self.bins = _bins(scenario, fine)
        self.width = self.period / self.bins
        self.allocated = mission.allocation(source)
        self.plan = mission.plan(scenario, self.allocated, rngs["plan"]) if issued is None else None
        edges = self.width * np.arange(self.bins + 1)
        jets, spun = (None, None) if issued is None else np.split(issued, [issued.shape[-1] - exchange.channels(scenario.vehicle)], -1)
        self.actuators = _actuators(scenario, rngs["pulses"], edges, jets)
        self.open_loop = self.plan is None or not (self.plan.held.any() or self.plan.held_by_wheels.any())
        if self.plan is not None and self.open_loop:
            self.actuators.issue(slice(None), self.allocated.commands(self.plan.demand))
        none: Array = np.zeros(0)
        self._executed = 0, 0, (none, none, none)
        self.exchange = exchange.Exchange(_setting(scenario, self.members, edges), spun)
        self.gyro, self.accelerometer = imu.gyro(scenario, rngs["gyro"]), imu.accelerometer(scenario, rngs["accelerometer"])
        self.torque = _disturbance(scenario, rngs["disturbance"])
        self.damping = np.array(scenario.disturbance.rate_n_m_s)[:, None, None]
        self.dynamics_of = dynamics_in(scenario)
        self.body = truth.bodies(scenario.truth, self.members)
        self._moved: tuple[Bodies, Dynamics] | None = None
        self.events = {event.at(self.period): event for event in scenario.events}
        self.records = scenario.sensors.records_per_cycle
        self.attitude = np.empty((self.members, scenario.cycles * self.records + 1, 4))
        """(S, K N + 1, 4) attitude at the start and at the end of each record."""
        self.rate = np.empty((self.members, scenario.cycles + 1, 3))
        """(S, K + 1, 3) body rate at cycle edges, rad/s."""
        initial = np.array(scenario.vehicle.environment.initial_attitude_wxyz)
        self.attitude[:, 0], self.rate[:, 0] = initial, scenario.initial.rate_rad_s
        alone = not self.open_loop or scenario.vehicle.spinning or scenario.fuel or (scenario.modelled and issued is None)
        self.together = 1 if alone or scenario.room_torque.any() else TOGETHER
        self.onboard = _onboard(source, np.repeat(initial[:, None], self.members, 1), running) if alone and issued is None else None
        self.modelled = np.zeros((self.members, scenario.cycles if scenario.modelled and issued is None else 0, 10))
        """(S, K, 10) body that the control assumed in each cycle; (S, 0, 10) without a model."""
        self.position = np.array(scenario.vehicle.imu.position_m)

    def truth(self) -> Array:
        """(S, 10) current true quantities."""
        return truth.values(self.body)

    def fly(self, k: int) -> int:
        """Simulate cycle k and the cycles integrated with it; return the next cycle.

        Order: events, commands, executed wrench, motion, IMU, fuel. Raises :class:`InputError` if the motion diverges or the fuel runs out.
        """
        jump = self._begin(k)
        self._command(k)
        # groups of cycles do not depend on the number of members or on later cycles
        breaks = self.scenario.cycles, *self.events, *self.changes
        until = min(k - k % self.together + self.together, *(cycle for cycle in breaks if cycle > k))
        mean, partial_impulse, burn_s = self._execute(k, until)
        disturbing = np.repeat(self.torque[:, :, k:until] + self._room_torque(k)[..., None], self.bins, -1)
        mean[:3] += disturbing
        partial_impulse[:3] += disturbing * (self.width / 2)
        spin = self.exchange.spin(k, self.rate[:, k].T, mean.shape[-1], self.actuators.spun(k))
        mean[:3] -= spin.torque
        partial_impulse[:3] -= spin.torque * (self.width / 2)
        here = self.attitude[:, k * self.records].T
        dynamics = self._dynamics()
        wrench = Wrench(mean, partial_impulse, spin.momentum, spin.torque, self.damping)
        motion = dynamics.advance(self.rate[:, k].T, dynamics.fixed(here), wrench, self.width)
        self.exchange.log(k, motion)
        self.rate[:, k + 1 : until + 1] = motion.ends.reshape(3, self.members, until - k, -1)[..., -1].transpose(1, 2, 0)
        records = slice(k * self.records + 1, until * self.records + 1)
        self.attitude[:, records] = _attitudes(here, motion, self.width, records.stop - records.start)
        self._sense(slice(k, until), motion, dynamics.specific_force(motion, mean[3:], self.position, self.width), jump)
        self._burn(k, burn_s)
        self._check_motion(k, until)
        return until

    def _room_torque(self, k: int) -> Array:
        """(3, S) world-fixed torque in body axes at the middle of cycle ``k``, extrapolated with the rate at its start, N m."""
        world = self.scenario.room_torque
        if not world.any():
            return np.zeros((3, self.members))
        middle = compose(self.attitude[:, k * self.records].T, quaternions(self.rate[:, k].T * (self.period / 2)))
        back = middle * np.array([[1.0], [-1.0], [-1.0], [-1.0]])
        return to_world(back, np.repeat(world[:, None], self.members, 1))

    def _dynamics(self) -> Dynamics:
        """Dynamics of the current bodies; cached until the bodies change."""
        if self._moved is None or self._moved[0] is not self.body:
            self._moved = self.body, self.dynamics_of(self._bare(self.body))
        return self._moved[1]

    def _bare(self, bodies: Bodies) -> Bodies:
        """Bodies without the inertia that the stored momentum accounts for."""
        return self.actuators.bare(self.exchange.bare(bodies))

    def _check_motion(self, first: int, last: int) -> None:
        """Raise :class:`InputError` if a member turns by more than 1 rad per cycle in the cycles from ``first`` to before ``last``."""
        wild = ~(np.abs(self.rate[:, first + 1 : last + 1]).max(2) <= 1 / self.period)
        if wild.any():
            k = int(wild.any(0).argmax())
            raise InputError(
                f"{self.source.source}, seed {self.seeds[int(wild[:, k].argmax())]}: the vehicle turns faster than one radian per cycle at "
                f"{self.period * (first + k + 1):g} s; check gains, delay, torques, disturbance and inertia"
            )

    def _begin(self, k: int) -> Array | float:
        """Apply events and changes at the start of a cycle; return the velocity jump (3, S) of the IMU, body axes, m/s.

        A wheel keeps its momentum over a rate jump, so its speed jumps.
        """
        jump: Array | float = 0.0
        if k in self.events and self.events[k].kind == "dock" and self.scenario.docked is not None:
            alone, other = self.body, truth.bodies(self.scenario.docked, self.members)
            self.body = truth.joined(alone, other, self.scenario.vehicle.bearing_mass_kg)
            both = self._bare(alone), other, self._bare(self.body)
            after, jump = truth.docked_motion(*both, self.rate[:, k].T, self.position, self.events[k])
            self.rate[:, k] = after.T
        if k in self.changes:
            self.body = self.changes[k].bodies
            self.rate[:, k] += self.changes[k].rate.T
            self.damping = self.damping + np.asarray(self.changes[k].damping)[..., None]
            self.actuators.strength[:, k:] *= np.asarray(self.changes[k].thrust)[..., None, None]
        return jump

    def _command(self, k: int) -> None:
        """Issue the commands of the plan and the attitude control; recorded commands stay."""
        if self.plan is None or self.onboard is None:
            return
        if self.scenario.modelled == "truth":
            self.onboard.body = self.truth()
        if self.scenario.modelled:
            self.modelled[:, k] = self.onboard.body
        demand, turning = self.plan.demand[:, k], self.plan.wheel_demand[:, k]
        torque = self.onboard.torque(demand[:, 3:]) if (self.plan.held[k] | self.plan.held_by_wheels[k]).any() else 0.0
        if self.plan.held[k].any():
            demand = demand + np.pad(torque * self.plan.held[k], ((0, 0), (0, 3)))
        if self.plan.held_by_wheels[k].any():
            turning = turning + torque * self.plan.held_by_wheels[k]
        if not self.open_loop:
            self.actuators.issue(k, self.allocated.commands(demand))
        self.exchange.issue(k, turning)

    def _execute(self, k: int, until: int) -> tuple[Array, Array, Array]:
        """Executed wrench of the actuators from cycle k to before ``until``; in open loop, many cycles are computed at once."""
        first, last, executed = self._executed
        if k >= last:
            ahead = self.together * max(AHEAD // self.members // self.together, 1) if self.open_loop else 1
            ends = k - k % self.together + ahead, self.scenario.cycles, *(cycle for cycle in self.changes if cycle > k)
            first, last = k, min(ends)
            executed = self.actuators.execute(first, last)
            self._executed = first, last, executed
        mean, partial_impulse, burn_s = executed
        mean, partial_impulse = (part[:, :, k - first : until - first].reshape(6, self.members, -1) for part in (mean, partial_impulse))
        return mean, partial_impulse, burn_s[:, k - first : until - first].sum(1)

    def _sense(self, cycles: slice, motion: CycleMotion, specific_force: Array, jump: Array | float) -> None:
        """Log rate and specific force (3, S, bins) by both sensors, and pass the increments to the on-board control."""
        angle = self.gyro.sense(cycles, self._recorded(self.gyro, motion.rate, motion.rate_dot * (self.width / 2)))
        recorded = self._recorded(self.accelerometer, specific_force, np.zeros_like(specific_force))
        velocity = self.accelerometer.sense(cycles, recorded, jump)
        if self.onboard is not None:
            self.onboard.learn(cycles.stop * self.period, self.actuators.issued[:, cycles.start], angle.T, velocity.T)
            self.onboard.sense(angle, np.array(self.scenario.vehicle.imu.body_from_imu), self.period)

    def _recorded(self, sensor: imu.Sensor, mean: Array, half_step: Array) -> Array:
        """(3, S, N) recorded values of bin means (3, S, bins), which change by ``half_step`` from the middle of a bin to its end."""
        per_record = (3, self.members, self.records * (mean.shape[-1] // self.bins), -1)
        if sensor.response is None:
            return np.asarray(mean.reshape(per_record).mean(-1))
        return sensor.response.records((mean - half_step).reshape(per_record), (mean + half_step).reshape(per_record), self.width)

    def _burn(self, k: int, burn_s: Array) -> None:
        """Subtract the fuel burnt in a cycle. Raises :class:`InputError` if mass or inertia is no longer positive."""
        bearing_mass, fuel = self.scenario.vehicle.bearing_mass_kg, self.scenario.fuel
        if fuel is None:
            return
        impulse = np.abs(burn_s) @ np.linalg.norm(self.actuators.wrench[:, 3:], axis=1)
        body = self.body = truth.burnt(self.body, fuel, impulse, bearing_mass)
        mass = body.mass - bearing_mass
        moment = np.linalg.eigvalsh(np.moveaxis(body.inertia, -1, 0))[:, 0]
        invalid = ~((mass > 0) & (moment > 0))
        if invalid.any():
            member = int(np.argmax(invalid))
            raise InputError(
                f"{self.source.source}, seed {self.seeds[member]}: at {self.period * (k + 1):g} s the fuel burnt leaves no body (mass "
                f"{mass[member]:.4g} kg, least moment of inertia {moment[member]:.4g} kg m^2); raise fuel.specific_impulse_s, or correct "
                "fuel.tank_position_m"
            )


def _onboard(source: ScenarioSource, attitude: Array, running: RunningOf | None) -> Onboard:
    """Attitude control of vehicles with initial attitude ``attitude`` (4, S)."""
    scenario, members = source.scenario, attitude.shape[1]
    body = np.repeat(nominal(scenario.vehicle.nominal)[None], members, 0)
    if scenario.modelled != "estimate":
        return Onboard(scenario.control, attitude, body, None)
    if running is None:
        raise InputError(f'{source.source}: control.model = "estimate" needs an estimator aboard; use massprop simulate, which has one')
    return Onboard(scenario.control, attitude, body, running(scenario.logged, source.source, members))


def _setting(scenario: Scenario, members: int, edges_s: Array) -> Setting:
    records, rate = scenario.sensors.records_per_cycle, scenario.initial.rate_rad_s
    return Setting(scenario.vehicle, scenario.actuators, members, scenario.cycles, records, scenario.delay_cycles, rate, edges_s)


def _bins(scenario: Scenario, fine: bool) -> int:
    """Number of bins in a cycle: a multiple of the records, and of the on-time ticks unless there are too many."""
    records, tick = scenario.sensors.records_per_cycle, scenario.tick_s
    ticks = round(scenario.vehicle.cycle.period_s / tick) if tick else 1
    base = int(np.lcm(records, ticks)) if ticks <= 4 * BINS and np.lcm(records, ticks) <= 10 * BINS else records
    imu = scenario.vehicle.imu
    averages = imu.measures != "sample" and imu.gyro_filter is None and imu.accel_filter is None
    minimum = FINE if fine and not averages else BINS
    return base * -(-minimum // base)


def _actuators(scenario: Scenario, rngs: list[np.random.Generator], edges_s: Array, issued: Array | None) -> Actuators:
    vehicle, real = scenario.vehicle, scenario.actuators
    wrench = vehicle.jet_wrench if vehicle.jets else vehicle.rotor_wrench if vehicle.rotors else np.eye(6)
    shape = (scenario.cycles, len(wrench))
    sigma = vehicle.thrust.pulse_sigma if real.pulse_sigma is None else real.pulse_sigma
    strength = real.scale * np.stack([1 + sigma * rng.standard_normal(shape) if sigma else np.ones(shape) for rng in rngs])
    start = vehicle.cycle.period_s * (np.arange(scenario.cycles) + scenario.delay_cycles)  # of execution
    for failure in scenario.failures:
        strength[:, failure.of(start), [jet.name for jet in vehicle.jets].index(failure.jet)] *= failure.thrust
    actuators = (Rotors if vehicle.rotors else Actuators)(scenario, wrench, strength, edges_s)
    if issued is not None:
        actuators.issued[:] = issued
    return actuators


def _disturbance(scenario: Scenario, rngs: list[np.random.Generator]) -> Array:
    """(3, S, K) disturbance torque that does not depend on the motion, body axes, N m."""
    stated, real = scenario.vehicle.environment, scenario.disturbance
    white = stated.disturbance_torque_n_m if real.torque_n_m is None else real.torque_n_m
    walk = stated.disturbance_walk_n_m if real.walk_n_m is None else real.walk_n_m
    shape = (scenario.cycles, 3)
    drawn = np.stack([white * rng.standard_normal(shape) + np.cumsum(walk * rng.standard_normal(shape), 0) for rng in rngs])
    middle = scenario.vehicle.cycle.period_s * (np.arange(scenario.cycles) + 0.5)
    periodic = np.sin(2 * np.pi / real.periodic_s * middle)[:, None] * np.array(real.periodic_n_m)
    return np.moveaxis(drawn + periodic + np.array(real.constant_n_m), -1, 0)


def _attitudes(attitude: Array, motion: CycleMotion, width_s: float, records: int) -> Array:
    """(S, N, 4) attitude at the end of each of N records, from ``attitude`` (4, S)."""
    turns = quaternions(rotation_vectors(motion, width_s))
    turns = compose_all(turns.reshape(4, attitude.shape[1], records, -1))
    attitudes = np.empty((attitude.shape[1], records, 4))
    for record in range(records):
        attitude = compose(attitude, turns[..., record])
        attitude = attitude / np.sqrt((attitude * attitude).sum(0))
        attitudes[:, record] = attitude.T
    return attitudes
