"""What could be wrong with the vehicle file or the log, where the two don't fit: suppositions tried one after another.

Each supposition changes what is taken for granted (the gyro's unit, the IMU's mounting, what each jet really does) and the log is fitted
again without any disturbance (:mod:`massprop_cli.fit`). One that explains nearly all of the misfit is
named, with the cure; none is acted on.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from massprop_cli import change
from massprop_cli.align import Aligned, align, channel_wrench
from massprop_cli.arrays import Array, BoolArray
from massprop_cli.columns import WRENCH
from massprop_cli.compensate import Samples, compensate
from massprop_cli.errors import InputError
from massprop_cli.fit import PASSES, Extra, Fit, fit
from massprop_cli.sensitivity import thrust_columns
from massprop_cli.start import first_reference
from massprop_cli.telemetry import Log, Notice
from massprop_cli.vehicle import Vehicle

LONGEST = 3000
"""Cycles that a supposition is tried on."""
MISFIT = 1.3
"""Mean squared residual over noise below which nothing is looked for."""
EXPLAINED = 0.1
"""A supposition is named if it leaves at most this part of the misfit ..."""
REMAINS = 3.0
"""... and no more than this over what noise explains: a wandering torque is fitted better by many a wrong supposition."""
ROUGH, ROUGH_PASSES = 400, 3
"""Cycles and passes of a first try."""
SUSPECTS = 4
"""Jets that are tried, one alone."""
PROMISING, FINALISTS = 0.5, 3
"""Part of the misfit that it may leave there, and how many are tried again with care."""
NOISE_RATIO = 2.0
"""Another unit leaves a variance within this factor of the stated noise's."""
FACTOR_PRIOR = 1.0
FACTOR_STEPS = 8
LARGEST = 3.0
"""Factors beyond are not tried."""
OFF = (0.03, 0.3)
"""A channel's factor is off if it differs by this much from what most channels have, and by this part of what the worst does."""


@dataclass(frozen=True)
class Supposition:
    """Something else than stated, and how to say it."""

    code: str
    message: str
    vehicle: Vehicle
    gyro: float = 1.0
    accel: float = 1.0
    settings: tuple[str, ...] = ()
    """KEY=VALUE of the vehicle file that mend it; units are columns of the log and not among them."""


@dataclass(frozen=True)
class Cure:
    """How a named fault is mended: keys of the vehicle file, and factors on what the log holds."""

    settings: tuple[str, ...] = ()
    gyro: float = 1.0
    accel: float = 1.0
    command: tuple[float, ...] = ()
    """On each component of a commanded wrench; empty: none."""


@dataclass(frozen=True)
class Explanation:
    """A supposition that was tried, and what it leaves."""

    chi_square: float
    code: str
    message: str
    cure: Cure
    change_s: float | None = None
    """When the mass properties changed at once, if that is what is supposed."""

    @property
    def notice(self) -> Notice:
        """For the reader."""
        return Notice(self.code, self.message)


def diagnose(log: Log, vehicle: Vehicle, delay_cycles: float, pieces: Sequence[slice], channels: Sequence[int] = ()) -> list[Explanation]:
    """What explains the misfit of the piece that fits worst, if anything does. Noise levels must be set in ``vehicle``.

    ``channels`` are the command channels that are likeliest at fault, in this order; without any, each jet is tried.
    """
    pieces = [slice(piece.start, min(piece.stop, piece.start + LONGEST)) for piece in pieces]
    fits = [_tried(log, Supposition("", "", vehicle), delay_cycles, piece) for piece in pieces]
    misfits = [np.inf if found is None else found.chi_square - 1 for found in fits]
    worst = int(np.argmax(misfits))
    piece, stated, misfit = pieces[worst], fits[worst], misfits[worst]
    if misfit <= MISFIT - 1:
        return []
    allowed = 1 + min(EXPLAINED * misfit, REMAINS)
    found = _fitting(log, vehicle, list(_suppositions(vehicle)), delay_cycles, piece, allowed)
    if not found:
        found = _fitting(
            log, vehicle, list(_single_jets(vehicle, channels[:SUSPECTS] or range(len(vehicle.jets)))), delay_cycles, piece, allowed
        )
    if not found:
        found = [e for e in _change(log, vehicle, delay_cycles, piece) if e.chi_square <= allowed]
    if not found and stated is not None:  # factors are many changes: they are asked only where no single one does it
        return [e for e in _factors(log, vehicle, delay_cycles, piece, stated) if e.chi_square <= allowed]
    return [min(found, key=lambda e: (e.chi_square, e.message))] if found else []


def _fitting(
    log: Log, vehicle: Vehicle, supposed: Sequence[Supposition], delay_cycles: float, piece: slice, allowed: float
) -> list[Explanation]:
    """Those that explain the misfit: all are tried roughly on a stretch, the best again with care."""
    busiest = _busiest(log, piece)
    aligned = align(log, vehicle, delay_cycles)
    stated = _tried(log, Supposition("", "", vehicle), delay_cycles, busiest, ROUGH_PASSES, aligned)
    least = np.inf if stated is None else 1 + PROMISING * (stated.chi_square - 1)
    rough = [
        (_tried(log, s, delay_cycles, busiest, ROUGH_PASSES, aligned if s.vehicle.jets == vehicle.jets else None), s) for s in supposed
    ]
    best = sorted(((found.chi_square, i) for i, (found, _) in enumerate(rough) if found is not None and found.chi_square <= least))
    careful = [(_tried(log, rough[i][1], delay_cycles, piece), rough[i][1]) for _, i in best[:FINALISTS]]
    return [
        Explanation(f.chi_square, s.code, s.message, Cure(s.settings, s.gyro, s.accel))
        for f, s in careful
        if f is not None and _explains(f, s, allowed)
    ]


def _busiest(log: Log, piece: slice) -> slice:
    """The ``ROUGH`` cycles of a piece in which most is commanded."""
    effort = np.abs(log.command[piece]) / np.maximum(np.abs(log.command).max(0), np.finfo(float).tiny)
    total = np.concatenate([[0.0], np.cumsum(effort.sum(1))])
    first = piece.start + int(np.argmax(total[ROUGH:] - total[:-ROUGH])) if len(total) > ROUGH else piece.start
    return slice(first, min(first + ROUGH, piece.stop))


def _explains(found: Fit, supposed: Supposition, allowed: float) -> bool:
    """Whether hardly anything of the misfit is left.

    Another unit must leave just the stated noise in every channel: any misfit drowns in noise once the signal is made small enough.
    """
    if supposed.gyro != 1.0 or supposed.accel != 1.0:
        return bool((np.abs(np.log(found.channels)) < np.log(NOISE_RATIO)).all())
    return found.chi_square <= allowed


def _change(log: Log, vehicle: Vehicle, delay_cycles: float, piece: slice) -> list[Explanation]:
    """The likeliest moment for a sudden change of the mass properties, each side fitted on its own."""
    samples = _samples(log, Supposition("", "", vehicle), delay_cycles)
    reference = None if samples is None else first_reference(samples, piece, vehicle)
    if samples is None or reference is None:
        return []
    best = change.likeliest(samples, piece, reference, vehicle)
    if best is None:
        return []
    time = round(float(samples.executed.start_s[best]), 9)
    message = (
        f"the log fits if the mass properties change at once at {time:.6g} s, as by docking or release; give the vehicle file "
        "[[phases]] that end and begin there (estimator.split_on_change = true does it): what is estimated over the change is no body's"
    )
    cure = Cure(("estimator.split_on_change=true",))
    return [Explanation(_sides(samples, piece, best, vehicle), "mass-change", message, cure, time)]


def _sides(samples: Samples, piece: slice, at: int, vehicle: Vehicle) -> float:
    """Chi-square of two bodies, one before cycle ``at`` and one from it on."""
    total = 0.0
    for side in (slice(piece.start, at), slice(at, piece.stop)):
        reference = first_reference(samples, side, vehicle)
        found = None if reference is None else fit(samples, side, reference, vehicle)
        if found is None:
            return float(np.inf)
        total += found.chi_square * (side.stop - side.start)
    return float(total / (piece.stop - piece.start))


def _single_jets(vehicle: Vehicle, suspects: Sequence[int]) -> Iterator[Supposition]:
    """Each of these jets mounted the other way round, and each dead."""
    for i, jet in ((i, vehicle.jets[i]) for i in suspects if vehicle.jets):
        for code, f, words in (
            ("jet-sign", -1.0, "pushes the other way than the vehicle file says; mend its force_n"),
            ("jet-dead", 0.0, "does not push at all; look at its valve and wiring"),
        ):
            factor = np.ones(len(vehicle.jets))
            factor[i] = f
            scaled = _scaled(vehicle, factor)
            yield Supposition(code, f"the log fits if jet {jet.name} {words}", scaled, settings=_forces(scaled, [i]))


def _suppositions(vehicle: Vehicle) -> Iterator[Supposition]:
    degree = np.pi / 180
    remedy = "mend the log, or scale its columns under [columns]"
    yield Supposition(
        "gyro-units", f"the log fits if its gyro columns are in degrees, not radians; {remedy} (0.0174533)", vehicle, gyro=degree
    )
    yield Supposition(
        "gyro-units", f"the log fits if its gyro columns were turned into radians twice; {remedy} (57.2958)", vehicle, gyro=1 / degree
    )
    yield Supposition("accel-units", f"the log fits if its accelerometer columns are in g; {remedy} (9.80665)", vehicle, accel=9.80665)
    mounted = np.array(vehicle.imu.body_from_imu)
    turns = [("the transpose of what is stated", mounted.T)]
    turns += [("", turn) for turn in _right_angles() if np.abs(turn - mounted.T).max() > 1e-9]
    for words, turn in turns:
        if np.abs(turn - mounted).max() > 1e-9:
            rows = tuple(tuple(float(x) + 0.0 for x in row) for row in turn)
            shown = [[round(x, 6) for x in row] for row in rows]
            message = f"the log fits if imu.body_from_imu is {words + ', ' if words else ''}{shown}; look at the IMU's mounting"
            supposed = vehicle.model_copy(update={"imu": vehicle.imu.model_copy(update={"body_from_imu": rows})})
            yield Supposition("imu-mounting", message, supposed, settings=(f"imu.body_from_imu={[list(row) for row in rows]}",))


def _right_angles() -> list[Array]:
    """The 24 ways to mount a box by right angles."""
    found: list[Array] = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[range(3), order] = signs
            if np.linalg.det(turn) > 0:
                found.append(turn)
    return found


def _tried(
    log: Log, supposed: Supposition, delay_cycles: float, piece: slice, passes: int = PASSES, aligned: Aligned | None = None
) -> Fit | None:
    """The fit under a supposition; None where it makes no body at all. ``aligned``: the log's commands, if the same are supposed."""
    samples = _samples(log, supposed, delay_cycles, aligned)
    if samples is None:
        return None
    reference = first_reference(samples, piece, supposed.vehicle)
    return None if reference is None else fit(samples, piece, reference, supposed.vehicle, passes=passes)


def _samples(log: Log, supposed: Supposition, delay_cycles: float, aligned: Aligned | None = None) -> Samples | None:
    try:
        read = aligned or align(log, supposed.vehicle, delay_cycles)
        rate, force = read.rate_imu_rad_s * supposed.gyro, read.specific_force_imu_m_s2 * supposed.accel
        return compensate(replace(read, rate_imu_rad_s=rate, specific_force_imu_m_s2=force), supposed.vehicle)
    except InputError:
        return None


def _factors(log: Log, vehicle: Vehicle, delay_cycles: float, piece: slice, stated: Fit) -> list[Explanation]:
    """What each channel's thrust really is over what is stated, if that explains the log: chi-square, code, message for each kind."""
    names = [jet.name for jet in vehicle.jets] if log.command_kind == "jets" else list(WRENCH)
    wrench = channel_wrench(log, vehicle)
    factor, found, used, tried = np.ones(len(names)), stated, log, vehicle
    best = np.inf
    for _ in range(FACTOR_STEPS):
        aligned = align(used, tried, delay_cycles)
        samples = compensate(aligned, tried)
        growth, force = thrust_columns(samples, piece, found.reference, tried)
        extra, fired = Extra(growth, force, FACTOR_PRIOR), (samples.executed.channels.whole[piece] != 0).any(0)
        step = fit(samples, piece, found.reference, tried, extra, passes=0)
        if step is None:
            break
        factor = factor * (1 + step.extra)
        # the scale common to all is not told from mass and inertia: most channels are taken to be as stated
        factor = np.where(fired, np.clip(factor / _common(factor, fired, wrench), -LARGEST, LARGEST), 1.0)
        used, tried = _with_factors(log, vehicle, factor)
        samples = compensate(align(used, tried, delay_cycles), tried)
        again = fit(samples, piece, found.reference, tried)
        if again is None:
            break
        done = not again.chi_square < best * 0.99
        best, found = min(best, again.chi_square), again
        if done:
            break
    least = max(OFF[0], OFF[1] * float(np.abs(factor - 1).max()))
    off = [(name, float(f)) for name, f in zip(names, factor, strict=True) if abs(f - 1) > least]
    kinds: dict[str, list[tuple[str, float]]] = {}
    for name, f in off:
        kinds.setdefault("jet-sign" if f < -0.5 else "jet-dead" if abs(f) < 0.2 else "thrust-scale", []).append((name, f))
    says = {
        "jet-sign": "push the other way than the vehicle file says; mend force_n",
        "jet-dead": "hardly push at all; look at valves and wiring",
        "thrust-scale": "push by another part of their stated thrust than the others; mend force_n or calibrate",
    }
    wrong = [i for i, name in enumerate(names) if name in dict(off)]
    mended = np.where(np.isin(np.arange(len(names)), wrong), factor, 1.0)
    by_jets = log.command_kind == "jets"
    cure = Cure(_forces(_scaled(vehicle, mended), wrong)) if by_jets else Cure(command=tuple(float(f) for f in mended))
    return [
        Explanation(best, code, f"the log fits if these {says[code]}: " + ", ".join(f"{name} ({f:+.3g})" for name, f in some), cure)
        for code, some in kinds.items()
    ]


def _common(factor: Array, fired: BoolArray, wrench: Array) -> Array:
    """(C,) what most channels of a kind have: those that only push (they share the mass' scale) and those that turn (the inertia's)."""
    arm = np.linalg.norm(wrench[:, :3], axis=1) / np.maximum(np.linalg.norm(wrench[:, 3:], axis=1), 1e-300)
    pushes = arm < 0.1 * arm.max()
    common = np.ones(len(factor))
    for kind in (pushes, ~pushes):
        if (kind & fired).any():
            common[kind] = np.median(factor[kind & fired]) or 1.0
    return common


def _forces(vehicle: Vehicle, jets: Sequence[int]) -> tuple[str, ...]:
    """The settings that give these jets their force."""
    return tuple(f"jets.{i}.force_n={[float(f'{x:.6g}') for x in vehicle.jets[i].force_n]}" for i in jets)


def _with_factors(log: Log, vehicle: Vehicle, factor: Array) -> tuple[Log, Vehicle]:
    if log.command_kind == "wrench":
        return replace(log, command=log.command * factor), vehicle
    return log, _scaled(vehicle, factor)


def _scaled(vehicle: Vehicle, factor: Array) -> Vehicle:
    """The vehicle with each jet's force multiplied."""
    jets = tuple(
        jet.model_copy(update={"force_n": tuple(float(x) for x in f * np.array(jet.force_n))})
        for jet, f in zip(vehicle.jets, factor, strict=True)
    )
    return Vehicle.model_construct(**{**dict(vehicle), "jets": jets})
