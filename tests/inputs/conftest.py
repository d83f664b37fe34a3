"""Recordings are read in forks here, as importing a library anew for each file takes a second; tests of the process itself say so."""

import pytest

from massprop_cli.inputs.formats import isolated
from tests.targets import forked


@pytest.fixture(autouse=True)
def _readers_in_forks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.node.get_closest_marker("apart") is None:
        monkeypatch.setattr(isolated, "run_reader", forked)
