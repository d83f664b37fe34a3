"""Results of sample logs as a report reads them, and figures read back from their SVG."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from massprop_cli import flow, job
from massprop_cli.base import escape
from massprop_cli.base.arrays import Array
from massprop_cli.result import build, read, store
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import EstimateItem

SAMPLES = Path(__file__).parents[1] / "sample_logs"
SVG = "{http://www.w3.org/2000/svg}"


def record(folder: Path, log: str, *assignments: str) -> Recorded:
    """Estimate a sample log into ``folder`` and read the result back."""
    found = _found(log, assignments)
    store.write(folder, found, escape.document(build.result(found)))
    return read.read(folder)


@cache
def _found(log: str, assignments: tuple[str, ...]) -> flow.Analysis:
    with np.errstate(all="ignore"):
        return job.of_file(SAMPLES / log, None, list(assignments)).analysis


def changed(recorded: Recorded, name: str, item: dict[str, object], phase: int = 0) -> Recorded:
    """With one estimate's fields changed."""
    phases = list(recorded.result.phases)
    estimates = dict(phases[phase].estimates)
    estimates[name] = EstimateItem.model_validate(estimates[name].model_dump() | item)
    phases[phase] = phases[phase].model_copy(update={"estimates": estimates})
    return replace(recorded, result=recorded.result.model_copy(update={"phases": phases}))


def drawn(svg: bytes, axes: str, gid: str) -> Array:
    """(n, 2) points of a series in its data's units, those inside its axes; empty where it isn't drawn."""
    root = ET.fromstring(svg)
    (frame,) = [group for group in root.iter(f"{SVG}g") if group.get("id") == f"axes-{axes}"]
    (a, b), (c, d) = (map(float, frame.attrib[f"data-{letter}"].split()) for letter in "xy")
    box = _points(next(frame.iter(f"{SVG}path")))
    series = [group for group in frame.iter(f"{SVG}g") if group.get("id") == gid]
    if not series:
        return np.empty((0, 2))
    points = np.concatenate([_points(path) for path in series[0].iter(f"{SVG}path")])
    inside = ((points >= box.min(0) - 0.01) & (points <= box.max(0) + 0.01)).all(1)
    found: Array = points[inside] * [b, d] + [a, c]
    return found


def follows(points: Array, time_s: Array, values: Array, within: tuple[float, float]) -> bool:
    """Whether every drawn point is a row of the history."""
    rows = np.abs(points[:, :1] - time_s).argmin(1)
    near_time = np.abs(points[:, 0] - time_s[rows]) <= within[0]
    return bool(len(points) > 10 and near_time.all() and (np.abs(points[:, 1] - values[rows]) <= within[1]).all())


def precision(svg: bytes, axes: str) -> tuple[float, float]:
    """What a hundredth of a point is in the units of the two axes."""
    found = re.search(rf'id="axes-{axes}" data-x="\S+ (\S+)" data-y="\S+ (\S+)"', svg.decode())
    assert found
    return 0.0101 * abs(float(found[1])), 0.0101 * abs(float(found[2]))


def _points(path: ET.Element) -> Array:
    numbers = re.findall(r"-?\d+(?:\.\d+)?", path.attrib["d"])
    return np.array(numbers, dtype=float).reshape(-1, 2)
