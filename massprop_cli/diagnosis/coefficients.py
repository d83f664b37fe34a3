"""Model of the free coefficients of :mod:`massprop_cli.diagnosis.channelwise`: mass properties and error parameters.

The vector x determines all coefficients. It holds the ten mass properties θ of :mod:`massprop_cli.model.plant`, and the error parameters:
thrust, place and direction of each channel, scale and turn of gyro and accelerometer, biases, timing, torques, and rates of change. A
:class:`Hypothesis` names the entries that may differ from the stated values; :mod:`massprop_cli.diagnosis.comparison` fits them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property, partial

import numpy as np

from massprop_cli.base.arrays import ROUNDING, Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.quaternion import matrices
from massprop_cli.base.rigidbody import cross, cross_matrix, rotation, tensor
from massprop_cli.diagnosis.channelwise import FreeResponse
from massprop_cli.diagnosis.design import GYRO_ERRORS, INTEGRATED
from massprop_cli.diagnosis.hypothesis import STRAIGHT, Hypothesis
from massprop_cli.diagnosis.precession import PER_AXIS
from massprop_cli.diagnosis.verticals import walking
from massprop_cli.errorparameters.environment import LEVEL
from massprop_cli.errorparameters.table import BY_COLUMN, BY_NAME, ENTRIES, TABLE
from massprop_cli.inputs.commands import CommandKind
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import centripetal, gamma, products, products_by_rate, products_turned
from massprop_cli.model.plant import Plant, plant_of
from massprop_cli.model.plant.free import FreeBody
from massprop_cli.model.plant.plant import MOMENT, MU, J

_UNIT = np.eye(3)
RAMP = 2 / 3
"""Half the mean square delay of thrust that rises and falls linearly, over the square of its mean delay."""
_SENSORS = (slice(0, 3), slice(3, 6))
THETA = 10
"""Number of mass properties at the start of x. Error parameters follow; those of single channels come last."""


@dataclass(frozen=True)
class Model:
    """Free coefficients as functions of x, for C channels that act."""

    places: Mapping[str, slice]
    position: Array
    """(C, 3) place of each channel, from O, body axes, m."""
    force: Array
    """(C, 3) force of each channel at full thrust, N."""
    couple: Array
    """(C, 3) torque of each channel in addition to that of its force, N m."""
    imu: Array
    mounting: Array
    """(3, 3) body from IMU, as stated."""
    bearing: Array | None
    gravity: float
    level: Array
    """(3, 3) mean projector onto the horizontal plane, body axes."""
    lags: Mapping[str, float]
    """Stated time constants, cycles."""
    clock_s: tuple[float, float] = (0.0, 1.0)
    """Mean mid-cycle time since the start of the log, and length of the segment, s."""
    together: tuple[tuple[int, ...], ...] = ()
    """Groups of channels that always fire together."""
    biases: Mapping[str, float] = field(default_factory=dict)
    """Nuisance parameters of the vehicle file and their sigmas; in every fit, and no fault."""
    walking: Mapping[str, float] = field(default_factory=dict)
    """Nuisance parameters for the walk of an integrated attitude, and their sigmas; only with hypotheses about something else."""
    world: Array = field(default_factory=lambda: np.eye(3))
    """(3, 3) world axes at the start of the log, in rows, body axes; on a bearing."""
    room_torque: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) stated torque along the world axes, N m."""
    steady: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) specific force of the support on a table, which was subtracted, m/s²."""
    plant: Plant = field(default_factory=FreeBody)
    """Plant. On a pedestal forces do not move the mass, as with mu = 0."""
    kind: CommandKind = "jets"
    thrusting: int = 0
    """Number of commanded channels; the channels after them store momentum."""
    devices: Mapping[str, tuple[tuple[int, ...], ...]] = field(default_factory=dict)
    """Channels of each wheel and gyro, by table of the vehicle file."""
    fired: tuple[int, ...] = ()
    """Indices of the channels in the log."""
    released: Array | None = None
    """(10,) initial θ of a body that only its weight turns; None if the commands give it."""

    @staticmethod
    def of(free: FreeResponse, vehicle: Vehicle, lag: float, kind: CommandKind) -> Model:
        """Model for a free response; ``lag`` of the thrust as stated, cycles."""
        position, force, couple = (part[free.fired] for part in _channel_geometry(vehicle, kind))
        bearing = np.array(vehicle.environment.bearing_position_m) if vehicle.pivoted else None
        gravity = vehicle.environment.gravity_m_s2 if vehicle.pivoted else 0.0
        imu, mounting = np.array(vehicle.imu.position_m), np.array(vehicle.imu.body_from_imu)
        biases = {one.name: sigma for one in TABLE if one.estimated and (sigma := one.sigma(vehicle)) > 0}
        period = vehicle.cycle.period_s
        lags = {"lag": lag, "gyro_lag": vehicle.imu.gyro_lag_s / period, "accel_lag": vehicle.imu.accel_lag_s / period}
        (world,) = matrices(np.array([vehicle.environment.initial_attitude_wxyz]))
        world_forces = world, np.array(vehicle.environment.room_torque_n_m), vehicle.environment.steady_force_m_s2
        geometry = position, force, couple, imu, mounting, bearing
        thrusting = len(free.fired) - len(vehicle.momentum_wrench)
        commands = kind, thrusting, _devices(vehicle, thrusting)
        free_parts = free.level, lags, free.clock_s, _parallel_channels(free), biases, walking(free.places, free.clock_s, vehicle, biases)
        return Model(
            free.places, *geometry, gravity, *free_parts, *world_forces, plant_of(vehicle), *commands, fired=tuple(free.fired.tolist())
        )

    @cached_property
    def entries(self) -> dict[str, slice]:
        """Range of each parameter in x."""
        ranges, at = {"theta": slice(0, THETA)}, THETA
        for name in ENTRIES:
            size = BY_NAME[name].size * (len(self.force) if BY_NAME[name].per_channel else 1)
            ranges[name] = slice(at, at + size)
            at += size
        return ranges

    def place(self, name: str) -> slice:
        """Range of one parameter in x."""
        return self.entries[name]

    @property
    def nuisances(self) -> dict[str, float]:
        """Nuisance parameters of every fit, and their sigmas."""
        return {**self.biases, **self.walking}

    @property
    def stated(self) -> Array:
        """(nx,) x as stated, with mass properties zero."""
        x = np.zeros(self.place("direction").stop)
        x[self.place("thrust")] = 1.0
        return x

    def cg(self, x: Array) -> Array:
        """(3,) CG from O, body axes, m."""
        return np.asarray(self.plant.parameters(x[:THETA])[MOMENT] + x[self.place("bearing")])

    @property
    def uncertain(self) -> Array:
        """(nx, n) directions of the nuisance parameters in x, each scaled to its sigma."""
        unit = np.eye(len(self.stated))
        return np.hstack([unit[:, :0], *(sigma * unit[:, self.place(name)] for name, sigma in self.nuisances.items())])

    @cached_property
    def _columns(self) -> dict[bytes, int]:
        return {}

    def columns(self, moved: BoolArray) -> int:
        """Number of leading columns that a fit needs if it varies the entries ``moved`` (nx,)."""
        key = moved.tobytes()
        if key not in self._columns:
            self._columns[key] = self._counted(moved)
        return self._columns[key]

    def _counted(self, moved: BoolArray) -> int:
        count = np.concatenate([[0], np.cumsum(moved)])
        differing = {name for name, place in self.entries.items() if count[place.stop] > count[place.start]}
        differing |= {*self.nuisances, *["room_torque"] * bool(self.room_torque.any())}
        last = max(place.stop for name, place in self.places.items() if name not in BY_COLUMN or differing & BY_COLUMN[name])
        last_unswung = max(place.stop for name, place in self.places.items() if not name.startswith((*GYRO_ERRORS, *LEVEL)))
        return int(last_unswung if self.places["rates"].start < last < last_unswung else last)

    def channel(self, hypothesis: Hypothesis) -> int | None:
        """The channel that a hypothesis is about, if it is about one channel and nothing else."""
        rows = np.flatnonzero(hypothesis.varied)
        first, count = self.place("thrust").start, len(self.force)
        if not rows.size or rows[0] < first or hypothesis.gyro is not STRAIGHT or hypothesis.accelerometer is not STRAIGHT:
            return None
        at = rows - first
        channels = set(np.where(at < count, at, (at - count) // 3 % max(count, 1)).tolist())
        return channels.pop() if len(channels) == 1 else None

    def without(self, channel: int) -> Hypothesis:
        """Hypothesis that the effect of one channel is free, and nothing else."""
        return Hypothesis("", (), np.zeros((len(self.stated), 0))).with_free_channel(channel)

    def wired(self, does: Sequence[int], spun: Sequence[int]) -> Model:
        """Model with channels exchanged (``does``) and rotors reversed (``spun``)."""
        order, sign = list(does or range(len(self.force))), np.where(np.isin(np.arange(len(self.force)), spun), -1.0, 1.0)
        return replace(self, position=self.position[order], force=self.force[order], couple=sign[:, None] * self.couple[order])

    @property
    def turns(self) -> BoolArray:
        """(3,) axes about which the body can turn; on a table only Z."""
        return self.plant.observable[[0, 3, 5]]

    def wrench(self, x: Array) -> tuple[Array, Array]:
        """(..., C, 3) torque about O and force of each channel.

        An error of the direction turns the force, or the torque of a channel without force; its size stays.
        """
        shape = (*x.shape[:-1], -1, 3)
        thrust, pushes = x[..., self.place("thrust"), None], self.force.any(-1, keepdims=True)
        line = np.where(pushes, self.force, self.couple)
        along = line + x[..., self.place("direction")].reshape(shape)
        size, stated = (np.linalg.norm(part, axis=-1, keepdims=True) for part in (along, line))
        turned = thrust * along * (stated / np.where(stated > 0, size, 1.0))
        force, couple = np.where(pushes, turned, 0.0), np.where(pushes, thrust * self.couple, turned)
        position = self.position + x[..., self.place("position")].reshape(shape)
        return cross(position, force) + couple, force

    def coefficients(self, x: Array, gyro: Array, accelerometer: Array) -> Array:
        """(..., p, 6) coefficients for x (..., nx) and IMU turns: growth of the rate, specific force."""

        def get(name: str) -> Array:
            return x[..., self.entries[name]]

        theta = get("theta")
        moment, mu, turns = theta[..., MOMENT], theta[..., MU] * self.plant.translates, np.outer(self.turns, self.turns)
        inverse, inertia = (each * turns for each in (tensor(theta[..., J]), np.linalg.inv(tensor(theta[..., J]))))
        torque, force = self.wrench(x)
        centre = moment if self.bearing is None else self.bearing + get("bearing")
        about = torque - cross(centre[..., None, :], force)
        by_product = -inverse @ gamma(inertia)
        felt = partial(self._felt, arm=self.imu + get("imu") - centre, moment=moment, mu=mu)
        spin: dict[str, Array] = {
            "channels": np.einsum("...ij,...cj->...ic", inverse, about),
            "products": by_product,
            "constant": inverse @ get("torque")[..., None],
        }
        if "rates" in self.places:
            spin["rates"] = inverse * get("drag")[..., None, :]
        push: dict[str, Array] = {name: felt(part) for name, part in spin.items()}
        push["channels"] = push["channels"] + mu[..., None, None] * np.swapaxes(force, -1, -2)
        push["products"] = push["products"] + self._centripetal(self.imu + get("imu") - centre, moment, mu)
        push["constant"] = push["constant"] + get("accel_bias")[..., None]
        if "precession" in self.places:
            spin["precession"] = inverse @ _precession(torque[..., self.thrusting :, :], get("gyro_bias"))
            push["precession"] = felt(spin["precession"])
        if "rates" in self.places:
            for parts in (spin, push):
                _subtract_bias(parts, get("gyro_bias"))
        if "later" in self.places:
            response = np.concatenate([inverse, -inverse @ cross_matrix(centre)], -1)
            through = felt(response)
            thrust = through.copy()
            thrust[..., 3:] += mu[..., None, None] * _UNIT
            self._add_times(spin, push, x, response, thrust)
            age, lighter = get("inertia_rate")[..., None], get("mass_rate")[..., None]
            spin["aging"] = -age * response
            push["aging"] = -age * through - lighter * (thrust - through)
        if self.bearing is not None:
            spin["level"] = -inverse @ cross_matrix(moment) * mu[..., None, None]
            spin["channels"] = spin["channels"] + np.einsum("...ij,...cj->...ic", spin["level"], force)
            self._add_weight(spin, push, x, inverse, felt)
        for name in sorted({"slope 0", "slope 1"} & self.places.keys()):
            spin[name], push[name] = np.zeros((3, 3)), get("slope")[..., int(name[-1]), None, None] * _UNIT
        return self._measured(spin, push, x, gyro, accelerometer)

    def _add_times(self, spin: dict[str, Array], push: dict[str, Array], x: Array, response: Array, thrust: Array) -> None:
        """Add coefficients of delay, lag, clock drift, ramps and supply, in place.

        A stated lag L that is L + e has the transfer function ``(1 + sL) / (1 + s(L + e)) = 1 − s e + s² e (L + e) − …`` relative to the
        stated one. For a sensor the first term is used with the sensor's lag, ``− s e / (1 + sL)``.
        """
        delay, lag, rise, fall = (x[..., self.entries[name]][..., 0] for name in ("delay", "lag", "rise", "fall"))
        for own, parts, sensor in ((response, spin, "gyro_lag"), (thrust, push, "accel_lag")):
            more = x[..., self.entries[sensor]][..., 0]
            begins = more if self.lags[sensor] == 0 else np.zeros_like(more)
            later = delay + lag + begins
            smeared = (later**2 + lag**2 + begins**2) / 2 + lag * self.lags["lag"]
            parts["later"] = later[..., None, None] * own
            parts["lagging"] = (more - begins)[..., None, None] * own
            parts["smeared"] = (smeared + RAMP * rise * fall)[..., None, None] * own
            parts["drifting"] = x[..., self.entries["drift"]][..., None] * own
            parts["rising"] = rise[..., None, None] * own
            parts["falling"] = fall[..., None, None] * own
            parts["sagging"] = x[..., self.entries["droop"]][..., None] * own
            parts["ebbing"] = x[..., self.entries["cycle_droop"]][..., None] * own

    def _add_weight(self, spin: dict[str, Array], push: dict[str, Array], x: Array, inverse: Array, felt: Callable[[Array], Array]) -> None:
        """Add coefficients of the weight, of horizontal forces and of a torque fixed in the room, in place; on a bearing."""
        spin["up"] = -self.gravity * inverse @ cross_matrix(x[..., MOMENT])
        push["up"] = self.gravity * _UNIT + felt(spin["up"])
        push["level"] = (x[..., MU] * self.plant.translates)[..., None, None] * _UNIT + felt(spin["level"])
        self._add_swings(spin, push, x)
        for one, torque in zip((*LEVEL, "up"), np.moveaxis(self.room_torque + x[..., self.entries["room_torque"]], -1, 0), strict=True):
            spun = inverse * torque[..., None, None]
            spin[one], push[one] = spin[one] + spun, push[one] + felt(spun)

    def _add_swings(self, spin: dict[str, Array], push: dict[str, Array], x: Array) -> None:
        """Add coefficients of a wrong vertical, in place; on a bearing: initial tilt, and gyro errors that turn it.

        If the gyro's axes are turned by δ, the integrated vertical turns by −δ from an initial vertical that is turned by δ. A turn of the
        body about the world's X moves its vertical along Y; a turn about Y moves it along −X.
        """
        turn, tilt = x[..., self.entries["gyro_turn"]], x[..., self.entries["tilt"]]
        integrated = INTEGRATED in self.places
        away = integrated * (np.stack([-tilt[..., 1], tilt[..., 0]], -1) + cross(turn, self.world[2]) @ self.world[:2].T)
        for i, name in enumerate(LEVEL):
            spin[name], push[name] = away[..., i, None, None] * spin["up"], away[..., i, None, None] * push["up"]
        for name in GYRO_ERRORS:
            for i in range(3):
                if f"{name} {i}" in self.places:
                    by = x[..., self.entries[name]][..., i, None, None]
                    spin[f"{name} {i}"], push[f"{name} {i}"] = by * spin["up"], by * push["up"]
        if integrated:
            spin["up"], push["up"] = (part - part @ cross_matrix(turn) for part in (spin["up"], push["up"]))

    def _felt(self, spin: Array, arm: Array, moment: Array, mu: Array) -> Array:
        """(..., 3, n) specific force at the IMU by angular accelerations (..., 3, n)."""
        felt: Array = -cross_matrix(arm) @ spin
        if self.bearing is not None:
            felt = felt + self.level @ (cross_matrix(moment * mu[..., None]) @ spin)
        return felt

    def _centripetal(self, arm: Array, moment: Array, mu: Array) -> Array:
        """(..., 3, 6) specific force at the IMU by products of rates."""
        found = centripetal(arm)
        if self.bearing is not None:
            found = found - self.level @ centripetal(moment * mu[..., None])
        return found

    def _measured(self, spin: Mapping[str, Array], push: Mapping[str, Array], x: Array, gyro: Array, accelerometer: Array) -> Array:
        """Coefficients in axes, units and scales of the IMU that measured."""
        found = np.zeros((*x.shape[:-1], max(p.stop for p in self.places.values()), 6))
        for name, place in self.places.items():
            found[..., place, :3], found[..., place, 3:] = np.swapaxes(spin[name], -1, -2), np.swapaxes(push[name], -1, -2)
        base = [np.broadcast_to(turn, (*x.shape[:-1], 3, 3)) for turn in (gyro, accelerometer)]
        other = (x[..., self.entries["gyro_turn"].start : self.entries["accel_scale"].stop] != 0).any(-1)
        other = other | ((base[0] != _UNIT) | (base[1] != _UNIT)).any((-2, -1))
        if other.any():
            found[other] = self._turned(found[other], x[other], base[0][other], base[1][other])
        return found

    def _turned(self, found: Array, x: Array, gyro: Array, accelerometer: Array) -> Array:
        """(N, p, 6) coefficients of IMUs that are turned or scaled."""
        turns = []
        for name, base in (("gyro", gyro), ("accel", accelerometer)):
            scale = np.exp(x[:, self.place(f"{name}_scale")])
            along = self.mounting @ (scale[:, :, None] * self.mounting.T)  # the IMU's own axes
            turns.append(along @ rotation(x[:, self.place(f"{name}_turn")]) @ base)
        back = np.linalg.inv(turns[0])
        turned = np.concatenate([found[..., axes] @ turn.swapaxes(1, 2) for turn, axes in zip(turns, _SENSORS, strict=True)], -1)
        turned[:, self.places["constant"], 3:] += ((turns[1] - _UNIT) @ self.steady)[:, None]
        for name, columns in (("products", products_turned(back)), ("rates", back)):
            if name in self.places:
                turned[:, self.places[name]] = columns.swapaxes(1, 2) @ turned[:, self.places[name]]
        if "precession" in self.places:
            place = self.places["precession"]
            for at in range(place.start, place.stop, PER_AXIS):
                turned[:, at : at + 3] = back.swapaxes(1, 2) @ turned[:, at : at + 3]
        return turned


def _devices(vehicle: Vehicle, first: int) -> dict[str, tuple[tuple[int, ...], ...]]:
    found: dict[str, tuple[tuple[int, ...], ...]] = {}
    # rotors are momentum devices without a table of their own
    stating = [one for _, own in vehicle.actuators for one in own if one.device is not None]
    for device, one in zip(vehicle.spinning, stating, strict=True):
        own, first = tuple(range(first, first + len(device.axes))), first + len(device.axes)
        if one is device:
            found[device.TABLE] = (*found.get(device.TABLE, ()), own)
    return found


def _channel_geometry(vehicle: Vehicle, kind: CommandKind) -> tuple[Array, Array, Array]:
    """(C, 3) place, force that moves the vehicle at full thrust, and additional torque of each channel."""
    if kind == "jets":
        position, force = np.array([jet.position_m for jet in vehicle.jets]).reshape(-1, 3), vehicle.jet_wrench[:, 3:]
        couple = np.zeros_like(force)
    elif kind == "rotors":
        position, force = np.array([rotor.position_m for rotor in vehicle.rotors]).reshape(-1, 3), vehicle.rotor_wrench[:, 3:]
        couple = vehicle.rotor_wrench[:, :3] - cross(position, force)
    else:
        position, couple, force = np.tile(vehicle.thrust.wrench_point_m, (6, 1)), np.eye(6)[:, :3], np.eye(6)[:, 3:]
    stored = vehicle.momentum_wrench[:, :3] * vehicle.environment.moving[:3]
    none = np.zeros_like(stored)
    return np.vstack([position, none]), np.vstack([force * vehicle.environment.moving[3:], none]), np.vstack([couple, stored])


def _precession(torque: Array, bias: Array) -> Array:
    """(..., 3, 4 A) torque of rates × stored momentum for axes (..., A, 3), and that by the gyro's ``bias``."""
    by_rate = -cross_matrix(torque)
    each = np.concatenate([by_rate, -(by_rate @ bias[..., None, :, None])], -1)
    return np.moveaxis(each, -3, -2).reshape(*each.shape[:-3], 3, -1)


def _subtract_bias(parts: dict[str, Array], bias: Array) -> None:
    """Replace the rates by rates less their bias, in place."""
    parts["rates"] = parts["rates"] - parts["products"] @ products_by_rate(bias)
    parts["constant"] = parts["constant"] + parts["products"] @ products(bias)[..., None]


def _parallel_channels(free: FreeResponse) -> tuple[tuple[int, ...], ...]:
    """Groups of channels whose columns are parallel."""
    columns = free.accelerometer.triangle[:, free.places["channels"]]
    size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    alike = np.abs((columns / size).T @ (columns / size)) > 1 - ROUNDING
    groups = dict.fromkeys(tuple(int(i) for i in np.flatnonzero(row)) for row in alike)
    return tuple(group for group in groups if len(group) > 1)
