"""Oscillation test: a flexible part or slosh that goes on after a push.

A spring or a pendulum within the vehicle answers each push by a swing of its own, so that at first the body seems lighter than it is: mass
or inertia come out too small, by up to the part that swings, in the likeness of a good fit. What is left, made white, is tested against
the answers of oscillators to what was commanded, damped within one period, of periods half an octave apart,

    y_k = Σ_j h_j u_(k−j),  h_j = exp(−j / P) (cos, sin)(2π j / P),  j = 1 … 3 P.

Two directions for each axis, so that any phase and damping shows in the one that is nearest. Rates are tested against the torque about each
axis, and against the forces across it, since a part that swings away from the CG turns the body; specific force against the force along
each axis, and against the torques across it. Of all cycles only the sums of products of what is some cycles apart are kept. As it knows
what was commanded, it sees a swing far below the noise, which no test of what is left alone does (:mod:`massprop_cli.conclude.whiteness`).
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from massprop_cli.base.arrays import ROUNDING, TINY, Array, BoolArray
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.whiteness import resting
from massprop_cli.diagnosis.lackoffit import correlation
from massprop_cli.estimate.disturbances import sized
from massprop_cli.estimate.history import History
from massprop_cli.estimate.residualtest import DOUBTFUL, deviate, threshold
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.model.resolved import Resolved
from massprop_cli.prepare.compensate import BLOCK, Source, apart

PERIODS = 4.0 * 2.0 ** np.arange(0, 8.5, 0.5)
"""Cycles: 4 to 1024."""
SEEN = 40
"""Logged speeds of rotors in the shortest period: what they did between them goes with the commands, too. Eight were too few for motors
with lags of ten and more: 5 of 16 clean logs seemed to swing, in 9 to 32."""
MEMORY = 3
"""Periods after which a push is forgotten."""
REPEATED = 2
"""Least periods within a phase."""
ANSWERS = np.array([[0, 1, 2, 3, 4, 5], [4, 5, 3, 1, 2, 0], [5, 3, 4, 2, 0, 1]])
"""Which commanded component (torque x y z, force x y z) what is left of rate x y z and specific force x y z is tested against: its own; and
those across."""
SENSORS = ("turn", "speed")
"""What of the body the gyro and the accelerometer see swing."""


class Lagged(NamedTuple):
    """Sums over a phase's cycles of products of what is 0, 1, … cycles apart; torque x y z and force x y z."""

    left: Array
    """(A, 6, L) what is left of rate and specific force, by what was commanded so many cycles before, of each of ``ANSWERS``."""
    commanded: Array
    """(6, L) what was commanded, by itself."""
    scatter: Array
    """(6,) mean square of what is left."""
    cycle_s: float
    """Mean length of a cycle."""


def swinging(history: History, samples: Source, used: Resolved, stated: Vehicle, apart_cycles: int = 0) -> dict[str, Reason]:
    """Why values are not to be called converged, by quantity: those that rest on a sensor which shows a swing.

    ``used`` holds the disturbances that were sized, beyond what is ``stated``; speeds of rotors are known every ``apart_cycles``.
    """
    cycles = history.cycles
    periods = PERIODS[: np.searchsorted(PERIODS, (cycles.stop - cycles.start) / REPEATED, "right")]
    periods = periods[periods >= SEEN * apart_cycles]
    if history.reference is None or not len(periods):
        return {}
    found = lagged(history, samples, used.held_axes)
    sigmas = swings(found, periods, np.array([correlation(used), 1.0]))
    # where disturbances had to be sized something is known to be amiss: then chance may show a sensor's own answers in one of ten logs
    own_rate = 10 * DOUBTFUL if sized(used, stated) else DOUBTFUL
    least = np.array([threshold(own_rate if n == 0 else DOUBTFUL, sigmas.size) for n in range(len(ANSWERS))])
    reasons: dict[str, Reason] = {}
    for sensor, own in enumerate(sigmas.transpose(1, 0, 2)):
        answer, at = divmod(int((own - least[:, None]).argmax()), len(periods))
        if own[answer, at] > least[answer]:
            period_s = float(periods[at]) * found.cycle_s
            reason = Reason.of("oscillation", motion=SENSORS[sensor], period_s=period_s, sigmas=float(own[answer, at]))
            # what is pushed aside and turns the body moves its CG too, and the other way round
            reasons |= dict.fromkeys(resting(history, (np.arange(6) // 3 == sensor) | (answer > 0)), reason)
    return reasons


def swings(one: Lagged, periods: Array, spread: Array) -> Array:
    """(A, 2, P) by how many sigmas what is left of rate and of specific force follows oscillators of each period, of each of ``ANSWERS``.

    Slow noise may have more power than white noise by the factors ``spread`` (2,).
    """
    explained, freedom = np.array([explained_by(one, float(period)) for period in periods]).transpose(3, 1, 2, 0)
    explained /= spread[:, None]
    among = np.maximum(freedom, 1)
    return np.where(freedom > 0, deviate(explained / among, among), 0.0)


def lagged(history: History, samples: Source, still: Sequence[int] = ()) -> Lagged:
    """Of a phase, part by part: products of fast Fourier transforms, added up; nothing is left of channels that are ``still``."""
    reference, cycles = history.reference, history.cycles
    assert reference is not None
    whole = cycles.stop - cycles.start
    lags = min(int(MEMORY * min(PERIODS[-1], whole / REPEATED)) + 1, whole)
    size = 1 << (min(BLOCK, whole) + 2 * lags - 1).bit_length()
    spectra = np.zeros((1 + len(ANSWERS), 6, size // 2 + 1), dtype=complex)
    before, power, count, lasting = np.zeros((6, lags)), np.zeros(6), 0, 0.0
    for part in apart(cycles):
        executed = samples.part(part).executed
        pushed = executed.channels.whole @ executed.channels.wrench
        pushed[:, :3] -= np.cross(reference.cg, pushed[:, 3:])
        rest = history.normalised[part.start - cycles.start : part.stop - cycles.start]
        told: BoolArray = np.asarray(np.isfinite(rest).all(1))
        rest = np.where(told[:, None], rest, 0.0)
        rest[:, still] = 0.0
        driven = np.hstack([before, pushed.T])
        now = np.fft.rfft(np.pad(np.stack([rest.T, pushed.T]), ((0, 0), (0, 0), (lags, 0))), size)
        past = np.fft.rfft(driven, size).conj()
        spectra += np.concatenate([now[0] * past[ANSWERS], now[1:] * past])
        power, count = power + (rest**2).sum(0), count + int(told.sum())
        before, lasting = driven[:, -lags:], lasting + float(executed.duration_s.sum())
    found = np.fft.irfft(spectra, size)[..., :lags]
    return Lagged(found[:-1], found[-1], power / max(count, 1), lasting / whole)


def explained_by(one: Lagged, period: float) -> Array:
    """(A, 2, 2) of each sensor: the sum of squares that oscillators of a period explain, over its scatter; and of how many directions.

    Oscillators' own sums of squares follow from the commands': Σ_jl h_j h_l R(j − l).
    """
    lags = min(int(MEMORY * period) + 1, one.left.shape[-1])
    kernel, across = _oscillator(period, lags)
    along = one.left[..., 1:lags] @ kernel.T
    both = np.hstack([one.commanded[:, :lags], np.zeros((6, 1)), one.commanded[:, lags - 1 : 0 : -1]])
    gram = np.einsum("hgl,al->ahg", across, both)
    power = one.commanded[:, 0].reshape(2, 3)
    driven: BoolArray = np.asarray(power > ROUNDING * power.sum(1, keepdims=True)).ravel()
    gram[~driven] = np.eye(2)
    square = np.einsum("bah,bah->ba", along, np.linalg.solve(gram[ANSWERS], along[..., None])[..., 0])
    told = one.scatter.reshape(2, 3) > 0  # nothing is left of what is not read
    counted = driven[ANSWERS].reshape(-1, 2, 3) & told
    scatter = np.maximum(one.scatter.reshape(2, 3).sum(1) / np.maximum(told.sum(1), 1), TINY)
    return np.stack([np.where(counted, square.reshape(-1, 2, 3), 0.0).sum(2) / scatter, 2.0 * counted.sum(2)], axis=2)


@lru_cache(64)
def _oscillator(period: float, lags: int) -> tuple[Array, Array]:
    """(2, L − 1) its answers h_j, j = 1 … L − 1; and (2, 2, 2 L) their products Σ_j h_j h_(j+l), l = 0 … L, −L + 1 … −1."""
    answer = np.exp((-1 + 2j * np.pi) * np.arange(1, lags) / period)
    kernel = np.stack([answer.real, answer.imag])
    spectrum = np.fft.rfft(kernel, 2 * lags)
    return kernel, np.fft.irfft(spectrum[:, None].conj() * spectrum, 2 * lags)
