"""Variance ``Σ x²/N`` and lag-one autocovariance ``Σ x[k] x[k−1]/(N−1)`` of a signal that is added in parts."""

import numpy as np

from massprop_cli.base.arrays import Array


class Moments:
    """Moments of rows (N, c) that are added in parts."""

    def __init__(self, columns: int, centred: bool = False) -> None:
        """``centred``: moments about the mean of all rows, else about zero."""
        self.count = 0
        self._centred = centred
        self._shift, self._sum, self._squares, self._products, self._last = (np.zeros(columns) for _ in range(5))

    def add(self, rows: Array) -> None:
        """Add the next rows (n, c)."""
        if not len(rows):
            return
        if self._centred and not self.count:
            self._shift = rows[0].copy()
        rows = rows - self._shift
        if not self.count:
            self._first = rows[0]
        self._sum = self._sum + rows.sum(0)
        self._squares = self._squares + (rows**2).sum(0)
        self._products = self._products + self._last * rows[0] + (rows[1:] * rows[:-1]).sum(0)
        self._last = rows[-1]
        self.count += len(rows)

    @property
    def variance(self) -> Array:
        """(c,) variance."""
        found: Array = self._squares / max(self.count, 1) - self._mean**2
        return np.maximum(found, 0.0)

    @property
    def lagged(self) -> Array:
        """(c,) lag-one autocovariance; needs two rows."""
        pairs = self.count - 1
        ends = 2 * self._sum - self._first - self._last
        return np.asarray(self._products / pairs - self._mean * ends / pairs + self._mean**2)

    @property
    def _mean(self) -> Array:
        return self._sum / max(self.count, 1) * self._centred
