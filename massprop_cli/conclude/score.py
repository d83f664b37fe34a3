"""A test of each assumption: whether the log would fit better with another value of it.

What is left of the log stands beside what a unit of each assumption would have added to it (:mod:`massprop_cli.conclude.assumptions`).
Their inner product over the latter's norm is the score test (Rao 1948): standard normal where the assumption is right, and sharper than any
test of what is left in all, which drowns one direction among thousands of cycles.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.conclude.assumptions import Examined
from massprop_cli.conclude.contradict import Contradiction
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import POSITIVE, Conclusion
from massprop_cli.errorparameters.sensor import ACCELEROMETER, GYRO
from massprop_cli.estimate.residualtest import REFUTED, threshold

WARY = 2.5
"""Sigmas from which on it is in doubt: so little, by chance, in one of 80 of each. Then what hangs on it is not called converged: seven of
a thousand values of clean logs. Of faults that a log tells by five sigma one in 160 shows less than this by chance, one in two less than
what refutes it. docs/faults.md moves."""
RARELY = 3.5
"""The same of what is rarely wrong: one in 2,000 of each."""
FAR, PART = 2.0, 0.005
"""Of its sigma and of its size, the change of a value that hangs on an assumption in doubt: its most likely change is uncertain itself."""
HARDLY = 4.0
"""Sigmas beyond which chance hardly makes any doubt of a log, so that no part of a value is too small to hang on it."""
SCALES = (GYRO, ACCELEROMETER)
"""Of a sensor's three axes, each of which is tested by itself too."""
APART = "scale of one kind of actuators"
MOVES = 1.0
"""Of its sigma, the least change of a value that touches it."""


@dataclass(frozen=True)
class Doubt:
    """An assumption that the log contradicts, or all but does."""

    what: str
    sigmas: float
    limit: float
    """Sigmas beyond which it is refuted (:mod:`massprop_cli.estimate.residualtest`)."""
    moves: tuple[Array | None, ...]
    """(10, a) of each phase: by how much the most likely value of it would move the estimates' state parameters, and as much of any that is
    of its kind, along another axis."""
    faint: bool = False
    """Whether it shows in several channels together alone: too little for its cause to be found."""
    hidden: tuple[Array | None, ...] = ()
    """The same along axes alone along which the log would not show as much: there it may be larger."""
    of_scale: bool = False
    """Whether it is of the scale of all that pushes or stores momentum, to which all that follows it is in proportion, however small."""

    @property
    def sure(self) -> bool:
        """Whether chance hardly makes so much."""
        return self.sigmas > self.limit

    def moved(self, at: int) -> Array | None:
        """(10,) by how much at most the state parameters of phase number ``at`` would move; None where it came to nothing."""
        moved = self.moves[at]
        found: Array | None = None if moved is None else np.abs(moved).max(1, initial=0.0)
        return found


def doubts(
    found: Examined, names: Sequence[str], groups: Sequence[Sequence[int]] = (), kinds_apart: Sequence[Sequence[int]] = ()
) -> list[Doubt]:
    """Those that are in doubt, the surest first; ``names`` of the command channels, of which ``groups`` may be wrong together.

    So may ``kinds_apart``: those that push beside others that only turn, by the unit of their forces, and all that store momentum.
    """
    told = [(response, noise) for response, noise in zip(found.responses, found.noise, strict=True) if response is not None]
    if not told:
        return []
    others = [ACCELEROMETER] * 3 + [f"thrust of {name}" for name in names]
    kinds, wholes = [t.code for t in found.varied] + others, [t.whole for t in found.varied] + others
    unit, first = np.eye(len(kinds)), len(kinds) - len(names)
    # the scale of all three axes at once is a direction of its own, and so is the thrust of jets along one line
    scales = [[i for i, whole in enumerate(wholes) if whole == name] for name in SCALES]
    every = [*kinds_apart, *groups]
    along = np.column_stack([unit, *(unit[:, group].sum(1) for group in (*scales, *([first + i for i in group] for group in every)))])
    several = [f"thrust of {', '.join(names[i] for i in group)}" for group in every]
    told_apart = len(kinds) + len(SCALES) + len(kinds_apart)
    # of two kinds that are apart either may be off
    whats, kind = [*kinds, *SCALES, *several], np.array([*wholes, *SCALES, *[APART] * len(kinds_apart), *several[len(kinds_apart) :]])
    gram = np.sum([response.gram for response, _ in told], 0)
    cross, own = gram[0, 1:].copy(), np.einsum("ei,ef,fi->i", along, gram[1:, 1:], along)
    # a factor on what was measured is one on its noise too, and of that an innovation is proof of nothing
    cross[[*scales[0], *scales[1]]] -= np.sum([noise * response.gram[0, 0] / noise.sum() for response, noise in told], 0)
    # no inner product is larger (Cauchy and Schwarz), as where a log has less noise than is stated
    most = np.sqrt(gram[0, 0] * own)
    cross = np.clip(cross @ along, -most, most)
    # what is stated to be uncertain may be off by that much
    uncertain = np.concatenate([[t.sigma for t in found.varied], np.zeros(len(whats) - len(found.varied))])
    with np.errstate(divide="ignore", invalid="ignore"):
        sizes = np.nan_to_num(np.abs(cross) / own)
        sigmas = np.nan_to_num(sizes / np.sqrt(max(found.scatter, 1.0) / own + uncertain**2))
    largest = np.array([t.most for t in found.varied])
    sigmas[: len(largest)] *= own[: len(largest)] > largest**-2
    shifts = [None if response is None else response.shift @ along for response in found.responses]
    limit = threshold(REFUTED, 2 * len(whats))  # it may be more or less

    def doubt(i: int) -> Doubt:
        kin, faint = kind == kind[i], i >= told_apart
        untold = kin & (own * sizes[i] ** 2 < WARY**2)
        moves, hidden = (tuple(None if by is None else sizes[i] * by[:, those] for by in shifts) for those in (kin, untold))
        return Doubt(whats[i], float(sigmas[i]), limit, moves, faint, hidden, kind[i] == APART)

    wary = np.array([RARELY if t.rare else WARY for t in found.varied] + [WARY] * (len(whats) - len(found.varied)))
    return [doubt(int(i)) for i in np.argsort(-sigmas, kind="stable") if sigmas[i] > wary[i]]


def by_doubts(conclusion: Conclusion, at: int, found: Sequence[Doubt]) -> Contradiction | None:
    """Of assumptions that nothing with a name stands for, in phase number ``at``: what their most likely values would move."""
    sure = [doubt for doubt in found if doubt.sure]
    touched: BoolArray = np.zeros(len(QUANTITIES), dtype=bool)
    for _, change, sigma in _changes(conclusion, at, sure):
        touched |= change > MOVES * sigma
    if not touched.any():
        return None
    names = ", ".join(name for name, hit in zip(QUANTITIES, touched, strict=True) if hit)
    first = sure[0]
    assumption = first.what.replace("-", " ")
    cause = Reason.of("assumption-contradicted", assumption=assumption, sigmas=first.sigmas, quantities=names)
    return Contradiction((cause,), touched)


def hanging(conclusion: Conclusion, at: int, found: Sequence[Doubt], sizes: Array, far: float = FAR) -> dict[str, Reason]:
    """Why values of phase number ``at`` are not to be called converged: each hangs much on an assumption that is in doubt.

    ``sizes`` (10,) are their natural ones; what moves one by ``far`` sigmas is much.
    """
    reasons: dict[str, Reason] = {}
    sizes = sizes.copy()
    sizes[POSITIVE] = np.fmin(sizes[POSITIVE], np.abs(conclusion.values[POSITIVE]))
    for doubt, change, sigma in _changes(conclusion, at, [doubt for doubt in found if not (doubt.sure or doubt.faint)]):
        part = 0.0 if doubt.of_scale or doubt.sigmas > HARDLY else PART
        least = np.maximum(far * sigma, part * sizes)
        for name, hit, by in zip(QUANTITIES, change > least, change / sigma, strict=True):
            if hit and name not in reasons:
                assumption = doubt.what.replace("-", " ")
                reasons[name] = Reason.of("assumption-in-doubt", sigmas=doubt.sigmas, assumption=assumption, quantity=name, moved=float(by))
    return reasons


def unseen(conclusion: Conclusion, at: int, found: Sequence[Doubt], sizes: Array) -> dict[str, Reason]:
    """The same where sigmas include what was refuted: of as much along another axis, of which the log shows nothing."""
    sure = [doubt for doubt in found if doubt.sure and doubt.hidden]
    return hanging(conclusion, at, [replace(doubt, moves=doubt.hidden, limit=np.inf) for doubt in sure], sizes, MOVES)


def _changes(conclusion: Conclusion, at: int, found: Sequence[Doubt]) -> Iterator[tuple[Doubt, Array, Array]]:
    """Each with (10,) by how much the values would move, and (10,) their sigmas; NaN, of which nothing is more, where nothing is told."""
    sigma = conclusion.sigmas
    mass = conclusion.estimates["mass"].value or np.nan
    for doubt in found:
        change = doubt.moved(at)
        if change is not None:
            change[9] *= mass**2  # of 1/m
            yield doubt, change, sigma
