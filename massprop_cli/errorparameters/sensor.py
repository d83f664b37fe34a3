"""What gyro and accelerometer may show otherwise than what is."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.errorparameters.parameter import ErrorParameter, Facts, FittedHypothesis, SpecialCase, Step, Unit, Wording
from massprop_cli.errorparameters.setup import Setup
from massprop_cli.errorparameters.timing import DIFFERENCE, LATENESS
from massprop_cli.inputs.equipment import PIVOTED, LowPass
from massprop_cli.inputs.vehicle import Vehicle

FINE, SHORTEST = 0.005, 0.05
"""Cycles behind derivatives by a low-pass that is shorter than a cycle; part of its time constant below which none gets."""
NO_FACTOR = 1e-9
"""Away from 1, of a factor that is none."""
DEGREE = float(np.pi / 180)
GRAVITY = 9.80665
WORDS = {"gyro": "gyro", "accel": "accelerometer"}
MEASURED = {"gyro": "rate", "accel": "specific force"}
INCREMENTS = {"gyro": "delta_theta_imu_rad", "accel": "delta_v_imu_m_s"}
GYRO, ACCELEROMETER = "gyro-scale", "accelerometer-scale"
"""Codes of the assumptions that the sensors' scales are exact."""
ASSUMED: dict[str, tuple[str, Literal["parts", "columns"]]] = {"gyro": (GYRO, "parts"), "accel": (ACCELEROMETER, "columns")}
_CALIBRATE = "no key: the remedy is a calibration, or a factor under [columns]"


def _unbiased(sensor: str, setup: Setup, error: Array) -> Setup:
    """The log's increments less a bias, which is in body axes."""
    name, log = INCREMENTS[sensor], setup.log
    own = np.array(setup.vehicle.imu.body_from_imu).T @ error
    return setup._replace(log=replace(log, **{name: getattr(log, name) - own * log.interval_s[:, None]}))


def _factor(sensor: str) -> Facts:
    def facts(finding: FittedHypothesis) -> Mapping[str, object]:
        factors = np.exp(finding.errors[f"{sensor}_scale"])
        # beside another hypothesis about the same sensor errors of both are in there: of all axes the middle one is common to them
        factor = float(factors["xyz".index(finding.subject[0])] if finding.subject else np.sort(factors)[1])
        return {"axis": f"'s {finding.subject[0]} axis" if finding.subject else "", "factor": factor, "inverse": 1 / factor}

    return facts


def _scale(sensor: Literal["gyro", "accel"]) -> ErrorParameter:
    word, code, by_axis = WORDS[sensor], *ASSUMED[sensor]
    columns = tuple(f"gyro_scale {i}" for i in range(3)) if sensor == "gyro" else ()
    return ErrorParameter(
        f"{sensor}_scale",
        f"{sensor}-scale",
        f"scale of the {word} along each of its axes",
        "1",
        prior=0.05,  # data sheets of small MEMS sensors: up to 3 %, and as much again over temperature
        usual=0.01,
        no_key=_CALIBRATE,
        no_sigma=_CALIBRATE,
        size=3,
        sensor=sensor,
        lowest=-0.5,  # what shows less is in another unit
        shown=lambda error, _: np.diag(np.exp(error)),
        columns=columns,
        bends="with gravity" if sensor == "gyro" else "never",
        redone="motion",
        difference=0.01,
        wording=Wording(
            f"the {word}{{axis}} reads {{factor:.5g}} of the true {MEASURED[sensor]}",
            "calibrate it, or scale its columns by {inverse:.6g} under [columns]",
            _factor(sensor),
        ),
        step=Step(
            code,
            0.01,
            "1 %",
            lambda _: f"the {word}'s scale{{along}} is assumed exact",
            lambda setup: any(setup.log.axes[:3] if sensor == "gyro" else setup.log.axes[3:]),
            by_axis=by_axis,
        ),
    )


def _bias(sensor: str, unit: Unit, prior: float, usual: float, columns: tuple[str, ...]) -> ErrorParameter:
    name, key = f"{sensor}_bias", f"imu.{sensor}_bias_sigma_{'rad_s' if sensor == 'gyro' else 'm_s2'}"
    shown = "rad/s" if sensor == "gyro" else "m/s^2"
    return ErrorParameter(
        name,
        f"{sensor}-bias",
        f"bias of the {WORDS[sensor]}",
        unit,
        prior=prior,
        usual=usual,
        no_key="no key: it is estimated where its sigma is stated",
        sigma_key=key,
        size=3,
        difference=usual,
        change=lambda setup, error: _unbiased(sensor, setup, error),
        states="size",
        columns=columns,
        bends="with gravity" if sensor == "gyro" else "never",
        estimated=True,
        redone="motion",
        wording=Wording(f"the {WORDS[sensor]} has a bias of {{imu_axes}} {shown}, IMU axes", f"state {key}"),
    )


def _lowpass(sensor: str) -> ErrorParameter:
    name = f"{sensor}_lag"
    return LATENESS(
        name,
        f"{sensor}-filter",
        f"first-order low-pass within the {WORDS[sensor]}",
        prior=1.0,  # filters are set to the rate at which a controller reads
        key=f"imu.{name}_s",
        sigma_key=f"imu.{name}_sigma_s",
        scale=lambda vehicle: vehicle.cycle.period_s,
        late=sensor == "gyro",  # the specific force alone comes late by the accelerometer's, which nothing else does
        wording=Wording(
            f"the {WORDS[sensor]} is low-pass filtered with a time constant of {{value:.3g}} ± {{sigma:.2g}} s",
            f"log unfiltered values, or state imu.{name}_s",
        ),
    )


def _slower(sensor: str, setup: Setup, error: Array) -> Setup | None:
    """A low-pass with a time constant 1 / (2π f) that is so many cycles longer; never of the other sign."""
    low_pass: LowPass | None = getattr(setup.vehicle.imu, f"{sensor}_filter")
    if low_pass is None or low_pass.order == 0:
        return None
    cycle_s = 2 * np.pi * setup.period_s
    lag = 1 / (low_pass.cutoff * cycle_s)
    return setup.having(f"imu.{sensor}_filter.cutoff_hz", np.array([1 / (max(lag + float(error[0]), SHORTEST * lag) * cycle_s)]))


def _later(sensor: str, setup: Setup, error: Array) -> Setup:
    """Values that are so many cycles later."""
    imu, name, by = setup.vehicle.imu, f"{sensor}_filter", float(error[0]) * setup.period_s
    low_pass = getattr(imu, name) or LowPass(order=0)
    changed = imu.model_copy(update={name: low_pass.model_copy(update={"latency_s": low_pass.latency + by})})
    return setup._replace(vehicle=setup.vehicle.model_copy(update={"imu": changed}))


def _hertz(sensor: str, vehicle: Vehicle) -> float:
    """Hz of cutoff to a cycle of time constant."""
    low_pass: LowPass | None = getattr(vehicle.imu, f"{sensor}_filter")
    return 1.0 if low_pass is None or low_pass.cutoff_hz in (None, "auto") else 2 * np.pi * low_pass.cutoff**2 * vehicle.cycle.period_s


def _stated_lowpass(sensor: str) -> tuple[ErrorParameter, ErrorParameter]:
    """What a low-pass that the vehicle file states may have otherwise."""
    table = f"imu.{sensor}_filter"
    stated = partial(ErrorParameter, code=f"{sensor}-filter", unit="cycles", usual=0.1, states="sigma", bends="always", redone="commands")
    return (
        stated(
            name=f"{sensor}_cutoff",
            what=f"time constant of the {WORDS[sensor]}'s low-pass, 1 / (2π cutoff)",
            key=f"{table}.cutoff_hz",
            sigma_key=f"{table}.cutoff_sigma_hz",
            scale=lambda vehicle: _hertz(sensor, vehicle),
            change=lambda setup, error: _slower(sensor, setup, error),
            difference=FINE,
        ),
        stated(
            name=f"{sensor}_latency",
            what=f"latency of the {WORDS[sensor]} beyond its low-pass",
            key=f"{table}.latency_s",
            sigma_key=f"{table}.latency_sigma_s",
            scale=lambda vehicle: vehicle.cycle.period_s,
            change=lambda setup, error: _later(sensor, setup, error),
            difference=FINE,
        ),
    )


_ATTITUDE = ErrorParameter(
    "attitude_latency",
    "attitude-misfit",
    "age of a logged attitude at its time_s",
    "cycles",
    key="imu.attitude_latency_s",
    sigma_key="imu.attitude_latency_sigma_s",
    lowest=0.0,
    scale=lambda vehicle: vehicle.cycle.period_s,
    bends="always",
    environments=PIVOTED,
    redone="commands",
    difference=DIFFERENCE,
)
PARAMETERS = (
    _ATTITUDE,
    _scale("gyro"),
    _scale("accel"),
    # turn-on biases of small MEMS sensors: 3 °/s and 50 mg at worst
    _bias("gyro", "rad/s", 0.02, 1e-3, ("rates", *(f"gyro_bias {i}" for i in range(3)))),
    _bias("accel", "m/s²", 0.5, 0.01, ()),
    _lowpass("gyro"),
    _lowpass("accel"),
    *_stated_lowpass("gyro"),
    *_stated_lowpass("accel"),
)


def _columns_held(finding: FittedHypothesis) -> Mapping[str, object]:
    """What columns hold, and by which factors they are corrected."""
    shows = [np.diag(finding.mounting.T @ turn @ finding.mounting) for turn in finding.turns]
    factors = dict.fromkeys(f"{1 / factor:.6g}" for own in shows for factor in own if abs(factor - 1) > NO_FACTOR)
    return {"which": finding.subject[0], "factors": " and ".join(factors)}


def _other_filter(sensor: str, key: str, unit: str, per: float) -> SpecialCase:
    """Of a low-pass that the vehicle file states, another value than it states."""
    name = f"imu.{sensor}_filter.{key}"
    sigma_key = "_sigma_".join(name.rsplit("_", 1))

    def moved(finding: FittedHypothesis) -> bool:
        return bool((finding.corrected.value(name) != finding.stated.value(name)).any())

    def facts(finding: FittedHypothesis) -> Mapping[str, object]:
        value, sigma = (per * float(finding.corrected.value(one)[0]) for one in (name, sigma_key))
        sought = key == "latency_s" and finding.stated.vehicle.cycle.command_delay_cycles == "auto"
        return {"value": value, "sigma": sigma, "stated": float(finding.stated.value(name)[0]), "or": instead if sought else ""}

    (other,) = (word for own, word in WORDS.items() if own != sensor)
    instead = f", or the {other}'s is off by as much with the opposite sign: with an automatic delay the log shows only their difference"
    words = f"the {WORDS[sensor]}'s {key.partition('_')[0]} is {{value:.4g}} ± {{sigma:.2g}} {unit}, not {name} = {{stated:.4g}}{{or}}"
    return SpecialCase(f"{sensor}-filter", Wording(words, 'correct it, or state "auto" to estimate it', facts), moved)


_HELD = Wording("its {which}", "correct the log, or scale these columns by {factors} under [columns]", _columns_held)
_AXES = Wording("velocity increments are in the IMU's axes at the start of each record", 'state imu.accel_axes = "start"')
SPECIAL_CASES = (
    SpecialCase("accel-axes", _AXES),
    *(_other_filter(sensor, *key) for sensor in WORDS for key in (("cutoff_hz", "Hz", 1.0), ("latency_s", "ms", 1e3))),
    *(SpecialCase(code, _HELD) for code in ("gyro-units", "accel-units", "column-kind")),
)
