"""Figures of a result, by name, as SVG or PNG.

A picture is made of panels (:mod:`panel`), each of which says in words what it shows; :mod:`canvas` draws them.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable

from massprop_cli import CG, INERTIA
from massprop_cli.errors import UsageError
from massprop_cli.report import words
from massprop_cli.report.figures import canvas, correlation, ellipsoid, estimates, excitation, innovations, signals
from massprop_cli.report.figures.canvas import Kind
from massprop_cli.report.figures.panel import Picture
from massprop_cli.report.figures.recording import only
from massprop_cli.report.read import Recorded

_PICTURES: dict[str, Callable[[Recorded], Picture]] = {
    "inertia": lambda recorded: estimates.picture(recorded, INERTIA, "Inertia against time", 3),
    "cg": lambda recorded: estimates.picture(recorded, CG, "Centre of gravity against time", 3),
    "mass": lambda recorded: estimates.picture(recorded, ("mass",), "Mass against time", 1),
    "torque": lambda recorded: signals.picture(recorded, "torque"),
    "force": lambda recorded: signals.picture(recorded, "force"),
    "rate": lambda recorded: signals.picture(recorded, "rate"),
    "acceleration": lambda recorded: signals.picture(recorded, "acceleration"),
    "innovations": innovations.picture,
    "excitation": excitation.picture,
    "correlation": correlation.picture,
    "ellipsoid": ellipsoid.picture,
}
NAMES: tuple[str, ...] = tuple(_PICTURES)
"""Figures there are."""


def picture(name: str, recorded: Recorded, phase: str | None = None) -> Picture:
    """The panels of a figure, of all phases or one.

    :class:`UsageError` for an unknown name or phase; :class:`InputError` where a figure against time finds no history.parquet.
    """
    if name not in _PICTURES:
        nearest = difflib.get_close_matches(name, NAMES, n=1)
        meant = f"; did you mean {nearest[0]}?" if nearest else ""
        raise UsageError(f"no figure {name!r}{meant} There are {', '.join(NAMES)}")
    return _PICTURES[name](recorded if phase is None else only(recorded, phase))


def draw(name: str, recorded: Recorded, kind: Kind, phase: str | None = None) -> bytes:
    """The figure as SVG or PNG; same result, same bytes. Errors as :func:`picture`."""
    found = picture(name, recorded, phase)
    of_phase = f", phase {words.clean(phase, 24)}" if phase is not None else ""
    title = f"{found.title}: {words.clean(recorded.result.vehicle.name, 40)}, {words.clean(recorded.result.log.path, 40)}{of_phase}"
    return canvas.render(found.panels, kind, found.columns, title)


__all__ = ["NAMES", "Kind", "Picture", "draw", "picture"]
