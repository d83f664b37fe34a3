"""Hypotheses of stated low-passes: another cutoff or another latency than the vehicle file states.

Cutoffs are fitted to the log together (:func:`massprop_cli.diagnosis.delay.detect`), and with the delay where that was estimated: it takes
the difference of the low-passes' own delays. For latencies rates and specific force are regressed on the commands as each would show them
(:func:`massprop_cli.diagnosis.freeresponse.unexplained_with`). A latency that is wrong for both sensors is a delay of the commands.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from massprop_cli.diagnosis.delay import LONGEST, PRIOR, SENSORS, apart, cycles_of, detect
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import MeasuredMotion, line_minimum, motion_of, sigma_at, unexplained_with
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.supposed import States, Supposed
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.errorparameters.table import BY_NAME, SIGMA_KEYS

LATER = (-1.0, -0.5, -0.25, -0.12, -0.06, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Cycles by which a sensor may be later than stated."""
SLOWER = tuple(np.log([0.1, 0.2, 0.4, 0.7, 1.0, 1.4, 2.5, 5.0, 10.0]).tolist())
"""Logarithms of the factor that the time constants of both sensors may have, to begin with."""
STEP, FINEST = 0.5, 1 / 512
"""With which the search for that goes on, and ends."""
ROUGHLY = 3.0
"""Times its own sigma that a value is uncertain by: an estimate with it hardly counts the log twice."""
MOVED = 3.0
"""Sigmas by which a cutoff must differ from the stated one."""
MOST = 0.8
"""Part of what the best of them explains that others explain at least, to be put to the test."""


def other_low_passes(case: Case, piece: slice) -> list[Supposed]:
    """Those that explain clearly more than the stated low-passes, by what free coefficients make of each."""
    search = _Search(case)
    # beside a delay that is to be found only the difference of both latencies shows
    late = [*search.stated][-1:] if search.sought else [*search.stated]
    found = [*map(search.latency, late), *search.cutoffs(piece)]
    least = max(CLEAR, MOST * max((gained for gained, _ in found), default=0.0))
    return [one for gained, one in found if gained > least]


class _Search:
    """Search for the values of one hypothesis after the other."""

    def __init__(self, case: Case) -> None:
        imu, cycle = case.vehicle.imu, case.vehicle.cycle
        self.case = case
        self.stated = {sensor: one for sensor in SENSORS if (one := getattr(imu, f"{sensor}_filter")) is not None}
        stated = cycle.command_delay_cycles
        self.sought = stated == "auto"
        self.loose = 1.0 if self.sought else cycle.command_delay_sigma_cycles
        # a delay that was estimated beside what is wrong here is as far off itself, and its sigma is that of the fit
        self.back = 0.0 if stated == "auto" else stated - case.timing.delay
        self.cost = sum(self._left({}, 0.0))

    @cached_property
    def motion(self) -> MeasuredMotion | None:
        """What the IMU felt; on a bearing when it was upright depends on the low-passes."""
        return None if self.case.vehicle.pivoted else motion_of(self.case.timing.of(self.case.log, self.case.vehicle))

    def cutoffs(self, piece: slice) -> list[tuple[float, Supposed]]:
        """Those that differ clearly among all of the fit, and by how much −2 log likelihood is less with them than as stated."""
        case, filtered = self.case, [sensor for sensor, one in self.stated.items() if one.order]
        delay, names = ["delay"] if self.loose else [], [f"{sensor}_cutoff" for sensor in filtered]
        estimated = self.sought or self.back != 0
        prior = [0.0 if estimated else self.loose] * len(delay) + [0.0] * len(names)
        begun = self._begun(filtered) if names else case.setup
        found = detect(begun, [piece], [*delay, *names], prior) if names else None
        if found is None or found.imu is None:
            return []
        there = case.setup._replace(vehicle=stating(case.vehicle, {"imu": found.imu}))
        sigmas = np.sqrt(np.diag(found.covariance))[len(delay) :]
        moved = np.abs(apart(there, case.setup, names))
        states, codes = States(), list[str]()
        for sensor, name, by, sigma in zip(filtered, names, moved, sigmas, strict=True):
            key = f"imu.{sensor}_filter.cutoff_hz"
            if by > MOVED * sigma:
                spread = ROUGHLY * sigma * BY_NAME[name].scale(there.vehicle)
                states |= {key: float(there.value(key)[0]), SIGMA_KEYS[key]: float(f"{spread:.3g}")}
                codes.append(f"{sensor}-filter")
        later = found.at.delay - case.timing.delay
        # a delay that is "auto" stays so
        supposed = Supposed(tuple(codes), states, later=later, loose=PRIOR / 2 if estimated else self.loose)
        return [(self.cost - sum(self._left(states, later)), supposed)] if codes else []

    def _begun(self, filtered: Sequence[str]) -> Setup:
        """Time constants of all by one factor; a delay that is to be found takes the difference of the low-passes' own."""
        own = [(1.0, 2**0.5)[self.stated[sensor].order - 1] * cycles_of(self.case.setup, f"{sensor}_cutoff") for sensor in filtered]

        def states(by: float) -> States:
            return {f"imu.{sensor}_filter.cutoff_hz": self.stated[sensor].cutoff * float(np.exp(-by)) for sensor in filtered}

        def later(by: float) -> float:
            return self.back + (float(np.mean(own)) * (1 - float(np.exp(by))) if self.sought else 0.0)

        by = line_minimum(lambda by: sum(self._left(states(by), later(by))), SLOWER, STEP / 2, STEP / 8)
        return Setup(self.case.log, stating(self.case.vehicle, states(by)), self.case.timing.moved(("delay",), (later(by),)))

    def latency(self, sensor: str) -> tuple[float, Supposed]:
        """The one that explains most, with the delay where that is to be found: as far as the other sensor shows it.

        And by how much −2 log likelihood is less with it than as stated.
        """
        others = [i for i, one in enumerate(SENSORS) if one != sensor]
        later, key = self._later(others) if self.sought else self.back, f"imu.{sensor}_filter.latency_s"

        def value(by: float) -> float:
            return float(self.stated[sensor].latency + by * self.case.vehicle.cycle.period_s)

        def cost(by: float) -> float:
            return sum(self._left({key: value(by)}, later))

        by = line_minimum(cost, LATER, STEP, FINEST)
        further = value(by + sigma_at(cost, by))
        states: States = {key: value(by), SIGMA_KEYS[key]: float(f"{ROUGHLY * abs(further - value(by)):.3g}")}
        return self.cost - cost(by), Supposed((f"{sensor}-filter",), states, ({key: further},), later, self.loose)

    def _later(self, sensors: Sequence[int]) -> float:
        """Cycles by which commands act later as far as these sensors tell."""
        return line_minimum(lambda later: sum(self._left({}, later)[i] for i in sensors), (0.0, *LATER), STEP, FINEST)

    def _left(self, values: States, later: float) -> tuple[float, float]:
        """By the same cycles whatever the low-passes: a slower one settles later."""
        return unexplained_with(self.case.setup, values, later, min(LONGEST, self.case.log.cycles // 4), self.motion)
