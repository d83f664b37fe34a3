"""The parts of a result that a campaign stores: values, sigmas, and the part of each sigma that all logs of a vehicle file share."""

from collections.abc import Mapping, Sequence

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.base.escape import line
from massprop_cli.campaign import outcome
from massprop_cli.campaign.outcome import PhaseQuantities, Value
from massprop_cli.check.finding import ExpectedQuantity
from massprop_cli.combine import incommon
from massprop_cli.estimate.quantities import by_scale, by_scale_beside, in_common
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.job import Unmet
from massprop_cli.report.body import values
from massprop_cli.result.judge import apart
from massprop_cli.result.schema import EstimateItem, PhaseItem, Result


def vehicle(result: Result) -> outcome.StatedVehicle:
    """The vehicle of a result, with the environment that its values depend on."""
    stated = result.vehicle
    return outcome.StatedVehicle(
        name=stated.name,
        sha256=result.provenance.vehicle_sha256,
        environment=stated.environment,
        bearing_mass_kg=stated.bearing_mass_kg,
    )


def stated(source: VehicleSource) -> outcome.StatedVehicle:
    """The vehicle of a vehicle file, for a log without a result."""
    vehicle = source.vehicle
    bearing = vehicle.environment.bearing_mass_kg if vehicle.on_air_bearing else 0.0
    return outcome.StatedVehicle(name=vehicle.name, sha256=source.sha256, environment=vehicle.environment.kind, bearing_mass_kg=bearing)


def of_result(
    result: Result, unmet: Unmet, bodies: list[PhaseQuantities], files: list[str], method: str, fingerprint: str = outcome.UNKEPT
) -> outcome.Outcome:
    """The outcome of a result, of one log or combined."""
    return outcome.Outcome(
        fingerprint=fingerprint,
        exit_code=unmet.exit_code,
        message=line(unmet.message),
        input_sha256=result.provenance.input_sha256,
        vehicle=vehicle(result),
        method=method,
        duration_s=result.log.duration_s,
        cycles=result.log.cycles,
        delay_cycles=result.delay.cycles,
        warnings=[warning.code for warning in result.warnings],
        missed=unmet.phrases,
        bodies=bodies,
        files=files,
    )


def expected(predicted: Sequence[ExpectedQuantity]) -> list[PhaseQuantities]:
    """Sigmas and verdicts that a check predicts, without values, for each phase."""
    phases: dict[str, dict[str, Value]] = {}
    for one in predicted:
        phases.setdefault(one.phase, {})[one.quantity] = Value(value=None, sigma=one.sigma, verdict=one.verdict, met=one.reached)
    split = {name: apart(every) for name, every in phases.items()}
    return [PhaseQuantities(part="phase", name=name, estimates=ten, about_pivot=about) for name, (ten, about) in split.items()]


def bodies(result: Result, used: Vehicle, stated: Vehicle) -> list[PhaseQuantities]:
    """Phases and docked object; ``used`` is the vehicle of the estimate, ``stated`` that of the vehicle file."""
    thesis = used.estimator.method == "thesis"
    alike = {phase.name: _possibly_shared(result, phase, used, stated) for phase in result.phases}
    parts = [_phase(phase, None if thesis else used, alike[phase.name]) for phase in result.phases]
    docked = result.docked_object
    if docked is not None:
        # The result has no effect of known values and vehicle-file errors on the difference of two phases: with any, the shared sigma is
        # unknown. The bearing is in both phases, so it cancels: by_scale needs none for the object.
        calculable = not (thesis or docked.known or any(phase.known or alike[phase.name].any() for phase in result.phases))
        name = f"{docked.after} less {docked.before}"
        slope = by_scale_beside(values(docked.estimates), 0.0, np.zeros(3))
        common = in_common(slope, np.array(docked.covariance, dtype=float), {}, used) if calculable else None
        parts.append(PhaseQuantities(part="docked", name=name, estimates=_values(docked.estimates, common, np.zeros(10))))
    return parts


def joint_bodies(result: Result) -> list[PhaseQuantities]:
    """Phases and docked object of a combined result; its sigmas include the shared errors, which are not separate."""
    parts = [_phase(phase, None, np.zeros(10)) for phase in result.phases]
    docked = result.docked_object
    return parts + (
        [] if docked is None else [PhaseQuantities(part="docked", name="object", estimates=_values(docked.estimates, None, np.zeros(10)))]
    )


def _phase(phase: PhaseItem, used: Vehicle | None, alike: Array) -> PhaseQuantities:
    """A phase with its possibly shared sigmas ``alike`` (10,), and its shared sigmas if ``used`` is given."""
    estimates = _values(phase.estimates, None if used is None else shared(phase, used), alike)
    pivot = (None, np.zeros(9)) if used is None or not phase.about_pivot else shared_about_pivot(phase, used, alike)
    return PhaseQuantities(part="phase", name=phase.name, estimates=estimates, about_pivot=_values(phase.about_pivot, *pivot))


def _values(estimates: Mapping[str, EstimateItem], common: Array | None, alike: Array) -> dict[str, Value]:
    """Values with their shared sigmas ``common`` (n,), NaN or None if unknown, and possibly shared sigmas ``alike`` (n,)."""
    return {
        name: Value(
            value=item.value,
            sigma=item.sigma,
            shared=None if common is None or not np.isfinite(common[i]) else float(common[i]),
            alike=min(float(alike[i]), item.sigma or 0.0),
            verdict=item.verdict,
            met=None if item.expected is None else item.expected.met,
            expected=None if item.expected is None else item.expected.value,
        )
        for i, (name, item) in enumerate(estimates.items())
    }


def shared(phase: PhaseItem, used: Vehicle) -> Array:
    """(10,) sigma of the error common to all logs, from thrust scale and known values; NaN without a value."""
    known = {name: sigma for name, (_, sigma) in phase.known.items()}
    vehicle = _with_discrepancy(phase, used)
    return in_common(by_scale(values(phase.estimates), used), np.array(phase.covariance, dtype=float), known, vehicle)


def shared_about_pivot(phase: PhaseItem, used: Vehicle, alike: Array) -> tuple[Array, Array]:
    """(9,) shared and (9,) possibly shared sigmas about the pivot, the latter from ``alike`` (10,).

    Without values of the ten quantities, the nine are proportional to the thrust scale.
    """
    known, vehicle = {name: sigma for name, (_, sigma) in phase.known.items()}, _with_discrepancy(phase, used)
    derivative = incommon.by_ten_about_pivot(phase, used.bearing_mass_kg, np.array(used.environment.bearing_position_m))
    pivot_alike = incommon.alike_about_pivot(alike, derivative)
    if derivative is not None:
        slope, covariance = by_scale(values(phase.estimates), used), np.array(phase.covariance, dtype=float)
        return in_common(slope, covariance, known, vehicle, derivative), pivot_alike
    if known and not used.on_pedestal:
        return np.full(9, np.nan), pivot_alike
    return in_common(values(phase.about_pivot), np.array(phase.about_pivot_covariance, dtype=float), known, vehicle), pivot_alike


def _with_discrepancy(phase: PhaseItem, used: Vehicle) -> Vehicle:
    """The vehicle with the sigma of the thrust scale that includes the log's model discrepancy.

    One log cannot show an error common to all thrusts, so the discrepancy adds to the stated sigma.
    """
    discrepancy = phase.discrepancy.thrust_scale_sigma if phase.discrepancy else 0.0
    sigma = float(np.hypot(used.thrust.scale_sigma, discrepancy))
    return used.model_copy(update={"thrust": used.thrust.model_copy(update={"scale_sigma": sigma})})


def _possibly_shared(result: Result, phase: PhaseItem, used: Vehicle, stated: Vehicle) -> Array:
    """(10,) sigma that all logs may share in addition to thrust scale and known values.

    Its part from a stated delay of sigma s, which the log reduces to V, is that of a delay error V²/s.
    """
    prior, posterior = stated.cycle.command_delay_sigma_cycles, used.cycle.command_delay_sigma_cycles
    delay = posterior**2 / prior if prior > 0 and stated.cycle.command_delay_cycles != "auto" else 0.0
    return incommon.alike(result, phase, delay)
