"""What ``--require`` says: the quantities that must be converged."""

from __future__ import annotations

from collections.abc import Sequence

from massprop_cli import QUANTITIES
from massprop_cli.errors import UsageError

ALL = "all"


def quantities(stated: str | Sequence[str] | None) -> tuple[str, ...]:
    """Names with commas between, or a sequence of names, as quantities in their order; upper and lower case alike, "all" for the ten.

    :class:`UsageError` names what is no quantity.
    """
    names = [] if stated is None else stated.split(",") if isinstance(stated, str) else [*stated]
    named = {name.strip().lower(): name.strip() for name in names}
    for name, written in named.items():
        if name not in (*QUANTITIES, ALL):
            raise UsageError(f"--require {written}: no such quantity; choose from {', '.join(QUANTITIES)} or {ALL}")
    return tuple(quantity for quantity in QUANTITIES if quantity in named or ALL in named)
