"""What ``massprop balance --json`` prints: the models below are the schema (``massprop schema balance``)."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from massprop_cli.balance.solve import Hanging, periods
from massprop_cli.base.arrays import Array
from massprop_cli.result.schema import Item, Triple

G_CM = 1e5
"""g cm in a kg m."""


class Moment(Item):
    """A first moment about the pivot, body axes; in N m it is gravity's torque where it lies level."""

    kg_m: Triple
    sigma_kg_m: Triple
    g_cm: Triple
    sigma_g_cm: Triple
    n_m: Triple
    sigma_n_m: Triple


class Hang(Item):
    """How the table hangs."""

    moment: Moment
    below_kg_m: float = Field(description="first moment below the pivot; negative where the table is top-heavy")
    period_s: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        description="the longer and the shorter period of small swings, wheels standing still; null where the table is top-heavy"
    )
    tilt_rad: float | None = Field(
        description="angle from the vertical at which the body axis that is to stand upright comes to rest; null likewise"
    )


class BallastChange(Item):
    """What to do with one ballast."""

    name: str
    what: Literal["move", "add"]
    by_mm: float | None = Field(description="along its axis; null where weight is added")
    to_mm: float | None = Field(description="its travel then; null likewise")
    add_kg: float | None = Field(description="null where it is moved")
    moment: Moment = Field(description="what it does to the first moment; sigma: of the ballast's mass and of where it is put")
    at_limit: bool = Field(description="it can go no further that way")


class WantedMoment(Item):
    """The remainder that is asked for."""

    kg_m: Triple
    g_cm: Triple
    default: list[Literal["x", "y", "z"]] = Field(description="components that nobody stated")
    note: str = Field(description="how the default was chosen")


class BallastPlan(Item):
    """The changes, and what they leave."""

    wanted: WantedMoment
    changes: list[BallastChange]
    remainder: Hang
    reached: bool = Field(description="every stated component and every level one is as wanted, and the table hangs below its pivot")
    note: str = Field(description="what cannot be reached, and why; empty where all is")


class RefinedMass(Item):
    """A ballast's mass by its statement and by both logs."""

    name: str
    stated_kg: float
    stated_sigma_kg: float
    refined_kg: float
    refined_sigma_kg: float


class Moved(Item):
    """One ballast's change between the two logs."""

    name: str
    by_mm: float | None
    add_kg: float | None


class MoveCheck(Item):
    """What moved against what was predicted."""

    moved: list[Moved]
    source: Literal["stated", "recommended"]
    predicted: Moment
    measured: Moment
    difference: Moment = Field(description="measured less predicted")
    sigmas: Triple = Field(description="the difference over its sigma, each axis")
    chi_square: float
    freedom: Literal[3] = 3
    p: float = Field(description="chance of as large a difference")
    as_predicted: bool
    masses: list[RefinedMass]
    thrust_scale: float = Field(description="thrust over stated thrust; 1 where it is stated as exact")
    thrust_scale_sigma: float


class BalanceSource(Item):
    """A result."""

    path: str = Field(description="the folder and its result.json")
    phase: str
    input_sha256: str
    vehicle_sha256: str


class Balance(Item):
    """The whole of what ``massprop balance --json`` prints."""

    schema_: Literal["massprop/balance/1"] = Field("massprop/balance/1", alias="schema")
    result: BalanceSource
    after: BalanceSource | None = Field(description="the log that was taken after the moves; null where none is named")
    vehicle: str
    gravity_m_s2: float
    pivot_m: Triple
    now: Hang = Field(description="of the result; of the later one where there is one, with what the moves say of it")
    plan: BallastPlan = Field(description="of what to do next")
    check: MoveCheck | None


def moment(value: Array, covariance: Array, gravity: float) -> Moment:
    """In all units, of κ (3,) kg m and its covariance (3, 3)."""
    sigma = np.sqrt(np.maximum(np.diag(covariance)[:3], 0.0))
    units, both = {"kg_m": 1.0, "g_cm": G_CM, "n_m": gravity}, (("", value), ("sigma_", sigma))
    return Moment(**{f"{of}{name}": (factor * part).tolist() for name, factor in units.items() for of, part in both})


def hang(hanging: Hanging) -> Hang:
    """How a table hangs: at rest with κ straight down."""
    swings, below = periods(hanging), -float(hanging.moment @ hanging.up)
    level = float(np.linalg.norm(hanging.moment + below * hanging.up))
    return Hang(
        moment=moment(hanging.moment, hanging.covariance, hanging.gravity),
        below_kg_m=below,
        period_s=list(swings) if swings else None,
        tilt_rad=float(np.arctan2(level, below)) if swings else None,
    )
