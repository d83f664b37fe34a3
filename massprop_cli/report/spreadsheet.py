"""Results as CSV (RFC 4180): a row for each phase and docked object, with fixed columns and numbers in full precision."""

import csv
import io
from collections.abc import Sequence

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.base.escape import cell
from massprop_cli.report.vocabulary import gap
from massprop_cli.result.judge import contradiction, parts
from massprop_cli.result.read import Recorded, labels
from massprop_cli.result.schema import DockedObject, EstimateItem, PhaseItem, Result

SENSORS, LOW_PASS = ("gyro", "accelerometer"), ("cutoff_hz", "cutoff_sigma_hz", "latency_s", "latency_sigma_s")
"""Parts of the column names for a sensor's estimated low-pass."""
SPELT = {"kg m^2": "kg_m2", "m": "m", "kg": "kg", "kg m": "kg_m"}
"""Units as column names contain them."""


def _of(quantity: str) -> tuple[str, ...]:
    """Column names of one quantity."""
    unit = SPELT[UNITS[quantity]]
    stated = (f"{quantity}_verdict", f"{quantity}_final_at_s", f"{quantity}_nominal_{unit}")
    held = (f"{quantity}_expected_{unit}", f"{quantity}_tolerance_{unit}", f"{quantity}_tolerance_stated", f"{quantity}_met")
    return f"{quantity}_{unit}", f"{quantity}_sigma_{unit}", *stated, *held


COLUMNS = (
    *("result", "log", "vehicle", "environment", "method", "part", "phase", "start_s", "end_s"),
    *(column for quantity in QUANTITIES for column in _of(quantity)),
    *("inertia_about", "axes", "products_of_inertia", "delay_cycles"),
    *(f"{sensor}_{key}" for sensor in SENSORS for key in LOW_PASS),
    *("contradiction", "missing", "warnings", "expectations"),
    *("massprop", "input_sha256", "vehicle_sha256"),
)
"""Column names in order."""


def text(recorded: Sequence[Recorded]) -> str:
    """One CSV file of all results."""
    out = io.StringIO()
    rows = csv.writer(out, lineterminator="\r\n")
    rows.writerow(COLUMNS)
    for item, name in zip(recorded, labels(recorded), strict=True):
        for _, part in parts(item.result):
            rows.writerow(_row(name, item.result, part))
    return out.getvalue()


def _row(name: str, found: Result, part: PhaseItem | DockedObject) -> list[str]:
    contradicted = contradiction(part)
    shown = {f"{one.sensor}_{key}": getattr(one, key) for one in found.low_passes for key in LOW_PASS}
    return [
        *(cell(name), cell(found.log.path), cell(found.vehicle.name), found.vehicle.environment),
        *(cell(found.provenance.method), *_part(part)),
        *(value for quantity in QUANTITIES for value in _quantity(part.estimates[quantity])),
        *(found.conventions.inertia_about, "body", found.conventions.products_of_inertia, repr(found.delay.cycles)),
        *(_number(shown.get(f"{sensor}_{key}")) for sensor in SENSORS for key in LOW_PASS),
        cell(contradicted),
        cell("; ".join(f"{q}: {gap(q, item, contradicted)}" for q, item in part.estimates.items() if item.verdict != "converged")),
        cell("; ".join(f"{warning.message} [{warning.code}]" for warning in found.warnings)),
        cell("" if found.expectations is None else found.expectations.path),
        *(cell(found.provenance.massprop), cell(found.provenance.input_sha256), cell(found.provenance.vehicle_sha256)),
    ]


def _part(part: PhaseItem | DockedObject) -> list[str]:
    if isinstance(part, DockedObject):
        return ["docked", cell(f"{part.after} less {part.before}"), "", ""]
    return ["phase", cell(part.name), repr(part.start_s), repr(part.end_s)]


def _quantity(item: EstimateItem) -> list[str]:
    found = [_number(item.value), _number(item.sigma), item.verdict, _number(item.final_at_s), _number(item.nominal)]
    held = item.expected
    if held is None:
        return [*found, "", "", "", ""]
    return [*found, _number(held.value), _number(held.tolerance), cell(held.stated), "true" if held.met else "false"]


def _number(value: float | None) -> str:
    return "" if value is None else repr(value)
