"""JSON Schemas of the files that massprop reads and writes; schemas/ holds the same, written by ``python -m massprop_cli.schemas``."""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

MODULES = {
    "log": "inputs.logrow",
    "vehicle": "inputs.vehicle",
    "scenario": "testbed.scenario",
    "expect": "inputs.expect",
    "result": "result.schema",
    "tolerance": "inputs.tolerancefile",
    "compare": "result.compare",
    "campaign": "campaign.campaignfile",
    "summary": "campaign.summary",
    "map": "inputs.formats.mapfile",
    "plan": "plan.document",
    "guess": "plan.guess",
    "check": "check.finding",
    "ballast": "inputs.ballast",
    "balance": "balance.document",
}
"""Which module has the model, and ``schema()``, of each file."""
NAMES = tuple(MODULES)


def schema(name: str) -> dict[str, Any]:
    """The schema called ``name``."""
    found: dict[str, Any] = import_module(f"massprop_cli.{MODULES[name]}").schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"massprop/{name}/1", **found}


def _write(folder: Path) -> None:
    for name in NAMES:
        text = json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"
        (folder / f"{name}.schema.json").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    _write(Path(sys.argv[1] if len(sys.argv) > 1 else "schemas"))
