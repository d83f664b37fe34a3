"""``massprop schema``."""

import json
from enum import StrEnum
from typing import Annotated

import typer

from massprop_cli.cli.guard import guarded


class SchemaName(StrEnum):
    """Files with a schema."""

    log = "log"
    vehicle = "vehicle"
    scenario = "scenario"
    expect = "expect"
    result = "result"
    tolerance = "tolerance"
    compare = "compare"
    campaign = "campaign"
    summary = "summary"
    map = "map"
    plan = "plan"
    guess = "guess"
    check = "check"
    ballast = "ballast"
    balance = "balance"
    predict = "predict"


@guarded
def schema(name: Annotated[SchemaName, typer.Argument(help="Which file.")]) -> None:
    """Print the JSON Schema of a file.

    Examples:
        massprop schema vehicle > vehicle.schema.json
    """
    from massprop_cli import schemas

    typer.echo(json.dumps(schemas.schema(name.value), indent=1, ensure_ascii=False))
