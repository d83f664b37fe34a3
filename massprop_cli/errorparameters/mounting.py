"""Where the IMU sits, and how it and each of its sensors is turned."""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.rigidbody import rotation
from massprop_cli.errorparameters.environment import LEVEL
from massprop_cli.errorparameters.parameter import ErrorParameter, FittedHypothesis, SpecialCase, Step, Wording, matrix
from massprop_cli.errorparameters.sensor import DEGREE, WORDS
from massprop_cli.errorparameters.setup import Setup

TURN = float(np.radians(0.1))
"""rad; the difference behind the derivative: its square is below what a log tells, and it is far above rounding."""
_TURNED = "no key for one sensor: the remedy is a calibration, or another axis under [columns]"


def _rotated(setup: Setup, error: Array) -> Setup:
    return setup.having("imu.body_from_imu", rotation(error) @ np.array(setup.vehicle.imu.body_from_imu))


def _seen_turned(error: Array, mounting: Array) -> Array:
    """(3, 3) what sensors show, IMU axes, whose axes are turned in the body's."""
    return mounting.T @ rotation(error) @ mounting


def _stated_place(setup: Setup) -> str:
    imu = setup.vehicle.imu
    stated = "stated as" if "position_m" in imu.model_fields_set else "not stated; assumed as"
    return f"imu.position_m is {stated} {', '.join(f'{value:g}' for value in imu.position_m)} m; moved along {{axis}}"


def _stated_turn(setup: Setup) -> str:
    known = "body_from_imu" in setup.vehicle.imu.model_fields_set
    words = "as stated" if known else "not stated: IMU axes are assumed to be body axes"
    return f"imu.body_from_imu is {words}; turned about {{axis}}"


def _turn(sensor: Literal["gyro", "accel"]) -> ErrorParameter:
    return ErrorParameter(
        f"{sensor}_turn",
        "imu-mounting",
        f"rotation of only the {WORDS[sensor]}'s axes",
        "rad",
        prior=0.3,  # as of the whole IMU
        usual=DEGREE if sensor == "accel" else 0.0,  # of both, and of one: they span the other
        difference=TURN if sensor == "accel" else 0.0,
        no_key=_TURNED,
        no_sigma=_TURNED,
        size=3,
        sensor=sensor,
        shown=_seen_turned,
        columns=LEVEL if sensor == "gyro" else (),
        bends="with gravity" if sensor == "gyro" else "never",
        redone="motion",
        wording=Wording(f"only the {WORDS[sensor]}'s axes are tilted, by {{angle:.3g}} degrees", f"calibrate the {WORDS[sensor]}"),
    )


def _from_stated(finding: FittedHypothesis) -> Mapping[str, object]:
    true = np.array(finding.corrected.vehicle.imu.body_from_imu)
    away = np.degrees(np.arccos(np.clip((np.trace(true.T @ finding.mounting) - 1) / 2, -1, 1)))
    words = f"{finding.subject[0]}, " if finding.subject else ""
    return {"words": words, "rows": matrix(true), "away": away}


def _alone(finding: FittedHypothesis) -> Mapping[str, object]:
    sensor = next(word for word in WORDS.values() if word in finding.subject)
    read = finding.turns[sensor != "gyro"]
    return {"sensor": sensor, "rows": matrix(finding.mounting.T @ read @ finding.mounting), "handed": _handed(read)}


def _mirrored(finding: FittedHypothesis) -> Mapping[str, object]:
    return {"rows": matrix(finding.turns[0].T @ finding.mounting), "handed": _handed(finding.turns[0])}


def _handed(turn: Array) -> str:
    return ", left-handed" if np.linalg.det(turn) < 0 else ""


PARAMETERS = (
    ErrorParameter(
        "imu",
        "imu-position",
        "position of the IMU",
        "m",
        prior=0.05,  # the size of an IMU: stated to its corner instead of its sensing centre
        usual=0.01,
        key="imu.position_m",
        sigma_key="imu.position_sigma_m",
        size=3,
        states="size",
        difference=1e-3,
        uncertain=("imu-position", "the position of the IMU is as stated, within imu.position_sigma_m"),
        wording=Wording(
            "the IMU sits {mm} mm away from imu.position_m",
            "correct it; or, if actuators were measured from another point, correct their positions, and the CG moves with them",
        ),
        step=Step("imu-position", 1e-3, "1 mm along {axis}", _stated_place, lambda setup: any(setup.log.axes[3:])),
    ),
    _turn("gyro"),
    _turn("accel"),
    ErrorParameter(
        "mounting",
        "imu-mounting",
        "rotation of the whole IMU",
        "rad",
        prior=0.3,  # beyond 17 degrees it is a right angle, which is tried by itself
        usual=DEGREE,
        key="imu.body_from_imu",
        sigma_key="imu.mounting_sigma_rad",
        size=3,
        states="size",
        entries=("gyro_turn", "accel_turn"),
        change=_rotated,
        shown=_seen_turned,
        redone="motion",
        difference=TURN,
        uncertain=("imu-mounting", "the mounting of the IMU is as stated, within imu.mounting_sigma_rad"),
        wording=Wording(
            "imu.body_from_imu is {words}{rows}, {away:.3g} degrees away from the stated one", "check the IMU's mounting", _from_stated
        ),
        step=Step("imu-mounting", DEGREE, "1 degree about {axis}", _stated_turn, most=1.0),
    ),
)
SPECIAL_CASES = (
    SpecialCase(
        "imu-mounting",
        Wording("only the {sensor}'s axes differ from the stated ones, by {rows}{handed}", "correct its columns under [columns]", _alone),
        lambda f: not set(WORDS.values()).isdisjoint(f.subject) and not any(f.errors[f"{sensor}_turn"].any() for sensor in WORDS),
    ),
    SpecialCase(
        "imu-mounting",
        Wording("the IMU's axes in body axes are {rows}{handed}", "correct its columns under [columns]", _mirrored),
        lambda f: set(WORDS.values()).isdisjoint(f.subject) and bool(np.linalg.det(f.turns[0]) < 0),
    ),
)
