"""A campaign tested against an earlier one: log by log where both have it, and vehicle by vehicle in the pooled values."""

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

Numbers = tuple[float, float | None]
"""A value and its sigma."""


@dataclass(frozen=True)
class Earlier:
    """An earlier campaign."""

    campaign: Summary
    sha256: str
    """Of its campaign.json."""


def read(place: str) -> Earlier:
    """Read a campaign.json, or that of a folder; :class:`InputError` names what is wrong with it."""
    folder = not place.endswith(".json") if location.is_url(place) else Path(place).is_dir()
    file = location.join(place, "campaign.json") if folder else place
    content = location.read(file, "campaign.json")
    return Earlier(summary.parse(content, file), hashlib.sha256(content).hexdigest())


def phases(earlier: Earlier) -> list[str]:
    """Names of all phases that its logs have."""
    outcomes = (row.outcome for row in earlier.campaign.logs)
    return list(dict.fromkeys(body.name for found in outcomes if found for body in found.bodies if body.part == "phase"))


def compare(rows: Sequence[CampaignRow], earlier: Earlier, gate: Gate) -> Baseline:
    """What lies further from the baseline than the gate allows; the sigma of a difference is sqrt(s1² + s2²).

    What the baseline estimated and this campaign doesn't is beyond; what it lacks itself is not, unless it lacks everything.
    """
    old = earlier.campaign
    now = {row.name: n for n, row in enumerate(rows)}
    before = set()
    tells = False
    beyond: list[Beyond] = []
    for row in old.logs:
        if row.outcome is not None and row.outcome.bodies:
            before.add(row.name)
            tells |= any(_told(value) for body in row.outcome.bodies for value in body.items.values())
            beyond += _log(row.name, rows[now[row.name]] if row.name in now else None, row, gate)
    beyond += [] if tells else [_beyond("nothing to compare: no log of the baseline has a value")]
    pools = {Key.of(pool): pool for pool in pooled(rows)}
    beyond += [item for pool in old.pooled for item in _pool(pools.get(Key.of(pool)), pool, gate)]
    return Baseline(
        sha256=earlier.sha256,
        compared=len(before & now.keys()),
        new=[name for name in now if name not in before],
        beyond=beyond,
    )


def _log(name: str, now: CampaignRow | None, before: CampaignRow, gate: Gate) -> Iterator[Beyond]:
    if before.outcome is None:
        return
    vehicle = before.outcome.vehicle.name if before.outcome.vehicle else None
    if now is None or now.outcome is None or not now.outcome.bodies:
        why = "the log is not in this campaign" if now is None else "not tried" if now.outcome is None else now.outcome.message
        yield _beyond(f"{name}: has a result in the baseline, none here: {why}", log=name, vehicle=vehicle)
        return
    mine = {(body.part, body.name): body.items for body in now.outcome.bodies}
    for body in before.outcome.bodies:
        here, about = mine.get((body.part, body.name)), {"log": name, "vehicle": vehicle, "part": _title(body)}
        if here is None:
            yield _beyond(f"{name}: {_title(body)} is in the baseline, and not here", **about)
            continue
        for quantity, old in body.items.items():
            pair = _told(here.get(quantity)), _told(old)
            yield from _difference(f"{name}: ", quantity, *pair, gate.of(quantity, _phase(body)), about)


def _phase(body: PhaseQuantities | Pool) -> str | None:
    return None if body.part == "docked" else body.name


def _told(item: Value | None) -> Numbers | None:
    return (item.value, item.sigma) if item and item.verdict in INFORMED and item.value is not None else None


def _pool(now: Pool | None, before: Pool, gate: Gate) -> Iterator[Beyond]:
    where, about = f"vehicle {before.vehicle}, all logs: ", {"vehicle": before.vehicle, "part": _title(before)}
    for quantity, old in before.items.items():
        new = now.items.get(quantity) if now is not None else None
        if new is not None and new.value is not None and old.value is not None:  # else its logs say so already
            pair = (new.value, new.sigma), (old.value, old.sigma)
            yield from _difference(where, quantity, *pair, gate.of(quantity, _phase(before)), about)


def _difference(
    where: str, quantity: str, new: Numbers | None, old: Numbers | None, allowed: Tolerance, about: Mapping[str, str | None]
) -> Iterator[Beyond]:
    """The difference of one quantity where it is beyond its tolerance."""
    if old is None:
        return
    unit, said = ALL_UNITS[quantity], f"{where}{quantity} in {about['part']}: "
    if new is None:
        message = f"{said}{old[0]:.9g} {unit} in the baseline, missing here"
        yield _beyond(message, **about, quantity=quantity, baseline_value=old[0])
        return
    off = new[0] - old[0]
    sigma = math.hypot(new[1], old[1]) if new[1] is not None and old[1] is not None else None
    most = allowed.absolute(old[0], sigma) or 0.0
    if abs(off) <= most:
        return
    sigmas = off / sigma if sigma else None
    how = "" if sigmas is None else f", {sigmas:+.3g} sigma"
    message = (
        f"{said}{new[0]:.9g}, in the baseline {old[0]:.9g}, off by {off:+.3g} {unit}{how}, allowed {most:.3g} {unit} "
        f"({allowed.stated(quantity.removeprefix(PIVOT))})"
    )
    yield _beyond(message, **about, quantity=quantity, value=new[0], baseline_value=old[0], sigmas=sigmas)


def _beyond(message: str, **told: str | float | None) -> Beyond:
    return Beyond.model_validate(dict.fromkeys(Beyond.model_fields) | told | {"message": " ".join(message.split())})


def _title(body: PhaseQuantities | Pool) -> str:
    return f"phase {body.name}" if body.part == "phase" else f"docked object ({body.name})"
