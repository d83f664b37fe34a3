"""Comparison of a result with a baseline, in units and in sigmas of the difference, ``sqrt(s1² + s2²)``."""

import math
from collections import Counter
from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from massprop_cli import PIVOT, QUANTITIES
from massprop_cli.conclude.reason import Reason
from massprop_cli.conclude.verdict import Verdict
from massprop_cli.inputs.tolerancefile import Gate
from massprop_cli.result.judge import INFORMED, items, parts
from massprop_cli.result.read import Recorded, check_same
from massprop_cli.result.schema import Conventions, EstimateItem, Item, Result


class ComparedSide(Item):
    """Result or baseline."""

    path: str = Field(description="folder and name of the result.json")
    massprop: str
    input_sha256: str
    vehicle_sha256: str


class Difference(Item):
    """Difference of one quantity, result minus baseline."""

    unit: str
    value: float | None
    sigma: float | None
    verdict: Verdict
    baseline_value: float | None
    baseline_sigma: float | None
    baseline_verdict: Verdict
    difference: float | None = Field(description="null: one of the values is missing")
    difference_sigma: float | None = Field(description="root sum square of both sigmas")
    sigmas: float | None = Field(description="difference over its sigma; null without a sigma, unless the difference is 0")
    tolerance: float | None = Field(description="allowed difference in the quantity's unit; null: it is in sigmas and there is no sigma")
    stated: str = Field(description='tolerance as stated, such as "4 sigma"')
    within: bool
    note: str


class ComparedPart(Item):
    """Comparison of a phase or of the docked object."""

    part: Literal["phase", "docked"]
    name: str
    compared: int = Field(description="number of quantities with a value in both")
    differences: dict[str, Difference]

    @property
    def title(self) -> str:
        """The name in tables and messages."""
        return f"phase {self.name}" if self.part == "phase" else self.name


class Comparison(Item):
    """Document that ``massprop compare --json`` prints."""

    schema_: Literal["massprop/compare/1"] = Field("massprop/compare/1", alias="schema")
    result: ComparedSide
    baseline: ComparedSide
    conventions: Conventions
    within: bool = Field(
        description=(
            "at least one quantity was compared, every difference is within its tolerance, and no value of the baseline is missing"
        )
    )
    compared: int = Field(description="number of quantities with a value in both, all parts together")
    parts: list[ComparedPart]
    notes: list[str]
    warnings: list[str] = Field(description="parts without any compared quantity")


def compare(result: Recorded, baseline: Recorded, gate: Gate) -> Comparison:
    """Compare a result with a baseline; :class:`InputError` unless both have the same vehicle and phases."""
    _check_alike(result, baseline)
    gate.check([phase.name for phase in result.result.phases])
    before = {key: items(body) for key, body in parts(baseline.result)}
    after = {key: items(body) for key, body in parts(result.result)}
    found, empty = [], []
    for key in dict.fromkeys([*before, *after]):
        docked = not key.startswith("phase ")
        name = key.removeprefix("phase ")
        names = dict.fromkeys([*QUANTITIES, *after.get(key, {}), *before.get(key, {})])
        pairs = {q: (after.get(key, {}).get(q), before.get(key, {}).get(q)) for q in names}
        differences = {q: _difference(q, new, old, gate, None if docked else name) for q, (new, old) in pairs.items()}
        both = sum(d.difference is not None for d in differences.values())
        found.append(ComparedPart(part="docked" if docked else "phase", name=name, compared=both, differences=differences))
        empty += [] if both else [_nothing(found[-1].title, after.get(key), before.get(key))]
    compared = sum(part.compared for part in found)
    return Comparison(
        result=_side(result),
        baseline=_side(baseline),
        conventions=result.result.conventions,
        within=compared > 0 and all(d.within for part in found for d in part.differences.values()),
        compared=compared,
        parts=found,
        notes=_notes(result.result, baseline.result),
        warnings=empty,
    )


def _nothing(title: str, new: Mapping[str, EstimateItem] | None, old: Mapping[str, EstimateItem] | None) -> str:
    """Message about a part in which no quantity has a value in both results."""
    counts = [{"absent": len(QUANTITIES)} if side is None else Counter(item.verdict for item in side.values()) for side in (new, old)]
    here, there = (", ".join(f"{n} {verdict}" for verdict, n in each.items()) for each in counts)
    return f"nothing could be compared in {title}: no quantity has a value in both (result: {here}; baseline: {there})"


def _side(recorded: Recorded) -> ComparedSide:
    made = recorded.result.provenance
    path = f"{recorded.name}/{recorded.path.name}"
    return ComparedSide(path=path, massprop=made.massprop, input_sha256=made.input_sha256, vehicle_sha256=made.vehicle_sha256)


def _check_alike(result: Recorded, baseline: Recorded) -> None:
    """Raise :class:`InputError` if the values have different meanings; the vehicle files may differ otherwise."""
    new, old = result.result, baseline.result
    what = ["vehicle", "environment", "bearing mass [kg]", "phases", "inertia about", "products of inertia"]
    what += ["docked object"] if new.docked_object and old.docked_object else []
    so = "their values are not comparable. Name a baseline of the same vehicle and phases"
    check_same(result.path, new, f"the baseline {baseline.path}", old, what, so)


def _notes(new: Result, old: Result) -> list[str]:
    made, before = new.provenance, old.provenance
    one_log = "both results are of one log and share its noise: sigmas of differences are too large, and differences have other causes"
    thesis = "sigmas of --method thesis are not errors: give tolerances in units or per cent"
    notes = {
        one_log: made.input_sha256 == before.input_sha256,
        "the vehicle files differ": made.vehicle_sha256 != before.vehicle_sha256,
        f"made by massprop {made.massprop} and {before.massprop}": made.massprop != before.massprop,
        f"made by the methods {made.method} and {before.method}": made.method != before.method,
        thesis: "thesis" in (made.method, before.method),
    }
    return [note for note, so in notes.items() if so]


def _difference(quantity: str, new: EstimateItem | None, old: EstimateItem | None, gate: Gate, phase: str | None) -> Difference:
    new, old = new or _absent(old), old or _absent(new)
    tolerance = gate.of(quantity, phase)
    value, before = _informed_value(new), _informed_value(old)
    difference = None if value is None or before is None else value - before
    sigma = None if difference is None or new.sigma is None or old.sigma is None else math.hypot(new.sigma, old.sigma)
    allowed = None if difference is None else tolerance.absolute(before or 0.0, sigma)
    return Difference(
        unit=new.unit,
        value=new.value,
        sigma=new.sigma,
        verdict=new.verdict,
        baseline_value=old.value,
        baseline_sigma=old.sigma,
        baseline_verdict=old.verdict,
        difference=difference,
        difference_sigma=sigma,
        sigmas=None if difference is None else 0.0 if difference == 0 else difference / sigma if sigma else None,
        tolerance=allowed,
        stated=tolerance.stated(quantity.removeprefix(PIVOT)),
        within=before is None if difference is None else abs(difference) <= (allowed or 0.0),
        note=_missing(new, old)
        or ("no sigma: only an equal value is within the tolerance" if tolerance.kind == "sigma" and not sigma else ""),
    )


def _informed_value(item: EstimateItem) -> float | None:
    """Value of an informed quantity; None otherwise."""
    return item.value if item.verdict in INFORMED else None


def _missing(new: EstimateItem, old: EstimateItem) -> str:
    said = [
        (("contradicted" if item.verdict == "contradicted" else "missing"), which)
        for item, which in ((new, "the result"), (old, "the baseline"))
        if _informed_value(item) is None
    ]
    if len({how for how, _ in said}) == 1 and len(said) == 2:
        return f"{said[0][0]} in both"
    return ", ".join(f"{how} in {which}" for how, which in said)


def _absent(other: EstimateItem | None) -> EstimateItem:
    """Placeholder for a quantity that one of the results does not have."""
    unit = other.unit if other else ""
    reason = str(Reason("no-docked-object"))
    return EstimateItem(
        value=None, sigma=None, unit=unit, verdict="not_excited", final_at_s=None, reason=reason, reason_code="no-docked-object"
    )


def failure(found: Comparison) -> str:
    """Reason why the result fails the comparison, in words; empty if it passes. A comparison without values fails."""
    missed = beyond(found)
    reasons = [f"beyond the baseline: {'; '.join(missed)}"] if missed else []
    return ". ".join([*([] if found.compared else ["; ".join(found.warnings)]), *reasons])


def beyond(found: Comparison) -> list[str]:
    """One phrase for each quantity beyond its tolerance."""
    return [f"{quantity} in {part.title}: {_why(d)}" for part in found.parts for quantity, d in part.differences.items() if not d.within]


def _why(d: Difference) -> str:
    if d.difference is None:
        return f"{d.baseline_value:.9g} {d.unit} in the baseline, {d.note} ({d.verdict})"
    sigmas = "" if d.sigmas is None else f", {d.sigmas:+.3g} sigma"
    allowed = "nothing" if d.tolerance is None else f"{d.tolerance:.3g} {d.unit}"
    off = f"off by {d.difference:+.3g} {d.unit}{sigmas}, allowed {allowed} ({d.stated})"
    return f"{d.value:.9g}, in the baseline {d.baseline_value:.9g}, {off}"
