"""What is declared of an error parameter, and what every declaration must hold."""

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import Any, Literal, get_args

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.dataclass import dataclass
from massprop_cli.errorparameters.setup import Setup, has_table, stated
from massprop_cli.inputs.actuators.wheel import Wheel
from massprop_cli.inputs.equipment import Jet
from massprop_cli.inputs.vehicle import Vehicle

Unit = Literal["1", "m", "N", "rad", "rad/s", "m/s²", "N m", "N m s", "cycles", "parts", "kg", "kg m²"]
Redone = Literal["body", "motion", "commands", "all"]
"""What another value changes: the model of the body alone; the IMU's readings or the attitude, too; what commands do, or when anything
is measured; or all of it."""


@dataclass(frozen=True)
class FittedHypothesis:
    """A hypothesis with its values, and log and vehicle file as stated and as corrected."""

    subject: tuple[str, ...]
    """Names of channels, an axis, a sensor or a unit."""
    names: tuple[str, ...]
    """Of the channels that fired."""
    errors: Mapping[str, Array]
    """By parameter: estimated less stated."""
    sigmas: Mapping[str, Array]
    stated: Setup
    corrected: Setup
    mounting: Array
    """(3, 3) body from IMU, as stated."""
    turns: tuple[Array, Array]
    """(3, 3) discrete turn or mirror of the gyro's axes and of the accelerometer's."""
    force: tuple[Array, Array]
    """(C, 3) of the channels that fired, as stated and as estimated."""
    inverse_mass: float
    """As estimated, 1/kg."""
    cg: Array
    """(3,) as estimated."""
    does: Mapping[str, str] = field(default_factory=dict)
    """Of channels that are wired as others are, the one of which each does what is stated."""

    @property
    def channel(self) -> int:
        """The first one that the hypothesis is about, among those that fired."""
        return self.names.index(self.subject[0])

    @property
    def factor(self) -> float:
        """Of that channel's thrust."""
        return 1.0 + float(self.errors["thrust"][self.channel])

    @property
    def tables(self) -> tuple[str, ...]:
        """Of the channels that fired, where the vehicle file states them; empty: a wrench's components."""
        vehicle, kind = self.stated.vehicle, self.stated.log.command_kind
        stored = [device.TABLE for device in vehicle.spinning for _ in device.axes]
        return (*("" if kind == "wrench" else kind for _ in range(len(self.names) - len(stored))), *stored)

    def mean(self, name: str) -> float:
        """Of a parameter's components."""
        return float(self.errors[name].mean())


Facts = Callable[[FittedHypothesis], Mapping[str, object]]


@dataclass(frozen=True)
class Wording:
    """A sentence and a remedy, with the facts that fill them in."""

    sentence: str = ""
    """Goes on "the log fits if …"; empty: no warning names the parameter."""
    remedy: str = ""
    facts: Facts = lambda _: {}
    """Beside those of :meth:`ErrorParameter.facts`."""

    def text(self, finding: FittedHypothesis, facts: Mapping[str, object]) -> str:
        """Sentence and remedy of a finding, with more ``facts``."""
        return f"{self.sentence}; {self.remedy}".format(**{**facts, **self.facts(finding)})


@dataclass(frozen=True)
class SpecialCase:
    """Values of a parameter for which a warning says something more specific: dead, reversed, swapped, another unit."""

    of: str
    """Code of the hypothesis."""
    wording: Wording
    applies: Callable[[FittedHypothesis], bool] = lambda _: True
    code: str = ""
    """Code of the warning; empty: that of the hypothesis."""


@dataclass(frozen=True)
class Step:
    """How an estimate's dependence on a parameter is shown, where the parameter is assumed as stated."""

    code: str
    size: float
    """Of the step that is shown, in the parameter's unit."""
    words: str
    """The same in words; ``{axis}``: the axis."""
    message: Callable[[Setup], str]
    """``{axis}``: the axis."""
    applies: Callable[[Setup], bool] = lambda _: True
    part_of: str = ""
    """Code of the assumption that reports its effect; it is tested by itself all the same."""
    axes: str = "XYZ"
    """Of its components."""
    stated: Callable[[Setup], bool] | None = None
    """Whether the vehicle file states it; None: by its key."""
    by_axis: Literal["alone", "parts", "columns"] = "alone"
    """Whether each axis is an assumption, or a part of one; or the filter carries columns of its own for them."""
    most: float = np.inf
    """In the parameter's unit: by which it may be off at most. Of a log that tells it no better than that it is not tested."""
    rare: bool = False
    """Whether so few vehicle files are wrong in it that chance makes most small misfits by it."""


@dataclass(frozen=True)
class ErrorParameter:
    """Something that may differ from what is stated."""

    name: str
    """Of the entry of x (:mod:`massprop_cli.diagnosis.coefficients`), if it has one."""
    code: str
    """Of the warning that names it."""
    what: str
    unit: Unit
    """Of the error in x."""
    prior: float = 0.0
    """One sigma of the error of a vehicle file that is wrong, in ``unit``; 0: never a hypothesis."""
    usual: float = 0.0
    """One sigma of the error of a vehicle file of a careful lab, in ``unit``; 0: it goes by another parameter.

    Of a direction in rad, and of what is in metres in parts of the vehicle's size, √(trace / mass).
    """
    key: str | None = None
    """Of its value in the vehicle file."""
    no_key: str = ""
    """Why there is none."""
    sigma_key: str | None = None
    no_sigma: str = ""
    """Why there is none."""
    size: int = 1
    """Components."""
    per_channel: bool = False
    entries: tuple[str, ...] = ()
    """Parameters that it moves together."""
    lowest: float = -np.inf
    """Least physical value, key's unit."""
    highest: float = np.inf
    slack: float = np.inf
    """In ``unit``: by how much a first, linear step may lead below ``lowest`` where a full fit does not."""
    scale: Callable[[Vehicle], float] = lambda _: 1.0
    """Key's unit per ``unit``."""
    change: Callable[[Setup, Array], Setup | None] | None = None
    """Log and vehicle file corrected by an error; None: by ``key`` alone."""
    shown: Callable[[Array, Array], Array] | None = None
    """(3, 3) what the sensor shows of the truth, IMU axes, by the error and the mounting: corrected by factors on the log's columns."""
    states: Literal["", "sigma", "size"] = ""
    """What a correction states under ``sigma_key``: the estimate's sigma, or the error's size, by which it is estimated anew.

    Else a refit one sigma further on stands for the uncertainty."""
    part: Callable[[FittedHypothesis], float] = lambda _: 1.0
    """Of that size."""
    columns: tuple[str, ...] = ()
    """Of the log's regression: without them it explains the motion while the parameter is as stated."""
    bends: Literal["never", "always", "with gravity"] = "never"
    """When the measurements are far from linear in it."""
    late: bool = False
    """Whether it makes motion late: only the shape within a cycle tells such parameters apart."""
    estimated: bool = False
    """Whether the estimator has it as an unknown where ``sigma_key`` is stated."""
    environments: tuple[str, ...] = ()
    """Kinds of environment in which it has a part; empty: all."""
    sensor: Literal["", "gyro", "accel"] = ""
    """The sensor that it is about alone."""
    redone: Redone = "body"
    difference: float = 0.0
    """In ``unit``: the step behind derivatives; 0: none is taken."""
    uncertain: tuple[str, str] = ("", "")
    """Code suffix and message of the assumption that its stated sigma adds to every sigma."""
    wording: Wording = Wording()
    step: Step | None = None

    def __post_init__(self) -> None:
        """:class:`ValueError` for a declaration that cannot be."""
        problem = next((text for wrong, text in self._problems() if wrong), None)
        if problem is not None:
            raise ValueError(f"error parameter {self.name!r}: {problem}")

    def _problems(self) -> list[tuple[bool, str]]:
        return [
            (not self.lowest < self.highest, f"no value lies between {self.lowest:g} and {self.highest:g}"),
            (self.prior < 0 or not np.isfinite(self.prior), f"the prior sigma {self.prior:g} is none"),
            (self.key is None and not self.no_key, "no key of the value, and no reason why there is none"),
            (self.sigma_key is None and not self.no_sigma, "no key of the sigma, and no reason why there is none"),
            (not all(map(_known, (self.key, self.sigma_key))), "the vehicle file has no such key"),
            (self.prior > 0 and not (self.wording.sentence and self.wording.remedy), "a hypothesis without a sentence or a remedy"),
            (bool(self.states) and self.sigma_key is None, "a sigma is stated under no key"),
        ]

    @property
    def moved(self) -> tuple[str, ...]:
        """The entries of x that it is made of."""
        return self.entries or (self.name,)

    @property
    def by_columns(self) -> bool:
        """Whether factors on the log's columns alone correct it."""
        return self.key is None and self.shown is not None

    @property
    def by_hand(self) -> bool:
        """Whether neither the vehicle file nor factors on the log can take its value."""
        return self.key is None and self.change is None and self.shown is None

    def facts(self, finding: FittedHypothesis) -> dict[str, object]:
        """What a sentence may say of the error, and of value and sigma in the key's unit."""
        error, scale = finding.errors[self.moved[0]], self.scale(finding.stated.vehicle)
        sigma = scale * float(finding.sigmas[self.moved[0]].max(initial=0.0))
        found: dict[str, object] = {"error": vector(error), "mm": vector(error, 1e3), "sigma": sigma, "percent_sigma": 100 * sigma}
        found |= {"angle": np.degrees(np.linalg.norm(error)), "imu_axes": vector(finding.mounting.T @ error) if error.size == 3 else ""}
        if self.key is not None and not self.per_channel:
            stated, value = (float(np.ravel(setup.value(self.key))[0]) for setup in (finding.stated, finding.corrected))
            found |= {"stated": stated, "value": value, "percent": 100 * value}
        return found

    def text(self, finding: FittedHypothesis) -> str:
        """Its sentence and remedy."""
        return self.wording.text(finding, self.facts(finding))

    def corrected_sigma(self, finding: FittedHypothesis) -> float:
        """What a correction states under ``sigma_key``."""
        if self.states == "sigma":
            return self.scale(finding.stated.vehicle) * float(finding.sigmas[self.name][0])
        size = self.part(finding) * float(np.abs(finding.errors[self.moved[0]]).max())
        return size if self.key is None else min(size, self.prior)

    def least(self, setup: Setup) -> float:
        """The error by which the stated value is at its least, in ``unit``; of jets, where each is. None (-inf) of a part of nothing."""
        now = 0.0 if self.key is None or np.isinf(self.lowest) else float(setup.value(self.key).max(initial=0.0))
        scale = self.scale(setup.vehicle)
        return (self.lowest - now) / scale if scale else -np.inf

    def sigma(self, vehicle: Vehicle) -> float:
        """One sigma that the vehicle file states, in ``unit``; 0: none, or of another environment."""
        if self.sigma_key is None or (self.environments and vehicle.environment.kind not in self.environments):
            return 0.0
        return float(stated(vehicle, self.sigma_key)[0]) / self.scale(vehicle)

    def apply(self, setup: Setup, error: Array) -> Setup | None:
        """Log and vehicle file with the error in place; None where the value is out of range or neither can take it."""
        if self.change is not None:
            return self.change(setup, error)
        if self.key is None or not has_table(setup.vehicle, self.key):
            return None
        value = setup.value(self.key) + self.scale(setup.vehicle) * error
        return None if value.max(initial=self.lowest) > self.highest else setup.having(self.key, np.maximum(value, self.lowest))

    def differing(self, setup: Setup, by: float, axis: int = 0) -> Setup:
        """With one component of its value ``by`` more, in ``unit``, in range or not."""
        found = replace(self, highest=np.inf).apply(setup, self.error(by, axis))
        if found is None:
            raise ValueError(f"{self.name} has no key to differ by")
        return found

    def error(self, by: float, axis: int = 0) -> Array:
        """(size,) of one component."""
        return np.asarray(by * np.eye(self.size)[axis])

    def ends(self, setup: Setup) -> tuple[float, float]:
        """Errors between which a derivative is taken, in ``unit``: both sides of what is stated where it is far from linear."""
        low = max(-self.difference, self.least(setup)) if self.bends == "always" else 0.0
        return low, self.difference

    @property
    def considered(self) -> bool:
        """Whether its stated sigma goes into every sigma without its being estimated (a consider parameter)."""
        return self.redone == "commands" and self.sigma_key is not None

    def stated_in(self, setup: Setup) -> bool:
        """Whether the vehicle file states its value."""
        if self.step is not None and self.step.stated is not None:
            return self.step.stated(setup)
        section, _, name = (self.key or "").partition(".")
        return self.key is not None and name in getattr(getattr(setup.vehicle, section), "model_fields_set", {name})


def _known(key: str | None) -> bool:
    """Whether the vehicle file has a key, ``section.name``."""
    if key is None:
        return True
    section, *names = key.split(".")
    field = Vehicle.model_fields.get(section)
    kind: Any = {"jets": Jet, "wheels": Wheel}.get(section) or (None if field is None else field.annotation)
    for name in names:
        # an optional table is its model or None
        kind = next((one for one in (kind, *get_args(kind)) if hasattr(one, "model_fields")), None)
        if kind is None or name not in kind.model_fields:
            return False
        kind = kind.model_fields[name].annotation
    return True


def vector(values: Array, unit: float = 1.0) -> str:
    """Three digits of each component."""
    return "(" + ", ".join(f"{unit * float(value):.3g}" for value in values) + ")"


def matrix(rows: Array) -> str:
    """Rows of a rotation."""
    return str([[round(float(value), 4) + 0.0 for value in row] for row in rows])
