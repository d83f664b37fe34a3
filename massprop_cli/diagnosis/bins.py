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

    def expected(bins: int) -> Array:
        vehicle = used.model_copy(update={"estimator": used.estimator.model_copy(update={"bins_per_cycle": bins})})
        read = here if bins == fewest else Stream.of(log, vehicle, setup.timing)
        each = [response(read, part, reference, vehicle) for part, reference in known]
        return np.concatenate([(one / noise).ravel() for pair in each for one, noise in zip(pair, np.split(used.noise, 2), strict=True)])

    if not known or not used.noise.all():
        return setup.vehicle
    chosen, coarse = fewest, expected(fewest)
    for finer in [bins for bins in BINS if bins > fewest]:
        fine = expected(finer)
        if not np.linalg.norm(fine - coarse) >= MOVED * np.sqrt(share):
            break  # or what runs away tells nothing
        chosen, coarse = finer, fine
    if chosen == fewest:
        return setup.vehicle
    return setup.vehicle.model_copy(update={"estimator": setup.vehicle.estimator.model_copy(update={"bins_per_cycle": chosen})})
