"""Score test of each assumption: whether another value would fit the log better.

For whitened residuals r and their derivative d with respect to an assumption (:mod:`massprop_cli.conclude.assumptions`), dᵀr / |d| is
standard normal if the assumed value is right (Rao 1948). The most likely error is −dᵀr / dᵀd.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.base.dataclass import dataclass
from massprop_cli.base.levels import CONTRADICTION
from massprop_cli.conclude.assumptions import SensitivityAnalysis
from massprop_cli.conclude.contradict import Contradiction
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import POSITIVE, Conclusion
from massprop_cli.errorparameters.sensor import ACCELEROMETER, GYRO
from massprop_cli.estimate.residualtest import REFUTED, threshold

IN_DOUBT = 2.5
"""Least score of an assumption in doubt, sigmas. Chance exceeds it in one of 80 tests, and about seven of 1,000 values of error-free logs
lose their verdict. Of errors of five sigma, one in 160 scores less, and one in two less than the threshold of a refutation. docs/faults.md
depends on it."""
IN_DOUBT_RARE = 3.5
"""The same for an assumption that is rarely wrong; chance exceeds it in one of 2,000 tests."""
FAR, PART = 2.0, 0.005
"""Least change of a value that depends on an assumption in doubt: in its sigmas, and relative to its size. The most likely error is itself
uncertain."""
SCALES = (GYRO, ACCELEROMETER)
"""Sensors whose three axes are also tested with one common scale."""
ACTUATOR_SCALE = "scale of one kind of actuators"
MOVES = 1.0
"""Least change of a value that a refuted assumption contradicts, in its sigmas."""


@dataclass(frozen=True)
class Doubt:
    """An assumption with a significant score test."""

    assumption: str
    sigmas: float
    """Score."""
    limit: float
    """Score above which the assumption is refuted (:mod:`massprop_cli.estimate.residualtest`)."""
    shifts: tuple[Array | None, ...]
    """(10, a) by phase: shift of the state parameters by the most likely error, and by the same error along each other axis; None without
    a response."""
    joint: bool = False
    """Whether only several channels together show the error, so that its cause cannot be identified."""
    unseen_shifts: tuple[Array | None, ...] = ()
    """Columns of ``shifts`` along axes where the log does not show such an error."""
    of_scale: bool = False
    """Whether it is the scale of one kind of actuators, to which the values are proportional."""

    @property
    def refuted(self) -> bool:
        """Whether the score exceeds the limit."""
        return self.sigmas > self.limit

    def largest_shift(self, phase: int) -> Array | None:
        """(10,) largest absolute shift of the state parameters of a phase; None without a response."""
        shifts = self.shifts[phase]
        largest: Array | None = None if shifts is None else np.abs(shifts).max(1, initial=0.0)
        return largest


def doubts(
    analysis: SensitivityAnalysis, names: Sequence[str], groups: Sequence[Sequence[int]] = (), actuator_kinds: Sequence[Sequence[int]] = ()
) -> list[Doubt]:
    """Assumptions in doubt, in descending order of their score; ``names`` are those of the command channels.

    Further tested directions are a common scale of each sensor's axes, of each of ``groups`` of channels, and of each of ``actuator_kinds``
    (jets next to momentum devices, or forces next to pure torques).
    """
    valid = [(response, power) for response, power in zip(analysis.responses, analysis.chi_squares, strict=True) if response is not None]
    if not valid:
        return []
    columns = [ACCELEROMETER] * 3 + [f"thrust of {name}" for name in names]
    codes, reported = [a.code for a in analysis.varied] + columns, [a.reported_code for a in analysis.varied] + columns
    unit, first = np.eye(len(codes)), len(codes) - len(names)
    scales = [[i for i, code in enumerate(reported) if code == name] for name in SCALES]
    together = [*actuator_kinds, *groups]
    directions = np.column_stack([unit, *(unit[:, g].sum(1) for g in (*scales, *([first + i for i in group] for group in together)))])
    joint_labels = [f"thrust of {', '.join(names[i] for i in group)}" for group in together]
    first_joint = len(codes) + len(SCALES) + len(actuator_kinds)
    labels, count = [*codes, *SCALES, *joint_labels], len(actuator_kinds)
    # all actuator kinds form one family: the error may be in either kind
    family = np.array([*reported, *SCALES, *[ACTUATOR_SCALE] * count, *joint_labels[count:]])
    gram = np.sum([response.gram for response, _ in valid], 0)
    score, information = gram[0, 1:].copy(), np.einsum("ei,ef,fi->i", directions, gram[1:, 1:], directions)
    # a scale error also scales the noise: remove the product of the innovations with themselves
    score[[*scales[0], *scales[1]]] -= np.sum([power * response.gram[0, 0] / power.sum() for response, power in valid], 0)
    # with less noise than stated that removes too much: keep the Cauchy-Schwarz bound
    bound = np.sqrt(gram[0, 0] * information)
    score = np.clip(score @ directions, -bound, bound)
    stated_sigmas = np.concatenate([[a.sigma for a in analysis.varied], np.zeros(len(labels) - len(analysis.varied))])
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.nan_to_num(np.abs(score) / information)
        sigmas = np.nan_to_num(errors / np.sqrt(max(analysis.scatter, 1.0) / information + stated_sigmas**2))
    largest = np.array([a.most for a in analysis.varied])
    sigmas[: len(largest)] *= information[: len(largest)] > largest**-2
    shifts = [None if response is None else response.shift @ directions for response in analysis.responses]
    limit = threshold(REFUTED, 2 * len(labels))  # two-sided

    def doubt(i: int) -> Doubt:
        relatives = family == family[i]
        unseen = relatives & (information * errors[i] ** 2 < IN_DOUBT**2)
        shown, hidden = (tuple(None if s is None else errors[i] * s[:, which] for s in shifts) for which in (relatives, unseen))
        return Doubt(labels[i], float(sigmas[i]), limit, shown, i >= first_joint, hidden, family[i] == ACTUATOR_SCALE)

    limits = np.array([IN_DOUBT_RARE if a.rare else IN_DOUBT for a in analysis.varied] + [IN_DOUBT] * (len(labels) - len(analysis.varied)))
    return [doubt(int(i)) for i in np.argsort(-sigmas, kind="stable") if sigmas[i] > limits[i]]


def assumption_contradiction(conclusion: Conclusion, phase: int, found: Sequence[Doubt]) -> Contradiction | None:
    """Contradiction by refuted assumptions, of the values of a phase that their most likely errors change; None without one."""
    refuted = [doubt for doubt in found if doubt.refuted]
    affected: BoolArray = np.zeros(len(QUANTITIES), dtype=bool)
    for _, change in _changes(conclusion, phase, refuted):
        affected |= change > MOVES * conclusion.sigmas
    if not affected.any():
        return None
    names = ", ".join(name for name, hit in zip(QUANTITIES, affected, strict=True) if hit)
    first = refuted[0]
    assumption = first.assumption.replace("-", " ")
    cause = Reason.of("assumption-contradicted", assumption=assumption, sigmas=first.sigmas, quantities=names)
    return Contradiction((cause,), affected)


def doubtful_values(conclusion: Conclusion, phase: int, found: Sequence[Doubt], sizes: Array, far: float = FAR) -> dict[str, Reason]:
    """Reasons, by quantity, against the verdict "converged": an assumption in doubt would change the value by more than ``far`` sigmas.

    ``sizes`` (10,) are the natural sizes.
    """
    reasons: dict[str, Reason] = {}
    sizes = sizes.copy()
    sizes[POSITIVE] = np.fmin(sizes[POSITIVE], np.abs(conclusion.values[POSITIVE]))
    for doubt, change in _changes(conclusion, phase, [doubt for doubt in found if not (doubt.refuted or doubt.joint)]):
        part = 0.0 if doubt.of_scale or doubt.sigmas > CONTRADICTION else PART
        least = np.maximum(far * conclusion.sigmas, part * sizes)
        for name, hit, by in zip(QUANTITIES, change > least, change / conclusion.sigmas, strict=True):
            if hit and name not in reasons:
                assumption = doubt.assumption.replace("-", " ")
                reasons[name] = Reason.of("assumption-in-doubt", sigmas=doubt.sigmas, assumption=assumption, quantity=name, moved=float(by))
    return reasons


def unseen_changes(conclusion: Conclusion, phase: int, found: Sequence[Doubt], sizes: Array) -> dict[str, Reason]:
    """:func:`doubtful_values` for refuted assumptions in the sigmas: the same error along an axis where the log does not show it."""
    refuted = [doubt for doubt in found if doubt.refuted and doubt.unseen_shifts]
    along_other_axes = [replace(doubt, shifts=doubt.unseen_shifts, limit=np.inf) for doubt in refuted]
    return doubtful_values(conclusion, phase, along_other_axes, sizes, MOVES)


def _changes(conclusion: Conclusion, phase: int, found: Sequence[Doubt]) -> Iterator[tuple[Doubt, Array]]:
    """Yield each assumption with (10,) the absolute change of the quantities; NaN without a mass."""
    mass = conclusion.estimates["mass"].value or np.nan
    for doubt in found:
        change = doubt.largest_shift(phase)
        if change is not None:
            change[9] *= mass**2  # from 1/m to m
            yield doubt, change
