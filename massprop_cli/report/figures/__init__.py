"""Figures of a result by name, as SVG or PNG: panels (:mod:`panel`) with alternative texts, rendered by :mod:`canvas`."""

import difflib
from collections.abc import Callable

from massprop_cli import CG, INERTIA
from massprop_cli.base.errors import UsageError
from massprop_cli.base.escape import line
from massprop_cli.report.figures import (
    canvas,
    command,
    comparison,
    correlation,
    ellipsoid,
    estimates,
    excitation,
    firing,
    innovations,
    prediction,
    settling,
    signals,
    whiteness,
)
from massprop_cli.report.figures.canvas import Kind
from massprop_cli.report.figures.panel import Picture, nothing
from massprop_cli.report.figures.recording import only
from massprop_cli.result.read import Recorded

_PICTURES: dict[str, tuple[str, Callable[[Recorded], Picture]]] = {
    "inertia": ("Inertia against time", lambda recorded: estimates.picture(recorded, INERTIA, 3)),
    "cg": ("Centre of gravity against time", lambda recorded: estimates.picture(recorded, CG, 3)),
    "mass": ("Mass against time", lambda recorded: estimates.picture(recorded, ("mass",), 1)),
    "settling": ("How the estimates settled", settling.picture),
    "expectations": ("Values against what was expected", comparison.against_expected),
    "rate-fit": ("Rate, measured against predicted", lambda recorded: prediction.picture(recorded, "rate")),
    "force-fit": ("Specific force, measured against predicted", lambda recorded: prediction.picture(recorded, "specific_force")),
    "command-fit": ("Residuals against the command", command.picture),
    "whiteness": ("Whiteness of the innovations", whiteness.picture),
    "firing": ("Thrust of each jet", firing.picture),
    "torque": ("Control torques", lambda recorded: signals.picture(recorded, "torque")),
    "force": ("Force commands", lambda recorded: signals.picture(recorded, "force")),
    "rate": ("Rates", lambda recorded: signals.picture(recorded, "rate")),
    "acceleration": ("Compensated accelerations", lambda recorded: signals.picture(recorded, "acceleration")),
    "innovations": ("Innovations", innovations.picture),
    "excitation": ("Excitation", excitation.picture),
    "correlation": ("Correlation of the estimates", correlation.picture),
    "ellipsoid": ("Equivalent inertia ellipsoid", ellipsoid.picture),
}
NAMES: tuple[str, ...] = tuple(_PICTURES)
"""Names of all figures."""
WITHOUT_TIME = ("expectations", "correlation", "ellipsoid")
"""Figures that do not need history.parquet."""
TITLES = {name: title for name, (title, _) in _PICTURES.items()}
"""Title of each figure."""


def picture(name: str, recorded: Recorded, phase: str | None = None) -> Picture:
    """Panels of a figure, for all phases or one.

    Raise :class:`UsageError` for an unknown figure or phase, and :class:`InputError` without history.parquet.
    """
    if name not in _PICTURES:
        nearest = difflib.get_close_matches(name, NAMES, n=1)
        meant = f" did you mean {nearest[0]}?" if nearest else ""
        raise UsageError(f"no figure {name!r};{meant} there are {', '.join(NAMES)}")
    found = _PICTURES[name][1](recorded if phase is None else only(recorded, phase))
    return found if found.panels else Picture(found.caption, (nothing("the log lacks the sensor of this figure"),))


def draw(name: str, recorded: Recorded, kind: Kind) -> bytes:
    """The figure as SVG or PNG; equal results give equal bytes. Errors as :func:`picture`."""
    found = picture(name, recorded)
    title = f"{TITLES[name]}: {line(recorded.result.vehicle.name, 40)}, {line(recorded.result.log.path, 40)}"
    return canvas.render(found.panels, kind, found.columns, title)


__all__ = ["NAMES", "TITLES", "WITHOUT_TIME", "Kind", "Picture", "draw", "picture"]
