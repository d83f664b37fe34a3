"""Number of bins in a cycle that its motion needs, so that more bins change no value by a large part of its sigma.

By the Cauchy–Schwarz inequality, a model error moves an estimate by at most its norm over the noise: of each error by itself, or of their
sum along the commands.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from massprop_cli.base.arrays import NORMAL_MEDIAN, Array, median
from massprop_cli.diagnosis import segment
from massprop_cli.diagnosis.delay import initial_reference
from massprop_cli.diagnosis.fit import response
from massprop_cli.errorparameters.setup import Setup, stating
from massprop_cli.estimate.noiselevels import with_noise_levels
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.gyroscopic import products
from massprop_cli.prepare.compensate import Samples
from massprop_cli.prepare.stream import Stream

BINS = (4, 16, 64)
"""Numbers of bins that are tested; each is compared with the previous one."""
MOVED = 0.3
"""Largest change of a value by too few bins, sigmas."""
LONGEST = 400
"""Cycles that are tested."""


def with_bins(setup: Setup, pieces: Sequence[slice]) -> Vehicle:
    """Vehicle with the bins that the log needs; unchanged if no reference can be fitted."""
    log, busy = segment.bounded(setup.log, setup.vehicle, setup.timing, pieces, LONGEST)
    parts = [slice(part.start, min(part.stop, part.start + LONGEST)) for part in busy]
    here = Stream.of(log, setup.vehicle, setup.timing)
    used, _ = with_noise_levels(here, parts, setup.vehicle)
    fewest = setup.vehicle.estimator.bins_per_cycle
    starts = [(part, initial_reference(here, part, used)) for part in parts]
    known = [(part, reference) for part, reference in starts if reference is not None]
    share = sum(part.stop - part.start for part, _ in known) / sum(piece.stop - piece.start for piece in pieces)

    def expected(bins: int) -> list[tuple[Array, Array]]:
        vehicle = stating(used, {"estimator.bins_per_cycle": bins})
        samples = here if bins == fewest else Stream.of(log, vehicle, setup.timing)
        return [response(samples, part, reference, vehicle) for part, reference in known]

    if not known or not used.noise.all():
        return setup.vehicle
    # on a bearing the weight shows the turn, too, and growth errors are not all that accumulates
    histories = None if setup.vehicle.pivoted else [_acted(here.part(part)) for part, _ in known]
    parts_seen, chosen, expected_coarse = [here.part(part) for part, _ in known], fewest, expected(fewest)
    for finer in [bins for bins in BINS if bins > fewest]:
        expected_fine = expected(finer)
        noise = np.maximum(used.noise, _residual(parts_seen, expected_fine))
        rate_errors = [(one - other) / noise[:3] for (one, _), (other, _) in zip(expected_fine, expected_coarse, strict=True)]
        force_errors = [(one - other) / noise[3:] for (_, one), (_, other) in zip(expected_fine, expected_coarse, strict=True)]
        change = max(
            _squares([*rate_errors, *force_errors]), 0.0 if histories is None else _squares(map(_as_acted, rate_errors, histories))
        )
        if not np.sqrt(change / share) >= MOVED:
            break  # or diverges
        chosen, expected_coarse = finer, expected_fine
    return setup.vehicle if chosen == fewest else stating(setup.vehicle, {"estimator.bins_per_cycle": chosen})


def _residual(parts: Sequence[Samples], expected: Sequence[tuple[Array, Array]]) -> Array:
    """(6,) robust sigma of the residuals of rates and specific force.

    If it far exceeds the noise the body is wrong, and more bins would only take time.
    """
    rate_residual = np.concatenate([np.diff(part.rate_rad_s, axis=0) - steps for part, (steps, _) in zip(parts, expected, strict=True)])
    force_residual = np.concatenate([part.specific_force_m_s2 - force for part, (_, force) in zip(parts, expected, strict=True)])
    return np.asarray(np.array([median(np.abs(column)) for column in (*(rate_residual / np.sqrt(2)).T, *force_residual.T)]) / NORMAL_MEDIAN)


def _squares(parts: Iterable[Array]) -> float:
    return float(sum((part**2).sum() for part in parts))


def _acted(samples: Samples) -> Array:
    """(K, up to 12) orthonormal rate histories by each component of the commands and each product of rates."""
    executed, rate = samples.executed, samples.rate_rad_s
    impulse = np.concatenate([executed.whole, products(rate) * executed.duration_s[:, None]], 1)
    accumulated = np.cumsum(impulse, axis=0)
    accumulated -= accumulated.mean(0)
    size = np.linalg.norm(accumulated, axis=0)
    return np.linalg.qr(accumulated[:, size > 0] / size[size > 0])[0]


def _as_acted(errors: Array, histories: Array) -> Array:
    """(up to 12, 3) accumulated errors (K − 1, 3) of the rate's growth along those histories.

    Gyro noise is independent between rates, not growths. The unknown initial rate takes the mean.
    """
    accumulated = np.cumsum(np.concatenate([np.zeros((1, 3)), errors]), axis=0)
    return np.asarray(histories.T @ (accumulated - accumulated.mean(0)))
