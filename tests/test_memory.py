"""An estimate's memory doesn't grow with its log."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import csv
from pyarrow import parquet as pq

SAMPLE = Path(__file__).parent.parent / "sample_logs" / "free-flyer"
RUN = (
    "import resource, subprocess, sys\n"
    "code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode\n"
    "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)"
)
"""From a small process, as Linux counts the memory of the one that starts a command as the command's own."""


def flown_again(times: int, folder: Path, kind: str) -> Path:
    """The sample log so many times in a row; between two the body is stopped."""
    once = pq.ParquetFile(SAMPLE / "log.parquet").read()
    columns = {name: np.tile(once.column(name).to_numpy(), times) for name in once.column_names}
    time_s = once.column("time_s").to_numpy()
    columns["time_s"] = np.concatenate([time_s + again * len(time_s) * (time_s[1] - time_s[0]) for again in range(times)])
    log = folder / f"{times}.{kind}"
    table = pa.table(columns)
    pq.write_table(table, log) if kind == "parquet" else csv.write_csv(table, log)
    return log


def largest(log: Path, folder: Path, *settings: str) -> float:
    """MB in memory at most while a log is estimated from."""
    command = [
        sys.executable,
        "-m",
        "massprop_cli",
        "estimate",
        str(log),
        "--vehicle",
        str(SAMPLE / "vehicle.toml"),
        "-q",
        "--allow-contradicted",
    ]
    command += ["--set", "estimator.adapt_noise=false", *settings, "--out", str(folder / "out" / log.name)]
    found = subprocess.run([sys.executable, "-S", "-c", RUN, *command], capture_output=True, text=True, check=True)
    code, memory = found.stdout.split()
    assert code == "0", found.stderr
    return float(memory)


@pytest.mark.thorough
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux's account of memory")
@pytest.mark.parametrize(("kind", "settings"), [("csv", ()), ("parquet", ("--delay", "auto"))])
def test_memory_does_not_grow_with_the_log(kind: str, settings: tuple[str, ...], tmp_path: Path) -> None:
    """An hour at 20 Hz and ten minutes: history and log alone are 800 bytes a cycle."""
    short, long = (largest(flown_again(times, tmp_path, kind), tmp_path, *settings) for times in (10, 60))
    assert long < 300
    assert long - short < 25
