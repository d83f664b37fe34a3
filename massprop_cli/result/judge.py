"""Test of a result against expectations; missing, not excited and unobservable quantities fail."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from massprop_cli import PIVOT
from massprop_cli.base.errors import InputError
from massprop_cli.result.schema import DockedObject, EstimateItem, ExpectationFile, Expected, ImpliedScale, PhaseItem, Result, implied_of

if TYPE_CHECKING:
    from massprop_cli.inputs.expect import Expectations, Wanted

_Kind = TypeVar("_Kind")
INFORMED = ("converged", "not_converged")
"""Verdicts of values that can meet an expectation."""


def judge(found: Result, expectations: Expectations) -> Result:
    """The result with the test of each estimate against its expectation; :class:`InputError` if an expected phase or object is missing."""
    names = [phase.name for phase in found.phases]
    own = _by_name(expectations, names)
    phases = [
        _phase(found, phase, _asked(expectations, items(phase), expectations.every | own.get(phase.name, {}))) for phase in found.phases
    ]
    docked = found.docked_object
    if expectations.docked and docked is None:
        raise InputError(
            f"{expectations.source}: expects a docked object, and the result has none; "
            "name the phases before and after docking in the vehicle file ([docking] before, after), or leave out docked"
        )
    if docked is not None:
        docked = docked.model_copy(
            update={"estimates": _estimates(docked.estimates, _asked(expectations, docked.estimates, expectations.docked))}
        )
    file = ExpectationFile(path=Path(expectations.source).name, sha256=expectations.sha256)
    return found.model_copy(update={"phases": phases, "docked_object": docked, "expectations": file})


def _asked(expectations: Expectations, estimates: dict[str, EstimateItem], wanted: dict[str, Wanted]) -> dict[str, Wanted]:
    """Expectations that apply to the estimates; of a simulation's truth, only those of observable quantities.

    :class:`InputError` if they are about a pivot and the result has none.
    """
    stranger = next((name for name in wanted if name not in estimates), None)
    if stranger is not None and not expectations.of_truth:
        raise InputError(f"{expectations.source}: expects {stranger}, and the result has no pivot; leave about_pivot out")
    asked = {name: one for name, one in wanted.items() if name in estimates}
    return {name: one for name, one in asked.items() if not (expectations.of_truth and estimates[name].verdict == "unobservable")}


def items(body: PhaseItem | DockedObject) -> dict[str, EstimateItem]:
    """Estimates of the ten quantities and of those about a pivot, the latter with a prefix."""
    return together(body.estimates, body.about_pivot if isinstance(body, PhaseItem) else {})


def together(ten: Mapping[str, _Kind], about_pivot: Mapping[str, _Kind]) -> dict[str, _Kind]:
    """The ten quantities and those about a pivot in one mapping, the latter with a prefix."""
    return {**ten, **{f"{PIVOT}{name}": item for name, item in about_pivot.items()}}


def apart(every: Mapping[str, _Kind]) -> tuple[dict[str, _Kind], dict[str, _Kind]]:
    """The inverse of :func:`together`."""
    ten = {name: item for name, item in every.items() if not name.startswith(PIVOT)}
    return ten, {name.removeprefix(PIVOT): item for name, item in every.items() if name.startswith(PIVOT)}


def _phase(found: Result, phase: PhaseItem, wanted: dict[str, Wanted]) -> PhaseItem:
    ten, about = apart(_estimates(items(phase), wanted))
    scale = phase.implied_thrust_scale or _implied(phase, wanted.get("mass"), implied_of(found.vehicle))
    return phase.model_copy(update={"estimates": ten, "about_pivot": about, "implied_thrust_scale": scale})


def _implied(phase: PhaseItem, mass: Wanted | None, of: str) -> ImpliedScale | None:
    """Thrust scale by which the estimated mass would be the expected one; None without either."""
    found = phase.estimates["mass"]
    if mass is None or found.value is None or found.sigma is None or not found.value > 0:
        return None
    scale = mass.value / found.value
    return ImpliedScale(by="expected mass", of=of, value=scale, sigma=scale * found.sigma / found.value)


def _by_name(expectations: Expectations, names: list[str]) -> dict[str, dict[str, Wanted]]:
    has = ", ".join(repr(name) for name in names)
    stated = [name for name, _ in expectations.phases]
    if stated and all(name is None for name in stated):
        if len(stated) != len(names):
            raise InputError(f"{expectations.source}: holds {len(stated)} phases without names; the result has {has}. Name each phase")
        stated = [*names]
    for name in stated:
        if name not in names:
            said = "has a phase without a name among named ones" if name is None else f"expects phase {name!r}, which the result lacks"
            raise InputError(f"{expectations.source}: {said}; the result has {has}. Name one of these")
    return {str(name): wanted for name, (_, wanted) in zip(stated, expectations.phases, strict=True)}


def _estimates(estimates: dict[str, EstimateItem], wanted: dict[str, Wanted]) -> dict[str, EstimateItem]:
    return {
        name: item.model_copy(update={"expected": _expected(name, item, wanted[name]) if name in wanted else None})
        for name, item in estimates.items()
    }


def _expected(name: str, item: EstimateItem, wanted: Wanted) -> Expected:
    tolerance = wanted.tolerance.absolute(wanted.value, item.sigma)
    difference = None if item.value is None else item.value - wanted.value
    informed = item.verdict in INFORMED and difference is not None
    return Expected(
        value=wanted.value,
        tolerance=tolerance,
        stated=wanted.tolerance.stated(name.removeprefix(PIVOT)),
        met=informed and abs(difference or 0.0) <= (tolerance or 0.0),
        difference=difference,
        sigmas=difference / item.sigma if difference is not None and item.sigma else None,
    )


def parts(found: Result) -> list[tuple[str, PhaseItem | DockedObject]]:
    """Title of each phase and of the docked object, with its estimates."""
    docked = found.docked_object
    return [
        *((f"phase {phase.name}", phase) for phase in found.phases),
        *([(f"docked object ({docked.after} less {docked.before})", docked)] if docked is not None else []),
    ]


def contradiction(body: PhaseItem | DockedObject) -> str:
    """Contradiction of a phase or docked object in words; empty without one."""
    return body.contradiction or next((item.reason for item in body.estimates.values() if item.verdict == "contradicted"), "")


def missed(found: Result) -> list[str]:
    """One phrase for each quantity that misses its expectation: quantity, expected value, estimate, tolerance."""
    return [
        f"{name} in {part}: {why(item, contradiction(body))}"
        for part, body in parts(found)
        for name, item in items(body).items()
        if item.expected is not None and not item.expected.met
    ]


def unpredicted(found: Result) -> dict[str, str]:
    """Failure of each cross-validated phase in words, by phase; empty for a phase that passes."""
    if found.provenance.settings.get("estimator.cross_validate") is None:
        return {}
    return {phase.name: _unpredicted(phase) for phase in found.phases}


def _unpredicted(phase: PhaseItem) -> str:
    tested = phase.cross_validation
    if tested is None:
        return f"phase {phase.name}: gives no estimate to cross-validate"
    if tested.passes:
        return ""
    worst = min(tested.segments, key=lambda one: one.p)
    return (
        f"phase {phase.name}: the other segments do not predict {worst.start_s:.4g} to {worst.end_s:.4g} s: chi-square "
        f"{worst.chi_square:.4g} of {worst.freedom}, p = {tested.p:.2g} with all segments counted, and the limit is {1 - tested.level:.2g}"
    )


def why(item: EstimateItem, contradiction: str = "") -> str:
    """Comparison of an estimate with its expectation in words; ``contradiction``: that of its phase."""
    expected = item.expected
    if expected is None:
        return ""
    allowed = "?" if expected.tolerance is None else f"{expected.tolerance:.3g}"
    wanted = f"expected {expected.value:.9g} ± {allowed} {item.unit}"
    by = f" ({expected.stated})" if expected.stated.endswith(("%", "sigma")) else ""
    if item.verdict == "contradicted":
        return f"{wanted}{by}, contradicted: {contradiction or item.reason}"
    if item.value is None or item.verdict not in INFORMED:
        return f"{wanted}{by}, missing: {item.verdict}, {item.reason}"
    off = "" if expected.sigmas is None else f", {expected.sigmas:+.3g} sigma"
    return f"{wanted}{by}, got {item.value:.9g} (off by {expected.difference:+.3g}{off})" + (
        "; its sigma is 0 or unknown, so a tolerance in sigmas accepts only the exact value"
        if expected.stated.endswith("sigma") and not item.sigma
        else ""
    )
