"""Commands that are logged otherwise than they acted, in ways that no error parameter describes."""

from collections.abc import Callable
from functools import partial

import numpy as np
from fault_thrust import Random, stated_forces
from fault_vehicles import Case, Subject

from massprop_cli.base.arrays import Array

Maker = Callable[[Subject, Random], Case | None]


def _command(s: Subject) -> Array:
    return s.clean.log.command


def commanded(s: Subject) -> bool:
    """Whether the log has any command."""
    return bool(_command(s).any())


def _logged(s: Subject, command: Array) -> Case:
    return s.clean.logging(command=command)


def clock(s: Subject) -> Array:
    """(K, 1) time from 0 to 1."""
    return np.linspace(0.0, 1.0, len(_command(s)))[:, None]


def throttled(s: Subject, part: Array) -> Case:
    """Commands that give as much as they did, of which the log says ``part`` (K, C or 1) times that; right in the mean."""
    flown, logged = _command(s), _command(s) * part
    mean = float(np.abs(logged).sum() / np.abs(flown).sum())
    if not s.vehicle.jets:
        return _logged(s, logged / mean)
    return stated_forces(s, _logged(s, logged), {jet.name: 1 / mean for jet in s.vehicle.jets})


def _used(s: Subject, rng: Random) -> int:
    return int(rng.choice(np.flatnonzero((_command(s) != 0).any(0))))


def _warming(s: Subject, _: Random) -> Case:
    pulses = np.cumsum(_command(s) != 0, 0)
    return throttled(s, 1 / (1 + 0.3 * (1 - np.exp(-pulses / 10.0))))


def _stepping(s: Subject, rng: Random) -> Case:
    count = len(_command(s))
    return throttled(s, np.repeat(rng.uniform(0.85, 1.0, 8), -(-count // 8))[:count, None])


def _rippling(s: Subject, rng: Random) -> Case:
    return throttled(s, 0.9 + 0.1 * np.sin(2 * np.pi * (rng.uniform(3, 8) * clock(s) + rng.uniform())))


def _scattering(s: Subject, rng: Random, sigma: float) -> Case:
    return throttled(s, np.clip(1 - 3 * sigma + sigma * rng.standard_normal(_command(s).shape), 0.6, 1.0))


def _least_bit(s: Subject, _: Random) -> Case | None:
    on = _command(s)
    return _logged(s, np.where(on > 0, np.maximum(on - 0.04 * s.period_s, 0.1 * on), 0.0)) if s.vehicle.jets else None


def _counted(s: Subject, _: Random) -> Case | None:
    unit_s = s.period_s / 8
    return _logged(s, np.minimum(np.round(_command(s) / unit_s) * unit_s, s.period_s)) if s.vehicle.jets else None


def _one_late(s: Subject, rng: Random) -> Case:
    command, i = _command(s).copy(), _used(s, rng)
    command[:-1, i], command[-1, i] = command[1:, i].copy(), 0.0
    return _logged(s, command)


def _from_half_time(s: Subject, rng: Random, factor: float) -> Case:
    """One channel gives ``factor`` times as much from half time on."""
    command = _command(s).copy()
    command[len(command) // 2 :, _used(s, rng)] *= factor
    return _logged(s, command)


def _missing(s: Subject, rng: Random) -> Case:
    command = _command(s).copy()
    command[rng.choice(len(command), max(3, len(command) // 50), replace=False)] = 0.0
    return _logged(s, command)


def _disordered(s: Subject, rng: Random) -> Case:
    command = _command(s).copy()
    for k in rng.choice(np.arange(1, len(command) - 2), max(3, len(command) // 30), replace=False):
        command[[k, k + 1]] = command[[k + 1, k]]
    return _logged(s, command)


def _delay_jumps(s: Subject, _: Random) -> Case:
    command, half = _command(s).copy(), len(_command(s)) // 2
    command[half:-1], command[-1] = command[half + 1 :].copy(), 0.0
    return _logged(s, command)


def _delay_alternates(s: Subject, _: Random) -> Case:
    command, later = _command(s), np.zeros_like(_command(s))
    later[:-1] = command[1:]
    part = 0.5 * (np.arange(len(command)) % 2)[:, None]
    return _logged(s, (1 - part) * command + part * later)


COMMANDS: dict[str, tuple[str, Maker]] = {
    "warm-up": ("thrust that grows by 30 % over the first pulses of each jet", _warming),
    "tank": ("thrust that falls by 20 % over the log", lambda s, _: throttled(s, 0.8 + 0.2 * clock(s))),
    "supply-ripple": ("thrust that goes up and down by 10 %", _rippling),
    "supply-steps": ("thrust that steps by up to 15 %", _stepping),
    "pulse-scatter-5": ("pulses that scatter by 5 %", partial(_scattering, sigma=0.05)),
    "pulse-scatter-1": ("pulses that scatter by 1 %", partial(_scattering, sigma=0.01)),
    "least-bit": ("4 % of a cycle more in each pulse than was logged", _least_bit),
    "on-times-counted": ("on-times logged in eighths of a cycle", _counted),
    "one-late": ("one channel a cycle later than the others", _one_late),
    "flips-midway": (
        "one channel reversed from half time on",
        lambda s, rng: None if s.vehicle.jets else _from_half_time(s, rng, -1.0),
    ),
    "weaker-later": ("one channel at 90 % from half time on", partial(_from_half_time, factor=0.9)),
    "all-weaker-later": ("all thrust at 90 % from half time on", lambda s, _: throttled(s, np.where(clock(s) < 0.5, 1.0, 0.9))),
    "commands-missing": ("2 % of the commands are not logged", _missing),
    "commands-disordered": ("3 % of the commands logged a cycle early", _disordered),
    "delay-jumps": ("delay longer by a cycle from half time on", _delay_jumps),
    "delay-alternates": ("delay longer by half a cycle in every other one", _delay_alternates),
}
"""By name: what it is, and a log with it; None where a vehicle can't have it."""
