"""What an estimate is worth behind IMUs that nobody chose: sampled or averaged, low-pass filtered, on clocks of their own.

    python benchmarks/imus.py --sets 30
    python benchmarks/imus.py --sets 30 --auto

Each set is four random bodies under one IMU (increments, means or samples; no low-pass, first order at 40 Hz, second order at 20 to 100 Hz;
97 to 400 Hz; control at 7 to 60 Hz; any offset and 50 ppm of drift), in free flight or on a bearing; with jets, or wheels beside them or
alone, told by their torque or by their speeds. With ``--auto`` cutoffs are left to be found.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
from scores import covered, rms_of
from script import counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli import QUANTITIES, flow
from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import anyimu

BODIES, DURATION_S, DELAY, WHEELED = 4, 40.0, 2.0, 0.4


def drawn(rng: np.random.Generator, auto: bool) -> tuple[anyimu.Imu, float]:
    """A random IMU and the control period, s."""
    measures = ["increment", "mean", "sample", "sample"][int(rng.integers(4))]
    order = int(rng.integers(1, 3)) if auto else int(rng.integers(3))
    cutoff = 40.0 if order == 1 else float(rng.uniform(20, 100))
    rate_hz, control_hz = float(rng.choice([97, 100, 125, 200, 250, 400])), float(rng.choice([7, 10, 20, 25, 30, 40, 60]))
    control_hz = 20.0 if control_hz > rate_hz / 1.5 else control_hz
    offset_s, ppm = float(rng.uniform(0, 1 / rate_hz)), float(rng.choice([0, 50, -50]))
    gyro, accel = 10 ** rng.uniform(-4, -2.7), 10 ** rng.uniform(-2.3, -1.2)
    imu = anyimu.Imu(rate_hz, measures, order, cutoff, offset_s=offset_s, ppm=ppm, gyro_noise=float(gyro), accel_noise=float(accel))
    return imu, 1 / control_hz


def measured(seed: int, auto: bool, said: Counter[str]) -> Array:
    """(BODIES, 10) deviations in sigmas."""
    imu, period_s = drawn(np.random.default_rng(9000 + seed), auto)
    rng = np.random.default_rng(seed)
    own, wheels = anyimu.bodies(rng, BODIES, bearing=bool(rng.random() < 0.35)), ""
    if rng.random() < WHEELED and not own.bearing:
        own, wheels = anyimu.wheeled(rng, own, jets=bool(rng.random() < 0.5)), str(rng.choice(["torque", "speed"]))
    odd = list[str]()
    flown, z = anyimu.fly(rng, own, imu, period_s, DURATION_S, DELAY * period_s), np.full((BODIES, 10), np.nan)
    for body in range(BODIES):
        used = anyimu.vehicle_of(own, body, flown, imu, period_s, DELAY * period_s, auto, wheels=wheels)
        try:
            found = flow.examine(anyimu.log_of(flown, body, imu, used), VehicleSource(used, "any-imu", ""))
        except InputError as error:
            said[f"refused: {error}"] += 1
            continue
        told, truth = found.conclusions[0].estimates, anyimu.truth_of(own, body)
        odd += [f"{body}: {notice.code}" for notice in found.notices if not notice.code.startswith("noise")]
        said.update(one.verdict for one in told.values())
        said.update(f"notice {notice.code}" for notice in found.notices if not notice.code.startswith("noise"))
        for i, name in enumerate(QUANTITIES):
            one = told[name]
            if one.value is not None and one.sigma:
                z[body, i] = (one.value - truth[i]) / one.sigma
    kind = f"{'bearing' if own.bearing else 'free':7s} {wheels:6s} {'jets' if own.jet_force.size else '':4s}"
    print(
        f"{seed:3d} {imu.measures:9s} order {imu.order} {imu.cutoff_hz:5.1f} Hz of {imu.rate_hz:3.0f} Hz, control {1 / period_s:3.0f} Hz, "
        f"{kind}: rms {np.sqrt(np.nanmean(z**2)):.2f}, worst {np.nanmax(np.abs(z)):.1f} {', '.join(odd)}",
        flush=True,
    )
    return z


def main() -> None:
    """Print one line for each set, then the totals."""
    parser = counted(__doc__, sets=30, first=0)
    parser.add_argument("--auto", action="store_true")
    asked, said = parser.parse_args(), Counter[str]()
    z = np.concatenate([measured(seed, asked.auto, said) for seed in range(asked.first, asked.first + asked.sets)])
    told = z[np.isfinite(z)]
    beyond = int((np.abs(told) > 4).sum())
    print(f"{len(told)} values: 95 % intervals cover {covered(told)}, rms {rms_of(told)}, {beyond} beyond 4 sigma; {dict(said)}")


if __name__ == "__main__":
    main()
