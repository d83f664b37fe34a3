"""Linear algebra that ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from massprop_cli.base.arrays import singular


def test_a_decomposition_that_fails_is_done_in_another_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """LAPACK's fails on some matrices of low rank, by its kernels; here on any in the order in which it comes first."""
    rng = np.random.default_rng(1)
    matrix = rng.normal(size=(40, 6)) @ rng.normal(size=(6, 9))
    plain = singular(matrix)
    decomposed, orders = np.linalg.svd, list[float]()

    def failing(given: Any, **options: Any) -> Any:
        orders.append(float(given[0, 0]))
        if len(orders) == 1:
            raise np.linalg.LinAlgError("SVD did not converge")
        return decomposed(given, **options)

    monkeypatch.setattr(np.linalg, "svd", failing)
    left, values, right = singular(matrix)
    assert orders == [matrix[0, 0], matrix[0, -1]]
    np.testing.assert_allclose(values, plain[1], atol=1e-12)
    np.testing.assert_allclose((left * values) @ right, matrix, atol=1e-12)
