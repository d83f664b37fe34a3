"""Reasons of verdicts and causes of contradictions: a code, its data, and the sentence that reports print.

The code compares codes only. :func:`str` makes the sentence.
"""

from typing import Literal, Self

from massprop_cli.base.dataclass import dataclass

VerdictReason = Literal[
    "no-part",
    "unweighed",
    "unweighed-pedestal",
    "ratios-only",
    "no-motion-informs",
    "sensor-absent",
    "sensor-absent-mass",
    "estimate-ended",
    "hardly-informed",
    "drowned",
    "precise",
    "unsteady",
    "steady",
    "contradiction",
    "assumption-in-doubt",
    "cause-unknown",
    "timing-untold",
    "wrench-point-untold",
    "scale-untold",
    "changed",
    "within-discrepancy",
    "discrepancy",
    "noise-correlated",
    "noise-heavy-tailed",
    "oscillation",
    "commands-lost",
    "phases-converged",
    "phases-not-converged",
    "phases-contradicted",
    "docked-lighter",
    "docked-faint",
    "no-docked-object",
    "sides-converged",
    "sides-not-converged",
    "sides-untold",
    "sides-contradicted",
    "logs-unobservable",
    "logs-not-excited",
    "logs-converged",
    "logs-not-converged",
    "logs-contradicted",
    "object-contradicted",
]
"""Reason codes of a quantity's verdict."""
Cause = Literal[
    "named-fault",
    "known-mismatch",
    "unexplained",
    "beyond-commands",
    "innovations-too-large",
    "residuals-follow",
    "assumption-contradicted",
    "causal-estimate-lost",
    "fit-lost",
    "no-body",
]
"""Cause codes of a contradiction between log and vehicle file."""
Code = VerdictReason | Cause
REPORTED: tuple[Code, ...] = ("named-fault", "known-mismatch", "unexplained", "beyond-commands")
"""Causes that already are warnings."""
NOT_WHITE: tuple[Code, ...] = ("noise-correlated", "noise-heavy-tailed", "commands-lost")
"""Reasons of quantities whose residuals are not white noise."""
MANY = 100.0
"""Largest number of sigmas that is printed; beyond it the sigmas are too small for the number to mean anything."""
HARDLY_INFORMED = "the motion in this phase gives too little information on it"

_LOOK_FOR = (
    "check for a flexible or sloshing part, lost commands, bumps, a torque that is not stated, a sensor whose resolution is coarser than "
    "its noise"
)
_NOT_NOISE = "its sigma assumes white noise, and the residuals are not white"
SENTENCES: dict[Code, str] = {
    "no-part": "it does not affect the motion of a vehicle that slides and yaws on a table",
    "unweighed": (
        "gravity torque gives only mass × offset from the bearing; weigh the vehicle and state known.mass, or push it along the table"
    ),
    "unweighed-pedestal": "gravity torque gives only mass × offset from the pivot; weigh the vehicle and state known.mass",
    "ratios-only": (
        "no command acted, and a free swing gives only the ratio of first moment to inertia; state the inertia (known.ixx, known.iyy and "
        "known.izz), or command torques"
    ),
    "no-motion-informs": "no motion of this vehicle makes it observable: it needs {wants}, which the commands cannot give",
    "sensor-absent": "it is not observable without the {absent}, which the log lacks; log the {absent}",
    "sensor-absent-mass": (
        "the mass is not observable without the {absent}, which the log lacks; log the {absent}, or weigh the vehicle and state known.mass"
    ),
    "estimate-ended": (
        "the filter gave an estimate until {until_s:.6g} s and none after: its equations became ill-conditioned; check units and noise "
        "levels"
    ),
    "hardly-informed": f"{HARDLY_INFORMED}; it needs {{wants}}",
    "drowned": "{share:.0%} of the information on it comes from channels in which disturbances exceed the commands",
    "precise": "informed: its sigma is below a tenth of the tolerance, after {steady} of {count} steady updates",
    "unsteady": "only {steady} of {count} steady updates: before these it moved by more than the tolerance, or was not informed",
    "steady": "informed, and within tolerance for the required number of updates",
    "contradiction": "the log contradicts the vehicle file: {cause}",
    "assumption-in-doubt": (
        "another {assumption} would fit the log better by {sigmas:.2g} sigma, which may be chance, and would move {quantity} by "
        "{moved:.2g} of its sigmas; check it, or record more of this motion"
    ),
    "cause-unknown": (
        "the vehicle file does not explain the log and no cause was found, so its sigma does not include the error; start from the nearest "
        "hypothesis in the warning cause-unknown"
    ),
    "timing-untold": "the log does not show when commands act ({taken}, the most likely value, was assumed); state it",
    "wrench-point-untold": (
        "the CG is at O if commanded torques are about O, and is unknown if they are about the CG; state thrust.wrench_point_m"
    ),
    "scale-untold": (
        "the largest value of every command is 1, so commands may be normalised, and the log does not show their scale; state the scale of "
        "each under [columns], or thrust.wrench_limits if 1 is a limit"
    ),
    "changed": (
        "{quantity} differs before {at_s:.6g} s ({before:.4g}) and after it ({after:.4g}) by {sigmas:.2g} sigma: was the IMU or ballast "
        "changed? Split the log there ([[phases]])"
    ),
    "within-discrepancy": (
        "informed and steady; its sigma with model error is {percent:.2g} % of its natural size, within the tolerance; largest part: {main}"
    ),
    "discrepancy": (
        "the vehicle file does not explain the log; its sigma with model error is {percent:.2g} % of its natural size, beyond the "
        "tolerance; largest part: {main}"
    ),
    "noise-correlated": (
        f"{_NOT_NOISE}: the residual of the {{sensor}} is correlated from cycle to cycle (autocorrelation up to {{correlation:.2g}}, at "
        f"lag {{lag}}); {_LOOK_FOR}"
    ),
    "noise-heavy-tailed": (
        f"{_NOT_NOISE}: the residual of the {{sensor}} has outliers (its kurtosis is {{kurtosis:.3g}} above that of noise); {_LOOK_FOR}"
    ),
    "oscillation": (
        "after each push the body's {motion} oscillates, with a period of about {period_s:.2g} s ({sigmas:.2g} sigma): values are too "
        "small by up to the part that oscillates; check for sloshing fuel, a flexible or loose part, thrust that decays slowly"
    ),
    "commands-lost": (
        f"{_NOT_NOISE}: some commands were probably not executed, and it is too large by the part that was lost; check for lost packets, "
        "inhibited jets, pulses too short to open a valve"
    ),
    "phases-converged": "both phases converged",
    "phases-not-converged": "not every quantity of both phases converged",
    "phases-contradicted": "the log contradicts the vehicle file in {phases}",
    "docked-lighter": "the docked object's mass is {mass:.4g} kg: {after} weighs less than {before}; {remedy}",
    "docked-faint": "the docked object's mass is {mass:.4g} ± {sigma:.2g} kg, so there may be no object; weigh it",
    "no-docked-object": "no docked object",
    "sides-converged": "both sides converged",
    "sides-not-converged": "not every quantity of both sides converged",
    "sides-untold": "the object is the difference of both sides, and not all ten quantities of both are estimated",
    "sides-contradicted": "a side is contradicted",
    "logs-unobservable": "no motion of this vehicle makes it observable in any of the logs",
    "logs-not-excited": "the motion of no log gives enough information on it, nor do all logs together",
    "logs-converged": "{converged} of {logs} logs converged; its joint sigma is {percent:.2g} % of its natural size",
    "logs-not-converged": "informed, but it converged in no log, and its joint sigma is above a quarter of the tolerance",
    "logs-contradicted": "contradicted in {logs}, or by the other logs",
    "object-contradicted": "the object that --added states does not fit the logs",
    "named-fault": "{message}",
    "known-mismatch": "{message}",
    "unexplained": "{message}",
    "beyond-commands": "{message}",
    "innovations-too-large": "innovations are {ratio:.3g} times as large as all estimated noise explains: the model is wrong",
    "residuals-follow": (
        "residuals follow the commands or the motion, so the sigmas are not valid ({quantities}; {worst} may be off by {sigmas:.2g} "
        "sigma); check delay, rise, lag and jets, the mounting and position of the IMU, low-passes, and torques that are not stated"
    ),
    "assumption-contradicted": (
        "the log contradicts an assumption: another {assumption} would fit better by {sigmas:.2g} sigma, and would move {quantities} by "
        "more than their sigmas"
    ),
    "causal-estimate-lost": (
        "the causal estimate diverged: its {worst} is {sigmas:.3g} sigmas from the fit of the whole phase, which --refine reports"
    ),
    "fit-lost": "the fit of the whole phase failed, so these values are not tested; check units of IMU and commands, and noise levels",
    "no-body": "{breach}: no real body has this",
}
"""Sentence of each code; names in braces are keys of its data. ``Literal`` types repeat the codes so that mypy checks each use."""


@dataclass(frozen=True)
class Reason:
    """A code of :data:`SENTENCES` with its data."""

    code: Code
    data: tuple[tuple[str, str | float], ...] = ()

    @classmethod
    def of(cls, code: Code, **data: str | float) -> Self:
        """Make a reason from a code and keyword data."""
        return cls(code, tuple(data.items()))

    def __str__(self) -> str:
        """Return the sentence."""
        return SENTENCES[self.code].format_map({name: _Sigmas(value) if name == "sigmas" else value for name, value in self.data})


class _Sigmas(float):
    """Number of sigmas; prints "more than 100" beyond :data:`MANY`."""

    def __format__(self, spec: str) -> str:
        return float.__format__(self, spec) if self < MANY else f"more than {MANY:g}"


def sigmas(count: float) -> str:
    """Number of sigmas as text."""
    return f"{_Sigmas(count):.2g}"
