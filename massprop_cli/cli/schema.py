"""``massprop schema``."""

import json
from enum import StrEnum
from typing import Annotated

import typer

from massprop_cli import schemas
from massprop_cli.cli.guard import guarded

SchemaName = StrEnum("SchemaName", [(name, name) for name in schemas.NAMES])  # type: ignore[misc]
"""Files with a schema."""


@guarded
def schema(name: Annotated[SchemaName, typer.Argument(help="Which file.")]) -> None:
    """Print the JSON Schema of a file.

    Examples:
        massprop schema vehicle > vehicle.schema.json
    """
    typer.echo(json.dumps(schemas.schema(name.value), indent=1, ensure_ascii=False))
