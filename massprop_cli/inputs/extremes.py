"""Values so many orders of magnitude apart that double precision can't hold them together: unusable input, and said as such."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.inputs.vehiclefile import VehicleSource

FAR = 1e6
"""What a testbed's file states lies within this of 1, in SI units; there the arithmetic must not fail."""


@contextmanager
def refused(place: object, source: VehicleSource) -> Iterator[None]:
    """Where linear algebra fails in this block: :class:`InputError` that names the vehicle file's most extreme value.

    Without an extreme value the failure is a bug, and stays what it was.
    """
    try:
        yield
    except (np.linalg.LinAlgError, OverflowError) as error:
        key, value = farthest(source.vehicle.model_dump(mode="json", by_alias=True, exclude_unset=True))
        if 1 / FAR < abs(value) < FAR:
            raise
        raise InputError(
            f"{place}: can't be computed with {key} = {value:g} of {source.source} ({error}); check its unit, all values are SI"
        ) from None


def farthest(data: Any, place: str = "") -> tuple[str, float]:
    """The dotted key and the value of the number that is farthest from 1, on a logarithmic scale; zeros don't count."""
    if isinstance(data, (int, float)) and not isinstance(data, bool):
        return place, float(data) or 1.0
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    found = [farthest(child, f"{place}.{key}" if place else str(key)) for key, child in items]
    return max(found, key=lambda one: abs(math.log10(abs(one[1]))), default=(place, 1.0))
