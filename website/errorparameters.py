"""docs/error-parameters.md, made from the table: ``python -m website.errorparameters`` writes it."""

from __future__ import annotations

import re

import numpy as np

from massprop_cli.errorparameters.parameter import ErrorParameter, SpecialCase, Wording
from massprop_cli.errorparameters.table import SPECIAL_CASES, TABLE
from website.stage import ROOT

PAGE = ROOT / "docs" / "error-parameters.md"
OPENING = """# Error parameters

Everything that may differ from what log and vehicle file state, made from the program's own table (`massprop_cli/errorparameters`). A test
fails where page and table differ; `python -m website.errorparameters` writes the page anew.

- **Prior**: one sigma of the error of a log or vehicle file that is wrong. A parameter without one is never a hypothesis.
- **Usual**: one sigma of the error of the vehicle file of a careful lab, for [sigmas of logs that nothing explains](discrepancy.md); of a
  direction in rad, and of what is in metres in parts of the vehicle's size, √(trace/mass).
- **Value**, **sigma**: keys of the vehicle file. Where there is none the table says why.
- **Step**: what the [assumptions](assumptions.md) show the effect of, where the parameter is assumed as stated.
- **Range**: physical values, in the unit of the key.
"""


def page() -> str:
    """All parameters, then their sentences and remedies, then the special cases."""
    named = [one for one in TABLE if one.wording.sentence]
    parts = [
        OPENING,
        "## Parameters\n",
        "| parameter | warning | unit of the error | prior | usual | value | sigma | step | range |",
        "|---|---|---|---|---|---|---|---|---|",
        *map(_row, TABLE),
        "\n## Sentences and remedies\n",
        "A warning says: the log fits if ...\n",
        "| warning | parameter | sentence | remedy |",
        "|---|---|---|---|",
        *(f"| {_link(one.code)} | {one.what} | {_texts(one.wording)} |" for one in named),
        "\n## Special cases\n",
        "Values of a parameter that mean something more specific.\n",
        "| hypothesis | warning | sentence | remedy |",
        "|---|---|---|---|",
        *map(_special, SPECIAL_CASES),
    ]
    return "\n".join(parts) + "\n"


def _row(one: ErrorParameter) -> str:
    code = _link(one.code) if one.wording.sentence else one.code
    prior, usual = (f"{size:.3g}" if size else "–" for size in (one.prior, one.usual))
    value = f"`{one.key}`" if one.key else one.no_key
    sigma = f"`{one.sigma_key}`" if one.sigma_key else one.no_sigma
    step = one.step.words.replace(" along {axis}", "").replace("{axis}", "X and Y") if one.step else "–"
    sizes = f"{prior} | {usual}"
    return f"| {one.what} | {code} | {one.unit} | {sizes} | {value} | {sigma} | {step.replace(' about X and Y', '')} | {_range(one)} |"


def _range(one: ErrorParameter) -> str:
    low, high = np.isfinite(one.lowest), np.isfinite(one.highest)
    return f"{one.lowest:g} to {one.highest:g}" if low and high else f"≥ {one.lowest:g}" if low else "any"


def _texts(wording: Wording) -> str:
    return " | ".join(re.sub(r"\{(\w+)[^}]*\}", r"*\1*", text) for text in (wording.sentence, wording.remedy))


def _special(case: SpecialCase) -> str:
    return f"| {case.of} | {_link(case.code or case.of)} | {_texts(case.wording)} |"


def _link(code: str) -> str:
    return f"[{code}](warnings/{code}.md)"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
