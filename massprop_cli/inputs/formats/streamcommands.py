"""Commands of a recording with separate clocks: one value per control cycle, from time stamps that may scatter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample
from massprop_cli.inputs.formats.signals import QuantitySignal, Signals

SAME_INTERVAL = 0.2
"""Relative tolerance of the commands' interval for commands once per control cycle; such commands start the cycles."""
SAME_TIME = 1e-3
"""Tolerance of equal times, as a fraction of a gyro sample; clocks are rounded."""
MAX_SCATTER = 0.15
"""Largest scatter of commands, as a fraction of a cycle, that is attributed to their time stamps, because controllers act in step."""
MIN_OPENING = 0.1
"""Smallest maximum opening of a valve in a recording."""
_CHANGES, _TOGETHER = 8, 0.7
"""Minimum number of command changes that show where cycles start, and minimum fraction of them at the same place in a cycle."""
_EARLY = 0.25
"""Largest time of an on-time's stamp before its cycle, as a fraction of the cycle."""


@dataclass(frozen=True)
class StreamCommand:
    """Commanded quantity."""

    signal: QuantitySignal
    holds: resample.Holds
    names: tuple[str, ...]
    kind: str
    """"mean", "on_time" or "share" (of a cycle)."""


def commands_of(signals: Signals, attitude: QuantitySignal | None) -> list[StreamCommand]:
    """Wrenches in body axes, jets, and devices with commands. Raises :class:`InputError` if no valve opens."""
    found = []
    for key, wrench, known, names in signals.wrenches():
        signal = signals.vector(key, wrench, known)
        if wrench.frame == "world" and attitude is not None:
            at = resample.attitude_at(attitude.values, attitude.times.s, signal.times.s)
            signal = replace(signal, values=resample.into_body(signal.values, at))
            signals.conversions.append(f"{key}: turned from world into body axes with the logged attitude at each command's time")
        found.append(StreamCommand(signal, wrench.holds, names, "mean"))
    jets = [(jet, *signals.jet(name, jet)) for name, jet in signals.map.jets.items()]
    _check_open(signals, [signal for _, signal, share in jets if share])
    for name, (jet, signal, share) in zip(signals.map.jets, jets, strict=True):
        kind = "share" if share else "on_time" if signal.paths else "mean"
        found.append(StreamCommand(signal, jet.holds, (columns.jet(name),), kind))
    found += [StreamCommand(signal, holds, (column,), "mean") for signal, column, kind, holds in signals.spinners() if kind == "mean"]
    return found


def _check_open(signals: Signals, valves: Sequence[QuantitySignal]) -> None:
    """Raise :class:`InputError` if no valve opens: the values are probably another quantity or unit."""
    widest = max(valves, key=lambda one: float(one.values.max()), default=None)
    if widest is None:
        return
    most = float(widest.values.max())
    if 0 < most < MIN_OPENING:
        raise signals.refused(
            widest,
            f"no valve is open by more than {most:.4g} ({100 * most:.3g} %) in all of this recording; a state is 0 or 1, or up to 100 %. "
            'If it is the on-time of a control cycle, state unit = "s", "ms" or "us"; if it is 0 to 1, unit = "open"; if it is the share '
            'of a cycle that a valve is open, unit = "s" with scale = the length of a cycle',
        )


def on_cycles(signals: Signals, command: StreamCommand, cycles: Array) -> Array:
    """(K, n) command of each control cycle."""
    signal, step, length = command.signal, command.signal.times.step_s, median(np.diff(cycles))
    text = f"{signal.key}: {len(signal.values)} values every {step:.6g} s by {signal.times.path!r}"
    if command.kind == "on_time":
        if step > (1 - SAME_INTERVAL) * length:
            if command.holds == "since_last":
                problem = "an on-time once a cycle belongs to the cycle of its stamp, so holds has no effect; drop holds, and if"
                problem += f" stamps are at the end of the cycle, state clock.offset_s = {-length:.6g} for it"
                raise signals.refused(signal, problem)
            count, first = resample.in_each(signal.times.s, cycles, _EARLY)
        else:  # values in every record, located by the middle of the record
            middle = step / 2 if command.holds == "until_next" else -step / 2
            count, first = resample.in_each(signal.times.s + middle, cycles, 0.0)
        wrong = np.flatnonzero((count < 1) | _differ(signal.values[:, 0], first, count))
        if wrong.size:
            at = cycles[wrong[0]] + signal.times.zero_s
            raise signals.refused(
                signal,
                f"{_counts(signal, first, count, int(wrong[0]))} in the control cycle of {length:.6g} s at {at:.13g} s; each cycle needs "
                "one (0 where the jet is off), or the same in all of its records: correct the length of cycles or their beginning "
                "([records])" + _other_reasons(int(count[wrong[0]])) + _clock_hint(signals, signal),
            )
        apart = np.abs(signal.times.s[first] - cycles[:-1]).max()
        most = int(count.max())
        each = "one in each control cycle" if most == 1 else f"up to {most} alike in each control cycle"
        signals.conversions.append(f"{text}, {each}, stamped up to {apart:.3g} s from its beginning")
        return signal.values[first]
    if not signal.paths:
        signals.conversions.append(f"{signal.key}: taken as {', '.join(f'{v:g}' for v in signal.values[0])} throughout, as the map states")
        return np.repeat(signal.values[:1], len(cycles) - 1, 0)
    times, scatter = _without_scatter(signal.times.s, cycles) if command.holds == "until_next" else (signal.times.s, 0.0)
    if scatter > 0:
        text += f", one in each control cycle, whose stamps scatter by up to {scatter:.3g} s and are taken as evenly spaced"
    found = resample.means(signal.values, times, command.holds, cycles)
    how = "held until the next" if command.holds == "until_next" else "each over the time since the last"
    signals.conversions.append(f"{text}, {how}; of each of {len(cycles) - 1} control cycles of {length:.6g} s the mean")
    return found * np.diff(cycles)[:, None] if command.kind == "share" else found


def _other_reasons(count: int) -> str:
    """Text with other reasons for a cycle without or with two on-times."""
    lost = "; if an on-time is logged only when it changes, log it in each cycle; if commands were lost, set records.end_s before them"
    lost = "" if count else lost
    return f"{lost}; if stamps are arrival times, state even = true; if the clock drifts, state its scale, under the clock of [jets]"


def _clock_hint(signals: Signals, signal: QuantitySignal) -> str:
    """Text that names a clock with values in the rows of this command, if another one is used; else empty."""
    used, own = signal.times.path, signals.clocks_like(signal.paths[0])
    if not own or used in own:
        return ""
    return f"; or its times are in {' or '.join(map(repr, own))}: state clock.path under [{signal.key}], which is by {used!r} now"


def where_they_change(commands: Sequence[StreamCommand], least_s: float, cycle_s: float) -> float | None:
    """Start of the first cycle, s, from the most frequent place of command changes (valve openings) in a cycle; None without one."""
    found, step = [], 0.0
    for command in commands:
        times, values = command.signal.times, command.signal.values
        if not command.signal.paths or times.step_s > (1 - SAME_INTERVAL) * cycle_s:
            continue
        change = np.diff(values, axis=0)
        changed = (change != 0).any(1) if command.kind == "mean" else (change > 0).any(1)
        found.append((times.s[1:] if command.holds == "until_next" else times.s[:-1])[changed])
        step = max(step, times.step_s)
    into = np.sort((np.concatenate([*found, []]) - least_s) % cycle_s)
    if len(into) < _CHANGES:
        return None
    around = np.concatenate([into, into + cycle_s])
    together = np.searchsorted(around, into + max(step, SAME_TIME * cycle_s), side="left") - np.arange(len(into))
    most = int(np.argmax(together))
    if together[most] < _TOGETHER * len(into):
        return None
    begun = median(around[most : most + together[most]]) % cycle_s
    return least_s + (begun if cycle_s - begun > SAME_TIME * cycle_s else 0.0)


def _differ(values: Array, first: IntArray, count: IntArray) -> BoolArray:
    """(K,) whether the ``count`` values of a cycle, starting at ``first``, differ."""
    changes = np.concatenate([[0], np.cumsum(np.diff(values) != 0)])
    last = np.minimum(first + np.maximum(count, 1), len(values)) - 1
    return np.asarray(changes[last] != changes[first])


def _counts(signal: QuantitySignal, first: IntArray, count: IntArray, cycle: int) -> str:
    """Number of on-times in a cycle, with two different ones."""
    own = list(dict.fromkeys(signal.values[first[cycle] : first[cycle] + count[cycle], 0].tolist()))
    return f"{count[cycle]} on-times ({' and '.join(f'{value:.4g} s' for value in own[:2])})" if own else "no on-time"


def begun_with(times_s: Array, least_s: float, cycle_s: float) -> float:
    """Start of the first cycle, s, with commands that start cycles: the first time stamp, corrected by the median of scattering ones."""
    first = float(times_s[0])
    off = (times_s - first + cycle_s / 2) % cycle_s - cycle_s / 2
    usual = median(off)
    if abs(usual) < SAME_TIME * cycle_s or float(np.abs(off - usual).max()) > MAX_SCATTER * cycle_s:
        return first
    return first + usual if first + usual >= least_s else first + usual + cycle_s


def _without_scatter(times_s: Array, cycles: Array) -> tuple[Array, float]:
    """Times of commands, one per cycle, at their median place in the cycle, and their scatter; else the time stamps and 0."""
    count, first = resample.in_each(times_s, cycles, _EARLY)
    if (count != 1).any():
        return times_s, 0.0
    into = times_s[first] - cycles[:-1]
    usual, length = median(into), median(np.diff(cycles))
    scatter = float(np.abs(into - usual).max())
    if scatter > MAX_SCATTER * length:
        return times_s, 0.0
    chance = max(4 * float(into.std()) / len(into) ** 0.5, SAME_TIME * length)
    even = times_s.copy()
    even[first] = cycles[:-1] + (usual if abs(usual) > chance else 0.0)
    # the commands just before and after, if they continue the sequence
    for edge, beyond, step in ((first[0], first[0] - 1, -length), (first[-1], first[-1] + 1, length)):
        if 0 <= beyond < len(even) and abs(times_s[beyond] - times_s[edge] - step) < 2 * MAX_SCATTER * length:
            even[beyond] = even[edge] + step
    return even, scatter if scatter > SAME_TIME * length else 0.0
