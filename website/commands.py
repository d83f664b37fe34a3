"""The commands' page, from the commands themselves."""

from __future__ import annotations

import re
from typing import Any

import typer

from massprop_cli.cli import app
from massprop_cli.cli.help import docstring_of

_OPENING = """# Commands

Made from the program itself: `massprop --help` and `massprop COMMAND -h` say the same.

Data go to stdout, messages to stderr. Flags go before the environment, that before files. Nothing is written outside `--out`.
[Exit codes](../exit-codes.md) are the same for all.
"""


def page() -> str:
    """A section for each command, in the order of ``massprop --help``."""
    group: Any = typer.main.get_command(app)
    documented = {str(command.name): docstring_of(command.callback) for command in app.registered_commands if command.callback}
    parts = [_OPENING, *(_section(group.commands[name], said.examples) for name, said in documented.items())]
    return "\n".join(parts)


def _section(command: Any, examples: tuple[str, ...]) -> str:
    arguments = [parameter for parameter in command.params if not parameter.opts[0].startswith("-")]
    options = [parameter for parameter in command.params if parameter.opts[0].startswith("-")]
    usage = " ".join(["massprop", command.name, *(parameter.metavar or parameter.name.upper() for parameter in arguments), "[OPTIONS]"])
    lines = [f"\n## massprop {command.name}\n", f"`{usage}`\n", f"{plain(command.help)}\n"]
    if examples:
        lines += ["```bash", *examples, "```\n"]
    rows = [f"| `{parameter.metavar or parameter.name.upper()}` | {plain(parameter.help)} | |" for parameter in arguments]
    groups = dict.fromkeys(getattr(option, "rich_help_panel", None) or "Others" for option in options)
    for name in groups:
        rows.append(f"| **{name}** | | |")
        rows += [_row(option) for option in options if (getattr(option, "rich_help_panel", None) or "Others") == name]
    return "\n".join([*lines, "| | | environment, default |", "|---|---|---|", *rows, ""])


def _row(option: Any) -> str:
    flag = getattr(option, "is_flag", False)
    value = "" if flag else f" {option.metavar or option.name.upper()}"
    spelt = ", ".join(f"`{name}{value}`" for name in option.opts)
    shown = [f"`{option.envvar}`"] if option.envvar else []
    default = option.default
    if not flag and default is not None and not option.required:
        shown.append(f"`{getattr(default, 'value', default)}`")
    return f"| {spelt} | {plain(option.help)} | {', '.join(shown)} |"


def plain(text: str | None) -> str:
    """Text of the program as Markdown: outside of code, stars, brackets and bars are themselves."""
    parts = (text or "").replace("``", "`").split("`")
    return "`".join(part if number % 2 else re.sub(r"([*_<>\[\]|])", r"\\\1", part) for number, part in enumerate(parts))
