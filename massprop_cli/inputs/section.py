"""Building blocks of configuration file models: numbers with ranges, vectors, and sections that refuse unknown keys."""

from collections.abc import Mapping
from typing import Annotated, Any, Self, cast

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, FiniteFloat

LEAST, MOST = 1e-30, 1e30
Positive = Annotated[FiniteFloat, Field(gt=LEAST, lt=MOST)]


def _within_range(value: float) -> float:
    """Refuse values whose squares or products would overflow or underflow."""
    if value != 0 and not LEAST < abs(value) < MOST:
        raise ValueError(f"must be 0, or from {LEAST:g} to {MOST:g} in size")
    return value


Real = Annotated[FiniteFloat, AfterValidator(_within_range)]
# bounds come before the validator, otherwise they would not become JSON Schema keywords
NonNegative = Annotated[FiniteFloat, Field(ge=0, lt=MOST), AfterValidator(_within_range)]
Vector = tuple[Real, Real, Real]
Metres = Annotated[FiniteFloat, Field(ge=-1e6, le=1e6), AfterValidator(_within_range)]
Place = tuple[Metres, Metres, Metres]
ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Section(BaseModel):
    """A table of a configuration file: immutable, unknown keys refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, defer_build=True)

    @classmethod
    def unset(cls) -> Self:
        """Section with every key at its default, without building a validator for the section (which is slow)."""
        return cast("Self", cls.model_construct())

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy with some keys changed and without cached properties of the original."""
        copied = super().model_copy(update=update, deep=deep)
        for cached in copied.__dict__.keys() - type(self).model_fields.keys():
            del copied.__dict__[cached]
        return copied
