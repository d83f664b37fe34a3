"""How the body may change, and what spins in it."""

from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters.parameter import ErrorParameter, FittedHypothesis, SpecialCase, Step, Wording
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.actuators.actuator import called

LIKELY = 0.2
"""Part by which stored momentum may be off: where nothing but momentum turns the vehicle, inertia is proportional to it, and what a log
tells of it, 50 % at best, isn't linear."""
GROWN = 1.0
"""Percent by which mass or inertia may seem to grow by chance: what thrust is repeatable to."""


def _rates(finding: FittedHypothesis) -> Mapping[str, object]:
    return {name: 100 * finding.mean(f"{name}_rate") for name in ("mass", "inertia")}


def _walked(finding: FittedHypothesis) -> float:
    """kg/√s of a random walk over relative change: over the log it may change the mass by as much."""
    return 1 / (finding.inverse_mass * float(np.sqrt(float(np.ptp(finding.stated.log.time_s)) or 1.0)))


def _heavier(setup: Setup, error: Array) -> Setup:
    heavier = {kind.TABLE: tuple(one.scaled(1 + float(error[0])) for one in own) for kind, own in setup.vehicle.actuators}
    return setup._replace(vehicle=setup.vehicle.model_copy(update=heavier))


def _spin(setup: Setup) -> str:
    devices = setup.vehicle.spinning
    uncertain = any(unknown.scales for device in devices for unknown in device.unknowns)
    words = "every sigma includes its uncertainty" if uncertain else "the vehicle file states no uncertainty of it"
    return f"inertia scales with the spin inertia or momentum that the vehicle file states for its {called(devices)}; {words}"


_CHANGES = "the mass changes by {mass:+.3g} % and the inertia by {inertia:+.3g} % from the first to the last cycle"
_NO_KEY = "no key: [drift] allows a change, and nothing states its size"
PARAMETERS = (
    ErrorParameter(
        "mass_rate",
        "fuel-use",
        "change of the mass over the log",
        "parts",
        prior=0.3,  # a tank is a third of a small vehicle
        usual=0.05,
        no_key=_NO_KEY,
        sigma_key="drift.mass",
        states="size",
        part=_walked,
        columns=("aging",),
        wording=Wording(_CHANGES, "state [drift]", _rates),
    ),
    ErrorParameter(
        "inertia_rate",
        "fuel-use",
        "change of the inertia over the log",
        "parts",
        prior=0.3,  # as of the mass that makes it
        no_key=_NO_KEY,
        no_sigma="drift.mass allows for both",
        columns=("aging",),
        wording=Wording(_CHANGES, "state [drift]", _rates),
    ),
    ErrorParameter(
        "spin_inertia",
        "wheel-inertia",
        "spin inertia or momentum of wheels, rotors and gyros",
        "1",
        usual=0.01,
        key="wheels.spin_inertia_kg_m2",
        sigma_key="wheels.spin_inertia_sigma_kg_m2",
        change=_heavier,
        redone="all",
        difference=0.01,
        step=Step("wheel-inertia", 0.01, "1 %", _spin, lambda setup: bool(setup.vehicle.spinning), most=LIKELY),
    ),
)
SPECIAL_CASES = (
    # no fuel is won
    SpecialCase(
        "fuel-use",
        Wording(
            f"{_CHANGES}; more likely the thrust falls, like the pressure of a tank that empties",
            "regulate the pressure, state thrust.nominal_pa and log supply_pa, or use less of the log",
            _rates,
        ),
        lambda finding: max(map(float, _rates(finding).values())) > GROWN,  # type: ignore[arg-type]
    ),
)
