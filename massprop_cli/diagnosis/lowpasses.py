"""Hypotheses of stated low-passes: another cutoff or another latency than the vehicle file states.

Rates and specific force are regressed on the commands as each would show them (:func:`massprop_cli.diagnosis.delay.unexplained_by`), with
nothing known of the body. Both sensors are mostly in one chip, so a cutoff may be wrong for both alike. A latency that is wrong for both is
a delay of the commands.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.diagnosis.corrections import Case
from massprop_cli.diagnosis.delay import SENSORS, MeasuredMotion, motion_of, unexplained_by
from massprop_cli.diagnosis.linesearch import line_minimum, sigma_at
from massprop_cli.diagnosis.ranking import CLEAR
from massprop_cli.diagnosis.supposed import Supposed
from massprop_cli.errorparameters.setup import stating
from massprop_cli.errorparameters.table import SIGMA_KEYS

LATER = (-1.0, -0.5, -0.25, -0.12, -0.06, 0.06, 0.12, 0.25, 0.5, 1.0)
"""Cycles by which a sensor may be later than stated."""
SLOWER = tuple(np.log([0.1, 0.2, 0.4, 0.7, 1.4, 2.5, 5.0, 10.0]).tolist())
"""Logarithms of the factors that a time constant may have."""
STEP, FINEST = 0.5, 1 / 512
"""With which the search for either goes on, and ends."""
ROUGHLY = 3.0
"""Times its own sigma that a value is uncertain by: rates are taken cycle by cycle, and the delay as it is."""
MOST = 0.8
"""Part of what the best of them explains that others explain at least, to be put to the test."""


def other_low_passes(case: Case) -> list[Supposed]:
    """Those that explain clearly more than the stated low-passes, by what free coefficients make of each."""
    search = _Search(case)
    filtered = [sensor for sensor, one in search.stated.items() if one.order]
    # beside a delay that is to be found only the difference of both latencies shows
    late = [*search.stated][-1:] if search.sought else [*search.stated]
    found = [search.best([sensor], "latency_s") for sensor in late]
    found += [search.best(which, "cutoff_hz") for which in ([one] for one in filtered)]
    found += [search.best(filtered, "cutoff_hz")] if len(filtered) == len(SENSORS) else []
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
        # a delay that was estimated beside what is wrong here is as far off itself
        self.back = 0.0 if stated == "auto" else stated - case.timing.delay
        self.cost = sum(self._left({}, 0.0))

    @cached_property
    def motion(self) -> MeasuredMotion | None:
        """What the IMU felt; on a bearing when it was upright depends on the low-passes."""
        return None if self.case.vehicle.pivoted else motion_of(self.case.timing.of(self.case.log, self.case.vehicle))

    def best(self, which: Sequence[str], key: str) -> tuple[float, Supposed]:
        """The value that explains most, with the delay where that is to be found: as far as the other sensor shows it.

        And by how much −2 log likelihood is less with it than as stated.
        """
        others = [i for i, sensor in enumerate(SENSORS) if sensor not in which]
        later = self._later(others) if self.sought and others else self.back

        def cost(by: float) -> float:
            return sum(self._left(self._values(which, key, by), later))

        by = line_minimum(cost, LATER if key == "latency_s" else SLOWER, STEP, FINEST)
        sigma = sigma_at(cost, by)
        values, further = self._values(which, key, by), self._values(which, key, by + sigma)
        spread = {SIGMA_KEYS[name]: float(f"{ROUGHLY * abs(further[name] - value):.3g}") for name, value in values.items()}
        codes = tuple(f"{one}-filter" for one in which)
        return self.cost - cost(by), Supposed(codes, {**values, **spread}, (dict(further),), later, self.loose)

    def _later(self, sensors: Sequence[int]) -> float:
        """Cycles by which commands act later as far as these sensors tell."""

        def cost(later: float) -> float:
            left = self._left({}, later)
            return sum(left[i] for i in sensors)

        return line_minimum(cost, (0.0, *LATER), STEP, FINEST)

    def _values(self, which: Sequence[str], key: str, by: float) -> dict[str, float]:
        """Values of the keys by which sensors are later, or their low-passes slower."""
        found = {}
        for sensor in which:
            one = self.stated[sensor]
            value = one.latency + by * self.case.vehicle.cycle.period_s if key == "latency_s" else one.cutoff * float(np.exp(-by))
            found[f"imu.{sensor}_filter.{key}"] = value
        return found

    def _left(self, values: dict[str, float], later: float) -> tuple[float, float]:
        timing = self.case.timing.moved(("delay",), (later,))
        try:
            if timing.delay >= 0:
                return unexplained_by(self.case.log, stating(self.case.vehicle, values), timing, motion=self.motion)
        except (InputError, np.linalg.LinAlgError):
            pass
        return np.inf, np.inf
