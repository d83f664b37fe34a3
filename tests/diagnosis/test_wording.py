"""What a cause is called, where its numbers say that it is another."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from massprop_cli.diagnosis import wording


def said(mass: float, inertia: float) -> str:
    rates = {"mass_rate": np.array([mass]), "inertia_rate": np.array([inertia])}
    return wording._fuel(cast(Any, SimpleNamespace(found=SimpleNamespace(value=rates.__getitem__))))


@pytest.mark.parametrize(("mass", "inertia"), [(-0.05, -0.002), (-0.2, 0.004)])
def test_what_grows_lighter_uses_fuel(mass: float, inertia: float) -> None:
    assert said(mass, inertia).endswith("from the first to the last cycle; state [drift]")


@pytest.mark.parametrize(("mass", "inertia"), [(0.06, 0.05), (0.0, 0.05)])
def test_what_seems_to_grow_heavier_has_thrust_that_falls(mass: float, inertia: float) -> None:
    assert "rather, thrust falls, as the pressure of a tank that empties" in said(mass, inertia)
