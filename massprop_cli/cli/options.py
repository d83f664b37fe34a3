"""Options that several commands take."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import Any

import typer

from massprop_cli.base.errors import InputError


class Method(StrEnum):
    """Estimators."""

    default = "default"
    thesis = "thesis"


def assignments(context: typer.Context, given: Mapping[str, object], assign: Sequence[str] | None) -> list[str]:
    """``dotted.key=value`` in the order in which they count: environment, ``--set``, flags.

    ``given`` holds the values of the options method, refine and delay, None or False where not given.
    """
    spelt: dict[str, Callable[[Any], str]] = {
        "method": lambda value: f'estimator.method="{value.value}"',
        "refine": lambda _: "estimator.refine=true",
        "delay": lambda value: f"cycle.command_delay_cycles={_delay(value)}",
    }
    stated = {key: spelt[key](value) for key, value in given.items() if value is not None and value is not False}
    from_environment = [key for key in stated if getattr(context.get_parameter_source(key), "name", "") == "ENVIRONMENT"]
    return [*(stated.pop(key) for key in from_environment), *(assign or []), *stated.values()]


def _delay(text: str) -> str:
    """The option's value as TOML; :class:`InputError` unless it is a delay."""
    try:
        if text != "auto" and not 0 <= float(text) < float("inf"):
            raise ValueError
    except ValueError:
        raise InputError(f"--delay {text!r}: not a delay; give a number of control cycles, 0 or more (may be fractional)") from None
    return '"auto"' if text == "auto" else repr(float(text))
