"""Sigmas of what is found: of a factor, whatever it is multiplied onto."""

from __future__ import annotations

import re

import pytest

from tests import faulty

FOUND = re.compile(r"jets\.4\.force_n\"? ?= ?\[([-0-9.e]+), 0, 0\]")


def found_thrust(stated_n: float) -> tuple[float, float]:
    """Of a jet that is stated to give so much: what it is corrected to, and how far one sigma on is, N."""
    log, vehicle = faulty.sample("free-flyer")
    (answer,) = faulty.examined(log, faulty.stated(vehicle, f"jets.4.force_n=[{stated_n}, 0.0, 0.0]")).mended
    value, further = (float(one) for one in FOUND.findall(" ".join(answer.settings))[:2])
    return value, abs(further - value)


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_factors_sigma_is_of_what_it_multiplies() -> None:
    """Stated at a quarter or at twice what it gives, a jet's thrust is found with the same sigma, and within four of it."""
    quarter, twice = found_thrust(0.25), found_thrust(2.0)
    true_n = faulty.sample("free-flyer")[1].jets[4].force_n[0]
    for value, sigma in (quarter, twice):
        assert sigma == pytest.approx(quarter[1], rel=0.1)
        assert abs(value - true_n) < 4 * sigma
