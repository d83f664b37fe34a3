"""What the compiled kernel costs, how it bears long flights, and what single precision loses.

    python benchmarks/kernel.py > docs/kernel.md
    python benchmarks/kernel.py --longest 10000000 > docs/kernel.md      # takes minutes

Times are CPU times of one thread. Beside a cycle stands filterpy's update of nine states by three measurements, timed in the same run,
where filterpy is installed. Code, RAM and stack for Cortex-M4F want gcc-arm-none-eabi.
"""

import io
import json
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.csv
import pyarrow.parquet
from script import SAMPLES, commit, counted

from massprop_cli import QUANTITIES, __version__
from massprop_cli import kernel as room
from massprop_cli.estimate import kernelflight
from massprop_cli.export import folder, resolve
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import Kernel, kernel, opened
from massprop_cli.kernel.compile import FLAGS
from massprop_cli.live import run

SOAK = Path(__file__).with_name("kernel_soak.c")
ARM = "arm-none-eabi-gcc"
M4F = ["-Os", "-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-DMP_SINGLE", "-fcallgraph-info=su"]

RINGS = (1024, 256, 128), (256, 128, 128), (128, 64, 128), (64, 64, 64), (32, 32, 32)
"""MP_LEARNING, MP_RING and MP_LONGEST."""
RAM = """RAM of the free-flyer sample's vehicle (aim: 65,536 bytes) by the number of cycles stored for processing again: MP_LEARNING,
MP_RING and MP_LONGEST of massprop.h. Last column: the largest change of a final value of the sample logs, in double precision.

| cycles | RAM | of that, cycles held | checkpoints | moves by up to |
|---|--:|--:|--:|--:|"""

INTRODUCTION = """# The compiled kernel

The causal estimator has two implementations: NumPy (massprop_cli/estimate) and C99 (massprop_cli/kernel). Both take the same decisions at
the same cycles. If a C compiler was present at installation, `estimate`, `batch` and Python run on C, otherwise on NumPy.
run.json names the implementation (`kernel`). Off-line computations over many cycles or hypotheses also run on C: the response of a segment,
the filter and the predictions of off-line fits, the effect of a lag on commands, and fits of hypotheses to a log.
`MASSPROP_KERNEL=numpy` selects NumPy. Both agree to 1e-6 of a sigma at every cycle of the sample logs, except for crazyflie/yaw. The
start of that log is chaotic: a change of 1e-13 in the measurements moves its values by sigmas in either implementation.

Only NumPy supports tables (`planar`), a free swing with known inertia, [drift], estimated damping, more than four wheels, wheels whose
torque is logged, control moment gyros, rotors with a spin inertia, jets or an IMU with uncertain position or thrust, more than 64 bins a
cycle, and delay or lag with a sigma (also an estimated one). For a log with wheels or rotors, sampled or filtered sensors, thrust that
droops or fails for a time, a drifting clock, more than 64 jets or a delay beyond 19 cycles, only the alignment runs on NumPy.

`massprop export-flight` writes the sources with a vehicle's tables for a flight computer, and a test vector. The flight code must reproduce
the vector bit for bit. It does on x86-64 with and without sanitizers, and on 32-bit ARM (gcc-arm-linux-gnueabihf under qemu-user).

In your own build, compile all .c files of the folder but `replay.c`, which has the only `main`. Each cycle you fill in an `mp_flown`
(preprocess.h) and read an `mp_values` (verdict.h). `mp_flown` has no attitude: on a bearing or pedestal the kernel integrates the gyro
from the vehicle file's initial attitude on, and free flight needs none. The members of `mp_flight` are not an interface: `preprocess` has
the commands in flight and the attitude, `pass` the estimate. Every call returns a status. On any status but MP_OK nothing has changed,
but after a refused begin the steps return MP_ORDER until a begin succeeds. A cycle a million periods or more
after the last is refused: after such a pause, begin again.

`massprop live` makes the same calls while records arrive on standard input:

    tail -f telemetry.csv | massprop live --vehicle vehicle.toml --out flight | controller

Each line of its output is one cycle: `{"time_s": ..., "phase": ..., "estimates": {"ixx": {"value": ..., "sigma": ..., "verdict": ...},
...}}`, SI, null where no value is possible. Verdicts are `untold`, `not_excited`, `not_converged` and `converged`, by the tolerances known
then. A verdict is `contradicted` where the running mean square of the normalised innovations of the gyro or the accelerometer is above 1.5
(expected: 1; [detection rates](aboard.md)). The mean is exponential: each cycle counts 1/256 less than the next one. At the beginning it is
the mean of all cycles and of 16 as stated. One cycle counts at most 25. Above 1.5 the vehicle differs from the vehicle file, or the stated
noise is more than 1.22 times too small; do not use any value.

A reading whose innovation is beyond 10 sigma does not enter the estimate: the gyro's predicted rate stands in its place, or the
accelerometer counts as absent in that cycle. Of Gaussian noise as stated 1.5e-21 of the readings are beyond 10 sigma (chi-square, 3 degrees
of freedom), so a flight of 10 million cycles loses one with a probability of 3e-14. The innovation still counts in the running mean: where
more than 2 % of the cycles have such readings, values are `contradicted`. Of readings in a row that are beyond 10 sigma, only the first two
are dropped; the third and those after it are used. Before the first estimate (16 cycles or more, with excitation) no innovation exists,
and until each axis has been excited a gyro reading of more than about 0.05 rad off may pass; then values stay `contradicted` or
untold until `mp_begin` or a new recording begins anew. The off-line estimate of the recording finds such readings by its own test.

The vehicle file must state noise levels and delay. At the end massprop estimates the recording (record.csv) like any log. That result also
includes estimated disturbances, so it may differ from the last line.

Cycles much shorter than a period may issue more commands than the kernel stores for each jet or wrench component (MP_PENDING of
preprocess.h: 24 that are still to act or still act). Then two neighbouring commands become one with the same impulse, the two whose first
moment changes least. No reading is used in the cycles in which that command acts. Later cycles are used again: the predicted rate has the
whole impulse.

On board, as on the ground, sensors may record samples and be behind low-passes with a latency, thrust may lag, jets may have delays of
their own, and pulses be centred or end in their cycles. Samples are taken to come at even distances within a cycle, on the clock of the
commands. Beside wheels, sensors must record increments or means without a filter.

On a pedestal each line has `about_pivot` in place of `estimates`: inertia about the pivot [kg m²] and first moment [kg m], on which alone
the motion depends. With a weighed mass m the CG is pivot + moment / m. Of wheels their speeds at the end of each cycle are needed (`speed`
of `mp_flown`; live, `wheel_NAME_rad_s` of each record); they are taken to change evenly in between. The stated noise must include what
tachometers add to it (`speed_error_in_noise`); `export-flight --log` takes that from a log. On the ground the error of a reading is
estimated from those before and after it, on board not. On a bearing or pedestal the estimate's own bias of the
gyro keeps the attitude right on board, cycle by cycle; on the ground further passes over the log do.
"""


def filterpy_us() -> float | None:
    """CPU time of one update of nine states by three measurements."""
    try:
        from filterpy.kalman import KalmanFilter  # type: ignore[import-not-found]
    except ImportError:
        return None
    one = KalmanFilter(dim_x=9, dim_z=3)
    one.H = np.random.default_rng(1).standard_normal((3, 9))
    least = np.inf
    for _ in range(5):
        begun = time.process_time()
        for _ in range(1000):
            one.update(np.zeros((3, 1)))
        least = min(least, (time.process_time() - begun) / 1000)
    return 1e6 * least


def limits(where: Path) -> list[str]:
    """Compiler flags of the vehicle of a folder."""
    return re.findall(r"-DMP_\w+=\d+", (where / "Makefile").read_text())


def optimised(where: Path) -> str:
    """The optimisation flags of the folder's Makefile."""
    return (where / "Makefile").read_text().partition("OPTIMISED = ")[2].partition("\n")[0]


def soaked(where: Path, *arguments: str, as_flown: bool = False) -> list[list[str]]:
    """The lines of kernel_soak.c, built as pip builds the kernel, or as the flight folder's Makefile does."""
    sources = [str(path) for path in where.glob("*.c") if path.name != "replay.c"]
    level = optimised(where).split() if as_flown else [flag for flag in FLAGS if flag.startswith("-O")]
    flags = ["-std=c99", *level, "-ffp-contract=off", *limits(where), f"-I{where}"]
    subprocess.run(["cc", *flags, *sources, str(SOAK), "-o", str(where / "soak"), "-lm"], check=True)
    with (where / "vector.txt").open() as vector:
        run = subprocess.run([str(where / "soak"), *arguments], stdin=vector, capture_output=True, text=True, check=False)
    return [line.split() for line in run.stdout.splitlines()]


def costs(where: Path, longest: int) -> None:
    """Print the time of a cycle against the length of the flight."""
    beside = filterpy_us()
    print("## A cycle\n\nThe free-flyer sample, then the same body turning freely, with the noise that its vehicle file states.\n")
    print("| cycles | mean of one, us | worst, us | mean / filterpy update | mean / filterpy update, as flown | wrong numbers |")
    print("|--:|--:|--:|--:|--:|--:|")
    kernelflight = soaked(where, str(longest), "1e-4", as_flown=True)
    for (cycles, mean, worst, wrong), (_, slower, *_) in zip(soaked(where, str(longest), "1e-4"), kernelflight, strict=True):
        ratios = ["-" if beside is None else f"{float(of) / 1000 / beside:.2f}" for of in (mean, slower)]
        print(f"| {int(cycles):,} | {float(mean) / 1000:.1f} | {float(worst) / 1000:,.0f} | {' | '.join(ratios)} | {wrong} |")
    told = "filterpy is not installed here" if beside is None else f"filterpy's update of 9 states by 3 measurements took {beside:.1f} us"
    print(f"\n{told}. The kernel is built as pip builds it, and as flown with {optimised(where)}.")
    print("The worst cycles are those after which the kernel processes the latest cycles again, or in which other programs ran.\n")


def health(where: Path, longest: int) -> None:
    """Print the wrong numbers without noise, and without excitation."""
    print("## Long flights\n\nA value, or a stored number, counts as wrong where it is not finite, a sigma where it is")
    print("not positive.\n")
    print("| flight | cycles | wrong numbers |\n|---|--:|--:|")
    for name, arguments in (
        ("noise of 1e-10, stated", ("1e-10", "stated")),
        ("noise of 1e-10, stated, and no excitation", ("1e-10", "stated", "0")),
    ):
        cycles, *_, wrong = soaked(where, str(longest), *arguments)[-1]
        print(f"| {name} | {int(cycles):,} | {wrong} |")
    print()


def answers() -> None:
    """CPU time from a record's line to the line that answers it, or to being ready for the next."""
    print("## Live\n\nCPU time to read and store a record and, at the end of a cycle, to print the estimate (`massprop live`).\n")
    print("| log | records | a cycle's | median, us | 99.9 %, us | worst, us |\n|---|--:|--:|--:|--:|--:|")
    for name in ("free-flyer", "high-rate"):
        log, text = SAMPLES / name / "log.parquet", io.BytesIO()
        pyarrow.csv.write_csv(pyarrow.parquet.read_table(log), text)
        lines, marks = text.getvalue().decode().splitlines(keepends=True), list[float]()

        def fed(lines: list[str] = lines, marks: list[float] = marks) -> Iterator[str]:
            for line in lines:
                marks.append(time.process_time())
                yield line
            marks.append(time.process_time())

        said = sum(1 for _ in run.follow(fed(), vehiclefile.load(log.with_name("vehicle.toml")), lambda _: None, print))
        took = 1e6 * np.diff(marks)[1:]
        records = round((len(lines) - 1) / said)
        print(f"| {name} | {len(took):,} | {records} | " + " | ".join(f"{np.quantile(took, q):,.0f}" for q in (0.5, 0.999, 1)) + " |")
    print()


def deepest(where: Path) -> int:
    """Bytes of stack along the deepest chain of calls, from the compiler's own graph of them; there is no recursion."""
    text = "".join(path.read_text() for path in where.glob("*.ci"))
    own = {name: int(size) for name, size in re.findall(r'title: "([^"]+)" label: "[^"]*?(\d+) bytes', text)}
    calls: dict[str, set[str]] = {}
    for caller, called in re.findall(r'sourcename: "([^"]+)" targetname: "([^"]+)"', text):
        calls.setdefault(caller, set()).add(called)

    def below(name: str) -> int:
        return own.get(name, 0) + max((below(called) for called in calls.get(name, ())), default=0)

    return below("mp_flight_step")


def sizes(where: Path) -> None:
    """Print sizes of code, state and stack on a Cortex-M4F."""
    print("## Cortex-M4F, single precision, -Os\n")
    if shutil.which(ARM) is None:
        print(f"Not measured: {ARM} is not installed here.\n")
        return
    sources = [path for path in where.glob("*.c") if path.name != "replay.c"]
    (where / "state.c").write_text('#include "flight.h"\nmp_flight state;\nmp_cycle held[MP_HELD];\nmp_run ring[MP_CHECKPOINTS];\n')
    flags = [*M4F, "-std=c99", "-ffp-contract=off", *limits(where)]
    for source in sources:
        subprocess.run([ARM, *flags, "-c", source.name, "-o", f"{source.stem}.o"], cwd=where, check=True)
    names = [f"{source.stem}.o" for source in sources if source.name != "table.c"]
    table = subprocess.run(["arm-none-eabi-size", *names], cwd=where, capture_output=True, text=True, check=True).stdout
    code = sum(int(line.split()[0]) for line in table.splitlines()[1:])
    print("| | bytes | aim |\n|---|--:|--:|")
    print(f"| code, without the vehicle's table | {code:,} | 32,768 |")
    print(f"| stack, along the deepest chain of calls from mp_flight_step | {deepest(where):,} | 8,192 |\n")
    print(RAM)
    full = ends(kernel())
    for cycles in RINGS:
        own = [f"-D{name}={size}" for name, size in zip(("MP_LEARNING", "MP_RING", "MP_LONGEST"), cycles, strict=True)]
        subprocess.run([ARM, *flags, *own, "-c", "state.c", "-o", "state.o"], cwd=where, check=True)
        listed = subprocess.run(["arm-none-eabi-nm", "-S", "state.o"], cwd=where, capture_output=True, text=True, check=True).stdout
        ram = {line.split()[3]: int(line.split()[1], 16) for line in listed.splitlines()}
        moved = max(np.nanmax(np.abs(a - b) / sigma) for (a, _), (b, sigma) in zip(ends(built(where, own)), full, strict=True))
        held = " | ".join(f"{ram[name]:,}" for name in ("state", "held", "ring"))
        print(f"| {', '.join(map(str, cycles))} | {held} | {moved:.2g} sigma |")
    print()


def built(where: Path, flags: list[str]) -> Kernel:
    """The kernel compiled with other limits or in another precision."""
    library = where / f"{'-'.join(flag.strip('-') for flag in flags)}.so"
    sources = map(str, sorted(Path(room.__file__).parent.glob("*.c")))
    subprocess.run(["cc", *FLAGS, *flags, *sources, "-o", str(library), "-lm"], check=True)
    return Kernel(opened(library), " ".join(flags))


def samples() -> Iterator[tuple[str, resolve.FlightConstants]]:
    """The sample logs with a truth."""
    for name in ("free-flyer", "docking", "high-rate", "air-bearing"):
        log = SAMPLES / name / "log.parquet"
        yield name, resolve.from_log(vehiclefile.load(log.with_name("vehicle.toml")), log)


def ends(of: Kernel) -> list[tuple[np.ndarray, np.ndarray]]:
    """Values and sigmas at the end of each phase."""
    return [last(found, leg, of) for _, found in samples() for leg in found.phases]


def precision(where: Path) -> None:
    """Print final errors in double and single precision."""
    single = built(where, ["-DMP_SINGLE"])
    print("## Single precision\n\nErrors over the sigmas of double precision, at the end of each phase of the sample logs with a truth.\n")
    print("| log | phase | rms, double | rms, single | ratio | largest change |\n|---|---|--:|--:|--:|---|")
    for name, found in samples():
        truth = json.loads((SAMPLES / name / "truth.json").read_text())["phases"]
        for number, leg in enumerate(found.phases):
            ends = [last(found, leg, of) for of in (kernel(), single)]
            true = np.array([truth[number][q] for q in QUANTITIES])
            z = [(end[0] - true) / ends[0][1] for end in ends]
            rms = [float(np.sqrt(np.nanmean(one**2))) for one in z]
            moved = np.abs(z[1] - z[0])
            most = int(np.nanargmax(np.where(np.isnan(moved), -1, moved)))
            told = f"{QUANTITIES[most]}, {moved[most]:.2g} sigma"
            print(f"| {name} | {leg.name} | {rms[0]:.2f} | {rms[1]:.2f} | {rms[1] / rms[0]:.2f} | {told} |")
    print()


def last(found: resolve.FlightConstants, leg: resolve.PhaseConstants, of: Kernel) -> tuple[np.ndarray, np.ndarray]:
    """Values and sigmas at the end of a phase."""
    assert found.log is not None
    flight = kernelflight.Flight(found.commands, leg.vehicle, leg.rule, of)
    told = flight.step(kernelflight.cycles_of(found.log, slice(0, min(leg.cycles.stop + 1, found.log.cycles)), leg.cycles), last=True)
    return told.values[-1], told.sigmas[-1]


def main() -> None:
    """Print the page."""
    parser = counted(__doc__)
    parser.add_argument("--longest", type=int, default=1_000_000, help="cycles")
    longest = parser.parse_args().longest
    print(INTRODUCTION)
    print(f"The tables: `python benchmarks/kernel.py --longest {longest} > docs/kernel.md`, commit {commit()}, massprop {__version__}.\n")
    with tempfile.TemporaryDirectory() as place:
        where, log = Path(place) / "free-flyer", SAMPLES / "free-flyer" / "log.parquet"
        folder.write(resolve.from_log(vehiclefile.load(log.with_name("vehicle.toml")), log), where)
        costs(where, longest)
        health(where, longest)
        answers()
        precision(where)
        sizes(where)


if __name__ == "__main__":
    main()
