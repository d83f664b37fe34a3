"""Integrals over the windows of IMU data, of a quantity given by bins of each cycle."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array


class Windows(NamedTuple):
    """Integrals over K cycles: with the rising and the falling half of the triangular window, and unweighted."""

    rising: Array
    falling: Array
    whole: Array

    @property
    def step(self) -> Array:
        """(K − 1, ...) integral under the whole triangular window, from each cycle to the next."""
        return self.rising[:-1] + self.falling[1:]


def windows(per_bin: Array, bin_s: Array, moment: Array | None = None) -> Windows:
    """Integrals of a quantity given by its (K, B, ...) means over bins of length ``bin_s`` (K,), s.

    ``moment`` (K, ...) is the sum of the bins' first moments, each about the bin's middle and divided by the bin's length. The rising half
    gives more weight to a later value.
    """
    bins = per_bin.shape[1]
    weight = (np.arange(bins) + 0.5) / bins
    bin_s = bin_s.reshape(-1, *(1,) * (per_bin.ndim - 2))
    rising, whole = np.einsum("b,kb...->k...", weight, per_bin) * bin_s, per_bin.sum(1) * bin_s
    if moment is not None:
        rising += moment / bins
    return Windows(rising, whole - rising, whole)
