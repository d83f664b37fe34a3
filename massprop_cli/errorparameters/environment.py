"""What the test environment may be otherwise than stated: bearing, gravity, torques, the table."""

from collections.abc import Callable, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.quaternion import quaternion_of, quaternion_product
from massprop_cli.errorparameters.parameter import ErrorParameter, Step, Unit, Wording, vector
from massprop_cli.errorparameters.sensor import DEGREE
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.inputs.equipment import PIVOTED

WALK = 1e-3
"""Of a steady torque, what a correction lets it change per cycle: over 1,000 cycles it wanders by 3 % of itself, so it stays steady."""
BALL_M = 0.005
"""One sigma of where a bearing's centre is: the ball is machined to a tenth of this; the offset of O from the drawing's datum is measured
by hand."""

LEVEL = ("east", "north")
"""Columns of the world's X and Y, as a gyro carries them."""
_BY_GRAVITY = "massprop reports the effect of one degree"


def _tilted(setup: Setup, error: Array) -> Setup:
    """The attitude at the start turned about the world's X and Y."""
    key = "environment.initial_attitude_wxyz"
    return setup.having(key, np.array(quaternion_product(quaternion_of(np.append(error, 0.0)), setup.value(key))))


def _on_bearing(setup: Setup) -> bool:
    return setup.vehicle.pivoted


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _stated(name: str, unit: str) -> Callable[[Setup], str]:
    def message(setup: Setup) -> str:
        environment = setup.vehicle.environment
        said = "stated" if name in environment.model_fields_set else "not stated; assumed"
        return f"environment.{name} is {said} as {getattr(environment, name):g} {unit}"

    return message


def _assumed(name: str, code: str, unit: Unit, what: str, usual: float, environments: tuple[str, ...]) -> ErrorParameter:
    """A number that scales what gravity does; an error is a part of it."""
    return ErrorParameter(
        name,
        code,
        what,
        "1",
        usual=usual,
        key=f"environment.{name}",
        no_sigma="its error is too small to change a value",
        lowest=0.0,
        scale=lambda vehicle: float(getattr(vehicle.environment, name)),
        environments=environments,
        difference=0.01,
        step=Step(
            code, 0.01, "1 %", _stated(name, unit), lambda setup: _on_bearing(setup) and getattr(setup.vehicle.environment, name) > 0
        ),
    )


PARAMETERS = (
    _assumed("bearing_mass_kg", "bearing-mass", "kg", "mass that translates with the vehicle and does not turn", 0.01, ("air_bearing",)),
    _assumed("gravity_m_s2", "gravity", "m/s²", "gravity", 0.003, PIVOTED),
    ErrorParameter(
        "bearing",
        "bearing-position",
        "position of the bearing's centre",
        "m",
        prior=BALL_M,
        usual=0.001,
        key="environment.bearing_position_m",
        no_sigma="its error moves the CG by as much: massprop reports the effect of 1 mm",
        size=3,
        environments=PIVOTED,
        difference=1e-4,
        wording=Wording("the bearing's centre is {mm} mm away from environment.bearing_position_m", "correct it"),
        step=Step(
            "bearing-position",
            1e-3,
            "1 mm along {axis}",
            lambda setup: (
                f"environment.bearing_position_m is {_listed(setup.vehicle.environment.bearing_position_m)} m; moved along {{axis}}"
            ),
            _on_bearing,
            most=BALL_M,  # the CG goes with it: what tells them apart is faint beside what noisy rates do to the vertical
        ),
    ),
    ErrorParameter(
        "tilt",
        "attitude-start",
        "tilt at the start about the world's X and Y",
        "rad",
        prior=0.1,  # what a ball's cup lets a vehicle lean, 6 degrees
        usual=0.2 * DEGREE,
        key="environment.initial_attitude_wxyz",
        no_sigma=_BY_GRAVITY,
        size=2,
        change=_tilted,
        columns=LEVEL,
        bends="with gravity",
        environments=PIVOTED,
        redone="motion",
        difference=0.1 * DEGREE,
        wording=Wording(
            "the vehicle starts tilted by {angle:.3g} degrees from environment.initial_attitude_wxyz", "correct it, or level the table"
        ),
        step=Step(
            "initial-attitude",
            DEGREE,
            "1 degree about the world's {axis}",
            lambda setup: (
                f"environment.initial_attitude_wxyz is {_listed(setup.vehicle.environment.initial_attitude_wxyz)}; "
                "tilted about the world's {axis}"
            ),
            lambda setup: _on_bearing(setup) and setup.log.attitude_wxyz is None,
            axes="XY",
        ),
    ),
    ErrorParameter(
        "room_torque",
        "room-torque",
        "steady torque in room axes",
        "N m",
        prior=1.0,  # as of a torque that turns with the vehicle
        key="environment.room_torque_n_m",
        no_sigma="massprop repeats a correction with it one sigma further",
        size=3,
        columns=LEVEL,
        environments=PIVOTED,
        redone="motion",
        difference=1e-3,
        wording=Wording(
            "a steady torque of {torque} N m in room axes acts in addition to the commands (a cable, a draught, a magnet)",
            "remove its cause, or state environment.room_torque_n_m",
            lambda finding: {"torque": vector(finding.corrected.value("environment.room_torque_n_m"))},
        ),
        step=Step(
            "room-torque",
            1e-3,
            "1 mN m about the room's {axis}",
            lambda setup: (
                f"environment.room_torque_n_m is {_listed(setup.vehicle.environment.room_torque_n_m)} N m; more about the room's {{axis}}"
            ),
            _on_bearing,
            rare=True,
        ),
    ),
    ErrorParameter(
        "torque",
        "steady-torque",
        "steady torque",
        "N m",
        prior=1.0,  # any: as large as what the jets of a large vehicle give
        no_key="no key: its size is not stated but estimated",
        sigma_key="environment.disturbance_walk_n_m",
        size=3,
        states="size",
        part=lambda _: WALK,
        wording=Wording(
            "a steady torque of {error} N m in body axes acts in addition to the commands",
            "remove its cause, or state environment.disturbance_walk_n_m",
        ),
    ),
    ErrorParameter(
        "drag",
        "rate-torque",
        "torque proportional to the rate",
        "N m s",
        prior=1.0,  # any: a body of 1 kg m² would stop within a second
        no_key="no key: it is estimated where its sigma is stated",
        sigma_key="environment.damping_sigma_n_m_s",
        size=3,
        states="size",
        columns=("rates",),
        estimated=True,
        uncertain=("damping", "the estimate includes a torque against the rate: {damping} N m s times the rate"),
        wording=Wording(
            "a torque of {error} N m s times the rate acts in addition to the commands (drag, or a cable)",
            "state environment.damping_sigma_n_m_s",
        ),
    ),
    ErrorParameter(
        "slope",
        "table-tilt",
        "tilt of a planar table, times gravity",
        "m/s²",
        no_key="no key: it is estimated with its stated sigma",
        sigma_key="environment.table_tilt_sigma_rad",
        size=2,
        scale=lambda vehicle: 1 / g if (g := vehicle.environment.gravity_m_s2) else np.inf,
        columns=("slope 0", "slope 1"),
        estimated=True,
        environments=("planar",),
    ),
)
