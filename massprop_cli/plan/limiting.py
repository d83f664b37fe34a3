"""The limit that keeps a precision from being reached, and about how much more of it would reach it."""

from massprop_cli.plan import limits as limited
from massprop_cli.plan.planner import ENOUGH, Planned

LESS = 0.95
"""Part of a ratio that a plan with any impulse must come below for the impulse to be what limits: seeds and guesses differ by less."""


def remedy(found: Planned, ratio: float) -> str:
    """How much more of what limits would reach a precision that is missed ``ratio`` times: as a sentence goes on."""
    return _impulse(found, ratio) or _time(found, ratio)


def _impulse(found: Planned, ratio: float) -> str:
    """What more impulse would reach; empty where the impulse does not limit."""
    allowed, freely = found.limits.get("impulse_n_s"), found.any_impulse
    if allowed is None or freely is None:
        return ""
    remaining = float(freely.ratios()[-1].max())
    if freely.used["impulse_n_s"] <= allowed or remaining > LESS * ratio:
        return ""
    longer = max(remaining, 1.0) ** 2
    # that plan spends freely; information also grows with the impulse of the one at hand
    needed = min(freely.used["impulse_n_s"] * longer / ENOUGH, allowed * ratio**2)
    reached = f" with {allowed:g} N s; about {needed:.3g} N s"
    if longer == 1.0:
        return f"{reached} would reach it (--max-impulse)"
    return f"{reached} in {freely.duration_s * longer:.3g} s would reach it (--max-impulse, --max-time)"


def _time(found: Planned, ratio: float) -> str:
    """How long would reach it: information grows with the time."""
    share = {key: found.used[key] / limit for key, limit in found.limits.items() if key != "impulse_n_s"}
    gentle = any(stretch.motion.level < 1 for stretch in found.stretches)
    by = f" with the limit on the {limited.NAMES[max(share, key=lambda key: share[key])]}" if share and gentle else ""
    return f"{by}; about {found.duration_s * ratio**2:.3g} s would reach it (--max-time)"
