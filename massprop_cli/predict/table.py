"""Terminal output of ``massprop predict``."""

from rich.console import Console

from massprop_cli.base import escape
from massprop_cli.predict.document import Explained, MotionItem, Prediction
from massprop_cli.predict.motion import ALL
from massprop_cli.report import digits
from massprop_cli.report.fit import fitted, titled

_WORDS = ("", "unit", "channel", "manoeuvre")


def show(found: Prediction, console: Console) -> None:
    """Print the test, the values of result and log, and the part of the motion that both explain."""
    test = found.test
    console.print(escape.rich(f"{found.vehicle}: {found.result.path}, phase {found.result.phase}, against {found.log.path}"))
    _quantities(found, console)
    console.print("± is one sigma; that of the difference excludes errors that both share. z is the difference over its sigma.")
    if found.motion:
        _motion([one for one in found.motion if one.manoeuvre == ALL], console)
        _manoeuvres(found.motion, console)
        console.print(
            "explained: part of the motion's mean square. residual: rms of measured − predicted; expected: from the log's noise. nis: mean "
            "square of normalised innovations, with values assumed exact; 1 is expected for the log's own values."
        )
    verdict = "Predicted" if test.passes else "Not predicted"
    console.print(f"{verdict}: chi-square {test.chi_square:.4g} of {test.freedom}, p = {test.p:.2g}; it passes above {1 - test.limit:.2g}.")


def _quantities(found: Prediction, console: Console) -> None:
    table = titled("values", ("", "result", "± result", "log", "± log", "difference", "± difference", "z", "unit"), _WORDS)
    for name, one in found.quantities.items():
        difference, sigma = digits.numbers(one.difference, one.difference_sigma)
        z = digits.ABSENT if one.difference is None or not one.difference_sigma else f"{one.difference / one.difference_sigma:+.2f}"
        of = (*digits.numbers(one.result, one.result_sigma), *digits.numbers(one.log, one.log_sigma))
        table.add_row(name, *of, difference, sigma, z, one.unit)
    fitted(table, console, ("± log", "± result"))


def _motion(items: list[MotionItem], console: Console) -> None:
    names = ("explained", "by log's values", "motion rms", "residual", "by log's", "expected", "unit", "nis", "log's nis")
    table = titled("motion explained", ("channel", *names), _WORDS)
    for one in items:
        rms = [one.motion_rms, one.result.residual_rms, one.log.residual_rms, one.result.expected_rms]
        nis = (digits.figures(by.mean_square, 3) for by in (one.result, one.log))
        table.add_row(one.channel, _percent(one.result), _percent(one.log), *(digits.figures(each, 3) for each in rms), one.unit, *nis)
    fitted(table, console, ("motion rms", "by log's"))


def _manoeuvres(items: list[MotionItem], console: Console) -> None:
    channels = list(dict.fromkeys(one.channel for one in items))
    table = titled("nis by manoeuvre", ("manoeuvre", "cycles", *channels), _WORDS)
    for manoeuvre in dict.fromkeys(one.manoeuvre for one in items):
        by = {one.channel: one for one in items if one.manoeuvre == manoeuvre}
        cells = (digits.figures(by[name].result.mean_square, 3) if name in by else digits.ABSENT for name in channels)
        table.add_row(manoeuvre, str(max(one.cycles for one in by.values())), *cells)
    fitted(table, console)


def _percent(of: Explained) -> str:
    """Explained part in percent, with two digits of the unexplained part."""
    return digits.ABSENT if of.percent is None else f"{digits.numbers(of.percent, max(100 - of.percent, 1e-9))[0]} %"
