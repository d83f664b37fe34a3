"""JSON Schemas of the files that massprop reads and writes; schemas/ holds the same, written by ``python -m massprop_cli.schemas``."""

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

MODULES = {
    "log": "inputs.logrow",
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
"""Which module has the model of each file; a log's rows have none, and a function of their own."""
NAMES = tuple(MODULES)


def schema(name: str) -> dict[str, Any]:
    """The schema called ``name``."""
    module, _, model = MODULES[name].partition(":")
    room = import_module(f"massprop_cli.{module}")
    found: dict[str, Any] = getattr(room, model).model_json_schema(by_alias=True) if model else room.schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"massprop/{name}/1", **found}


def _write(folder: Path) -> None:
    for name in NAMES:
        text = json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"
        (folder / f"{name}.schema.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    _write(Path(sys.argv[1] if len(sys.argv) > 1 else "schemas"))
