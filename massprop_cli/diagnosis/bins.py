"""As many bins a cycle as its motion asks for: so many that more of them move no value by a good part of its sigma.

An estimate moves by no more sigmas than the norm of what its model is off by, over noise (Cauchy and Schwarz).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis import segment
from massprop_cli.diagnosis.delay import first_of
from massprop_cli.diagnosis.fit import response
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.estimate.noiselevels import with_noise_levels
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.stream import Stream

BINS = (4, 16, 64)
"""Each finer than the motion that is looked at by the one before."""
MOVED = 0.3
"""Sigmas by which too few of them may move a value."""
LONGEST = 400
"""Cycles that are looked at."""


def with_bins(setup: Setup, pieces: Sequence[slice]) -> Vehicle:
    """The vehicle with as many bins a cycle as the log asks for; as it is where nothing tells how the body answers."""
    log, busy = segment.bounded(setup.log, setup.vehicle, setup.timing, pieces, LONGEST)
    parts = [slice(part.start, min(part.stop, part.start + LONGEST)) for part in busy]
    here = Stream.of(log, setup.vehicle, setup.timing)
    used, _ = with_noise_levels(here, parts, setup.vehicle)
    fewest = setup.vehicle.estimator.bins_per_cycle
    begun = [(part, first_of(here, part, used)) for part in parts]
    known = [(part, reference) for part, reference in begun if reference is not None]
    share = sum(part.stop - part.start for part, _ in known) / sum(piece.stop - piece.start for piece in pieces)

    def expected(bins: int) -> list[tuple[Array, Array]]:
        vehicle = used.model_copy(update={"estimator": used.estimator.model_copy(update={"bins_per_cycle": bins})})
        read = here if bins == fewest else Stream.of(log, vehicle, setup.timing)
        return [response(read, part, reference, vehicle) for part, reference in known]

    if not known or not used.noise.all():
        return setup.vehicle
    acted = [_acted(here.part(part))[:, : 0 if setup.vehicle.pivoted else None] for part, _ in known]  # the weight shows the turn, too
    chosen, coarse = fewest, expected(fewest)
    for finer in [bins for bins in BINS if bins > fewest]:
        fine = expected(finer)
        if not _moved(fine, coarse, acted, used.noise, share) >= MOVED:
            break  # or what runs away tells nothing
        chosen, coarse = finer, fine
    if chosen == fewest:
        return setup.vehicle
    return setup.vehicle.model_copy(update={"estimator": setup.vehicle.estimator.model_copy(update={"bins_per_cycle": chosen})})


def _acted(samples: Samples) -> Array:
    """(K, 12) orthonormal: how the rate would have grown by each component of the commands and each product of rates alone."""
    executed, rate = samples.executed, samples.rate_rad_s
    impulse = np.concatenate([executed.whole, products(rate) * executed.duration_s[:, None]], 1)
    grown = np.cumsum(impulse, axis=0)
    grown -= grown.mean(0)
    size = np.linalg.norm(grown, axis=0)
    return np.linalg.qr(grown[:, size > 0] / size[size > 0])[0]


def _moved(
    fine: Sequence[tuple[Array, Array]], coarse: Sequence[tuple[Array, Array]], acted: Sequence[Array], noise: Array, share: float
) -> float:
    """Sigmas by which a value may move at most, in a log of which so large a ``share`` is looked at.

    By errors of the growth of the rate and of the specific force, each alone; and by what of the former adds up, but for what the unknown
    rate at the beginning takes, as commands and rates do: the gyro's noise is each rate's.
    """
    alone = together = 0.0
    for (steps, force), (other_steps, other_force), basis in zip(fine, coarse, acted, strict=True):
        off = (steps - other_steps) / noise[:3]
        alone += float((off**2).sum() + (((force - other_force) / noise[3:]) ** 2).sum())
        grown = np.cumsum(np.concatenate([np.zeros((1, 3)), off]), axis=0)
        together += float(((basis.T @ (grown - grown.mean(0))) ** 2).sum())
    return float(np.sqrt(max(alone, together) / share))
