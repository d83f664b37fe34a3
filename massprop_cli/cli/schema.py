"""``massprop schema``."""

import json
from enum import StrEnum
from typing import Annotated

import typer

from massprop_cli.cli.guard import guarded

SchemaName = StrEnum(
    "SchemaName",
    "log vehicle scenario expect result tolerance compare campaign summary map plan guess check ballast balance predict",
)
"""Names of all schemas."""


@guarded
def schema(name: Annotated[SchemaName, typer.Argument(help="Which file.")]) -> None:
    """Print the JSON Schema of a file.

    Examples:
        massprop schema vehicle > vehicle.schema.json
    """
    from massprop_cli import schemas

    typer.echo(json.dumps(schemas.schema(name.value), indent=1, ensure_ascii=False))
