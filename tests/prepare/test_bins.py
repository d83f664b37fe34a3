"""The compiled kernel's integrals of a piecewise linear signal are NumPy's."""

from __future__ import annotations

import weakref

import numpy as np
import pytest

from massprop_cli.kernel import Kernel, kernel, pointer
from massprop_cli.prepare import signal
from massprop_cli.prepare.signal import Signal, window_integrals


@pytest.mark.skipif(kernel().library is None, reason=f"integrals run on {kernel().name}")
@pytest.mark.parametrize("lag_s", [0.0, 0.3, 7.0])
@pytest.mark.parametrize("events", [0, 1, 300])
def test_integrals_and_moments_agree(events: int, lag_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Events before, within and after the bins, at their edges, and several at once."""
    rng = np.random.default_rng(events)
    edges = 100 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 200))])
    time = np.concatenate([rng.uniform(90, 320, events), edges[: min(events, 20)], edges[: min(events, 20)]])
    driven = Signal(time, rng.standard_normal(len(time)), 0.1 * rng.standard_normal(len(time)))
    own = window_integrals([driven, driven], edges, lag_s)
    monkeypatch.setattr(signal, "kernel", lambda: Kernel(None, "none"))
    for mine, other in zip(own, window_integrals([driven, driven], edges, lag_s), strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-11, atol=1e-11 * max(float(np.abs(other).max()), 1.0))


def test_what_a_call_is_handed_stays_for_as_long_as_the_call() -> None:
    """An array without another name was given back before the call that read it began."""
    numbers = np.arange(3.0)
    there, place = weakref.ref(numbers), pointer(numbers)
    del numbers
    assert there() is not None
    assert place.value == there().ctypes.data  # type: ignore[union-attr]
    del place
    assert there() is None
