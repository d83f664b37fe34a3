"""Integrals under the windows that IMU data carry, of quantities known by bins of each cycle."""

from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import Array


class Windows(NamedTuple):
    """An integral over each cycle: under the rising and falling halves of the triangular window, and plain."""

    rising: Array
    falling: Array
    whole: Array

    @property
    def step(self) -> Array:
        """(K − 1, ...) from each cycle into the next."""
        return self.rising[:-1] + self.falling[1:]


def windows(per_bin: Array, bin_s: Array, lateness: Array | None = None) -> Windows:
    """Integrals of a (K, B, ...) quantity given as means over bins of length ``bin_s`` (K,).

    ``lateness`` (K, ...) is the sum of the bins' first moments, each about its own middle and over its own length: the rising half
    weights what comes late in a bin more.
    """
    bins = per_bin.shape[1]
    weight = (np.arange(bins) + 0.5) / bins
    bin_s = bin_s.reshape(-1, *(1,) * (per_bin.ndim - 2))
    rising, whole = np.einsum("b,kb...->k...", weight, per_bin) * bin_s, per_bin.sum(1) * bin_s
    if lateness is not None:
        rising += lateness / bins
    return Windows(rising, whole - rising, whole)
