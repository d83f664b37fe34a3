"""Objects in MATLAB files: a timeseries gives its times and samples; of what can't be read the message says how to save it."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.base.errors import InputError
from massprop_cli.inputs.formats import listing, propose, reading, vectors
from massprop_cli.inputs.formats.recording import Recording

NONE = np.zeros((0, 0))
TIMES = np.arange(40)[:, None] * 0.05
RATES = np.random.default_rng(4).normal(size=(40, 3))


def opaque(name: str, **held: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of mat-io on pandas
        from matio.utils.matclass import MatlabOpaque

    return MatlabOpaque(held, classname=name)


def timeseries(data: Array, times: Any = TIMES, units: str = "seconds", first: bool = True, **info: Any) -> Any:
    """As MATLAB saves it: times are in its metadata, even ones as their beginning and step."""
    said = {"Units": np.array([units]), "Time_": times, "Increment_": NONE, "Start_": NONE} | info
    held = {
        "Data_": data,
        "Time_": NONE,
        "IsTimeFirst_": np.array([[first]]),
        "DataInfo": opaque("tsdata.datametadata", Units=np.array(["g"])),
    }
    return opaque("timeseries", TimeInfo=opaque("tsdata.timemetadata", **said), **held)


def saved(path: Path, variables: dict[str, Any], version: str = "v7") -> Recording:
    import matio

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), variables, version=version)
    return reading.load(path)


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_a_timeseries_gives_its_times_and_samples(version: str, tmp_path: Path) -> None:
    read = saved(tmp_path / "log.mat", {"run": {"acc": timeseries(RATES), "fx": timeseries(RATES[:, :1])}}, version)
    assert list(read.streams) == ["run.acc.Time", *(f"run.acc.Data(:,{n})" for n in (1, 2, 3)), "run.fx.Time", "run.fx.Data"]
    np.testing.assert_array_equal(read.streams["run.acc.Time"].values, TIMES.ravel())
    for n in range(3):
        one = read.streams[f"run.acc.Data(:,{n + 1})"]
        assert (one.clock, one.unit) == ("run.acc.Time", "g")
        np.testing.assert_array_equal(one.values, RATES[:, n])
    assert not read.unread


def test_times_that_are_a_beginning_and_a_step(tmp_path: Path) -> None:
    even: dict[str, Any] = {"Start_": np.array([[0.5]]), "Increment_": np.array([[0.25]]), "Length": np.array([[40.0]])}
    read = saved(tmp_path / "log.mat", {"w": timeseries(RATES, NONE, "minutes", **even)})
    clock = read.streams["w.Time"]
    assert clock.unit == "s"
    np.testing.assert_allclose(clock.values, 60 * (0.5 + 0.25 * np.arange(40)))


def test_times_in_whole_minutes_are_seconds_whatever_whole_numbers_they_are(tmp_path: Path) -> None:
    minutes = np.arange(40, dtype=np.uint8)[:, None]
    clock = saved(tmp_path / "log.mat", {"w": timeseries(RATES, minutes, "minutes")}).streams["w.Time"]
    np.testing.assert_array_equal(clock.values, 60.0 * np.arange(40))


def test_samples_in_columns_have_matlabs_index(tmp_path: Path) -> None:
    read = saved(tmp_path / "log.mat", {"w": timeseries(RATES.T.reshape(3, 1, 40), units="milliseconds", first=False)})
    assert read.streams["w.Time"].unit == "ms"
    found = [one for one in vectors.vectors(read) if one.axes == "012"]
    assert [one.paths for one in found] == [[f"w.Data({n},1,:)" for n in (1, 2, 3)]]
    np.testing.assert_array_equal(np.stack([one.values for one in found[0].streams], 1), RATES)


def test_a_timeseries_within_another_object_and_a_cell(tmp_path: Path) -> None:
    cell = np.empty((1, 1), dtype=object)
    cell[0, 0] = opaque("Simulink.SimulationData.Signal", Values=timeseries(RATES[:, :1]))
    read = saved(tmp_path / "log.mat", {"logsout": opaque("Simulink.SimulationData.Dataset", Elements=cell)})
    assert list(read.streams) == ["logsout.Elements{1}.Values.Time", "logsout.Elements{1}.Values.Data"]


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: timeseries(RATES, NONE), r"is a MATLAB timeseries without times"),
        (lambda: timeseries(RATES[:30]), r"is a MATLAB timeseries of 40 times and 30 x 3 numbers"),
        (lambda: opaque("lab.Recorder", Name=np.array(["imu"])), r"is a MATLAB object of class lab.Recorder, which only MATLAB reads"),
    ],
)
def test_what_cannot_be_read_says_how_to_save_it(made: Callable[[], Any], said: str, tmp_path: Path) -> None:
    remedy = r"s = struct\('time', ts.Time, 'data', ts.Data\); save\("
    with pytest.raises(InputError, match=rf"^[^\n]*log.mat, 'w': {said}; [^\n]*{remedy}[^\n]*$"):
        saved(tmp_path / "log.mat", {"w": made()})
    beside = saved(tmp_path / "log.mat", {"t": TIMES, "w": made()})
    assert list(beside.streams) == ["t"]
    assert [one.path for one in listing.listed(beside) if one.note.startswith("not read: it is a MATLAB ")] == ["w"]
    assert "# not read: 'w' is a MATLAB " in propose.draft(beside)
