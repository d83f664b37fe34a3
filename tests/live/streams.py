"""Sample logs as streams of records."""

import io
import json
from collections.abc import Sequence
from functools import cache

import pyarrow.csv
import pyarrow.parquet

from massprop_cli.inputs import vehiclefile
from massprop_cli.live import run
from tests.analysed import SAMPLES


@cache
def recorded(name: str) -> tuple[str, ...]:
    """A sample log as lines of CSV."""
    text = io.BytesIO()
    pyarrow.csv.write_csv(pyarrow.parquet.read_table(SAMPLES / name / "log.parquet"), text)
    return tuple(text.getvalue().decode().splitlines(keepends=True))


def as_objects(lines: Sequence[str]) -> list[str]:
    names = [name.strip('"\n') for name in lines[0].split(",")]
    rows = (line.strip().split(",") for line in lines[1:])
    return [json.dumps({name: float(cell) if cell else None for name, cell in zip(names, row, strict=True)}) + "\n" for row in rows]


def followed(name: str, lines: Sequence[str], *assignments: str) -> tuple[list[dict[str, object]], str, list[str]]:
    """What is said, what is kept and what is warned of."""
    record, warned = io.StringIO(), list[str]()
    source = vehiclefile.load(SAMPLES / name / "vehicle.toml", assignments)
    said = [json.loads(line) for line in run.follow(lines, source, record.write, warned.append)]
    return said, record.getvalue(), warned
