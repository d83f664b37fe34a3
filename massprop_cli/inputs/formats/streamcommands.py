"""Commands of a recording whose streams have clocks of their own: of each control cycle, by stamps that may scatter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massprop_cli.base.arrays import Array, BoolArray, IntArray, median
from massprop_cli.base.dataclass import dataclass
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample
from massprop_cli.inputs.formats.signals import QuantitySignal, Signals

LIKE = 0.2
"""Commands that come as often as control cycles, to this part of a cycle, begin them."""
SAME = 1e-3
"""Part of a gyro sample by which instants may differ that are the same: clocks are rounded."""
STAMPED = 0.15
"""Of a cycle, by which stamps of commands may scatter that come once in each: a controller's commands act in step with its cycles."""
AJAR = 0.1
"""A valve that is on is open farther than this, at least once in a recording."""
_CHANGES, _TOGETHER = 8, 0.7
"""Changes of commands that tell where cycles begin, at least, and the part of them that come so far into a cycle, to a record."""
_EARLY = 0.25
"""Of a cycle: an on-time stamped so much before a cycle begins is still that cycle's."""


@dataclass(frozen=True)
class StreamCommand:
    """One commanded quantity."""

    signal: QuantitySignal
    holds: resample.Holds
    names: tuple[str, ...]
    kind: str
    """mean, on_time or share (of a cycle)."""


def commands_of(signals: Signals, attitude: QuantitySignal | None) -> list[StreamCommand]:
    """Wrenches in body axes, jets, and devices commanded by means; :class:`InputError` where no valve ever opens."""
    found = []
    for key, wrench, known, names in signals.wrenches():
        signal = signals.vector(key, wrench, known)
        if wrench.frame == "world" and attitude is not None:
            at = resample.attitude_at(attitude.values, attitude.times.s, signal.times.s)
            signal = replace(signal, values=resample.into_body(signal.values, at))
            signals.made.append(f"{key}: turned from world into body axes with the logged attitude at each command's time")
        found.append(StreamCommand(signal, wrench.holds, names, "mean"))
    jets = [(jet, *signals.jet(name, jet)) for name, jet in signals.map.jets.items()]
    _check_open(signals, [signal for _, signal, share in jets if share])
    for name, (jet, signal, share) in zip(signals.map.jets, jets, strict=True):
        kind = "share" if share else "on_time" if signal.paths else "mean"
        found.append(StreamCommand(signal, jet.holds, (columns.jet(name),), kind))
    found += [StreamCommand(signal, holds, (column,), "mean") for signal, column, kind, holds in signals.spinners() if kind == "mean"]
    return found


def _check_open(signals: Signals, valves: Sequence[QuantitySignal]) -> None:
    """Valves of which none ever opens: their numbers are another quantity, or percent of what isn't."""
    widest = max(valves, key=lambda one: float(one.values.max()), default=None)
    if widest is None:
        return
    most = float(widest.values.max())
    if 0 < most < AJAR:
        raise signals.refused(
            widest,
            f"no valve is open by more than {most:.4g} ({100 * most:.3g} %) in all of this recording; a state is 0 or 1, or up to 100 %. "
            'If it is the on-time of a control cycle, state unit = "s", "ms" or "us"; if it is 0 to 1, unit = "open"; if it is the share '
            'of a cycle that a valve is open, unit = "s" with scale = the length of a cycle',
        )


def on_cycles(signals: Signals, command: StreamCommand, cycles: Array) -> Array:
    """(K, n) the command of each control cycle."""
    signal, step, length = command.signal, command.signal.times.step_s, median(np.diff(cycles))
    said = f"{signal.key}: {len(signal.values)} values every {step:.6g} s by {signal.times.path!r}"
    if command.kind == "on_time":
        if step > (1 - LIKE) * length:
            if command.holds == "since_last":
                problem = "an on-time once a cycle belongs to the cycle of its stamp, so holds has no effect; drop holds, and if"
                problem += f" stamps are at the end of the cycle, state clock.offset_s = {-length:.6g} for it"
                raise signals.refused(signal, problem)
            count, first = resample.in_each(signal.times.s, cycles, _EARLY)
        else:  # in every record, which counts by its middle
            middle = step / 2 if command.holds == "until_next" else -step / 2
            count, first = resample.in_each(signal.times.s + middle, cycles, 0.0)
        wrong = np.flatnonzero((count < 1) | _differing(signal.values[:, 0], first, count))
        if wrong.size:
            at = cycles[wrong[0]] + signal.times.zero_s
            raise signals.refused(
                signal,
                f"{_counted(signal, first, count, int(wrong[0]))} in the control cycle of {length:.6g} s at {at:.13g} s; each cycle needs "
                "one (0 where the jet is off), or the same in all of its records: correct the length of cycles or their beginning "
                "([records])" + _astray(int(count[wrong[0]])) + _another_clock(signals, signal),
            )
        apart = np.abs(signal.times.s[first] - cycles[:-1]).max()
        most = int(count.max())
        each = "one in each control cycle" if most == 1 else f"up to {most} alike in each control cycle"
        signals.made.append(f"{said}, {each}, stamped up to {apart:.3g} s from its beginning")
        return signal.values[first]
    if not signal.paths:
        signals.made.append(f"{signal.key}: taken as {', '.join(f'{v:g}' for v in signal.values[0])} throughout, as the map states")
        return np.repeat(signal.values[:1], len(cycles) - 1, 0)
    times, scatter = _in_step(signal.times.s, cycles) if command.holds == "until_next" else (signal.times.s, 0.0)
    if scatter > 0:
        said += f", one in each control cycle, whose stamps scatter by up to {scatter:.3g} s and are taken as evenly spaced"
    found = resample.means(signal.values, times, command.holds, cycles)
    how = "held until the next" if command.holds == "until_next" else "each over the time since the last"
    signals.made.append(f"{said}, {how}; of each of {len(cycles) - 1} control cycles of {length:.6g} s the mean")
    return found * np.diff(cycles)[:, None] if command.kind == "share" else found


def _astray(count: int) -> str:
    """What else makes a cycle hold no on-time, or two."""
    lost = (
        ""
        if count
        else "; if an on-time is logged only when it changes, log it in each cycle; if commands were lost, set records.end_s before them"
    )
    return f"{lost}; if stamps are arrival times, state even = true; if the clock drifts, state its scale, under the clock of [jets]"


def _another_clock(signals: Signals, signal: QuantitySignal) -> str:
    """A clock that has a time in just the rows of a command that was read by another."""
    used, own = signal.times.path, signals.clocks_like(signal.paths[0])
    if not own or used in own:
        return ""
    return f"; or its times are in {' or '.join(map(repr, own))}: state clock.path under [{signal.key}], which is by {used!r} now"


def where_they_change(commands: Sequence[StreamCommand], least_s: float, cycle_s: float) -> float | None:
    """When cycles begin: as far into a cycle as most changes of commands (openings of valves) come together; None where they do not."""
    found, step = [], 0.0
    for command in commands:
        times, values = command.signal.times, command.signal.values
        if not command.signal.paths or times.step_s > (1 - LIKE) * cycle_s:
            continue
        change = np.diff(values, axis=0)
        changed = (change != 0).any(1) if command.kind == "mean" else (change > 0).any(1)
        found.append((times.s[1:] if command.holds == "until_next" else times.s[:-1])[changed])
        step = max(step, times.step_s)
    into = np.sort((np.concatenate([*found, []]) - least_s) % cycle_s)
    if len(into) < _CHANGES:
        return None
    around = np.concatenate([into, into + cycle_s])
    together = np.searchsorted(around, into + max(step, SAME * cycle_s), side="left") - np.arange(len(into))
    most = int(np.argmax(together))
    if together[most] < _TOGETHER * len(into):
        return None
    begun = median(around[most : most + together[most]]) % cycle_s
    return least_s + (begun if cycle_s - begun > SAME * cycle_s else 0.0)


def _differing(values: Array, first: IntArray, count: IntArray) -> BoolArray:
    """(K,) whether those of a cycle differ, of which ``count`` follow each other from the ``first`` on."""
    changes = np.concatenate([[0], np.cumsum(np.diff(values) != 0)])
    last = np.minimum(first + np.maximum(count, 1), len(values)) - 1
    return np.asarray(changes[last] != changes[first])


def _counted(signal: QuantitySignal, first: IntArray, count: IntArray, cycle: int) -> str:
    """How many there are in a cycle and, of those that are not alike, two."""
    own = list(dict.fromkeys(signal.values[first[cycle] : first[cycle] + count[cycle], 0].tolist()))
    return f"{count[cycle]} on-times ({' and '.join(f'{value:.4g} s' for value in own[:2])})" if own else "no on-time"


def begun_with(times_s: Array, least_s: float, cycle_s: float) -> float:
    """When cycles begin that commands begin: with the first stamp, or where the median of stamps that scatter puts it."""
    first = float(times_s[0])
    off = (times_s - first + cycle_s / 2) % cycle_s - cycle_s / 2
    usual = median(off)
    if abs(usual) < SAME * cycle_s or float(np.abs(off - usual).max()) > STAMPED * cycle_s:
        return first
    return first + usual if first + usual >= least_s else first + usual + cycle_s


def _in_step(times_s: Array, cycles: Array) -> tuple[Array, float]:
    """Times of commands of which each cycle has one, at the median offset into it, and their scatter; else the stamps, and 0."""
    count, first = resample.in_each(times_s, cycles, _EARLY)
    if (count != 1).any():
        return times_s, 0.0
    into = times_s[first] - cycles[:-1]
    usual, length = median(into), median(np.diff(cycles))
    scatter = float(np.abs(into - usual).max())
    if scatter > STAMPED * length:
        return times_s, 0.0
    chance = max(4 * float(into.std()) / len(into) ** 0.5, SAME * length)
    even = times_s.copy()
    even[first] = cycles[:-1] + (usual if abs(usual) > chance else 0.0)
    # those before and after follow on, where they are of the same kind
    for edge, beyond, step in ((first[0], first[0] - 1, -length), (first[-1], first[-1] + 1, length)):
        if 0 <= beyond < len(even) and abs(times_s[beyond] - times_s[edge] - step) < 2 * STAMPED * length:
            even[beyond] = even[edge] + step
    return even, scatter if scatter > SAME * length else 0.0
