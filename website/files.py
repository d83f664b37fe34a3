"""A page for each file that massprop reads or writes, from its JSON Schema."""

from __future__ import annotations

import json
from typing import Any

from massprop_cli import schemas
from website.commands import plain

Schema = dict[str, Any]
READ = {"log": "log.md", "vehicle": "vehicle.md", "result": "result.md", "map": "formats.md", "plan": "plan.md", "guess": "plan.md"}
READ |= {"check": "plan.md", "expect": "reports.md", "tolerance": "reports.md", "compare": "reports.md", "scenario": "simulate.md"}
READ |= {"ballast": "balance.md", "balance": "balance.md", "predict": "predict.md"}
READ |= {"campaign": "campaigns.md", "summary": "campaigns.md"}
"""Where a file is explained."""
_LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<", "maxItems": "items ≤", "minItems": "items ≥"}


def page(name: str) -> str:
    """Every key with its type, default and meaning; a section for each table within."""
    schema = schemas.schema(name)
    explained = f" What it is for: [{READ[name].removesuffix('.md')}](../{READ[name]})." if name in READ else ""
    opening = f"# Keys: {name}\n\nMade from the program itself: `massprop schema {name}` prints the JSON Schema.{explained}\n"
    tables = [_table(schema), *(f"\n## {title}\n\n{_table(part)}" for title, part in sorted(schema.get("$defs", {}).items()))]
    return "\n".join([opening, *tables])


def _table(part: Schema) -> str:
    said = f"{plain(part.get('description', ''))}\n\n" if part.get("description") else ""
    properties = part.get("properties", {}) | part.get("patternProperties", {})
    if not properties:
        return f"{said}{_type(part)}\n"
    required = part.get("required", [])
    rows = [_row(key, item, key in required) for key, item in properties.items()]
    return "\n".join([f"{said}| key | type | default | meaning |", "|---|---|---|---|", *rows, ""])


def _row(key: str, item: Schema, required: bool) -> str:
    stated = item.get("default")
    # what a table holds by default stands in its own section
    shown = "" if stated is None or isinstance(stated, dict) else f"`{json.dumps(stated, ensure_ascii=False)}`"
    default = "required" if required else shown
    return f"| `{key}` | {_type(item)} | {default} | {plain(item.get('description', ''))} |"


def _type(item: Schema) -> str:
    """A type in words, with a link to the table that it is."""
    if "$ref" in item:
        name = item["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower().lstrip('_')})"
    if "anyOf" in item:
        return " or ".join(dict.fromkeys(_type(one) for one in item["anyOf"]))
    if "const" in item or "enum" in item:
        return ", ".join(f"`{json.dumps(value)}`" for value in item.get("enum", [item.get("const")]))
    kind = item.get("type", "any")
    kind = " or ".join(kind) if isinstance(kind, list) else kind
    inner = item.get("items") or item.get("additionalProperties")
    of = f" of {_type(inner)}" if isinstance(inner, dict) and inner else ""
    limits = [f"{sign} {item[key]:g}" for key, sign in _LIMITS.items() if key in item]
    return f"{kind}{of}{' (' + ', '.join(limits) + ')' if limits else ''}"
