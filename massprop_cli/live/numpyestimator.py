"""Recursive estimator without the compiled kernel: :mod:`massprop_cli.estimate.causal` on a growing log.

It is slow, because it aligns the whole log again after each cycle.
"""

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
from massprop_cli.export.resolve import FlightConstants, PhaseConstants
from massprop_cli.inputs.telemetry import Log
from massprop_cli.model.parameters import sizes_of_quantities
from massprop_cli.model.plant import Reference
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.stream import Stream

END, LENGTH, THETA, VELOCITY, IGNORED, UNUSED = 0, 1, slice(2, 5), slice(5, 8), slice(8, 10), 10
"""Indices of the kernel inputs of a cycle (:func:`massprop_cli.estimate.kernelflight.cycles_of`); commands follow."""
WINDOW = 256
"""Length of the running mean square of a sensor's normalised innovations, cycles."""
LARGEST = 25.0
"""Largest mean square of one cycle in the running mean."""
AS_STATED = 16
"""Number of cycles with mean square 1 with which the running mean starts."""
MISFIT = 1.5
"""Running mean square beyond which model and flight contradict each other."""
GATE = 12
"""Index of the innovation gate in a rule (:func:`massprop_cli.estimate.kernelflight.rule_of`)."""
MOST_REJECTED = 2
"""Largest number of consecutive readings that the gate rejects; a longer departure is motion (MP_BELIEVED in the kernel)."""


class NumPyEstimator:
    """Estimator of one flight; same methods as :class:`massprop_cli.live.estimator.KernelEstimator`."""

    def __init__(self, constants: FlightConstants) -> None:
        commands, self.vehicle = constants.commands, constants.vehicle
        self.jets, self.late, self.memory_s = bool(commands[0]), bool(commands[WAITS]), float(commands[MEMORY_S])
        self.rows: list[Array] = []
        """Kernel inputs of each cycle."""
        self.rejected = [0, 0]
        """Consecutive readings of gyro and accelerometer beyond the gate."""
        self.begin(constants.phases[0])

    def begin(self, phase: PhaseConstants) -> None:
        """Start a new phase with the next cycle that is completed."""
        self.phase, self.rule, self.first = phase, ConvergenceRule(phase), max(len(self.rows) - self.late, 0)
        self.causal: Causal | None = None

    def step(self, numbers: Array) -> Reported | None:
        """Process the next cycle and return the report that it completes."""
        self.rows.append(numbers.copy())
        return self._estimated(len(self.rows) - self.late)

    def last(self) -> Reported | None:
        """At the end of the flight, return the report of the cycle that waits for the next one."""
        return self._estimated(len(self.rows)) if self.late else None

    def _estimated(self, stop: int) -> Reported | None:
        """Report after the first ``stop`` cycles; None if the last of them is outside all phases, or executes commands not in the log."""
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
        values, covariance = quantities(rows.parameters, self.phase.resolved)
        ratio = self.rule.variance_factor(rows.normalised[0], reference)
        sigmas = np.sqrt(ratio * np.einsum("kii->ki", covariance))
        return Reported(rows, values, sigmas, self.rule.verdicts(values[0], sigmas[0], ratio > 1, reference)[None])

    def _gated(self, cycles: slice) -> tuple[Rows, Reference | None]:
        """Update with the innovation gate: reject a reading of the last cycle beyond it, but report its innovation."""
        before, gate = copy(self.causal), self.phase.rule[GATE]
        rows, reference = self._updated(cycles)
        gated = before if gate > 0 and before is not None and before.started and not before.run.stuck else None
        innovations = rows.normalised.reshape(2, 3)
        for sensor in range(2):
            if gated is not None and self.rejected[sensor] < MOST_REJECTED and np.linalg.norm(innovations[sensor]) > gate:
                self.causal = copy(gated)
                self._reject(cycles.stop - 1, sensor, rows.innovation[0, :3], gated.run.estimate.inertia)
                rows, reference = self._updated(cycles)
                innovations[sensor + 1 :] = rows.normalised.reshape(2, 3)[sensor + 1 :]
            if not np.isnan(innovations[sensor]).any():
                self.rejected[sensor] = self.rejected[sensor] + 1 if gate > 0 and np.linalg.norm(innovations[sensor]) > gate else 0
        return rows._replace(normalised=innovations.reshape(1, 6)), reference

    def _reject(self, cycle: int, sensor: int, torque_n_m: Array, inertia: Array) -> None:
        """Mark a reading as ignored; the predicted rate, from the innovation torque, replaces a gyro reading."""
        row = self.rows[cycle]
        row[IGNORED.start + sensor] = 1.0
        if sensor == 0:
            rate = np.linalg.solve(inertia, torque_n_m) * row[LENGTH]
            row[THETA] -= np.array(self.vehicle.imu.body_from_imu).T @ rate * row[LENGTH]
        else:
            row[VELOCITY] = 0.0

    def _updated(self, cycles: slice) -> tuple[Rows, Reference | None]:
        """Process the new ``cycles`` and return the last row, and the estimate; None before the first estimate."""
        samples = Stream.of(self._log(np.array(self.rows)), self.vehicle, stated_timing(self.vehicle))
        if self.causal is None:
            self.causal = Causal(samples, cycles, self.phase.resolved, Consider())
        else:
            self.causal.extend(samples, cycles.stop)
        rows, previous = Rows.empty(1), -1
        while previous < self.causal.run.at < cycles.stop:
            previous = self.causal.run.at
            rows = self.causal.block()
        return rows.last(), self.causal.run.estimate if self.causal.started else None

    def _log(self, inputs: Array) -> Log:
        """The log of all cycles so far, one record each; ``inputs`` (K, n): kernel inputs."""
        return Log(
            path=Path("what has arrived"),
            sha256="",
            rows=len(inputs),
            records_per_cycle=1,
            time_s=inputs[:, END],
            interval_s=inputs[:, LENGTH],
            delta_theta_imu_rad=inputs[:, THETA],
            delta_v_imu_m_s=inputs[:, VELOCITY],
            command_kind="jets" if self.jets else "wrench",
            command=inputs[:, UNUSED + 1 :],
            attitude_wxyz=None,
            notices=(),
            ignored=inputs[:, IGNORED] != 0,
        )


class ConvergenceRule:
    """Verdicts from steady values and the mean square innovation, as ``mp_report`` of massprop_cli/kernel/verdict.c."""

    def __init__(self, phase: PhaseConstants) -> None:
        _, self.count, self.relative, *tolerances = phase.rule[:6]
        self.tolerance = np.repeat(tolerances, [6, 3, 1])
        self._begin()

    def _begin(self) -> None:
        self.steady, self.values = np.zeros(10), np.full(10, np.nan)
        self.counted, self.misfit = [AS_STATED] * 2, [1.0] * 2

    def variance_factor(self, normalised: Array, reference: Reference | None) -> float:
        """Factor on the variances: the larger running mean square of gyro and accelerometer if it exceeds :data:`MISFIT`, else 1.

        ``normalised`` (6,): normalised innovations of the cycle.
        """
        if reference is None:
            return 1.0
        for sensor, squares in enumerate(normalised.reshape(2, 3) ** 2):
            if not np.isnan(squares).any():
                self.counted[sensor] = min(self.counted[sensor] + 1, WINDOW)
                self.misfit[sensor] += (min(float(squares.mean()), LARGEST) - self.misfit[sensor]) / self.counted[sensor]
        return max(self.misfit) if max(self.misfit) > MISFIT else 1.0

    def verdicts(self, values: Array, sigmas: Array, contradicted: bool, reference: Reference | None) -> Array:
        """(10,) indices in ``VERDICTS`` after the next cycle; tolerances are relative to the sizes of the estimate ``reference``."""
        if reference is None:
            self._begin()
            return np.zeros(10)
        sizes = sizes_of_quantities(reference)
        tolerance, prior = self.tolerance * (sizes if self.relative else 1.0), sizes.copy()
        prior[POSITIVE] = np.minimum(sizes, values)[POSITIVE]
        with np.errstate(invalid="ignore"):
            informed = sigmas < HALVED * PRIOR * prior
            unchanged = np.abs(values - self.values) <= tolerance
            precise = sigmas < PRECISE * tolerance
        self.steady = np.where(informed & unchanged, np.minimum(self.steady + 1, self.count), 0.0)
        self.values = values
        converged = (self.steady == self.count) | (informed & precise & (self.steady >= LEAST_STEADY * self.count))
        verdicts = np.where(converged, "converged", np.where(informed, "not_converged", "not_excited"))
        if contradicted:
            verdicts[:] = "contradicted"
        verdicts[np.isnan(values)] = "untold"
        return np.array([VERDICTS.index(verdict) for verdict in verdicts], dtype=float)
