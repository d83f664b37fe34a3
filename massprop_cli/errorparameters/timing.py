"""When commands act, and by which clock."""

from functools import partial

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters.parameter import ErrorParameter, FittedHypothesis, SpecialCase, Step, Wording
from massprop_cli.errorparameters.setup import DELAY, LAG, Setup
from massprop_cli.inputs.equipment import FASTEST_PPM

LATER = ("later", "lagging", "smeared")
"""Columns of what comes later."""
EARLIEST = 0.5
"""Cycles below zero that a first, linear step may lead to: half the grid on which motion and commands are compared."""
DIFFERENCE = 0.02
"""Cycles behind derivatives: far above rounding, and commands that move so little change cycle means linearly."""
DELAY_STEP = 0.1
"""Cycles that the assumption of a delay is shown for."""
LATENESS = partial(
    ErrorParameter,
    unit="cycles",
    lowest=0.0,
    slack=EARLIEST,
    states="sigma",
    columns=LATER,
    bends="always",
    late=True,
    redone="commands",
    difference=DIFFERENCE,
)
"""Something by which motion comes late after the commands, or its sensor shows it late."""
CHANCE = 3.0
"""Sigmas within which a drift is none."""


def _drifting(setup: Setup, error: Array) -> Setup:
    """The clocks agree where the log begins, so the delay of the stretch is that of its own less what has run up before."""
    faster_ppm = 1e6 * float(error[0]) * setup.period_s / setup.clock_s[1]
    began = 1e-6 * faster_ppm * setup.clock_s[0] / setup.period_s
    changed = setup.having("imu.clock_drift_ppm", setup.value("imu.clock_drift_ppm") + faster_ppm)
    return changed.having(DELAY, changed.value(DELAY) - began)


def _steady(finding: FittedHypothesis) -> bool:
    """Whether clocks that are supposed to drift hardly do: what the log shows is their delay."""
    return bool((np.abs(finding.errors["drift"]) <= CHANCE * finding.sigmas["drift"]).all())


def _lagging(setup: Setup, error: Array) -> Setup:
    """In cycles, as the timing has it, or rotors of their own."""
    return setup.having(LAG, setup.value(LAG) + setup.period_s * error)


def _assumed(setup: Setup) -> str:
    cycle = setup.vehicle.cycle
    exact = "assumed exact (cycle.command_delay_sigma_cycles is not stated)"
    words = "every sigma includes its uncertainty" if cycle.command_delay_sigma_cycles > 0 else exact
    said = "" if "command_delay_cycles" in cycle.model_fields_set else " (not stated, the default)"
    return f"the command delay is {setup.timing.delay:.6g} cycles{said}; {words}"


_DRIFT = ErrorParameter(
    "drift",
    "clock-drift",
    "drift of the IMU's clock against that of the commands",
    "cycles",
    prior=2.0,  # over the stretch: 100 ppm, of two cheap oscillators, over 1,000 s at 20 Hz
    key="imu.clock_drift_ppm",
    no_sigma="the log gives it to parts per million, too precise to change a value",
    lowest=-FASTEST_PPM,
    highest=FASTEST_PPM,
    change=_drifting,
    columns=("drifting",),
    bends="always",
    late=True,
    redone="commands",
    wording=Wording("the IMU's clock runs {value:.4g} ppm faster than that of the commands", "use one clock, or state imu.clock_drift_ppm"),
)
_DELAY = LATENESS(
    "delay",
    "delay-mismatch",
    "delay from command to execution",
    prior=1.0,  # whether a command acts in the cycle that issues it or in the next
    usual=0.1,
    key=DELAY,
    sigma_key="cycle.command_delay_sigma_cycles",
    wording=Wording(
        "the command delay is {value:.4g} ± {sigma:.2g} cycles, not cycle.command_delay_cycles = {stated:g}",
        'correct it, or state "auto" to estimate it',
    ),
    step=Step("command-delay", DELAY_STEP, f"{DELAY_STEP:g} cycles", _assumed),
)
PARAMETERS = (
    _DRIFT,
    _DELAY,
    LATENESS(
        "lag",
        "thrust-lag",
        "first-order lag of thrust or wrench",
        prior=0.5,  # valves and motors answer within a cycle, or the loop would not hold
        usual=0.1,
        key=LAG,
        sigma_key="thrust.lag_sigma_s",
        scale=lambda vehicle: vehicle.cycle.period_s,
        change=_lagging,
        wording=Wording("thrust follows commands with a lag of {value:.4g} ± {sigma:.2g} s", "state thrust.lag_s"),
    ),
)
SPECIAL_CASES = (
    SpecialCase("clock-drift", Wording(_DELAY.wording.sentence, _DELAY.wording.remedy, _DELAY.facts), _steady, "delay-mismatch"),
)
