"""What it brings the attitude control to take its body from the running estimate: pointing error and fuel after docking.

python benchmarks/control.py > docs/control.md
"""

from collections.abc import Sequence

import numpy as np
from script import commit, counted

from massprop_cli import QUANTITIES, __version__
from massprop_cli.live.estimator import OnboardEstimator
from massprop_cli.testbed import scenario, simulate
from massprop_cli.testbed.simulate import SimulatedFlight

GAINS = {
    "the single body, frozen": ("control.model=nominal",),
    "the same, stiff": ("control.model=nominal", "control.natural_frequency_rad_s=1.2", "control.damping=1.7"),
    "the running estimate": ("control.model=estimate",),
    "the true body": ("control.model=truth",),
}
RUNNING, STIFF = "the running estimate", "the same, stiff"
WHOLE = (
    (5, 25, "stops the turn that docking left"),
    (25, 40, "is excited"),
    (40, 80, "is pushed along y and z"),
    (80, 100, "is left alone"),
)
QUIET = 'plan=[{motion="hold", start_s=0.0, end_s=100.0}]'
LIGHT = tuple(f"docked.{name}={value}" for name, value in (("mass", 2.0), ("ixx", 0.02), ("iyy", 0.02), ("izz", 0.02)))
SMALL = (*LIGHT, "docked.ixy=0.0", "docked.iyz=0.0", "docked.cg_x=0.3", "docked.cg_y=0.0", "docked.cg_z=0.0")

INTRODUCTION = """# Control by the running estimate

`massprop simulate docked-hold` flies a 22 kg free flyer that docks with 30 kg at 5 s. Its CG moves by 0.47 m, its moments of inertia grow
6.2, 5.4 and 6.0 times. Its control holds the attitude (0.5 rad/s, 0.7 of critical damping) by gains made of the body that it takes itself
to have: `nominal`, what the vehicle file says of it alone; `estimate`, the same until massprop's running estimate of a quantity has
converged, then that; `truth`, which nobody has in flight. The offset torque of that body's CG is fed forward while it is pushed. The
estimator is that of `massprop live`, fed with each cycle's commands and IMU increments when it ends. "Stiff" are frozen gains of the single
body as high as the docked vehicle wants them (1.2 rad/s, 1.7), which is what one would do without an estimate where delay and structure
allow it.

Pointing error is the angle between the true attitude and the one held, rms over seeds and time, and the largest of all. Fuel is the jets'
impulse, thrust times on-time over all jets, mean of a seed; pushes and excitation are counted with it.
"""

WORDS = """## In words

- Pushed off its CG the docked vehicle points as well by the running estimate as by the true body; frozen gains let it swing. Holding it
  costs fuel that a swinging vehicle does not burn. Stiff gains bring most of the pointing for the same fuel; what is left is the CG, which
  no gain knows.
- Left alone after that it saves fuel: frozen gains damp the slow swing hardly.
- Before a quantity has converged nothing is gained: the turn that docking leaves is stopped by the frozen gains, where stiff ones stop it
  as closely as true ones. A vehicle that is not excited learns late: each gain that steps up then moves it, and all of it burns more than
  with either frozen or true gains.
- Excitation burns far more than better gains save. It pays where pointing counts, or where the mass properties are wanted anyway; where
  those of the docked object are known beforehand, gains of these need none.
- A small object changes little, and its estimate brings little.
- On-times below half a PWM tick (2.5 ms) are not fired, so that small errors stay; the larger a gain, the smaller. That is much of the
  pointing error where nothing pushes, whatever body the gains are of.
"""


def impulse(flight: SimulatedFlight) -> np.ndarray:
    """(S, K) impulse of all jets, N s."""
    return np.asarray(flight.issued @ np.linalg.norm(flight.vehicle.jet_wrench[:, 3:], axis=1))


def pointing(flight: SimulatedFlight) -> np.ndarray:
    """(S, K) angle between the attitude and the one held, degrees."""
    cosine = np.abs((flight.attitude_wxyz[:, 1:] * flight.attitude_wxyz[:, :1]).sum(-1))
    return np.asarray(np.degrees(2 * np.arccos(np.minimum(cosine, 1.0))))


def table(
    seeds: Sequence[int], stretches: Sequence[tuple[int, int, str]], assignments: Sequence[str] = (), without: str = ""
) -> dict[str, SimulatedFlight]:
    """Print one row for each interval and kind of gains."""
    flights = {
        name: simulate.fly(scenario.load("docked-hold", [*own, *assignments]), seeds, running=OnboardEstimator)
        for name, own in GAINS.items()
        if name != without
    }
    print("| from, s | to, s | the vehicle | gains of | pointing error, rms, degrees | largest | fuel, N s | ± over seeds |")
    print("|--:|--:|---|---|--:|--:|--:|--:|")
    for start, end, what in (*stretches, (5, 100, "all of it")):
        for name, flight in flights.items():
            here = (flight.time_s > start) & (flight.time_s <= end)
            error, fuel = pointing(flight)[:, here], impulse(flight)[:, here].sum(1)
            rms = np.sqrt((error**2).mean())
            print(f"| {start} | {end} | {what} | {name} | {rms:.3f} | {error.max():.2f} | {fuel.mean():.2f} | {fuel.std(ddof=1):.2f} |")
    print()
    return flights


def learned(flight: SimulatedFlight) -> None:
    """When each quantity of the control's body changes first, and how far it is from the truth in the end."""
    print(
        "When the running estimate first replaces a nominal value, median and last of the seeds, and how far the value in use is from the"
    )
    print("truth at 100 s, rms over seeds:\n")
    print("| quantity | median, s | last, s | nominal, off by | in use, off by | unit |\n|---|--:|--:|--:|--:|---|")
    changed = flight.modelled != flight.modelled[:, :1]
    for i, name in enumerate(QUANTITIES):
        ends = flight.truth[:, -1, i]
        first = np.where(changed[:, :, i].any(1), flight.time_s[changed[:, :, i].argmax(1)], np.inf)
        off = [np.sqrt(((flight.modelled[:, k, i] - ends) ** 2).mean()) for k in (0, -1)]
        unit = "kg m²" if i < 6 else "m" if i < 9 else "kg"
        print(f"| {name} | {np.median(first):.2f} | {first.max():.2f} | {off[0]:.3g} | {off[1]:.2g} | {unit} |")
    print()


def main() -> None:
    """Fly and print the page."""
    seeds = range(1, counted(__doc__, seeds=50).parse_args().seeds + 1)
    print(INTRODUCTION)
    print(f"Made by `python benchmarks/control.py > docs/control.md` at commit {commit()} (massprop {__version__}), {len(seeds)} seeds.\n")
    print("## Where it matters\n")
    learned(table(seeds, WHOLE)[RUNNING])
    print("Attitude control uses the moments of inertia and the CG; it has no use for the mass and the products.\n")
    print("## Where it brings little\n\nThe same vehicle that does nothing after docking but hold, and is not excited:\n")
    table(seeds, ((5, 25, WHOLE[0][2]), (25, 100, "is left alone")), (QUIET,), STIFF)
    print("The whole of docked-hold with an object of 2 kg, whose CG is 0.3 m ahead of O, in place of the 30 kg:\n")
    table(seeds, WHOLE, SMALL, STIFF)
    print(WORDS, end="")


if __name__ == "__main__":
    main()
