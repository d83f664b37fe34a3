"""Results that several tests of pages look at, and pages whose figures are left blank."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

import pytest

from massprop_cli.report import figures, html
from massprop_cli.report.figures import canvas
from massprop_cli.result.read import Recorded
from tests.campaigns import without_drawing
from tests.recording import record
from tests.report.page import Page

Drawing = Callable[[str], bytes]
"""A figure's SVG by the figure's name."""


@pytest.fixture(scope="session")
def refined(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("refined"), "scenarios/refined/log.parquet")


@pytest.fixture(scope="session")
def bearing(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("bearing"), "air-bearing/log.parquet")


@pytest.fixture(scope="session")
def thesis(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("thesis"), "free-flyer/log.parquet", 'estimator.method="thesis"')


@pytest.fixture(scope="session")
def flyer_drawing(flyer: Recorded) -> Drawing:
    """The free flyer's figures, each drawn once."""
    return cache(lambda name: figures.draw(name, flyer, "svg"))


@pytest.fixture(scope="session")
def flyer_page(flyer: Recorded) -> Page:
    """Without its figures."""
    with blank():
        return Page(html.page([flyer]))


@pytest.fixture(scope="session")
def docking_page(docking: Recorded) -> Page:
    """Without its figures."""
    with blank():
        return Page(html.page([docking]))


@pytest.fixture
def blank_figures() -> Iterator[None]:
    with blank():
        yield


@contextmanager
def blank() -> Iterator[None]:
    """Pages without their figures: drawing takes most of a page's time, and says nothing of the rest."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(canvas, "render", without_drawing)
        yield
