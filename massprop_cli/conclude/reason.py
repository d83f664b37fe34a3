"""Why a verdict is as it is: a code with its data, and the one catalogue of the sentences that are printed.

Logic compares codes alone; :func:`str` makes the sentence where a result is written.
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
"""Of one quantity's verdict."""
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
"""Of a contradiction between log and vehicle file."""
Code = VerdictReason | Cause
REPORTED: tuple[Code, ...] = ("named-fault", "known-mismatch", "unexplained", "beyond-commands")
"""Causes that are warnings by themselves."""
NOT_WHITE: tuple[Code, ...] = ("noise-correlated", "noise-heavy-tailed", "commands-lost")
"""Reasons by which a disturbance stands for what is not noise."""
MANY = 100.0
"""Sigmas beyond which a number of them says nothing more: by then they are too small."""
HARDLY_INFORMED = "the motion in this phase hardly informed it"

_LOOK_FOR = (
    "look for a flexible or sloshing part, commands that were not executed, bumps, a torque that is not stated, a sensor that counts in "
    "steps of more than its noise"
)
_NOT_NOISE = "its sigma treats as noise what is not noise"
SENTENCES: dict[Code, str] = {
    "no-part": "it has no part in the motion of a vehicle that slides and yaws on a table",
    "unweighed": (
        "the gravity torque gives only the mass times the offset from the bearing; weigh the vehicle and state known.mass, or push it "
        "along the table"
    ),
    "unweighed-pedestal": "gravity torque gives only mass × offset from the pivot; weigh the vehicle and state known.mass",
    "ratios-only": (
        "no command acted, and a free swing gives only ratios of first moment and inertia; state the inertia (known.ixx, known.iyy and "
        "known.izz), or command torques"
    ),
    "no-motion-informs": "no motion of this vehicle can inform it by this method; it wants {wants}, which its commands don't give",
    "sensor-absent": "the log has no {absent}, and without it no motion of this vehicle informs it; log the {absent}",
    "sensor-absent-mass": (
        "the log has no {absent}, and without it no motion of this vehicle informs the mass; log the {absent}, or weigh the vehicle and "
        "state known.mass"
    ),
    "estimate-ended": (
        "an estimate stood until {until_s:.6g} s and none after: its numbers came too far apart; check units and noise levels"
    ),
    "hardly-informed": f"{HARDLY_INFORMED}; it wants {{wants}}",
    "drowned": "{share:.0%} of the information on it lies in channels that disturbances dominate, not the commands",
    "precise": "informed, and its sigma is below a tenth of the tolerance, though only {steady} of {count} steady updates came",
    "unsteady": "{steady} of {count} steady updates: before these it moved more than the tolerance, or was not informed yet",
    "steady": "informed, and within tolerance for the required number of updates",
    "contradiction": "log and vehicle file contradict each other: {cause}",
    "assumption-in-doubt": (
        "the log would fit better by {sigmas:.2g} sigma, which may be chance, with another {assumption}, and {quantity} would move by "
        "{moved:.2g} of its sigmas: check that, or record more of this motion"
    ),
    "cause-unknown": (
        "log and vehicle file don't fit and the cause is unknown, so its sigma leaves out what the cause may do to it; look at what came "
        "nearest in the warning cause-unknown"
    ),
    "timing-untold": "the log cannot show when its commands act ({taken} was taken as the most likely); state it",
    "wrench-point-untold": (
        "the CG is at O if commanded torques are about O, and may be anywhere if they are about the CG; state thrust.wrench_point_m"
    ),
    "scale-untold": (
        "the largest value of every command is 1, so they may be normalised, and the log fits with any scale of them; state the scale of "
        "each under [columns], or thrust.wrench_limits if 1 is a limit"
    ),
    "changed": (
        "what the log says of {quantity} before {at_s:.6g} s ({before:.4g}) and after it ({after:.4g}) is apart by {sigmas:.2g} sigma: has "
        "the IMU been changed, or ballast? Split the log there ([[phases]])"
    ),
    "within-discrepancy": (
        "informed and steady, and ± {percent:.2g} % of its natural size with all that log and vehicle file don't explain of one another; "
        "most of it: {main}"
    ),
    "discrepancy": (
        "log and vehicle file don't explain one another, and it is ± {percent:.2g} % of its natural size with that, beyond the tolerance; "
        "most of it: {main}"
    ),
    "noise-correlated": (
        f"{_NOT_NOISE}: the residual of the {{sensor}} is correlated from cycle to cycle (autocorrelation up to {{correlation:.2g}}, at "
        f"lag {{lag}}); {_LOOK_FOR}"
    ),
    "noise-heavy-tailed": (
        f"{_NOT_NOISE}: the residual of the {{sensor}} stands in a few cycles (its kurtosis is {{kurtosis:.3g}} beyond that of noise); "
        f"{_LOOK_FOR}"
    ),
    "oscillation": (
        "after each push the body's {motion} swings on, about once in {period_s:.2g} s ({sigmas:.2g} sigma): the body seems lighter than "
        "it is, by up to the part that swings; look for sloshing fuel, a flexible or loose part, thrust that trails off"
    ),
    "commands-lost": (
        f"{_NOT_NOISE}: some of the commands seem not to have been executed, and it would be too large by the part that was lost; look for "
        "lost packets, inhibited jets, pulses too short to open a valve"
    ),
    "phases-converged": "both phases converged",
    "phases-not-converged": "not every quantity of both phases converged",
    "phases-contradicted": "log and vehicle file contradict each other in {phases}",
    "docked-lighter": "the docked object's mass is {mass:.4g} kg: {after} weighs less than {before}; {remedy}",
    "docked-faint": "the docked object's mass is {mass:.4g} ± {sigma:.2g} kg, which may be none; weigh it",
    "no-docked-object": "no docked object",
    "sides-converged": "both sides converged",
    "sides-not-converged": "not every quantity of both sides converged",
    "sides-untold": "the object is what both sides differ by, and not all ten quantities of both are told",
    "sides-contradicted": "a side is contradicted",
    "logs-unobservable": "no motion of this vehicle could inform it in any of the logs",
    "logs-not-excited": "no log's motion informed it, nor do all together",
    "logs-converged": "{converged} of {logs} logs converged; together ± {percent:.2g} % of its natural size",
    "logs-not-converged": "informed, but converged in no log, and together above a quarter of the tolerance",
    "logs-contradicted": "contradicted by or in {logs}",
    "object-contradicted": "the object that --added states does not fit the logs",
    "named-fault": "{message}",
    "known-mismatch": "{message}",
    "unexplained": "{message}",
    "beyond-commands": "{message}",
    "innovations-too-large": "innovations are {ratio:.3g} times as large as all noise that was sized makes them: the model does not hold",
    "residuals-follow": (
        "the residuals still follow the commands or the motion, so they are no noise and the sigmas are not valid ({quantities}; {worst} "
        "may be off by {sigmas:.2g} sigma); look for a wrong delay, rise, lag, jet, mounting or position of the IMU, a low-pass, a torque "
        "that is not stated"
    ),
    "assumption-contradicted": (
        "the log contradicts an assumption: with another {assumption} it would fit better by {sigmas:.2g} sigma, and {quantities} would "
        "move by more than their sigmas"
    ),
    "causal-estimate-lost": (
        "the causal estimate lost its way on this log: its {worst} lies {sigmas:.3g} sigmas from that of the fit of the whole phase, which "
        "--refine gives"
    ),
    "fit-lost": "no fit of the whole phase stands, so nothing tests these values; check units of IMU and commands, and noise levels",
    "no-body": "{breach}: no body has it",
}
"""Of each code, with its data in braces."""


@dataclass(frozen=True)
class Reason:
    """A code of :data:`SENTENCES` with what its sentence names."""

    code: Code
    data: tuple[tuple[str, str | float], ...] = ()

    @classmethod
    def of(cls, code: Code, **data: str | float) -> Self:
        """With its data by name."""
        return cls(code, tuple(data.items()))

    def __str__(self) -> str:
        """The sentence."""
        return SENTENCES[self.code].format_map({name: _Sigmas(value) if name == "sigmas" else value for name, value in self.data})


class _Sigmas(float):
    """How many, as far as anybody believes them."""

    def __format__(self, spec: str) -> str:
        return float.__format__(self, spec) if self < MANY else f"more than {MANY:g}"


def sigmas(count: float) -> str:
    """In words."""
    return f"{_Sigmas(count):.2g}"
