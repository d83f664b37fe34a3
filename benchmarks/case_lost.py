"""Recordings with records that the recorder lost: whose rows are missing, or hold nothing, zeros or the reading before."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from case_kind import Columns, Kind, Made, Random, kept, per_cycle

from massprop_cli.base.arrays import IntArray
from massprop_cli.inputs.columns import DELTA_THETA, DELTA_V, TIME, WRENCH
from massprop_cli.inputs.vehicle import Vehicle

APART = 8
"""Records between two places at least."""


def _places(count: int, rng: Random, part: float) -> IntArray:
    """Random rows, apart from one another: ``part`` of all."""
    rows = np.unique(rng.integers(5, count - APART, max(3, round(part * count))))
    return rows[np.diff(rows, prepend=-APART - 1) > APART]


def _without(columns: Columns, vehicle: Vehicle, rows: IntArray) -> Made:
    count = len(columns[TIME])
    keep = np.setdiff1d(np.arange(count), rows)
    return Made(kept(columns, keep), vehicle, f"{count - len(keep)} of {count}")


def _dropped(columns: Columns, vehicle: Vehicle, rng: Random) -> Made:
    """Single rows are missing, whatever their place in a control cycle."""
    return _without(columns, vehicle, _places(len(columns[TIME]), rng, 0.005))


def _in_a_row(columns: Columns, vehicle: Vehicle, rng: Random) -> Made | None:
    """Two to five control cycles in a row are missing."""
    each = per_cycle(columns, vehicle)
    starts = _places(len(columns[TIME]) // each, rng, 0.003)
    lost = np.concatenate([np.arange(start, start + int(rng.integers(2, 6))) for start in starts])
    return _without(columns, vehicle, (lost[:, None] * each + np.arange(each)).ravel())


def _within(columns: Columns, vehicle: Vehicle, rng: Random) -> Made | None:
    """The log begins within a control cycle; commands stand in the first row of each, or in all."""
    each, count = per_cycle(columns, vehicle), len(columns[TIME])
    if each == 1:
        return None
    begin, every = int(rng.integers(1, each)), rng.random() < 0.5
    commands = [name for name in columns if every and (name.startswith("jet_") or name in WRENCH)]
    whole = columns | {name: np.repeat(columns[name][::each], each)[:count] for name in commands}
    return Made(kept(whole, slice(begin, None)), vehicle, f"from row {begin} of {each}")


def _rows_held(columns: Columns, vehicle: Vehicle, rng: Random) -> Made | None:
    """Whole rows repeat the row before, where each row is a control cycle."""
    names = [name for name in columns if name != TIME]
    return _rewritten(columns, vehicle, rng, None, names) if per_cycle(columns, vehicle) == 1 else None


def _rewritten(columns: Columns, vehicle: Vehicle, rng: Random, value: float | None, names: Sequence[str]) -> Made:
    """A value in the place of readings; None: those of the row before, a few records long."""
    changed = {name: np.array(values, float) for name, values in columns.items()}
    rows = _places(len(columns[TIME]), rng, 0.005)
    for row in rows:
        part = slice(row, row + (1 if value is not None else int(rng.integers(1, 5))))
        for name in names:
            changed[name][part] = changed[name][row - 1] if value is None else value
    return Made(changed, vehicle, f"{len(rows)} places")


LOST, SENSED = ("records-lost",), (*DELTA_THETA, *DELTA_V)
KINDS = {
    "records-dropped": Kind("single rows are missing", _dropped, LOST),
    "records-dropped-cycles": Kind("2 to 5 control cycles in a row are missing", _in_a_row, LOST),
    "begun-within": Kind("begins within a control cycle", _within, LOST),
    "records-empty": Kind("empty cells of both sensors", partial(_rewritten, value=np.nan, names=SENSED), LOST),
    "records-filled": Kind("-9999 in the place of readings", partial(_rewritten, value=-9999.0, names=SENSED), LOST),
    "records-zero": Kind("zeros in the place of readings", partial(_rewritten, value=0.0, names=SENSED), LOST),
    "gyro-zero": Kind("the gyro's alone", partial(_rewritten, value=0.0, names=DELTA_THETA), LOST),
    "readings-held": Kind("1 to 4 records repeat the reading before", partial(_rewritten, value=None, names=SENSED), LOST),
    "rows-held": Kind("1 to 4 rows repeat the row before, with its command", _rows_held, LOST),
}
