"""The settings that a result rests on, such that giving them back reproduces it."""

from __future__ import annotations

from typing import Any

from massprop_cli.base.configfile import literal
from massprop_cli.flow import Analysis
from massprop_cli.inputs import vehicle
from massprop_cli.inputs.estimatorsettings import UNWIDENED


def effective_settings(analysis: Analysis) -> dict[str, Any]:
    """Dotted keys and values which, given back as settings, reproduce the result."""
    used = analysis.vehicle
    keys: dict[str, Any] = {"cycle.command_delay_cycles": analysis.timing.delay, "thrust.lag_s": analysis.timing.lag_s(used)}
    timing_sigmas = {
        "cycle.command_delay_sigma_cycles": used.cycle.command_delay_sigma_cycles,
        "thrust.lag_sigma_s": used.thrust.lag_sigma_s,
        "thrust.lag_delay_correlation": used.thrust.lag_delay_correlation,
    }
    keys |= {key: sigma for key, sigma in timing_sigmas.items() if sigma}
    for section, names in (
        ("imu", ("gyro_noise_rad_s", "accel_noise_m_s2", "attitude_sigma_rad", "gyro_outliers_s", "accel_outliers_s")),
        ("environment", ("disturbance_torque_n_m", "disturbance_walk_n_m")),
    ):
        keys |= {k: v for k, v in vehicle.flat(getattr(used, section), section).items() if k.split(".")[1] in names}
    found = "gyro_filter", "accel_filter", "filter_correlation", *(["measures"] if used.imu.measures == "sample" else [])
    keys |= {k: v for k, v in vehicle.flat(used.imu, "imu").items() if k.split(".")[1] in found}
    estimator = vehicle.flat(used.estimator, "estimator") | {"estimator.adapt_noise": False}
    if used.estimator.accel_noise_scale == UNWIDENED:
        del estimator["estimator.accel_noise_scale"]
    return keys | estimator | vehicle.flat(used.convergence, "convergence") | _set_by_user(analysis, keys)


def setting_sources(analysis: Analysis) -> dict[str, str]:
    """Where each of :func:`effective_settings` came from: "option", "vehicle file", "default", or "log" if a first pass found it."""
    stated = analysis.source.vehicle
    options = {assignment.partition("=")[0].strip() for assignment in analysis.assignments}
    found = {}
    for key, value in effective_settings(analysis).items():
        section, _, name = key.partition(".")
        part = getattr(stated, section, None)
        if key in options:
            found[key] = "option"
        elif part is None or vehicle.flat(part, section).get(key) != value:
            found[key] = "log"
        else:
            found[key] = "vehicle file" if name.partition(".")[0] in part.model_fields_set else "default"
    return found


def _set_by_user(analysis: Analysis, keys: dict[str, Any]) -> dict[str, Any]:
    """Other keys that the command line overrode."""
    pairs = (assignment.partition("=") for assignment in analysis.assignments)
    others = {key.strip(): literal(value.strip()) for key, _, value in pairs}
    return {k: v for k, v in others.items() if k not in keys and not k.startswith(("estimator.", "convergence."))}
