"""history.parquet as written, tested against the analysis and result.json."""

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from massprop_cli.base.errors import InputError
from massprop_cli.result.historyfile import EXECUTED
from massprop_cli.result.read import Recorded, read
from tests.analysed import SAMPLES, analysed
from tests.faulty import sample
from tests.recording import record

AXES = "xyz"


def columns(recorded: Recorded, phase: str, *names: str) -> np.ndarray:
    return np.column_stack([recorded.history[phase][name] for name in names])


EDITS: dict[str, tuple[str, Callable[[list[float]], list[object]], str]] = {
    "a number beyond all": ("ixx", lambda values: [1e308, *values[1:]], "holds numbers beyond 1e+150"),
    "a sigma below 0": ("ixx_sigma", lambda values: [-1.0, *values[1:]], "is below 0"),
    "no time": ("time_s", lambda values: [*values[:-1], float("nan")], "does not increase"),
    "time that goes back": ("time_s", lambda values: [*values[1:], values[0]], "does not increase"),
    "lists": ("ixx", lambda values: [[value] for value in values], "holds no numbers"),
}


@pytest.mark.parametrize("name", EDITS)
def test_a_history_that_nobody_could_draw_is_refused(name: str, flyer: Recorded, tmp_path: Path) -> None:
    column, edit, words = EDITS[name]
    shutil.copy(flyer.path, tmp_path)
    table = pq.read_table(flyer.path.with_name("history.parquet"))
    index = table.column_names.index(column)
    pq.write_table(table.set_column(index, column, pa.array(edit(table.column(column).to_pylist()))), tmp_path / "history.parquet")
    with pytest.raises(InputError, match=f"history.parquet: {column} in phase all {re.escape(words)}; it was edited"):
        read(tmp_path)


def test_whitened_innovations_are_those_that_the_fit_is_judged_by(docking: Recorded) -> None:
    for phase in docking.result.phases:
        z = columns(docking, phase.name, *(f"whitened_{kind}_{axis}" for kind in ("rate", "specific_force") for axis in AXES))
        told, found = z[np.isfinite(z).all(1)], phase.innovations
        assert found is not None
        assert len(told) == found.cycles
        assert (told**2).sum(1).mean() == pytest.approx(found.nis)
        assert (told**2).mean(0) == pytest.approx(found.channel_variance)


def test_predicted_and_its_residual_make_what_was_measured(flyer: Recorded) -> None:
    found = analysed("free-flyer")
    residual = found.settled[0].residual
    assert residual is not None
    measured = columns(flyer, "all", *(f"rate_{a}_rad_s" for a in AXES), *(f"specific_force_{a}_m_s2" for a in AXES))
    predicted = columns(flyer, "all", *(f"predicted_rate_{a}_rad_s" for a in AXES), *(f"predicted_specific_force_{a}_m_s2" for a in AXES))
    assert measured - predicted == pytest.approx(residual.value, abs=1e-12, nan_ok=True)
    assert flyer.history["all"]["predicted_rate_y_sigma_rad_s"] == pytest.approx(residual.sigma[:, 1], nan_ok=True)


def test_what_jets_executed_is_what_the_log_commands_two_cycles_later(flyer: Recorded) -> None:
    """These jets rise and fall at once."""
    log, used = sample("free-flyer")
    for j, jet in enumerate(used.jets):
        executed = flyer.history["all"][f"{EXECUTED}{jet.name}_s"]
        assert (jet.rise_s, jet.fall_s) == (0.0, 0.0)
        assert executed == pytest.approx(log.command[: len(executed), j], abs=1e-12)


def test_the_thesis_predicts_neither_rates_nor_specific_force(tmp_path_factory: pytest.TempPathFactory) -> None:
    assert (SAMPLES / "high-rate").is_dir()
    thesis = record(tmp_path_factory.mktemp("thesis"), "high-rate/log.parquet", 'estimator.method="thesis"')
    (told,) = thesis.history.values()
    assert np.isnan(told["predicted_rate_x_rad_s"]).all()
    assert np.isfinite(told["specific_force_x_m_s2"]).all()
