"""The estimator in the loop: what the control takes is what its own past records said, and nothing before that has converged."""

from __future__ import annotations

import io
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import Kernel, kernel
from massprop_cli.live import legs, run
from massprop_cli.live.aboard import Aboard
from massprop_cli.live.legs import Compiled
from massprop_cli.live.onnumpy import OnNumPy
from massprop_cli.testbed import output, scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import Flight
from tests.analysed import SAMPLES
from tests.commandline import massprop

compiled = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
SEEDS = (1, 2, 3)
CUT_S = 40.0
"""Where the packaged plan has an edge, after the values have come into use."""


@cache
def flown(model: str, until_s: float = 100.0) -> tuple[ScenarioSource, Flight]:
    """The packaged scenario, or its beginning."""
    whole = scenario.load("docked-hold", [f"control.model={model}"]).scenario
    plan = [segment for segment in whole.plan if (segment.end_s or 0.0) <= until_s]
    beginning = whole.model_copy(update={"duration_s": until_s, "plan": tuple(plan)}) if until_s < 100.0 else whole
    source = ScenarioSource(beginning, "docked-hold")
    return source, simulate.fly(source, SEEDS, running=Aboard)


def heard(source: ScenarioSource, flight: Flight, member: int) -> list[dict[str, Any]]:
    """What massprop live says of the log that such a flight leaves."""
    text = io.BytesIO()
    pyarrow.csv.write_csv(output.log_table(flight, member, source.scenario), text)
    vehicle = vehiclefile.parse(output.vehicle_toml(flight.vehicle), "vehicle.toml")
    lines = text.getvalue().decode().splitlines(keepends=True)
    return [json.loads(line) for line in run.follow(lines, vehicle, io.StringIO().write, print)]


def first_change(flight: Flight, member: int) -> int:
    """The cycle in which a value that gains or CG are of is another one for the first time."""
    used = flight.modelled[member][:, [0, 3, 5, 6, 7, 8]]
    return int(np.argmax((used != used[0]).any(1)))


@compiled
@pytest.mark.parametrize("member", range(len(SEEDS)))
def test_the_control_takes_what_live_says_of_its_log_once_that_has_converged(member: int) -> None:
    """Live can't look ahead; within its sigmas the values are the truth's."""
    source, flight = flown("estimate")
    said, k = heard(source, flight, member), 0
    expected, sigmas = flight.modelled[member, 0].copy(), np.full(10, np.inf)
    for end, used in zip(flight.time_s[:-1], flight.modelled[member, 1:], strict=True):
        if k < len(said) and said[k]["time_s"] == pytest.approx(end):
            for i, name in enumerate(QUANTITIES):
                one = said[k]["estimates"][name]
                if one["verdict"] == "converged":
                    expected[i], sigmas[i] = one["value"], one["sigma"]
            k += 1
        with np.errstate(invalid="ignore"):
            assert (np.abs(used - expected) <= 1e-5 * sigmas)[np.isfinite(sigmas)].all()
        assert (used == expected)[~np.isfinite(sigmas)].all()
    assert k == len(said) - 1  # the last comes when there is nothing left to control
    assert np.isfinite(sigmas).all()
    assert (np.abs(flight.modelled[member, -1] - flight.truth[member, -1]) < 4 * sigmas).all()


@compiled
def test_before_a_value_has_converged_the_flight_is_the_frozen_one_to_the_last_bit() -> None:
    (_, frozen), (_, running) = flown("nominal"), flown("estimate")
    assert (frozen.modelled == frozen.modelled[:, :1]).all()
    for member in range(len(SEEDS)):
        first = first_change(running, member)
        assert 120 < first < 600
        assert np.array_equal(frozen.issued[member, :first], running.issued[member, :first])
        assert np.array_equal(frozen.delta_theta_rad[member, :first], running.delta_theta_rad[member, :first])
        assert np.array_equal(frozen.delta_v_m_s[member, :first], running.delta_v_m_s[member, :first])
        assert not np.array_equal(frozen.issued[member], running.issued[member])


@compiled
def test_a_flight_that_ends_sooner_begins_the_same() -> None:
    (_, whole), (_, cut) = flown("estimate"), flown("estimate", CUT_S)
    count = round(CUT_S / 0.05)
    assert cut.issued.shape[1] == count
    for name in ("issued", "delta_theta_rad", "delta_v_m_s", "modelled"):
        assert np.array_equal(getattr(whole, name)[:, :count], getattr(cut, name)), name
    assert (cut.modelled[:, -1] != cut.modelled[:, 0]).any(1).all()


@compiled
def test_following_the_estimate_points_better_than_the_frozen_gains() -> None:
    """In each of the seeds, from where the plan pushes."""

    def rms(model: str) -> Array:
        _, flight = flown(model)
        angle = 2 * np.degrees(np.linalg.norm(flight.attitude_wxyz[:, 801:, 1:], axis=-1))
        found: Array = np.sqrt((angle**2).mean(1))
        return found

    assert (rms("estimate") < 0.1 * rms("nominal")).all()
    assert np.abs(rms("estimate") / rms("truth") - 1).max() < 0.2


class Beside:
    """Both engines on one flight."""

    def __init__(self, resolved: Any) -> None:
        self.first, self.second, self.count = Compiled(resolved), OnNumPy(resolved), 0

    def begin(self, leg: Any) -> None:
        self.first.begin(leg)
        self.second.begin(leg)

    def step(self, numbers: Array) -> Any:
        return self._same(self.first.step(numbers), self.second.step(numbers))

    def last(self) -> Any:
        return self._same(self.first.last(), self.second.last())

    def _same(self, one: Any, other: Any) -> Any:
        assert (one is None) == (other is None)
        if one is not None:
            told = np.isfinite(one.values)
            assert (told == np.isfinite(other.values)).all()
            assert (np.abs(one.values - other.values)[told] < 1e-6 * one.sigmas[told]).all()
            assert other.sigmas[told] == pytest.approx(one.sigmas[told], rel=1e-6)
            assert (one.verdicts == other.verdicts).all()
        return one


def both(name: str, monkeypatch: pytest.MonkeyPatch, cycles: int, *assignments: str) -> list[Any]:
    """What is said of the first cycles of a sample log."""
    text = io.BytesIO()
    pyarrow.csv.write_csv(pyarrow.parquet.read_table(SAMPLES / name / "log.parquet").slice(0, cycles), text)
    source = vehiclefile.load(SAMPLES / name / "vehicle.toml", assignments)
    monkeypatch.setattr(legs, "Compiled", Beside)
    lines = text.getvalue().decode().splitlines(keepends=True)
    return [json.loads(line) for line in run.follow(lines, source, io.StringIO().write, print)]


@compiled
@pytest.mark.parametrize("name", ["free-flyer", "docking", "air-bearing"])
def test_numpy_says_cycle_by_cycle_what_the_kernel_says(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Delays of two cycles and of none, a gap between phases."""
    said = both(name, monkeypatch, 260, 'phases=[{name="a", start_s=0.0, end_s=6.0}, {name="b", start_s=7.0, end_s=100.0}]')
    assert {one["phase"] for one in said} == {"a", "b"}
    assert sum(e["verdict"] == "converged" for e in said[-1]["estimates"].values()) > 0


@compiled
def test_both_say_that_what_is_flown_is_another_vehicle(monkeypatch: pytest.MonkeyPatch) -> None:
    """Delay of a twentieth of a cycle less than flown: every value that is told is contradicted, none ever called converged."""
    said = both("free-flyer", monkeypatch, 120, "cycle.command_delay_cycles=1.95")
    verdicts = [[e["verdict"] for e in one["estimates"].values()] for one in said]
    assert set(verdicts[-1]) - {"untold"} == {"contradicted"}
    assert not any("converged" in each for each in verdicts)


@compiled
@pytest.mark.parametrize("key", ["gyro_noise_rad_s", "accel_noise_m_s2"])
@pytest.mark.parametrize(("too_small", "contradicted"), [(1.1, False), (1.4, True)])
def test_either_sensors_noise_contradicts_where_it_is_stated_a_fifth_too_small_or_more(
    key: str, too_small: float, contradicted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1.5 in variance; over some hundred cycles 1.1 and 1.4 in sigma are three sigma of chance from that, and more."""
    noise = getattr(vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml").vehicle.imu, key)
    said = both("free-flyer", monkeypatch, 160, f"imu.{key}={noise / too_small}")
    assert any(e["verdict"] == "contradicted" for e in said[-1]["estimates"].values()) == contradicted


@compiled
def test_without_a_compiler_numpy_flies_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    source, flight = flown("estimate", CUT_S)
    monkeypatch.setattr(legs, "kernel", lambda: Kernel(None, "NumPy"))
    again = simulate.fly(source, SEEDS[:1], running=Aboard)
    assert np.array_equal(again.issued[0], flight.issued[0])
    assert again.modelled[0] == pytest.approx(flight.modelled[0], rel=1e-8)


REFUSED = {
    "vehicle.cycle.command_delay_cycles=auto": "cycle.command_delay_cycles must be stated",
    "vehicle.imu.gyro_noise_rad_s=0.0": "imu.gyro_noise_rad_s must be stated",
    "vehicle.drift.mass=0.1": "[drift] is stated, and the kernel knows none",
    "vehicle.thrust.lag_s=0.01": "thrust.lag_s is not 0, and the kernel knows no lag",
    "vehicle.cycle.command_delay_cycles=25.0": "a delay of 25 cycles, and the kernel holds 19",
    "vehicle.estimator.method=thesis": "estimator.method is 'thesis', and the kernel is the default one",
    "vehicle.cycle.command_delay_sigma_cycles=0.1": "the kernel takes them as exact",
}


@pytest.mark.parametrize("setting", REFUSED)
def test_a_vehicle_that_no_running_estimate_can_hold_is_refused(setting: str, tmp_path: Path) -> None:
    command = ["simulate", "docked-hold", "--out", "flown", "--set", setting]
    found = massprop(tmp_path, *command, *(["--set", "actuators.delay_cycles=2.0"] if "auto" in setting else []))
    assert found.returncode == 3
    assert REFUSED[setting] in found.stderr
    assert 'control.model = "estimate"' in found.stderr
    assert len(found.stderr.strip().splitlines()) <= 1 + found.stderr.count("warning")
    assert not (tmp_path / "flown").exists()


def test_the_estimator_is_handed_one_vehicle_for_each_member() -> None:
    vehicle = scenario.load("docked-hold").scenario.logged
    found = Aboard(vehicle, "here", 3)
    assert [phase.name for phase in vehicle.phases] == ["single", "combined"]
    assert len(found.each) == 3
