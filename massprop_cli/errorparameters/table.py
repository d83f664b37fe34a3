"""All error parameters, and what is asked of them together."""

from collections.abc import Sequence

from massprop_cli.errorparameters import body, environment, mounting, sensor, thrust, timing
from massprop_cli.errorparameters.parameter import ErrorParameter, FittedHypothesis

SPECIAL_CASES = (*timing.SPECIAL_CASES, *thrust.SPECIAL_CASES, *sensor.SPECIAL_CASES, *mounting.SPECIAL_CASES, *body.SPECIAL_CASES)
ENTRIES = (
    *("gyro_turn", "accel_turn", "gyro_scale", "accel_scale", "imu", "bearing", "gyro_bias", "accel_bias", "torque", "drag"),
    *("delay", "rise", "fall", "droop", "cycle_droop", "lag", "gyro_lag", "accel_lag", "drift", "mass_rate", "inertia_rate"),
    *("tilt", "slope", "room_torque", "thrust", "position", "direction"),
)
"""Parameters that are entries of x, in the order that massprop_cli/kernel/hypothesis.c has them."""


def checked(parameters: Sequence[ErrorParameter]) -> tuple[ErrorParameter, ...]:
    """The parameters; :class:`ValueError` if one is declared twice, or an entry of x or what a parameter is made of not at all."""
    names = [one.name for one in parameters]
    twice = sorted({name for name in names if names.count(name) > 1})
    missing = sorted({*ENTRIES, *(part for one in parameters for part in one.moved)} - set(names))
    if twice or missing:
        raise ValueError(f"error parameters declared twice: {twice}; not declared: {missing}")
    return tuple(parameters)


TABLE = checked(
    (*(*mounting.PARAMETERS, *timing.PARAMETERS, *thrust.PARAMETERS), *(*sensor.PARAMETERS, *body.PARAMETERS, *environment.PARAMETERS))
)
"""In the order in which corrections apply them and assumptions are listed."""
FAMILY = {
    one.name: module.__name__.rpartition(".")[2]
    for module in (mounting, timing, thrust, sensor, body, environment)
    for one in module.PARAMETERS
}
"""In which module each is declared."""
BY_NAME = {one.name: one for one in TABLE}
PRIORS = {name: BY_NAME[name].prior for name in ENTRIES if BY_NAME[name].prior > 0}
SIGMA_KEYS = {one.key: one.sigma_key for one in TABLE if one.key and one.sigma_key}
"""By the key of the value."""
LATE = frozenset(one.code for one in TABLE if one.late)
"""Codes of what makes motion late."""
BY_COLUMN = {
    column: {one.name for one in TABLE if column in one.columns} for column in dict.fromkeys(name for one in TABLE for name in one.columns)
}
"""The parameters that each column of the log's regression is there for."""
CODES = frozenset({*(one.code for one in TABLE if one.prior > 0), *(case.code or case.of for case in SPECIAL_CASES)})
"""Of all warnings that name an error."""


def words_of(code: str, finding: FittedHypothesis) -> tuple[str, str]:
    """(code of the warning, text that goes on "the log fits if …") of a hypothesis with its values."""
    for case in SPECIAL_CASES:
        if case.of == code and case.applies(finding):
            return case.code or code, case.wording.text(finding, {})
    named = [one for one in TABLE if one.code == code and one.wording.sentence]
    moved = [one for one in named if all(finding.errors[name].any() for name in one.moved)]
    best = max(moved or named, key=lambda one: len(one.moved))
    return code, best.text(finding)
