"""What rows bring that those before them did not tell, against least squares on all rows before at once."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import grown
from massprop_cli.estimate.innovations import innovations_given, sequential_innovations
from massprop_cli.kernel import kernel

pytestmark = pytest.mark.numerical
UNKNOWNS, CYCLES = 7, 40


def test_each_cycle_is_predicted_by_least_squares_on_all_before_it() -> None:
    rng = np.random.default_rng(0)
    known = np.triu(rng.standard_normal((UNKNOWNS, UNKNOWNS + 1))) + 3 * np.eye(UNKNOWNS, UNKNOWNS + 1)
    rows = rng.standard_normal((CYCLES, 6, UNKNOWNS + 1))
    left, root = sequential_innovations(known, rows)
    for k in range(CYCLES):
        before = np.vstack([known, rows[:k].reshape(-1, UNKNOWNS + 1)])
        x = np.linalg.lstsq(before[:, :-1], before[:, -1], rcond=None)[0]
        information = before[:, :-1].T @ before[:, :-1]
        ahead = rows[k, :, :-1]
        np.testing.assert_allclose(left[k], rows[k, :, -1] - ahead @ x, atol=1e-10)
        np.testing.assert_allclose(root[k] @ root[k].T, np.eye(6) + ahead @ np.linalg.solve(information, ahead.T), atol=1e-10)
    assert (np.diagonal(root, axis1=1, axis2=2) > 0).all()
    assert np.abs(np.triu(root, 1)).max() == 0


@pytest.mark.skipif(kernel().library is None, reason="no compiled kernel was built")
def test_the_kernel_says_what_numpy_says_of_unknowns_that_nothing_told_before() -> None:
    rng = np.random.default_rng(1)
    known = 1e-6 * np.eye(UNKNOWNS, UNKNOWNS + 1)
    rows = rng.standard_normal((CYCLES, 6, UNKNOWNS + 1)) * 10.0 ** rng.uniform(-3, 3, UNKNOWNS + 1)
    left, root = sequential_innovations(known, rows)
    other, spread = innovations_given(grown(known, rows)[:-1], rows)
    whitened = [np.linalg.solve(by, of[..., None]) for by, of in ((root, left), (spread, other))]
    np.testing.assert_allclose(whitened[0][2:], whitened[1][2:], atol=1e-6)
