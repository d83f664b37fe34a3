"""Results of sample logs that several reports are tested on, and one thread of linear algebra for each worker."""

import os
from collections.abc import Generator

# before anything imports numpy: on matrices this small a second thread only waits, and takes a core from the other worker
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import pytest
from hypothesis import HealthCheck, settings

from massprop_cli.result.read import Recorded
from tests.extras import optional
from tests.recording import record

# how long an example takes is the machine's affair, which may be busy with other tests
settings.register_profile("massprop", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("massprop")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None, None, None]:
    """A test whose fixtures need an absent package is skipped, or fails where all are to run."""
    with optional():
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    """The same of the test itself."""
    with optional():
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is thorough beside a quick case of the same test is run before a release, as what counts over many seeds is.

    A page whose blocks all run takes as long as hundreds of other tests: at the end one worker would wait for it.
    """
    thorough = [item.get_closest_marker("thorough") is not None for item in items]
    tests = [item.nodeid.partition("[")[0] for item in items]
    quick = {test for test, further in zip(tests, thorough, strict=True) if not further}
    for item, test, further in zip(items, tests, thorough, strict=True):
        if further and test in quick:
            item.add_marker(pytest.mark.seeds)
    items.sort(key=lambda item: "website" not in item.nodeid)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--kills", type=int, default=6, help="how often tests/cli/test_kill.py ends each command")


@pytest.fixture(scope="session")
def flyer(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("flyer"), "free-flyer/log.parquet")


@pytest.fixture(scope="session")
def docking(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("docking"), "docking/log.parquet")


@pytest.fixture
def worked_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Campaigns from Python start no processes, and their pages are without figures."""
    from massprop_cli import api
    from massprop_cli.report.figures import canvas
    from tests import campaigns

    monkeypatch.setattr(api, "LocalExecutor", campaigns.Here)
    monkeypatch.setattr(canvas, "render", campaigns.without_drawing)
