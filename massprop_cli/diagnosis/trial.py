"""A supposition put to the test: applied to log and vehicle file, which are reduced anew, until its values stand."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.diagnosis import causes
from massprop_cli.diagnosis.contest import Fitted, fitted
from massprop_cli.diagnosis.cures import Case, applied
from massprop_cli.diagnosis.look import FITS, Look, about_its_body, at_once, looked
from massprop_cli.diagnosis.suppositions import ENTRIES, Model
from massprop_cli.diagnosis.whitening import Disturbance
from massprop_cli.estimate.phases import as_stated
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.stream import Stream

CLOSE = 1.4
"""Times pure error, beyond six sigmas of chance, that a log that is mended may leave: its motion within the cycles is its body's."""
NEARLY, PART = 6.0, 1e-3
"""Mended, it fits as well with up to so many times pure error, if that is so small a part of what was left before."""
BETTER = 0.2
"""Part of what was left before below which a case is worth a fit by the estimator itself."""
CURVED = frozenset({"gyro_turn", "gyro_scale", "gyro_bias", "tilt", "delay", "rise", "lag", "gyro_lag", "accel_lag", "drift"})
"""Entries of x by which what is measured changes along no straight line."""
HOPELESS, SMALL = 20.0, 0.01
"""Times pure error, and part of what was left before, above which a supposition about anything else won't make the log fit."""
NO_DRIFT = (0.01, 5.0)
"""Cycles over the stretch, and sigmas, below which clocks don't drift apart."""
AGAIN = 8
"""How often one is applied anew from where it led."""
STILL = 0.01
"""A change of −2 log likelihood that ends that."""


@dataclass(frozen=True)
class Trial:
    """A supposition, how it is mended, and what it leaves."""

    fitted: Fitted
    case: Case
    excess: float
    """−2 log likelihood beyond that of free coefficients, with the price of its freedom."""
    score: float
    """−2 log likelihood of what was measured, with that price."""
    fits: bool
    look: Look | None = None
    """What is left of the log as mended; None where that can't be written down."""
    units: float = 0.0
    """−2 log of how densely the mended measurements lie where they were measured."""


def hopeless(look: Look, found: Fitted) -> bool:
    """Whether what it leaves in the first reduction, which is as good as exact for what it is about, is far too much."""
    turned = any((turn != np.eye(3)).any() for turn in (found.supposed.gyro, found.supposed.accelerometer))
    moved = {name for name in ENTRIES if found.supposed.free[found.model.place(name)].any()}
    left = float(found.chi_square.sum() / look.freedom)
    return not turned and not moved & CURVED and left > max(HOPELESS, SMALL * look.misfit)


def tried(look: Look, found: Fitted) -> Trial | None:
    """A supposition with its best values in log and vehicle file; None where it makes them another testbed's."""
    case = applied(look.case, found, look.free.fired)
    if case is None:
        look, found = _once_more(look, found)
        excess = look.score(found.chi_square, found)
        return Trial(found, look.case, excess, look.free_cost + excess, _passes(look, found))
    return refined(look, found, case)


def _once_more(look: Look, found: Fitted) -> tuple[Look, Fitted]:
    """Fitted to a reduction about its own body, where that leaves less."""
    theta = found.value("theta")
    about = looked(look.case, look.piece, look.free.beside, theta)
    if about is None:
        return look, found
    (again,) = fitted(about.model, about.free, about.free.variance, [found.supposed], theta)
    better = about.free_cost + about.likelihood(again.chi_square) < look.free_cost + look.likelihood(found.chi_square)
    return (about, again) if better else (look, found)


def _passes(look: Look, found: Fitted) -> bool:
    """Whether the log fits so far as the small step to it tells: of what can't be put into log or vehicle file."""
    freedom = look.freedom - found.unknowns
    left = float(found.chi_square.sum() / freedom)
    return left < FITS[0] + FITS[1] * np.sqrt(2 / freedom) and (left < PART * look.misfit or not look.loud)


def refined(look: Look, found: Fitted, case: Case) -> Trial | None:
    """What is left once the case is reduced anew, its unknowns moved on from there until they stand.

    First beside the disturbance that it was found with: a misfit may hide behind that, and without it the way is too steep.
    """
    found, case, mended = _led(look, found, case, look.free.beside)
    if mended is not None and look.free.beside:
        found, case, mended = _led(look, found, case, ())
    if mended is None:
        return None
    found = replace(found, chi_square=mended.stated.chi_square)
    if at_once(found):
        x = found.x.copy()
        thrust = look.model.place("thrust")
        x[thrust] = np.where(x[thrust] == 1.0, 1.0, x[thrust].round())
        found = replace(found, x=x)
        case = applied(look.case, found, look.free.fired) or case
    much = mended.misfit < PART * look.misfit
    close = mended.misfit < CLOSE + FITS[1] * np.sqrt(2 / mended.freedom)
    fits = (close and not mended.loud) or (much and (mended.fits or mended.misfit < NEARLY))
    fits = fits or (mended.misfit < BETTER * look.misfit and _explained_by_engine(case, look.piece))
    fits = fits and not _no_drift(found)
    excess = mended.score(mended.stated.chi_square, found)
    units = _by_units(mended, found)
    return Trial(found, case, excess, mended.free_cost + excess + units, fits, mended, units)


def _no_drift(found: Fitted) -> bool:
    """Whether a drift of the clocks is none beside the delay that is supposed with it: then it is the delay alone."""
    drift = abs(float(found.value("drift")[0]))
    own = found.supposed.code == "clock-drift"
    return own and drift < max(NO_DRIFT[0], NO_DRIFT[1] * float(found.spread[-1]) * causes.EXPECTED["drift"])


def _led(look: Look, found: Fitted, case: Case, likely: tuple[Disturbance, ...]) -> tuple[Fitted, Case, Look | None]:
    """A supposition moved on until it stands, beside one of the ``likely`` disturbances, or what is likeliest now."""
    mended = looked(case, look.piece, likely, found.value("theta") if found.unknowns else None)
    if mended is None or mended.model.places != look.model.places:
        return found, case, None
    if not found.unknowns:
        return found, case, about_its_body(mended)
    for _ in range(AGAIN):
        (more,) = fitted(mended.model, mended.free, mended.free.variance, [found.supposed], found.value("theta"))
        found = replace(found, spread=more.spread * np.sqrt(max(mended.misfit, 1.0)))
        if mended.likelihood(mended.stated.chi_square) - mended.likelihood(more.chi_square) < STILL:
            break
        further = replace(found, x=_together(found.x, more.x, look.model))
        then = applied(look.case, further, look.free.fired)
        there = None if then is None else looked(then, look.piece, mended.free.beside, more.value("theta"))
        if then is None or there is None or there.cost > mended.cost - STILL:
            break
        found, case, mended = further, then, there
    return found, case, mended


def _together(x: Array, more: Array, model: Model) -> Array:
    """Both changes of x one after the other; the second was found with the first in place."""
    found = more.copy()
    own = slice(10, None)
    found[own] = x[own] + more[own] - model.stated[own]
    thrust = model.place("thrust")
    found[thrust] = x[thrust] * more[thrust]
    return found


def _by_units(mended: Look, found: Fitted) -> float:
    """−2 log of the density of mended measurements in the units and along the axes of the measured."""
    supposed, free = found.supposed, mended.free
    sensors = (("gyro_scale", supposed.gyro, free.gyro), ("accel_scale", supposed.accelerometer, free.accelerometer))
    return float(sum(2 * told.spare * (found.value(name).sum() + np.log(abs(np.linalg.det(turn)))) for name, turn, told in sensors))


def _explained_by_engine(case: Case, piece: slice) -> bool:
    """Whether the stated noise explains an off-line fit of a piece, as exact as the estimator is."""
    log, vehicle, timing = case
    phase = Phase(name="piece", start_s=0.0, end_s=1.0)
    try:
        return not as_stated(Stream.of(log, vehicle, timing), [(phase, piece)], vehicle, Consider()).dubious
    except np.linalg.LinAlgError:
        return False
