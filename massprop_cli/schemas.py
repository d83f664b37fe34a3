"""JSON Schemas of the files that massprop reads and writes; schemas/ holds the same, written by ``python -m massprop_cli.schemas``."""

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

MODULES = {
    "vehicle": "inputs.vehicle:Vehicle",
    "scenario": "testbed.scenario:Scenario",
    "expect": "inputs.expect:ExpectFile",
    "result": "result.schema:Result",
    "tolerance": "inputs.tolerancefile:ToleranceFile",
    "compare": "result.compare:Comparison",
    "campaign": "campaign.campaignfile:CampaignFile",
    "summary": "campaign.summary:Summary",
    "map": "inputs.formats.mapfile:MapFile",
    "plan": "plan.document:PlanFile",
    "guess": "plan.guess:GuessFile",
    "check": "check.finding:Check",
    "ballast": "inputs.ballast:BallastFile",
    "balance": "balance.document:Balance",
    "predict": "predict.document:Prediction",
}
"""Which module has the model of each file; a log's rows have none (:func:`_log_row`)."""
NAMES = ("log", *MODULES)


def schema(name: str) -> dict[str, Any]:
    """The schema called ``name``."""
    if name == "log":
        found = _log_row()
    else:
        module, _, model = MODULES[name].partition(":")
        found = getattr(import_module(f"massprop_cli.{module}"), model).model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"massprop/{name}/1", **found}


def _log_row() -> dict[str, Any]:
    """One row of a log. Command columns may be null in all rows of a control cycle but the first."""
    from massprop_cli.inputs import columns
    from massprop_cli.inputs.vehicle import ACTUATORS

    number, command, text = {"type": "number"}, {"type": ["number", "null"]}, {"type": ["string", "null"]}
    duration = {**command, "minimum": 0}
    described: tuple[tuple[tuple[str, ...], dict[str, Any], str], ...] = (
        ((columns.TIME,), number, "end of the record's interval, strictly increasing, s"),
        (columns.DELTA_THETA, number, "gyro angle increment over the record, IMU axes, rad"),
        (columns.DELTA_V, number, "accelerometer increment (specific force) over the record, IMU axes, m/s"),
        (columns.GYRO, number, "mean rate over the record, alternative to the angle increment, rad/s"),
        (columns.ACCEL, number, "mean specific force over the record, alternative to the velocity increment, m/s^2"),
        (columns.WRENCH[:3], command, "mean commanded torque about O over the control cycle, body axes, N m"),
        (columns.WRENCH[3:], command, "mean commanded force over the control cycle, body axes, N"),
        (columns.QUATERNION, command, "quaternion wxyz at time_s, world from body; all four null in records without one"),
        ((columns.SUPPLY,), number, "supply voltage over the record, for rotors that state nominal_v, V"),
        ((columns.PRESSURE,), number, "absolute supply pressure over the record, for thrust.nominal_pa, Pa"),
        ((columns.PULSE_JET,), text, "jet of a pulse; any row may hold one pulse"),
        ((columns.PULSE_START,), command, "commanded start of the pulse on the commands' clock, s"),
        ((columns.PULSE_DURATION,), duration, "commanded duration of the pulse, s"),
        ((columns.EVENT,), text, 'text, e.g. "dock"'),
    )
    actuators = [column for kind in ACTUATORS.values() for column in kind.COLUMNS]
    return {
        "title": "Log row",
        "description": _log_row.__doc__,
        "type": "object",
        "properties": {name: {**kind, "description": meaning} for names, kind, meaning in described for name in names},
        "patternProperties": {
            "^jet_.+_s$": {**duration, "description": "commanded on-time in this control cycle, s"},
            **{f"^{one.start}.+{one.end}$": {**(command if one.nullable else number), "description": one.description} for one in actuators},
        },
        "required": [columns.TIME],
        # a planar table needs one gyro axis; that other environments need three is known only from the vehicle file
        "anyOf": [{"required": [name]} for name in (*columns.DELTA_THETA, *columns.GYRO)],
    }


def _write(folder: Path) -> None:
    for name in NAMES:
        text = json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"
        (folder / f"{name}.schema.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    _write(Path(sys.argv[1] if len(sys.argv) > 1 else "schemas"))
