"""One fault on one vehicle with one seed: what was said of it, and what it did to the values."""

import gc
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Literal

import numpy as np
from fault_kinds import FAULTS
from fault_named import CAUSES, SIZED, Drawn
from fault_vehicles import VEHICLES, Body, Case, Subject, subject
from script import KEPT, SAMPLES, cpu_s

from massprop_cli import QUANTITIES, flow, job
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.conclude.verdict import POSITIVE, Conclusion
from massprop_cli.estimate.history import History
from massprop_cli.estimate.phases import as_stated, estimates
from massprop_cli.flow import Analysis
from massprop_cli.inputs.columns import WRENCH
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.align import align
from massprop_cli.prepare.compensate import compensate

SIGMAS, PART = 4.0, 0.005
"""A converged value is wrong if it is off by more than this many sigmas and this part of its size."""
TELLS = 25.0
"""Chi-square that a fault must leave in the off-line fit, at the noise that is truly there, before any log can tell it: five sigma."""
OVERLAP = 5
"""Cycles that a phase must share with a true body to be taken as that body's."""
SAMPLE = SAMPLES / "free-flyer" / "log.parquet"
WRONG = ("--set", "cycle.command_delay_cycles=2.5")
"""What the sample log doesn't fit, so that a cause is looked for."""
TIMES = 3
LONG = 3.0
"""Times its clean twin's command, above which a log is timed again as often as its twin is anyhow: what else the machine does only makes
times longer."""
UNKNOWN = frozenset({"contradicted", "cause-unknown"})
Status = Literal["right", "half", "wrong", "unknown", "silent", "harmless", "hidden", "refused", "crash"]


@dataclass(frozen=True)
class Value:
    """One quantity of one phase."""

    phase: str
    name: str
    value: float
    sigma: float
    true: float
    size: float
    """Its natural one."""
    verdict: str

    @property
    def off(self) -> float:
        """Error in sigmas."""
        return (self.value - self.true) / self.sigma if self.sigma > 0 else float("inf")

    @property
    def apart(self) -> float:
        """Error over its natural size."""
        return abs(self.value - self.true) / self.size

    @property
    def wrong(self) -> bool:
        """Whether the error is beyond both limits."""
        return abs(self.off) > SIGMAS and self.apart > PART

    @property
    def good(self) -> bool:
        """Whether the value is converged and wrong."""
        return self.verdict == "converged" and self.wrong


@dataclass(frozen=True)
class Run:
    """What massprop reports on one log with a fault."""

    fault: str
    vehicle: str
    seed: int
    what: str
    status: Status
    """right: the cause and no other; half: one of two; wrong: an innocent cause; unknown: it is said to fit no cause; silent: nothing is
    said of harm; harmless: nothing beyond 4 sigma, no cause named; hidden: harm that no log can tell; refused: no result; crash."""
    values: tuple[Value, ...] = ()
    mended: bool = False
    """Whether the corrected answer is there and right."""
    seconds: float = 0.0
    """CPU time."""
    clean_seconds: float = 1.0
    notices: tuple[Notice, ...] = ()

    @property
    def harm(self) -> bool:
        """Whether a value is more than 4 sigma off."""
        return any(abs(value.off) > SIGMAS for value in self.values)

    @property
    def good(self) -> tuple[str, ...]:
        """Quantities that look good and are wrong, where the log could have told."""
        return () if self.status == "hidden" else tuple(value.name for value in self.values if value.good)

    @property
    def ratio(self) -> float:
        """CPU time over that of the same log without the fault."""
        return self.seconds / self.clean_seconds

    @property
    def command_ratio(self) -> float:
        """The same ratio for the whole `massprop estimate` command."""
        return (self.seconds + overhead(WRONG)) / (self.clean_seconds + overhead(()))


def run(fault: str, vehicle: str, seed: int) -> Run | None:
    """One run; None where the vehicle can't have the fault."""
    flown = subject(vehicle, seed)
    drawn = FAULTS[fault].draw(flown, flown.drawing(fault))
    if drawn is None:
        return None
    try:
        found, seconds = _examined(drawn.case, vehicle)
    except InputError as error:
        return Run(fault, vehicle, seed, drawn.what, "refused", notices=(Notice("refused", str(error)),))
    except Exception:  # a crash is a cell of the matrix, not its end
        return Run(fault, vehicle, seed, drawn.what, "crash", notices=(Notice("crash", traceback.format_exc()),))
    twin, clean_seconds = _twin(vehicle, seed)
    values = tuple(_values(found, drawn.case.bodies))
    status = _status(found, drawn, flown, values)
    if status in ("unknown", "silent") and any(abs(v.off) > SIGMAS for v in values) and not _tells(drawn.case, found, twin):
        status = "hidden"
    right = any(all(_fits(c, drawn.case.bodies) for c in answer.conclusions) for answer in found.mended)
    made = Run(fault, vehicle, seed, drawn.what, status, values, right, seconds, clean_seconds, found.notices)
    return made if made.command_ratio < LONG else replace(made, seconds=min(seconds, _least_seconds(drawn.case, vehicle)))


@dataclass(frozen=True)
class Clean:
    """What massprop reports on one log without a fault."""

    vehicle: str
    codes: tuple[str, ...]
    """Causes named."""
    told: int
    """Values with a sigma, ..."""
    converged: int
    """... those called converged, ..."""
    wrong: int
    """... and wrong."""


def clean(vehicle: str, seed: int) -> Clean:
    """Estimate the log without fault of one vehicle and seed."""
    case = subject(vehicle, seed).clean
    found, _ = _examined(case, vehicle)
    codes = {notice.code for notice in found.notices} & CAUSES - VEHICLES[vehicle].said
    values = tuple(_values(found, case.bodies))
    converged = sum(value.verdict == "converged" for value in values)
    return Clean(vehicle, tuple(sorted(codes)), len(values), converged, sum(value.good for value in values))


@lru_cache(maxsize=2)
def _twin(vehicle: str, seed: int) -> tuple[Analysis, float]:
    case = subject(vehicle, seed).clean
    found, seconds = _examined(case, vehicle)
    return found, min(seconds, _least_seconds(case, vehicle))


def _least_seconds(case: Case, name: str) -> float:
    return min(_examined(case, name)[1] for _ in range(TIMES))


def _examined(case: Case, name: str) -> tuple[Analysis, float]:
    """The analysis of a case, and its CPU time, s."""
    begin = time.process_time()
    with np.errstate(all="ignore"):
        found = flow.examine(case.log, VehicleSource(case.vehicle, name, ""))
    return found, time.process_time() - begin


@cache
def overhead(options: tuple[str, ...]) -> float:
    """CPU time of `massprop estimate` of a sample log beyond that of :func:`massprop_cli.job.of_file`: its start, and what it writes.

    Each the least of a few, since it is a difference of two that something else on the machine may lengthen.
    """
    job.of_file(SAMPLE, None, options[1:])  # loads what is loaded late
    own, whole = [], []
    for _ in range(TIMES):
        begin = time.process_time()
        job.of_file(SAMPLE, None, options[1:])
        own.append(time.process_time() - begin)
        begin = cpu_s()
        with tempfile.TemporaryDirectory() as out:
            command = [sys.executable, "-m", "massprop_cli", "estimate", str(SAMPLE), "-q", "--allow-contradicted", *options, "--out", out]
            subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True, env=KEPT)
        whole.append(cpu_s() - begin)
    return min(whole) - min(own)


def warm_up() -> None:
    """Load what is loaded late, so that no run's time holds it, and look for rubbish as seldom as the command does."""
    gc.set_threshold(100_000, 50, 50)
    _examined(subject("bearing", 1).clean, "bearing")


def _status(found: Analysis, drawn: Drawn, flown: Subject, values: Sequence[Value]) -> Status:
    channels = [jet.name for jet in flown.vehicle.jets] or list(WRENCH)
    named = [n for n in found.notices if n.code in CAUSES]
    met = [any(due.met_by(n, channels) for n in named) for due in drawn.dues]
    suspects = [n for n in named if n.code not in SIZED | flown.kind.said]
    if not all(any(due.met_by(n, channels) for due in drawn.dues) for n in suspects):
        return "wrong"
    if met and all(met):
        return "right"
    if any(met):
        return "half"
    if not any(abs(value.off) > SIGMAS for value in values):
        return "harmless"
    said = any(n.code in UNKNOWN for n in found.notices) or any(value.verdict == "contradicted" for value in values)
    return "unknown" if said else "silent"


def _bodies(conclusion: Conclusion, bodies: Sequence[Body], cycle_s: float) -> Array:
    """(B, 10) the true bodies during a phase."""
    phase = conclusion.phase
    during = [b.values for b in bodies if min(b.end_s, phase.end_s) - max(b.start_s, phase.start_s) > OVERLAP * cycle_s]
    # pieces shorter than that are those of a body that changes all the time
    return np.array(during or [b.values for b in bodies if b.start_s < phase.end_s and b.end_s > phase.start_s])


def _values(found: Analysis, bodies: Sequence[Body]) -> Iterator[Value]:
    """Each value against the nearest true body of its phase."""
    for conclusion, history in zip(found.conclusions, found.histories, strict=True):
        true = _bodies(conclusion, bodies, found.vehicle.cycle.period_s)
        sizes = history.natural_sizes.copy()
        sizes[POSITIVE] = np.minimum(sizes[POSITIVE], true[:, POSITIVE].min(0))
        yield from against(conclusion, true, sizes)


def against(conclusion: Conclusion, true: Array, sizes: Array) -> Iterator[Value]:
    """Each value against the nearest of these bodies (B, 10), with natural sizes (10,)."""
    for i, (name, e) in enumerate(conclusion.estimates.items()):
        if e.value is not None and e.sigma is not None:
            nearest = float(true[np.abs(true[:, i] - e.value).argmin(), i])
            yield Value(conclusion.phase.name, name, e.value, e.sigma, nearest, float(sizes[i]), e.verdict)


def _fits(conclusion: Conclusion, bodies: Sequence[Body]) -> bool:
    """Whether a corrected answer is some true body's within 4 sigma, in all that it tells."""
    told = {name: e for name, e in conclusion.estimates.items() if e.value is not None and e.sigma is not None}
    return bool(told) and any(
        all(
            abs((e.value or 0.0) - body.values[i]) <= SIGMAS * (e.sigma or 0.0)
            for i, name in enumerate(QUANTITIES)
            if (e := told.get(name)) is not None
        )
        for body in bodies
    )


def _tells(case: Case, found: Analysis, twin: Analysis) -> bool:
    """Whether the fault leaves a trace in the off-line fit, at the disturbances that the clean log has.

    Both logs have the same noise, so what differs between their whitened innovations is what the fit can't absorb.
    """
    settings = twin.vehicle.environment
    keys = [f"environment.{key}={getattr(settings, key)}" for key in ("disturbance_torque_n_m", "disturbance_walk_n_m")]
    scale = twin.vehicle.estimator.accel_noise_scale
    keys += [f"estimator.accel_noise_scale={list(scale)}"]
    used = changed(case.vehicle, [*keys, "estimator.adapt_noise=false"])
    with np.errstate(all="ignore"):
        samples = compensate(align(case.log, used, found.timing.delay, found.timing.lag_s(used)), used)
        phases = [(history.phase, history.cycles) for history in found.histories]
        try:
            plain = as_stated(samples, phases, used, Consider())
            settled = estimates(samples, phases, plain, Consider(), lambda *_: None, size=False, noisier=False).settled
        except np.linalg.LinAlgError:
            return True  # so far from any vehicle that nothing can be fitted
    left, clean_left = (_innovations(histories) for histories in (settled, twin.settled))
    trace = sum(float(np.nansum((left[k] - clean_left[k]) ** 2)) for k in left.keys() & clean_left.keys())
    return not trace < TELLS


def _innovations(histories: Sequence[History]) -> dict[int, Array]:
    """Whitened innovations (6,) by cycle, counted from the log's start."""
    return {cycle: row for h in histories for cycle, row in zip(range(h.cycles.start, h.cycles.stop), h.normalised, strict=True)}
