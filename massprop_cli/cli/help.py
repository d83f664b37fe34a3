"""What ``--help`` shows: a command's docstring with its examples, options in groups, and no type behind a flag."""

import inspect
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from typer.core import TyperCommand, TyperGroup

EXAMPLES = "Examples:\n"
"""What comes after this line of a command's docstring is commands as a shell takes them."""


class DocstringCommand(NamedTuple):
    """A command's docstring."""

    text: str
    """Paragraphs, each on one line."""
    examples: tuple[str, ...]


def told(command: Callable[..., Any]) -> DocstringCommand:
    """Text and examples of a command's docstring."""
    text, _, examples = inspect.cleandoc(command.__doc__ or "").partition(EXAMPLES)
    return DocstringCommand(
        re.sub(r"(?<!\n)\n(?!\n)", " ", text).strip(), tuple(line.strip() for line in examples.splitlines() if line.strip())
    )


def epilog(said: DocstringCommand) -> str | None:
    """The examples below the options, a line each; what is in brackets is no markup."""
    lines = [f"  {line}".replace("[", r"\[") for line in said.examples]
    return "\n".join(["[bold]Examples[/]", *lines]) if lines else None


class _BareFlags:
    """A command whose flags stand alone in its help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, ``--help`` too."""
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in found:
            if getattr(parameter, "is_flag", False) and parameter.metavar is None:
                parameter.metavar = ""
        return found


class Command(_BareFlags, TyperCommand):
    """One command."""


class DocstringGroup(_BareFlags, TyperGroup):
    """All commands together."""
