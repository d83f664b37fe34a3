"""Text of ``--help``: a command's docstring with examples, options in groups, flags without a type."""

import inspect
import re
from collections.abc import Callable
from typing import Any, NamedTuple

from typer.core import TyperCommand, TyperGroup

EXAMPLES = "Examples:\n"
"""Heading in a command's docstring; shell commands follow it."""


class DocstringCommand(NamedTuple):
    """Docstring of a command, in parts."""

    text: str
    """Paragraphs, one per line."""
    examples: tuple[str, ...]


def docstring_of(command: Callable[..., Any]) -> DocstringCommand:
    """Text and examples of a command's docstring."""
    text, _, examples = inspect.cleandoc(command.__doc__ or "").partition(EXAMPLES)
    return DocstringCommand(
        re.sub(r"(?<!\n)\n(?!\n)", " ", text).strip(), tuple(line.strip() for line in examples.splitlines() if line.strip())
    )


def epilog(docstring: DocstringCommand) -> str | None:
    """Examples as help text, one per line, with brackets escaped; None without examples."""
    lines = [f"  {line}".replace("[", r"\[") for line in docstring.examples]
    return "\n".join(["[bold]Examples[/]", *lines]) if lines else None


class _BareFlags:
    """Mixin: the help shows flags without a metavar."""

    def get_params(self, ctx: Any) -> list[Any]:
        """All parameters, including ``--help``."""
        parameters: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        for parameter in parameters:
            if getattr(parameter, "is_flag", False) and parameter.metavar is None:
                parameter.metavar = ""
        return parameters


class Command(_BareFlags, TyperCommand):
    """A command."""


class DocstringGroup(_BareFlags, TyperGroup):
    """The group of all commands."""
