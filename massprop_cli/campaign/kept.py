"""What a campaign keeps of a result: values, sigmas, and how much of each sigma all logs of a vehicle file share."""

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


def vehicle(found: Result) -> outcome.StatedVehicle:
    """The vehicle's name and what its values mean."""
    stated = found.vehicle
    return outcome.StatedVehicle(
        name=stated.name,
        sha256=found.provenance.vehicle_sha256,
        environment=stated.environment,
        bearing_mass_kg=stated.bearing_mass_kg,
    )


def stated(source: VehicleSource) -> outcome.StatedVehicle:
    """The vehicle of a vehicle file, where there is no result."""
    of = source.vehicle
    bearing = of.environment.bearing_mass_kg if of.on_air_bearing else 0.0
    return outcome.StatedVehicle(name=of.name, sha256=source.sha256, environment=of.environment.kind, bearing_mass_kg=bearing)


def of_result(
    found: Result, unmet: Unmet, bodies: list[PhaseQuantities], files: list[str], method: str, fingerprint: str = outcome.UNKEPT
) -> outcome.Outcome:
    """The outcome of a log, or of several, with a result."""
    return outcome.Outcome(
        fingerprint=fingerprint,
        exit_code=unmet.exit_code,
        message=line(unmet.message),
        input_sha256=found.provenance.input_sha256,
        vehicle=vehicle(found),
        method=method,
        duration_s=found.log.duration_s,
        cycles=found.log.cycles,
        delay_cycles=found.delay.cycles,
        warnings=[warning.code for warning in found.warnings],
        missed=unmet.phrases,
        bodies=bodies,
        files=files,
    )


def expected(found: Sequence[ExpectedQuantity]) -> list[PhaseQuantities]:
    """Sigmas and verdicts, without values, that a check expects of each phase."""
    phases: dict[str, dict[str, Value]] = {}
    for one in found:
        phases.setdefault(one.phase, {})[one.quantity] = Value(value=None, sigma=one.sigma, verdict=one.verdict, met=one.reached)
    split = {name: apart(every) for name, every in phases.items()}
    return [PhaseQuantities(part="phase", name=name, estimates=ten, about_pivot=about) for name, (ten, about) in split.items()]


def bodies(found: Result, used: Vehicle, stated: Vehicle) -> list[PhaseQuantities]:
    """Phases and docked object; of the vehicle as it was ``used``, and as its file states it."""
    thesis = used.estimator.method == "thesis"
    alike = {phase.name: _stated(found, phase, used, stated) for phase in found.phases}
    kept = [_phase(phase, None if thesis else used, alike[phase.name]) for phase in found.phases]
    docked = found.docked_object
    if docked is not None:
        # of what is known, or uncertain, of both phases the share in their difference isn't told; no part of the object stays behind with a
        # bearing, so the scale has no say in its CG
        told = not (thesis or docked.known or any(phase.known or alike[phase.name].any() for phase in found.phases))
        name = f"{docked.after} less {docked.before}"
        by = by_scale_beside(values(docked.estimates), 0.0, np.zeros(3))
        common = in_common(by, np.array(docked.covariance, dtype=float), {}, used) if told else None
        kept.append(PhaseQuantities(part="docked", name=name, estimates=_values(docked.estimates, common, np.zeros(10))))
    return kept


def joint_bodies(found: Result) -> list[PhaseQuantities]:
    """The bodies of a result of several logs; its sigmas include what the logs share, not stated apart."""
    kept = [_phase(phase, None, np.zeros(10)) for phase in found.phases]
    docked = found.docked_object
    return kept + (
        [] if docked is None else [PhaseQuantities(part="docked", name="object", estimates=_values(docked.estimates, None, np.zeros(10)))]
    )


def _phase(phase: PhaseItem, used: Vehicle | None, alike: Array) -> PhaseQuantities:
    """A phase with its shared sigmas, where the vehicle as it was ``used`` is given; ``alike`` (10,)."""
    own = _values(phase.estimates, None if used is None else shared(phase, used), alike)
    pivot = (None, np.zeros(9)) if used is None or not phase.about_pivot else shared_about_pivot(phase, used, alike)
    return PhaseQuantities(part="phase", name=phase.name, estimates=own, about_pivot=_values(phase.about_pivot, *pivot))


def _values(estimates: Mapping[str, EstimateItem], common: Array | None, alike: Array) -> dict[str, Value]:
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
    """(10,) sigma of what the scale and what is known make of every log's error alike; NaN where there is no value."""
    known = {name: sigma for name, (_, sigma) in phase.known.items()}
    return in_common(by_scale(values(phase.estimates), used), np.array(phase.covariance, dtype=float), known, _doubted(phase, used))


def shared_about_pivot(phase: PhaseItem, used: Vehicle, alike: Array) -> tuple[Array, Array]:
    """(9,) the same about the pivot, and what logs may have ``alike`` (10,) there; without the ten, the nine scale with the thrust."""
    known, doubted = {name: sigma for name, (_, sigma) in phase.known.items()}, _doubted(phase, used)
    onto = incommon.by_ten_about_pivot(phase, used.bearing_mass_kg, np.array(used.environment.bearing_position_m))
    more = incommon.alike_about_pivot(alike, onto)
    if onto is not None:
        return in_common(by_scale(values(phase.estimates), used), np.array(phase.covariance, dtype=float), known, doubted, onto), more
    if known and not used.on_pedestal:
        return np.full(9, np.nan), more
    return in_common(values(phase.about_pivot), np.array(phase.about_pivot_covariance, dtype=float), known, doubted), more


def _doubted(phase: PhaseItem, used: Vehicle) -> Vehicle:
    """The vehicle with the thrust as uncertain as the discrepancy of its log makes it; no log shows an error common to all thrust."""
    beyond = phase.discrepancy.thrust_scale_sigma if phase.discrepancy else 0.0
    sigma = float(np.hypot(used.thrust.scale_sigma, beyond))
    return used.model_copy(update={"thrust": used.thrust.model_copy(update={"scale_sigma": sigma})})


def _stated(found: Result, phase: PhaseItem, used: Vehicle, stated: Vehicle) -> Array:
    """(10,) sigma that all logs may share beside scale and known values; of a stated delay's sigma s that a log narrows to V, V²/s."""
    given, left = stated.cycle.command_delay_sigma_cycles, used.cycle.command_delay_sigma_cycles
    delay = left**2 / given if given > 0 and stated.cycle.command_delay_cycles != "auto" else 0.0
    return incommon.alike(found, phase, delay)
