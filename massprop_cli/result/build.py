"""Conversion of an analysis to the model of result.json."""

import platform
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from massprop_cli import __version__
from massprop_cli.base.arrays import TINY, Array, median
from massprop_cli.base.configfile import literal
from massprop_cli.conclude.discrepancy import Discrepancy
from massprop_cli.conclude.docking import Docked
from massprop_cli.conclude.physical import breach, nearest_consistent
from massprop_cli.conclude.verdict import Conclusion, Estimate
from massprop_cli.errorparameters.setup import stating, value_of
from massprop_cli.estimate.crossvalidation import CrossValidation
from massprop_cli.estimate.history import History
from massprop_cli.estimate.quantities import open_scale
from massprop_cli.flow import Analysis, CorrectedEstimate
from massprop_cli.inputs import vehicle
from massprop_cli.inputs.estimatorsettings import UNWIDENED
from massprop_cli.inputs.section import ZERO
from massprop_cli.inputs.vehicle import Known, Nominal, Quantity, Vehicle
from massprop_cli.inputs.vehiclefile import FACTORS
from massprop_cli.prepare.attitude import world_up_b
from massprop_cli.prepare.clock import cycle_edges
from massprop_cli.result import schema


def result(analysis: Analysis) -> schema.Result:
    """Build the result of an analysis."""
    analysis = _as_filed(analysis)
    log = analysis.log
    start, length = cycle_edges(log, slice(0, log.cycles))
    return schema.Result(
        schema="massprop/result/1",
        provenance=schema.Provenance(
            massprop=__version__,
            input_sha256=log.sha256,
            vehicle_sha256=analysis.source.sha256,
            map_sha256=log.made.sha256 if log.made else None,
            settings=effective_settings(analysis),
            setting_sources=setting_sources(analysis),
            versions={"python": platform.python_version(), "numpy": np.__version__},
        ),
        vehicle=_vehicle(analysis),
        log=schema.LogInfo(
            path=log.path.name,
            rows=log.rows,
            cycles=log.cycles,
            duration_s=float(start[-1] + length[-1] - start[0]),
            cycle_s=median(length),
            mapped=list(log.made.conversions) if log.made else [],
        ),
        delay=_delay(analysis),
        lag=_lag(analysis),
        low_passes=_low_passes(analysis),
        conventions=schema.Conventions(),
        phases=[
            _phase(analysis, i, factors, told)
            for i, (factors, told) in enumerate(zip(analysis.lack_of_fit, analysis.discrepancies, strict=True))
        ],
        docked_object=_docked(analysis.docked, analysis.vehicle),
        mended=[_mended(answer) for answer in analysis.mended],
        assumptions=[schema.Assumption.model_validate(one, from_attributes=True) for one in analysis.assumptions],
        warnings=[schema.WarningItem.model_validate(one, from_attributes=True) for one in analysis.notices],
    )


def _as_filed(analysis: Analysis) -> Analysis:
    """The analysis with the ``uncertain`` values as the vehicle file states them; the log may have been read about their estimates."""
    filed, at = analysis.source.vehicle, analysis.timing
    stated = {key: value_of(filed, key) for entry in filed.uncertain for key in entry if key not in FACTORS}
    keys = {key: value for key, value in stated.items() if isinstance(value, (int, float, tuple))}
    delay, lag_s = keys.get("cycle.command_delay_cycles"), keys.get("thrust.lag_s")
    at = at._replace(delay=delay) if isinstance(delay, float) else at
    at = at._replace(lag=lag_s / filed.cycle.period_s) if isinstance(lag_s, float) else at
    return replace(analysis, vehicle=stating(analysis.vehicle, keys), timing=at) if keys else analysis


def _vehicle(analysis: Analysis) -> schema.VehicleInfo:
    used = analysis.vehicle
    return schema.VehicleInfo(
        name=used.name,
        environment=used.environment.kind,
        bearing_mass_kg=used.bearing_mass_kg,
        bearing_position_m=list(used.environment.bearing_position_m if used.pivoted else ZERO),
        commands=analysis.log.command_kind,
        jets=[jet.name for jet in used.jets] if analysis.log.command_kind == "jets" else [],
        rotors=[rotor.name for rotor in used.rotors],
        thrust_scale_sigma=open_scale(used),
        wheels=[wheel.name for wheel in used.spinning],
        gravity_m_s2=used.environment.gravity_m_s2 if used.on_pedestal else None,
        initial_up=world_up_b(np.array(used.environment.initial_attitude_wxyz)).tolist() if used.on_pedestal else None,
        ballast=list(used.ballast),
    )


def _delay(analysis: Analysis) -> schema.Delay:
    found = analysis.detected
    told = found is not None and found.sigma.delay > 0
    return schema.Delay(
        cycles=analysis.timing.delay,
        source=_source(analysis, "cycle", "command_delay_cycles"),
        detected_cycles=found.at.delay if found is not None and told else None,
        sigma_cycles=found.sigma.delay if found is not None and told else None,
    )


def _lag(analysis: Analysis) -> schema.Lag:
    found, period = analysis.detected, analysis.source.vehicle.cycle.period_s
    return schema.Lag(
        lag_s=analysis.timing.lag_s(analysis.vehicle),
        source=_source(analysis, "thrust", "lag_s"),
        sigma_s=found.sigma.lag * period if found is not None and found.sigma.lag > 0 else None,
    )


def _low_passes(analysis: Analysis) -> list[schema.DetectedLowPass]:
    sought, names = () if analysis.detected is None else analysis.detected.unknown, {"gyro": "gyro", "accel": "accelerometer"}
    found = []
    for sensor, name in names.items():
        low_pass = getattr(analysis.vehicle.imu, f"{sensor}_filter")
        values = {
            key: getattr(low_pass, key) if f"{sensor}_{key.partition('_')[0]}" in sought else None
            for key in ("cutoff_hz", "cutoff_sigma_hz", "latency_s", "latency_sigma_s")
        }
        if any(value is not None for value in values.values()):
            found.append(schema.DetectedLowPass(sensor=name, **values))
    imu = analysis.vehicle.imu
    if analysis.source.vehicle.imu.attitude_latency_s == "auto" and imu.attitude_latency_sigma_s > 0:
        late = {"latency_s": imu.attitude_latency, "latency_sigma_s": imu.attitude_latency_sigma_s}
        found.append(schema.DetectedLowPass(sensor="attitude", cutoff_hz=None, cutoff_sigma_hz=None, **late))
    return found


def _source(analysis: Analysis, section: str, key: str) -> Literal["vehicle", "option", "detected", "default"]:
    stated = getattr(analysis.source.vehicle, section)
    if getattr(stated, key) == "auto":
        return "detected"
    if any(assignment.startswith(f"{section}.{key}=") for assignment in analysis.assignments):
        return "option"
    return "vehicle" if key in stated.model_fields_set else "default"


def _phase(analysis: Analysis, i: int, factors: Array, told: Discrepancy | None) -> schema.PhaseItem:
    conclusion, settled, used = analysis.conclusions[i], analysis.settled[i], analysis.vehicle
    about_origin, validated = conclusion.inertia_about_origin, analysis.cross_validations[i] if analysis.cross_validations else None
    return schema.PhaseItem(
        name=conclusion.phase.name,
        start_s=conclusion.phase.start_s,
        end_s=conclusion.phase.end_s,
        estimates=_with_scatter(estimate_items(conclusion.estimates, used.nominal), validated and validated.sigmas),
        covariance=matrix(conclusion.covariance),
        inertia_about_origin=matrix(about_origin) if np.isfinite(about_origin).all() else None,
        physical=physical(conclusion),
        about_pivot=_with_scatter(estimate_items(conclusion.about_pivot), validated and validated.pivot_sigmas),
        about_pivot_covariance=_pivot_covariance(conclusion),
        innovations=_innovations(settled, factors),
        contradiction=conclusion.contradiction,
        known=_known(used.in_phase(conclusion.phase).known),
        implied_thrust_scale=_implied(conclusion, used.in_phase(conclusion.phase)),
        discrepancy=None if told is None else _discrepancy(told, conclusion.thrust_scale_sigma),
        cross_validation=None if validated is None else _cross_validation(analysis, validated),
    )


def _with_scatter(items: dict[str, schema.EstimateItem], sigmas: Array | None) -> dict[str, schema.EstimateItem]:
    """Estimates with sigmas (n,) by the scatter of segments, if they have a value."""
    if sigmas is None or not items:
        return items
    given = {name: float(sigma) for name, sigma in zip(items, sigmas, strict=True) if np.isfinite(sigma) and items[name].value is not None}
    return {name: one.model_copy(update={"segment_sigma": given.get(name)}) for name, one in items.items()}


def _cross_validation(analysis: Analysis, found: CrossValidation) -> schema.CrossValidationItem:
    level = analysis.stated.estimator.cross_validate or 0.0
    end_s, (start_s, _) = analysis.samples.end_s, cycle_edges(analysis.log, slice(0, analysis.log.cycles))
    segments = [
        schema.SegmentItem(
            start_s=float(start_s[one.cycles.start]),
            end_s=float(end_s[one.cycles.stop - 1]),
            chi_square=one.chi_square,
            freedom=one.freedom,
            p=one.p,
        )
        for one in found.segments
    ]
    return schema.CrossValidationItem(level=level, p=found.p, passes=found.p > 1 - level, segments=segments)


def _pivot_covariance(conclusion: Conclusion) -> schema.Matrix | None:
    if conclusion.pivot is None or not conclusion.about_pivot:
        return None
    known = np.array([one.value is not None for one in conclusion.about_pivot.values()])
    return matrix(np.where(known[:, None] & known, conclusion.pivot[1], np.nan))


def _discrepancy(told: Discrepancy, common: float) -> schema.DiscrepancyItem:
    shares = {name: [float(sigma) if np.isfinite(sigma) else None for sigma in sigmas] for name, sigmas in told.shares.items()}
    return schema.DiscrepancyItem(scale=told.scale, thrust_scale_sigma=common, behaves_like=list(told.behaves_like), shares=shares)


def physical(conclusion: Conclusion) -> schema.Physical:
    """Physical consistency of an inertia."""
    moments, broken = conclusion.principal_moments, breach(conclusion)
    told = bool(np.isfinite(moments).all())
    return schema.Physical(
        consistent=not (broken and broken.certain) if told else None,
        principal_moments=[float(moment) for moment in moments] if told else None,
        note=broken.message if broken else "",
        nearest_consistent=matrix(nearest_consistent(conclusion.inertia)) if broken and broken.of_inertia else None,
    )


def _known(known: Mapping[Quantity, Known]) -> dict[str, tuple[float, float]]:
    return {name: (quantity.value, quantity.sigma) for name, quantity in known.items()}


def _implied(conclusion: Conclusion, vehicle: Vehicle) -> schema.ImpliedScale | None:
    """Thrust scale that a known mass implies: known mass over the log's own; None on a pedestal, where no motion informs the mass."""
    known = None if vehicle.on_pedestal else vehicle.known.get("mass")
    mass, variance = float(conclusion.bare[0][9]), float(conclusion.bare[1][9, 9])
    if known is None or variance <= 0 or not np.isfinite(mass + variance) or mass <= 0:
        return None
    value = known.value / mass
    of = schema.MOMENTUM if vehicle.spinning and vehicle.thrust.scale_sigma > 0 else schema.THRUST
    return schema.ImpliedScale(
        by="known.mass", of=of, value=value, sigma=value * float(np.hypot(known.sigma / known.value, np.sqrt(variance) / mass))
    )


def _mended_items(found: Mapping[str, Estimate]) -> dict[str, schema.MendedEstimate]:
    return {name: schema.MendedEstimate.model_validate(one, from_attributes=True) for name, one in found.items()}


def _mended(answer: CorrectedEstimate) -> schema.Mended:
    phases = [
        schema.MendedPhase(
            name=conclusion.phase.name,
            estimates=_mended_items(conclusion.estimates),
            about_pivot=_mended_items(conclusion.about_pivot),
            contradiction=conclusion.contradiction,
        )
        for conclusion in answer.conclusions
    ]
    notice = answer.fault.notice
    return schema.Mended(code=notice.code, message=notice.message, settings=list(answer.settings), whole=answer.complete, phases=phases)


def _innovations(history: History, factors: Array) -> schema.Innovations | None:
    found = history.moments()
    if found.count < 3:
        return None
    correlation = found.lagged / np.maximum(found.variance, TINY)

    def read(values: Array) -> list[float | None]:
        return [None if unread else float(value) for value, unread in zip(values, history.unread, strict=True)]

    return schema.Innovations(
        cycles=found.count,
        nis=float(found.variance.sum()),
        channel_variance=read(found.variance),
        lag_one_correlation=read(correlation),
        lack_of_fit=[float(factor) for factor in factors],
    )


def estimate_items(estimates: Mapping[str, Estimate], nominal: Nominal | None = None) -> dict[str, schema.EstimateItem]:
    """Estimates as items of a result."""
    return {
        name: schema.EstimateItem(
            value=e.value,
            sigma=e.sigma,
            unit=e.unit,
            verdict=e.verdict,
            final_at_s=e.final_at_s,
            reason=str(e.reason),
            reason_code=e.reason.code,
            nominal=nominal.value(name) if nominal else None,
        )
        for name, e in estimates.items()
    }


def _docked(found: Docked | None, used: Vehicle) -> schema.DockedObject | None:
    if found is None:
        return None
    return schema.DockedObject(
        before=found.before,
        after=found.after,
        estimates=estimate_items(found.estimates),
        covariance=matrix(found.covariance),
        contradiction=found.contradiction,
        known=_known(used.docking.known if used.docking else {}),
    )


def matrix(values: Array) -> schema.Matrix:
    """A matrix for JSON: null for NaN."""
    return [[float(cell) if np.isfinite(cell) else None for cell in row] for row in values]


def effective_settings(analysis: Analysis) -> dict[str, Any]:
    """Dotted keys and values that reproduce the result if they are given as settings."""
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
    found = *found, *(["attitude_latency_s", "attitude_latency_sigma_s"] if used.imu.attitude_latency_s else [])
    found = *found, *(["gyro_bias_rad_s"] if any(used.imu.gyro_bias_rad_s) else [])
    keys |= {k: v for k, v in vehicle.flat(used.imu, "imu").items() if k.split(".")[1] in found}
    for number, (wheel, before) in enumerate(zip(used.wheels, analysis.source.vehicle.wheels, strict=True)):
        if wheel != before:
            keys[f"wheels.{number}.speed_error_in_noise"] = wheel.speed_error_in_noise
    estimator = vehicle.flat(used.estimator, "estimator") | {"estimator.adapt_noise": False}
    if used.estimator.accel_noise_scale == UNWIDENED:
        del estimator["estimator.accel_noise_scale"]
    return keys | estimator | vehicle.flat(used.convergence, "convergence") | _set_by_user(analysis, keys)


def setting_sources(analysis: Analysis) -> dict[str, str]:
    """Source of each of :func:`effective_settings`: "option", "vehicle file", "default", or "log" if it was estimated."""
    stated = analysis.source.vehicle
    options = {assignment.partition("=")[0].strip() for assignment in analysis.assignments}
    found = {}
    for key, value in effective_settings(analysis).items():
        section, _, name = key.partition(".")
        part = getattr(stated, section, None)
        if key in options:
            found[key] = "option"
        elif part is None or isinstance(part, tuple) or vehicle.flat(part, section).get(key) != value:
            found[key] = "log"
        else:
            found[key] = "vehicle file" if name.partition(".")[0] in part.model_fields_set else "default"
    return found


def _set_by_user(analysis: Analysis, keys: dict[str, Any]) -> dict[str, Any]:
    """Further keys that the command line set."""
    pairs = (assignment.partition("=") for assignment in analysis.assignments)
    others = {key.strip(): literal(value.strip()) for key, _, value in pairs}
    return {k: v for k, v in others.items() if k not in keys and not k.startswith(("estimator.", "convergence."))}
