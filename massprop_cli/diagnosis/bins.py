"""As many bins a cycle as its motion asks for: so many that more of them move no value by a good part of its sigma.

An estimate moves by no more sigmas than the norm of what its model is off by, over noise (Cauchy and Schwarz): each error by itself, or
what adds up of them as commands do.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from massprop_cli.base.arrays import Array, median
from massprop_cli.diagnosis import segment
from massprop_cli.diagnosis.delay import first_of
from massprop_cli.diagnosis.fit import response
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.estimate.noiselevels import MEDIAN, with_noise_levels
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
        vehicle = stating(used, {"estimator.bins_per_cycle": bins})
        read = here if bins == fewest else Stream.of(log, vehicle, setup.timing)
        return [response(read, part, reference, vehicle) for part, reference in known]

    if not known or not used.noise.all():
        return setup.vehicle
    # on a bearing the weight shows the turn, too, and errors of the rate's growth are not all that adds up
    acted = None if setup.vehicle.pivoted else [_acted(here.part(part)) for part, _ in known]
    seen, chosen, coarse = [here.part(part) for part, _ in known], fewest, expected(fewest)
    for finer in [bins for bins in BINS if bins > fewest]:
        fine = expected(finer)
        noise = np.maximum(used.noise, _residual(seen, fine))
        off = [(one - other) / noise[:3] for (one, _), (other, _) in zip(fine, coarse, strict=True)]
        felt = [(one - other) / noise[3:] for (_, one), (_, other) in zip(fine, coarse, strict=True)]
        moved = max(_squares([*off, *felt]), 0.0 if acted is None else _squares(map(_as_acted, off, acted)))
        if not np.sqrt(moved / share) >= MOVED:
            break  # or what runs away tells nothing
        chosen, coarse = finer, fine
    return setup.vehicle if chosen == fewest else stating(setup.vehicle, {"estimator.bins_per_cycle": chosen})


def _residual(parts: Sequence[Samples], expected: Sequence[tuple[Array, Array]]) -> Array:
    """(6,) what a body leaves of each rate and specific force, as the sigma of a normal scatter with that median.

    Where it is far above the noise the body is none, and bins that follow its motion to within the noise only take time.
    """
    grown = np.concatenate([np.diff(part.rate_rad_s, axis=0) - steps for part, (steps, _) in zip(parts, expected, strict=True)])
    felt = np.concatenate([part.specific_force_m_s2 - force for part, (_, force) in zip(parts, expected, strict=True)])
    return np.asarray(np.array([median(np.abs(column)) for column in (*(grown / np.sqrt(2)).T, *felt.T)]) / MEDIAN)


def _squares(parts: Iterable[Array]) -> float:
    return float(sum((part**2).sum() for part in parts))


def _acted(samples: Samples) -> Array:
    """(K, up to 12) orthonormal: how the rate would have grown by each component of the commands and each product of rates alone."""
    executed, rate = samples.executed, samples.rate_rad_s
    impulse = np.concatenate([executed.whole, products(rate) * executed.duration_s[:, None]], 1)
    grown = np.cumsum(impulse, axis=0)
    grown -= grown.mean(0)
    size = np.linalg.norm(grown, axis=0)
    return np.linalg.qr(grown[:, size > 0] / size[size > 0])[0]


def _as_acted(off: Array, acted: Array) -> Array:
    """(up to 12, 3) what of errors (K − 1, 3) of the rate's growth adds up as commands and rates do.

    The gyro's noise is each rate's, not each growth's; the unknown rate at the beginning takes the mean.
    """
    grown = np.cumsum(np.concatenate([np.zeros((1, 3)), off]), axis=0)
    return np.asarray(acted.T @ (grown - grown.mean(0)))
