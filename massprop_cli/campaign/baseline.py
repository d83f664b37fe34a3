"""Comparison of a campaign with an earlier one, the baseline: each log, and the pooled values of each vehicle."""

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from massprop_cli import ALL_UNITS, PIVOT
from massprop_cli.base.dataclass import dataclass
from massprop_cli.campaign import location, summary
from massprop_cli.campaign.outcome import CampaignRow, PhaseQuantities, Value
from massprop_cli.campaign.pooled import Key, Pool, pooled
from massprop_cli.campaign.summary import Baseline, Beyond, Summary
from massprop_cli.inputs.tolerance import Tolerance
from massprop_cli.inputs.tolerancefile import Gate
from massprop_cli.result.judge import INFORMED

ValueSigma = tuple[float, float | None]
"""A value and its sigma, SI."""


@dataclass(frozen=True)
class Earlier:
    """An earlier campaign."""

    campaign: Summary
    sha256: str
    """Digest of its campaign.json."""


def read(place: str) -> Earlier:
    """Read a campaign.json, or the one in a folder; raise :class:`InputError` if it cannot be read."""
    folder = not place.endswith(".json") if location.is_url(place) else Path(place).is_dir()
    file = location.join(place, "campaign.json") if folder else place
    content = location.read(file, "campaign.json")
    return Earlier(summary.parse(content, file), hashlib.sha256(content).hexdigest())


def phases(earlier: Earlier) -> list[str]:
    """Names of all phases in the logs of an earlier campaign."""
    outcomes = (row.outcome for row in earlier.campaign.logs)
    return list(dict.fromkeys(body.name for outcome in outcomes if outcome for body in outcome.bodies if body.part == "phase"))


def compare(rows: Sequence[CampaignRow], earlier: Earlier, gate: Gate) -> Baseline:
    """List the differences from the baseline that exceed the tolerances; the sigma of a difference is sqrt(s1² + s2²).

    A value that only the baseline has exceeds its tolerance, and one that only this campaign has does not. A baseline without any value is
    one difference.
    """
    baseline = earlier.campaign
    index = {row.name: n for n, row in enumerate(rows)}
    estimated = set()
    has_values = False
    beyond: list[Beyond] = []
    for row in baseline.logs:
        if row.outcome is not None and row.outcome.bodies:
            estimated.add(row.name)
            has_values |= any(_reported(value) for body in row.outcome.bodies for value in body.items.values())
            beyond += _log(row.name, rows[index[row.name]] if row.name in index else None, row, gate)
    beyond += [] if has_values else [_beyond("nothing to compare: no log of the baseline has a value")]
    pools = {Key.of(pool): pool for pool in pooled(rows)}
    beyond += [item for pool in baseline.pooled for item in _pool(pools.get(Key.of(pool)), pool, gate)]
    return Baseline(
        sha256=earlier.sha256,
        compared=len(estimated & index.keys()),
        new=[name for name in index if name not in estimated],
        beyond=beyond,
    )


def _log(name: str, now: CampaignRow | None, before: CampaignRow, gate: Gate) -> Iterator[Beyond]:
    """Differences of one log."""
    if before.outcome is None:
        return
    vehicle = before.outcome.vehicle.name if before.outcome.vehicle else None
    if now is None or now.outcome is None or not now.outcome.bodies:
        why = "the log is not in this campaign" if now is None else "not tried" if now.outcome is None else now.outcome.message
        yield _beyond(f"{name}: has a result in the baseline, none here: {why}", log=name, vehicle=vehicle)
        return
    new_items = {(body.part, body.name): body.items for body in now.outcome.bodies}
    for body in before.outcome.bodies:
        items, about = new_items.get((body.part, body.name)), {"log": name, "vehicle": vehicle, "part": _title(body)}
        if items is None:
            yield _beyond(f"{name}: {_title(body)} is in the baseline, and not here", **about)
            continue
        for quantity, old in body.items.items():
            pair = _reported(items.get(quantity)), _reported(old)
            yield from _difference(f"{name}: ", quantity, *pair, gate.of(quantity, _phase(body)), about)


def _phase(body: PhaseQuantities | Pool) -> str | None:
    """Name of the phase, None for a docked object."""
    return None if body.part == "docked" else body.name


def _reported(item: Value | None) -> ValueSigma | None:
    """Value and sigma, None without a value or where the data do not inform it."""
    return (item.value, item.sigma) if item and item.verdict in INFORMED and item.value is not None else None


def _pool(now: Pool | None, before: Pool, gate: Gate) -> Iterator[Beyond]:
    """Differences of one vehicle's pooled values."""
    where, about = f"vehicle {before.vehicle}, all logs: ", {"vehicle": before.vehicle, "part": _title(before)}
    for quantity, old in before.items.items():
        new = now.items.get(quantity) if now is not None else None
        if new is not None and new.value is not None and old.value is not None:  # a missing value is already listed for its logs
            pair = (new.value, new.sigma), (old.value, old.sigma)
            yield from _difference(where, quantity, *pair, gate.of(quantity, _phase(before)), about)


def _difference(
    where: str, quantity: str, new: ValueSigma | None, old: ValueSigma | None, allowed: Tolerance, about: Mapping[str, str | None]
) -> Iterator[Beyond]:
    """The difference of one quantity if it exceeds its tolerance."""
    if old is None:
        return
    unit, prefix = ALL_UNITS[quantity], f"{where}{quantity} in {about['part']}: "
    if new is None:
        message = f"{prefix}{old[0]:.9g} {unit} in the baseline, missing here"
        yield _beyond(message, **about, quantity=quantity, baseline_value=old[0])
        return
    difference = new[0] - old[0]
    sigma = math.hypot(new[1], old[1]) if new[1] is not None and old[1] is not None else None
    limit = allowed.absolute(old[0], sigma) or 0.0
    if abs(difference) <= limit:
        return
    sigmas = difference / sigma if sigma else None
    in_sigmas = "" if sigmas is None else f", {sigmas:+.3g} sigma"
    message = (
        f"{prefix}{new[0]:.9g}, in the baseline {old[0]:.9g}, off by {difference:+.3g} {unit}{in_sigmas}, allowed {limit:.3g} {unit} "
        f"({allowed.stated(quantity.removeprefix(PIVOT))})"
    )
    yield _beyond(message, **about, quantity=quantity, value=new[0], baseline_value=old[0], sigmas=sigmas)


def _beyond(message: str, **fields: str | float | None) -> Beyond:
    """The difference with its message on one line; fields not given are null."""
    return Beyond.model_validate(dict.fromkeys(Beyond.model_fields) | fields | {"message": " ".join(message.split())})


def _title(body: PhaseQuantities | Pool) -> str:
    """Part of the vehicle as messages name it."""
    return f"phase {body.name}" if body.part == "phase" else f"docked object ({body.name})"
