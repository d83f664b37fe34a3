"""Sigmas of what is found: of a factor, whatever it is multiplied onto."""

from __future__ import annotations

import re

import numpy as np
import pytest

from massprop_cli.conclude.verdict import Conclusion
from tests import faulty

FOUND = re.compile(r"jets\.4\.force_n=\[([-0-9.e]+), 0, 0\]")


def corrected(stated_n: float) -> tuple[float, Conclusion]:
    """Of a jet that is stated to give so much: what it is corrected to, N, and the values then."""
    log, vehicle = faulty.sample("free-flyer")
    (answer,) = faulty.examined(log, faulty.stated(vehicle, f"jets.4.force_n=[{stated_n}, 0.0, 0.0]")).mended
    (value,) = FOUND.findall(" ".join(answer.settings))
    return float(value), answer.conclusions[0]


@pytest.mark.thorough
@pytest.mark.seeds
def test_a_factor_is_found_alike_from_far_below_and_above() -> None:
    """Stated at a quarter or at twice what it gives, a jet's thrust is found to a thousandth, with the same values and sigmas."""
    (quarter, below), (twice, above) = corrected(0.25), corrected(2.0)
    true_n = faulty.sample("free-flyer")[1].jets[4].force_n[0]
    assert quarter == pytest.approx(true_n, rel=1e-3)
    assert twice == pytest.approx(true_n, rel=1e-3)
    np.testing.assert_allclose(below.sigmas, above.sigmas, rtol=0.1)
    assert (np.abs(below.values - above.values) < 0.5 * above.sigmas).all()
