"""The causal pass without a compiled kernel: :mod:`massprop_cli.estimate.causal` on a growing log. Slow: each cycle aligns all anew."""

from copy import copy
from pathlib import Path

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.conclude.verdict import HALVED, LEAST_STEADY, POSITIVE, PRECISE, PRIOR
from massprop_cli.diagnosis.resolve import stated_timing
from massprop_cli.estimate.causal import Causal
from massprop_cli.estimate.kernelflight import MEMORY_S, VERDICTS, WAITS, Reported
from massprop_cli.estimate.quantities import quantities
from massprop_cli.estimate.rows import Rows
from massprop_cli.export.resolve import Constants, Leg
from massprop_cli.inputs.telemetry import Log
from massprop_cli.model.parameters import sizes_of_quantities
from massprop_cli.model.plant import Reference
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.stream import Stream

END, LENGTH, THETA, VELOCITY, IGNORED, UNUSED = 0, 1, slice(2, 5), slice(5, 8), slice(8, 10), 10
"""Where a cycle's numbers stand (:func:`massprop_cli.estimate.kernelflight.cycles_of`); commands follow."""
LATEST, LOUDEST, AS_STATED, MISFIT = 256, 25.0, 16, 1.5
"""In the running mean square of a sensor's normalised innovations each cycle counts 1/LATEST less than the next; the most that one of them
counts; how many before the first are taken to be as stated; and the mean beyond which model and flight contradict each other."""
GATE = 12
"""Where the gate stands in a rule (:func:`massprop_cli.estimate.kernelflight.rule_of`)."""
BELIEVED = 2
"""Readings in a row that are left out because their innovation is beyond the gate; the next one is motion: MP_BELIEVED."""


class OnNumPy:
    """The estimator of one flight."""

    def __init__(self, resolved: Constants) -> None:
        commands, self.vehicle = resolved.commands, resolved.vehicle
        self.jets, self.late, self.memory_s = bool(commands[0]), bool(commands[WAITS]), float(commands[MEMORY_S])
        self.rows: list[Array] = []
        self.far = [0, 0]
        self.begin(resolved.legs[0])

    def begin(self, leg: Leg) -> None:
        """Another phase, with the next cycle that is completed."""
        self.leg, self.steady, self.first = leg, Steady(leg), max(len(self.rows) - self.late, 0)
        self.causal: Causal | None = None

    def step(self, numbers: Array) -> Reported | None:
        """The next cycle; what the one completed by it came to."""
        self.rows.append(numbers.copy())
        return self._estimated(len(self.rows) - self.late)

    def last(self) -> Reported | None:
        """The one that waits."""
        return self._estimated(len(self.rows)) if self.late else None

    def _estimated(self, stop: int) -> Reported | None:
        """The estimate after the last of ``stop`` cycles; None for a cycle of no phase, or with commands from before the first."""
        if not stop or self.rows[stop - 1][UNUSED]:
            return None
        ends, lengths = np.array([row[:2] for row in self.rows[:stop]]).T
        started = ends - lengths
        usable = int(np.searchsorted(started, started[0] + self.memory_s - 1e-6 * self.vehicle.cycle.period_s))
        if usable >= stop:
            return None
        first = max(self.first, usable)
        rows, reference = Rows.empty(1), None
        if stop - first > 1:
            with np.errstate(all="ignore"):
                rows, reference = self._gated(slice(first, stop))
        values, covariance = quantities(rows.parameters, self.leg.own)
        ratio = self.steady.excess(rows.normalised[0], reference)
        sigmas = np.sqrt(ratio * np.einsum("kii->ki", covariance))
        return Reported(rows, values, sigmas, self.steady.verdicts(values[0], sigmas[0], ratio > 1, reference)[None])

    def _gated(self, cycles: slice) -> tuple[Rows, Reference | None]:
        """The row of :meth:`_passed`; a reading of the last cycle beyond the gate is left out, and its innovation reported."""
        before, gate = copy(self.causal), self.leg.rule[GATE]
        rows, reference = self._passed(cycles)
        gated = before if gate > 0 and before is not None and before.started and not before.run.stuck else None
        innovations = rows.normalised.reshape(2, 3)
        for sensor in range(2):
            if gated is not None and self.far[sensor] < BELIEVED and np.linalg.norm(innovations[sensor]) > gate:
                self.causal = copy(gated)
                self._leave_out(cycles.stop - 1, sensor, rows.innovation[0, :3], gated.run.estimate.inertia)
                rows, reference = self._passed(cycles)
                innovations[sensor + 1 :] = rows.normalised.reshape(2, 3)[sensor + 1 :]
            if not np.isnan(innovations[sensor]).any():
                self.far[sensor] = self.far[sensor] + 1 if gate > 0 and np.linalg.norm(innovations[sensor]) > gate else 0
        return rows._replace(normalised=innovations.reshape(1, 6)), reference

    def _leave_out(self, cycle: int, sensor: int, torque_n_m: Array, inertia: Array) -> None:
        """A reading; the predicted rate, by the innovation as a torque, stands in place of the gyro's."""
        row = self.rows[cycle]
        row[IGNORED.start + sensor] = 1.0
        if sensor == 0:
            rate = np.linalg.solve(inertia, torque_n_m) * row[LENGTH]
            row[THETA] -= np.array(self.vehicle.imu.body_from_imu).T @ rate * row[LENGTH]
        else:
            row[VELOCITY] = 0.0

    def _passed(self, cycles: slice) -> tuple[Rows, Reference | None]:
        """The row after the last of ``cycles``, and the present estimate."""
        samples = Stream.of(self._log(np.array(self.rows)), self.vehicle, stated_timing(self.vehicle))
        if self.causal is None:
            self.causal = Causal(samples, cycles, self.leg.own, Consider())
        else:
            self.causal.extend(samples, cycles.stop)
        rows, begun = Rows.empty(1), -1
        while begun < self.causal.run.at < cycles.stop:
            begun = self.causal.run.at
            rows = self.causal.block()
        return rows.last(), self.causal.run.estimate if self.causal.started else None

    def _log(self, flown: Array) -> Log:
        """The log of all cycles up to now, one record each."""
        return Log(
            path=Path("what has arrived"),
            sha256="",
            rows=len(flown),
            records_per_cycle=1,
            time_s=flown[:, END],
            interval_s=flown[:, LENGTH],
            delta_theta_imu_rad=flown[:, THETA],
            delta_v_imu_m_s=flown[:, VELOCITY],
            command_kind="jets" if self.jets else "wrench",
            command=flown[:, UNUSED + 1 :],
            attitude_wxyz=None,
            notices=(),
            ignored=flown[:, IGNORED] != 0,
        )


class Steady:
    """The number of cycles for which each quantity has been steady: ``mp_report`` of massprop_cli/kernel/verdict.c."""

    def __init__(self, leg: Leg) -> None:
        _, self.count, self.relative, *tolerances = leg.rule[:6]
        self.tolerance = np.repeat(tolerances, [6, 3, 1])
        self._begin()

    def _begin(self) -> None:
        self.steady, self.values = np.zeros(10), np.full(10, np.nan)
        self.counted, self.misfit = [AS_STATED] * 2, [1.0] * 2

    def excess(self, normalised: Array, reference: Reference | None) -> float:
        """Running mean square of normalised innovations (6,) of gyro or accelerometer, the larger, where it is beyond chance; else 1."""
        if reference is None:
            return 1.0
        for sensor, squares in enumerate(normalised.reshape(2, 3) ** 2):
            if not np.isnan(squares).any():
                self.counted[sensor] = min(self.counted[sensor] + 1, LATEST)
                self.misfit[sensor] += (min(float(squares.mean()), LOUDEST) - self.misfit[sensor]) / self.counted[sensor]
        return max(self.misfit) if max(self.misfit) > MISFIT else 1.0

    def verdicts(self, values: Array, sigmas: Array, contradicted: bool, reference: Reference | None) -> Array:
        """(10,) numbers of ``VERDICTS`` of the next row, by the sizes of the present estimate."""
        if reference is None:
            self._begin()
            return np.zeros(10)
        sizes = sizes_of_quantities(reference)
        tolerance, prior = self.tolerance * (sizes if self.relative else 1.0), sizes.copy()
        prior[POSITIVE] = np.minimum(sizes, values)[POSITIVE]
        with np.errstate(invalid="ignore"):
            informed = sigmas < HALVED * PRIOR * prior
            still = np.abs(values - self.values) <= tolerance
            sure = sigmas < PRECISE * tolerance
        self.steady = np.where(informed & still, np.minimum(self.steady + 1, self.count), 0.0)
        self.values = values
        stands = (self.steady == self.count) | (informed & sure & (self.steady >= LEAST_STEADY * self.count))
        said = np.where(stands, "converged", np.where(informed, "not_converged", "not_excited"))
        if contradicted:
            said[:] = "contradicted"
        said[np.isnan(values)] = "untold"
        return np.array([VERDICTS.index(one) for one in said], dtype=float)
