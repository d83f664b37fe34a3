"""What a log gives if a fault that it names is corrected, as text: beside the result, never in its place."""

import shlex

from massprop_cli.base.escape import line
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.report import digits, vocabulary
from massprop_cli.result.schema import Mended, MendedPhase

TITLE = "Corrected estimate"


def options(found: Mended) -> list[str]:
    """The options of ``massprop estimate`` that correct it, as a shell takes them."""
    return [f"--set {shlex.quote(line(setting))}" for setting in found.settings]


def beyond(found: Mended) -> str:
    """That the options don't give these values by themselves; empty where they do."""
    return "" if found.whole else "These options alone do not give these values: the readings of a sensor were turned, too."


def rows(phase: MendedPhase) -> list[tuple[str, str, str, str, Verdict]]:
    """Quantity, value, sigma, unit, verdict."""
    about = {f"{name} about the pivot": item for name, item in phase.about_pivot.items()}
    return [
        (name, *digits.numbers(item.value, item.sigma, item.verdict), vocabulary.unit(item.unit), item.verdict)
        for name, item in {**phase.estimates, **about}.items()
    ]


def still(phase: MendedPhase) -> str:
    """What correcting doesn't correct; empty where it corrects all."""
    return f"still contradicted: {phase.contradiction}" if phase.contradiction else ""
