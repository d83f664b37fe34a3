"""Hypotheses about stated low-passes: another cutoff or another latency.

Cutoffs are fitted together (:func:`massprop_cli.diagnosis.delay.detect`), with the delay if that was estimated, since it absorbs their
common delay. Latencies are those of least free-response cost (:func:`massprop_cli.diagnosis.freeresponse.costs_with`). A common
latency error of both sensors is a delay of the commands.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from massprop_cli.base.levels import CHANCE, CLEAR
from massprop_cli.diagnosis.corrections import ANEW
from massprop_cli.diagnosis.delay import LONGEST, PRIOR, SENSORS, cycles_of, detect, differences
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.freeresponse import MeasuredMotion, costs_with, line_minimum, motion_of, sigma_at
from massprop_cli.diagnosis.keyhypothesis import KeyHypothesis, KeyValues
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.errorparameters.table import BY_NAME, SIGMA_KEYS

LATER = (-1.0, -0.5, -0.25, -0.12, -0.06, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Latency changes that are searched, cycles."""
SLOWER = tuple(np.log([0.1, 0.2, 0.4, 0.7, 1.0, 1.4, 2.5, 5.0, 10.0]).tolist())
"""Initial logarithms of the common factor on the time constants."""
STEP, FINEST = 0.5, 1 / 512
"""First and last step of that search."""
MOST = 0.8
"""Least gain over that of the best hypothesis."""


def other_low_passes(case: Case, piece: slice) -> list[KeyHypothesis]:
    """Other low-passes with a clearly lower free-response cost than the stated ones."""
    search = _Search(case)
    # with an open delay, only the difference of both latencies is observable
    sensors = [*search.stated][-1:] if search.sought else [*search.stated]
    rated = [*map(search.latency, sensors), *search.cutoffs(piece)]
    least_gain = max(CLEAR, MOST * max((gained for gained, _ in rated), default=0.0))
    return [one for gained, one in rated if gained > least_gain]


class _Search:
    """Search for other cutoffs and latencies of one case."""

    def __init__(self, case: Case) -> None:
        imu, cycle = case.vehicle.imu, case.vehicle.cycle
        self.case = case
        self.stated = {sensor: one for sensor in SENSORS if (one := getattr(imu, f"{sensor}_filter")) is not None}
        stated = cycle.command_delay_cycles
        self.sought = stated == "auto"
        self.loose = 1.0 if self.sought else cycle.command_delay_sigma_cycles
        # a delay estimated with a wrong low-pass is wrong itself, with the sigma of that fit
        self.back = 0.0 if stated == "auto" else stated - case.timing.delay
        self.cost = sum(self._left({}, 0.0))

    @cached_property
    def motion(self) -> MeasuredMotion | None:
        """Measured motion; None on a bearing, where it depends on the low-passes."""
        return None if self.case.vehicle.pivoted else motion_of(self.case.timing.of(self.case.log, self.case.vehicle))

    def cutoffs(self, piece: slice) -> list[tuple[float, KeyHypothesis]]:
        """Hypothesis of the cutoffs that changed significantly, with its decrease of −2 log likelihood."""
        case, filtered = self.case, [sensor for sensor, one in self.stated.items() if one.order]
        delay, names = ["delay"] if self.loose else [], [f"{sensor}_cutoff" for sensor in filtered]
        estimated = self.sought or self.back != 0
        prior = [0.0 if estimated else self.loose] * len(delay) + [0.0] * len(names)
        start = self._begun(filtered) if names else case.setup
        timing = detect(start, [piece], [*delay, *names], prior) if names else None
        if timing is None or timing.imu is None:
            return []
        setup = case.setup._replace(vehicle=stating(case.vehicle, {"imu": timing.imu}))
        sigmas = np.sqrt(np.diag(timing.covariance))[len(delay) :]
        changes = np.abs(differences(setup, case.setup, names))
        states, codes = KeyValues(), list[str]()
        for sensor, name, by, sigma in zip(filtered, names, changes, sigmas, strict=True):
            key = f"imu.{sensor}_filter.cutoff_hz"
            if by > CHANCE * sigma:
                spread = ANEW * sigma * BY_NAME[name].scale(setup.vehicle)
                states |= {key: float(setup.value(key)[0]), SIGMA_KEYS[key]: float(f"{spread:.3g}")}
                codes.append(f"{sensor}-filter")
        later = timing.at.delay - case.timing.delay
        # an open delay stays open
        hypothesis = KeyHypothesis(tuple(codes), states, delay_change=later, delay_sigma=PRIOR / 2 if estimated else self.loose)
        return [(self.cost - sum(self._left(states, later)), hypothesis)] if codes else []

    def _begun(self, filtered: Sequence[str]) -> Setup:
        """Setup with one factor on all time constants; an open delay compensates their mean."""
        delays = [(1.0, 2**0.5)[self.stated[sensor].order - 1] * cycles_of(self.case.setup, f"{sensor}_cutoff") for sensor in filtered]

        def states(by: float) -> KeyValues:
            return {f"imu.{sensor}_filter.cutoff_hz": self.stated[sensor].cutoff * float(np.exp(-by)) for sensor in filtered}

        def later(by: float) -> float:
            return self.back + (float(np.mean(delays)) * (1 - float(np.exp(by))) if self.sought else 0.0)

        by = line_minimum(lambda by: sum(self._left(states(by), later(by))), SLOWER, STEP / 2, STEP / 8)
        return Setup(self.case.log, stating(self.case.vehicle, states(by)), self.case.timing.moved(("delay",), (later(by),)))

    def latency(self, sensor: str) -> tuple[float, KeyHypothesis]:
        """Latency of least cost, with its decrease of −2 log likelihood; an open delay is that of the other sensor."""
        others = [i for i, one in enumerate(SENSORS) if one != sensor]
        later, key = self._later(others) if self.sought else self.back, f"imu.{sensor}_filter.latency_s"

        def value(by: float) -> float:
            return float(self.stated[sensor].latency + by * self.case.vehicle.cycle.period_s)

        def cost(by: float) -> float:
            return sum(self._left({key: value(by)}, later))

        by = line_minimum(cost, LATER, STEP, FINEST)
        one_sigma = value(by + sigma_at(cost, by))
        states: KeyValues = {key: value(by), SIGMA_KEYS[key]: float(f"{ANEW * abs(one_sigma - value(by)):.3g}")}
        return self.cost - cost(by), KeyHypothesis((f"{sensor}-filter",), states, ({key: one_sigma},), later, self.loose)

    def _later(self, sensors: Sequence[int]) -> float:
        """Change of the delay of least cost by these sensors, cycles."""
        return line_minimum(lambda later: sum(self._left({}, later)[i] for i in sensors), (0.0, *LATER), STEP, FINEST)

    def _left(self, values: KeyValues, later: float) -> tuple[float, float]:
        """Costs over the same cycles for all low-passes, since a slower one settles later."""
        return costs_with(self.case.setup, values, later, min(LONGEST, self.case.log.cycles // 4), self.motion)
