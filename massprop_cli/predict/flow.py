"""Test of a result against a log that it was not made from."""

from pathlib import Path

import numpy as np

from massprop_cli.base.errors import InputError
from massprop_cli.combine import twice
from massprop_cli.job import Judged
from massprop_cli.predict.difference import Compared, compared
from massprop_cli.predict.document import PredictedQuantity, Prediction, PredictionSource, PredictionTest
from massprop_cli.predict.motion import explained
from massprop_cli.result.read import Recorded, check_same
from massprop_cli.result.schema import BY_OBJECT, PhaseItem, Result

_REMEDY = "Give the vehicle file that the result was made with (--vehicle), or make the result again"


def predict(recorded: Recorded, log: Path, judged: Judged, phase: str | None, limit: float) -> Prediction:
    """Test whether the values of a result predict an estimated log; :class:`InputError` if that cannot be tested."""
    told, own = recorded.result, judged.result
    _check_other(recorded, log, own)
    _check_alike(recorded, log, own)
    mine, theirs = chosen(recorded.path, told, phase), chosen(log, own, phase)
    pivoted = told.vehicle.environment == "pedestal"
    for path, item in ((recorded.path, mine), (log, theirs)):
        _check_told(path, item, pivoted)
    sides = (told.vehicle, mine), (own.vehicle, theirs)
    found = compared(*sides)
    if not found.freedom:
        raise InputError(
            f"{log}: has no estimated quantity in common with {recorded.path}, except known values; record the manoeuvres of the result's "
            "log, and estimate again"
        )
    number = next(i for i, one in enumerate(judged.analysis.conclusions) if one.phase.name == theirs.name)
    with np.errstate(all="ignore"):
        motion = explained(judged.analysis, number, sides)
    return Prediction(
        vehicle=told.vehicle.name,
        result=_source(recorded.path, told, mine),
        log=_source(log, own, theirs),
        test=PredictionTest(chi_square=found.chi_square, freedom=found.freedom, p=found.p, limit=limit, passes=found.p > 1 - limit),
        quantities=_quantities(found, mine, theirs, pivoted),
        motion=motion,
    )


def chosen(path: Path, of: Result, name: str | None) -> PhaseItem:
    """The only phase of a result, or the one with this name; :class:`InputError` if it does not exist."""
    phases = {one.name: one for one in of.phases}
    if len(phases) == 1:
        return of.phases[0]
    if name is None or name not in phases:
        said = f"no phase {name!r}; it has" if name is not None else "phases"
        raise InputError(f"{path}: has {said} {', '.join(phases)}. Name one with --phase")
    return phases[name]


def failure(found: Prediction) -> str:
    """Failure of the test in words; empty if the result predicts the log."""
    test = found.test
    if test.passes:
        return ""
    return (
        f"{found.result.path} does not predict {found.log.path}: chi-square {test.chi_square:.4g} of {test.freedom}, "
        f"p = {test.p:.2g}, and the limit is {1 - test.limit:.2g}"
    )


def contradicted(path: Path, item: PhaseItem) -> str:
    """Contradicted values of a phase in words; empty without any."""
    names = [name for name, one in (item.estimates | item.about_pivot).items() if one.verdict == "contradicted"]
    return f"{path}: {', '.join(names)} contradicted in phase {item.name}: {item.contradiction}" if names else ""


def _check_other(recorded: Recorded, log: Path, own: Result) -> None:
    made = own.provenance.input_sha256
    if made in twice.logs(recorded.result):
        raise InputError(f"{recorded.path}: was made from {log}, so the test proves nothing; name another log")
    if twice.alike(twice.values_and_sigmas(recorded.result), twice.values_and_sigmas(own)):
        raise InputError(
            f"{recorded.path}: all values and sigmas are those of {log}: the same recording in another file, so the test proves nothing; "
            "name another log"
        )


def _check_alike(recorded: Recorded, log: Path, own: Result) -> None:
    told = recorded.result
    for path, one in ((recorded.path, told), (log, own)):
        if one.provenance.method == "thesis":
            raise InputError(f"{path}: estimator.method is thesis, whose sigmas are not errors; use the default method")
    what = ("vehicle", "environment", "environment.bearing_position_m", "bearing mass [kg]", "thrust.scale_sigma")
    check_same(log, own, str(recorded.path), told, what, f"the result and the log are not of one vehicle. {_REMEDY}")


def _check_told(path: Path, item: PhaseItem, pivoted: bool) -> None:
    if item.implied_thrust_scale is not None and item.implied_thrust_scale.by == BY_OBJECT:
        raise InputError(
            f"{path}: an added object sets the scale of its values; multiply the forces (or wheels' inertia) of the vehicle file by "
            f"{item.implied_thrust_scale.value:.6g}, and name the result of a log estimated with these"
        )
    if pivoted and (not item.about_pivot or item.about_pivot_covariance is None):
        raise InputError(
            f"{path}: has no about_pivot with its covariance; name the result of one log on the pedestal, made by this version"
        )
    values = (item.about_pivot if pivoted else item.estimates).values()
    if all(one.value is None for one in values):
        raise InputError(f"{path}: gives no value in phase {item.name}: {next(iter(values)).reason}. Record a log that informs one")


def _source(path: Path, of: Result, item: PhaseItem) -> PredictionSource:
    made = of.provenance
    return PredictionSource(path=str(path), phase=item.name, input_sha256=sorted(twice.logs(of)), vehicle_sha256=made.vehicle_sha256)


def _quantities(found: Compared, mine: PhaseItem, theirs: PhaseItem, pivoted: bool) -> dict[str, PredictedQuantity]:
    items = {}
    for name, difference, sigma in zip(found.names, found.difference, found.sigma, strict=True):
        one, other = (side.about_pivot[name] if pivoted else side.estimates[name] for side in (mine, theirs))
        told = bool(np.isfinite(difference))
        items[name] = PredictedQuantity(
            unit=one.unit,
            result=one.value,
            result_sigma=one.sigma,
            log=other.value,
            log_sigma=other.sigma,
            difference=float(difference) if told else None,
            difference_sigma=float(sigma) if told else None,
        )
    return items
