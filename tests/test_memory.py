"""An estimate's memory doesn't grow with its log."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv
from pyarrow import parquet as pq

SAMPLE = Path(__file__).parent.parent / "sample_logs" / "free-flyer"
MASSPROP = sys.executable, "-m", "massprop_cli"
RUN = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode\n"
    "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)"
)
"""From a small process, as Linux counts the memory of the one that starts a command as the command's own."""


def flown_again(times: int, folder: Path) -> Path:
    """The sample log so many times in a row; between two the body is stopped."""
    once = pq.ParquetFile(SAMPLE / "log.parquet").read()
    columns = {name: np.tile(once.column(name).to_numpy(), times) for name in once.column_names}
    time_s = once.column("time_s").to_numpy()
    columns["time_s"] = np.concatenate([time_s + again * len(time_s) * (time_s[1] - time_s[0]) for again in range(times)])
    log = folder / f"{times}.csv"
    csv.write_csv(pa.table(columns), log)
    return log


def largest(log: Path, folder: Path, *settings: str, vehicle: Path = SAMPLE / "vehicle.toml") -> float:
    """MB in memory at most while a log is estimated from."""
    command = [*MASSPROP, "estimate", str(log), "--vehicle", str(vehicle), "-q", "--allow-contradicted"]
    command += ["--set", "estimator.adapt_noise=false", *settings, "--out", str(folder / "out" / log.name)]
    found = subprocess.run([sys.executable, "-S", "-c", RUN, *command], capture_output=True, text=True, check=True)
    code, memory = found.stdout.split()
    assert code == "0", found.stderr
    return float(memory)


def assert_no_growth(logs: Sequence[Path], folder: Path, *settings: str, vehicle: Path = SAMPLE / "vehicle.toml") -> None:
    """8 MB at most for the 24,000 cycles that a second log has more.

    In the quietest of three runs: what threads hold for a moment is no growth.
    """
    for last in (False, False, True):
        less, more = (largest(log, folder, *settings, vehicle=vehicle) for log in logs)
        assert more < 300
        if more - less < 8:
            return
        assert not last, f"{less} MB, then {more} MB"


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux's account of memory")
def test_memory_does_not_grow_with_the_log(tmp_path: Path) -> None:
    """Half an hour at 20 Hz, which does not fit, and ten minutes: history and log alone are 800 bytes a cycle."""
    assert_no_growth([flown_again(times, tmp_path) for times in (10, 30)], tmp_path)


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux's account of memory")
def test_nor_does_it_where_a_delay_is_looked_for(tmp_path: Path) -> None:
    """The same of a flight that fits."""
    settings = "--set", "duration_s=1800", "--set", 'plan=[{motion="random", axes=["roll", "x", "pitch", "y"], start_s=0, end_s=60}]'
    subprocess.run([*MASSPROP, "simulate", "free-flyer", *settings, "--out", str(tmp_path / "flown"), "-q"], check=True)
    once, logs = pq.read_table(tmp_path / "flown" / "log.parquet"), [tmp_path / "10.parquet", tmp_path / "30.parquet"]
    for log, minutes in zip(logs, (10, 30), strict=True):
        pq.write_table(once.slice(0, 1200 * minutes), log)
    assert_no_growth(logs, tmp_path, "--delay", "auto", vehicle=tmp_path / "flown" / "vehicle.toml")
