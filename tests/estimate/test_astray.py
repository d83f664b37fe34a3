"""Numbers that end on the way: nothing is said from there on, or the log is refused; never a traceback."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.base.errors import InputError
from massprop_cli.conclude import estimated
from massprop_cli.estimate import causal, compiled
from massprop_cli.estimate.causal import Causal
from massprop_cli.estimate.rows import Rows
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import faulty

TURNS = 20
"""Blocks until the causal pass breaks down."""


def test_a_causal_pass_that_breaks_down_says_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """By NumPy; the off-line fit stands, but no value is given where the last row has none."""
    log, used = faulty.sample("free-flyer")
    block, left = Causal.block, [TURNS]

    def breaking(self: Causal) -> Rows:
        left[0] -= 1
        if left[0] < 0:
            raise np.linalg.LinAlgError("Singular matrix")
        return block(self)

    monkeypatch.setattr(compiled, "supports", lambda *_: False)
    monkeypatch.setattr(Causal, "block", breaking)
    found = faulty.examined(log, used)
    told = np.isfinite(found.histories[0].values[:, 5])
    assert told.any()
    assert not told[np.flatnonzero(told)[-1] + 1 :].any()
    assert all(estimate.value is None for estimate in found.conclusions[0].estimates.values())
    assert "converged" not in {estimate.verdict for estimate in found.conclusions[0].estimates.values()}


def test_a_causal_pass_that_never_begins_goes_about_the_fit_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of few cycles of a second each the first tell no body as yet: all ten were not excited, and the log told them."""
    log, used = faulty.sample("free-flyer")
    begun = faulty.examined(log, used)
    monkeypatch.setattr(compiled, "supports", lambda *_: False)
    monkeypatch.setattr(causal, "first_reference", lambda *_: None)
    led = faulty.examined(log, used)
    assert {estimate.verdict for estimate in led.conclusions[0].estimates.values()} == {"converged"}
    assert (np.abs(led.conclusions[0].values - begun.conclusions[0].values) < 0.1 * begun.conclusions[0].sigmas).all()


def test_a_log_on_which_no_fit_stands_is_refused_with_what_to_check(monkeypatch: pytest.MonkeyPatch) -> None:
    log, used = faulty.sample("free-flyer")

    def broken(*_: object) -> None:
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(estimated, "_by_default", broken)
    with pytest.raises(InputError, match=r"the log and vehicle\.toml give an ill-conditioned problem .* check units"):
        flow.examine(log, VehicleSource(used, "vehicle.toml", ""))
