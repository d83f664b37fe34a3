"""Appendix B of the thesis again: what P0, Q and R do to the thesis's filters on simulation 1.

python benchmarks/thesis_tuning.py > docs/thesis-tuning.md
"""

import numpy as np

from massprop_cli.estimate import thesis
from massprop_cli.estimate.history import History
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare.align import align
from massprop_cli.prepare.compensate import compensate
from massprop_cli.testbed import scenario, simulate

VARIATIONS = {
    "as published (P0 = 10, R = 0.05)": (1.0, 1.0, 1.0),
    "P0 × 1e-3": (1e-3, 1.0, 1.0),
    "P0 × 100": (100.0, 1.0, 1.0),
    "Q = 0": (1.0, 0.0, 1.0),
    "Q × 1e7": (1.0, 1e7, 1.0),
    "R × 1e-4": (1.0, 1.0, 1e-4),
    "R × 100": (1.0, 1.0, 100.0),
}
"""Factors on P0, Q and R of the first filter, as in appendix B."""
PUBLISHED = {
    "P0 × 1e-3": "sluggish",
    "P0 × 100": "a spike, then fine",
    "Q = 0": "no visible change",
    "Q × 1e7": "bounds grow while idle, estimates wander",
    "R × 1e-4": "volatile",
    "R × 100": "poor convergence",
}
MOMENTS = {"Ixx": 0, "Iyy": 3, "Izz": 5}
IDLE_S = (12.5, 15.5)
"""Attitude hold with little left to do, between the yaw pulses and the diverts."""
EXCITED_S = (2.0, 12.0)


def tuned(vehicle: Vehicle, p0: float, q: float, r: float) -> Vehicle:
    """The vehicle with the thesis's matrices scaled."""
    stated = vehicle.estimator.thesis
    scaled = stated.model_copy(update={"p1": tuple(p0 * x for x in stated.p1), "q1": tuple(q * x for x in stated.q1), "r1": r * stated.r1})
    return vehicle.model_copy(update={"estimator": vehicle.estimator.model_copy(update={"method": "thesis", "thesis": scaled})})


def measures(history: History, column: int) -> list[str]:
    """Features of one estimate that a plot shows, as numbers."""
    value, sigma, time = history.values[:, column], history.sigmas[:, column], history.time_s
    idle = (time > IDLE_S[0]) & (time <= IDLE_S[1])
    excited = (time > EXCITED_S[0]) & (time <= EXCITED_S[1])
    numbers = (
        value[-1],
        np.abs(value).max(),
        np.sqrt(np.mean(np.diff(value[excited]) ** 2)),
        np.ptp(value[idle]),
        sigma[-1],
        sigma[idle][-1] / sigma[idle][0],
    )
    return [f"{number:.3g}" for number in numbers]


def main() -> None:
    """Fly once, estimate with each variation, and print."""
    source = scenario.load("preliminary")
    flown = simulate.fly(source, [1])
    true = flown.truth[0, 0]
    print(HEAD)
    for name, factors in VARIATIONS.items():
        used = tuned(flown.vehicle, *factors)
        samples = compensate(align(flown.log(0), used, 0.0, 0.0), used)
        history, _ = thesis.replay(samples, slice(0, len(samples)), flown.phases[0], used)
        notice = "; ".join(f"`{notice.code}`" for notice in history.notices)
        for moment, column in MOMENTS.items():
            cells = [name, moment, f"{true[column]:g}", *measures(history, column), PUBLISHED.get(name, "good"), notice]
            print("| " + " | ".join(cells) + " |")


HEAD = """# What tuning does to the thesis's filters

Made by `python benchmarks/thesis_tuning.py > docs/thesis-tuning.md`: `massprop simulate preliminary` (simulation 1 of the thesis, no noise)
through `--method thesis`, with P0, Q and R of its first filter scaled as in its appendix B. Moments of inertia about the CG, body axes,
kg m². *Largest* is the largest magnitude on the way (a spike shows here); *jitter* the root mean square step from cycle to cycle between 2
and 12 s; *wander* the range of the estimate over 12.5 to 15.5 s, when hardly anything is excited; *bound* the filter's sqrt(P) at the end
(its “precision”), and how much it grew while idle. The default method has none of these matrices to tune.

| variation | moment | true | at the end | largest | jitter | wander | bound | bound's growth, idle | appendix B says | warning |
|---|---|--:|--:|--:|--:|--:|--:|--:|---|---|"""

if __name__ == "__main__":
    main()
