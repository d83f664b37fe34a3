"""Linear algebra that ends."""

from typing import Any

import numpy as np
import pytest

from massprop_cli.base.arrays import cubic, singular


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


def test_a_cubic_through_values_is_exact_for_a_parabola_and_stays_at_its_ends() -> None:
    at = np.arange(12.0)
    wanted = np.linspace(1.0, 10.0, 100)
    np.testing.assert_allclose(cubic(wanted, at, 0.3 * at**2 - at), 0.3 * wanted**2 - wanted, atol=1e-12)
    assert cubic(np.array([-3.0, 20.0]), at, at).tolist() == [0.0, 11.0]
    assert cubic(np.array([1.0]), at[:1], np.array([7.0])).tolist() == [7.0]
