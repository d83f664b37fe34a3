"""The page of the Python interface, from its docstrings."""

from __future__ import annotations

import inspect
import re
from functools import cached_property
from typing import Any

import massprop_cli
from massprop_cli import api

_OPENING = """# From Python

Made from the docstrings of `massprop_cli.api`. `import massprop_cli` is quick; the interface, with pandas, is imported when it is first
used.

```python
from massprop_cli import InputError, estimate_log, run_campaign

found = estimate_log("sample_logs/free-flyer/log.parquet", require="mass<2%")
mass = found.result.phases[0].estimates["mass"]
print(f"{mass.value:.2f} ± {mass.sigma:.2f} kg, {mass.verdict}; exit code {found.exit_code}")
print(found.table.loc["all", ["value", "sigma", "unit"]])
print(found.history[["time_s", "ixx", "ixx_sigma"]].tail(1))

campaign = run_campaign(["sample_logs/free-flyer", "sample_logs/high-rate"], "massprop-out", jobs=1)
print(campaign.table[["log", "mass"]], campaign.exit_code)

try:
    estimate_log("nothing.parquet")
except InputError as error:
    print(error)
```
"""


def page() -> str:
    """Functions, then what they return, then the rest that the package exports."""
    named: list[Any] = [getattr(massprop_cli, name) for name in massprop_cli.__all__ if not name.startswith("__")]
    functions = [item for item in named if inspect.isfunction(item)]
    classes = [item for item in named if inspect.isclass(item)]
    parts = [_OPENING, *(_function(item, "##") for item in functions), *(_class(item) for item in classes)]
    return "\n".join(
        [*parts, "## QUANTITIES, UNITS\n", "The ten quantities in their order everywhere, and the SI unit of each.\n", _units()]
    )


def _function(function: Any, level: str) -> str:
    signature = inspect.signature(function, eval_str=True, globals=vars(api))
    parameters = [*signature.parameters.values()]
    first = next((n for n, one in enumerate(parameters) if one.kind is one.KEYWORD_ONLY), len(parameters))
    lines = [*map(_parameter, parameters[:first]), *(["*"] if first < len(parameters) else []), *map(_parameter, parameters[first:])]
    shown = "\n".join([f"{function.__name__}(", *(f"    {line}," for line in lines), f") -> {signature.return_annotation.__name__}"])
    return f"{level} {function.__name__}\n\n```text\n{shown}\n```\n\n{_said(function)}\n"


def _parameter(one: inspect.Parameter) -> str:
    return re.sub(r"\b(?:collections\.abc|massprop_cli\.[a-z_.]+|pathlib|typing)\.", "", str(one))


def _class(kind: Any) -> str:
    fields = {name: _said(vars(base)[name]) for base in reversed(kind.__mro__[:-1]) for name in vars(base) if _property(base, name)}
    rows = [f"| `{name}` | {' '.join(said.split())} |" for name, said in fields.items()]
    table = ["| | |", "|---|---|", *rows] if rows and kind.__module__ == api.__name__ else []
    return "\n".join([f"## {kind.__name__}\n", f"{_said(kind)}\n", *table, ""])


def _property(base: Any, name: str) -> bool:
    return not name.startswith("_") and isinstance(vars(base)[name], (property, cached_property))


def _said(thing: Any) -> str:
    """A docstring as Markdown."""
    text = inspect.getdoc(thing) or ""
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text).replace("``", "`")


def _units() -> str:
    rows = [f"| `{name}` | {unit.replace('^2', '²')} |" for name, unit in massprop_cli.UNITS.items()]
    return "\n".join(["| | |", "|---|---|", *rows, ""])
