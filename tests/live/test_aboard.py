"""The estimator in the loop: what the control takes is what its own past records said, and nothing before that has converged."""

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
from massprop_cli.base.errors import InputError
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import Kernel, kernel
from massprop_cli.live import estimator, run
from massprop_cli.live.estimator import KernelEstimator, OnboardEstimator
from massprop_cli.live.numpyestimator import NumPyEstimator
from massprop_cli.testbed import output, scenario, simulate
from massprop_cli.testbed.scenario import ScenarioSource
from massprop_cli.testbed.simulate import SimulatedFlight
from tests.analysed import SAMPLES
from tests.commandline import massprop

compiled = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
SEEDS = (1, 2, 3)
END_S = {"estimate": 60.0, "nominal": 50.0, "truth": 50.0}
"""The first when all has converged, the others when the plan has pushed for ten seconds."""
CUT_S = 21.0
"""Values have come into use, and nothing is drawn yet."""


def beginning(model: str, until_s: float) -> ScenarioSource:
    """Of the packaged scenario."""
    whole = scenario.load("docked-hold", [f"control.model={model}"]).scenario
    plan = [segment for segment in whole.plan if (segment.start_s or 0.0) < until_s]
    return ScenarioSource(whole.model_copy(update={"duration_s": until_s, "plan": tuple(plan)}), "docked-hold")


@cache
def flown(model: str) -> tuple[ScenarioSource, SimulatedFlight]:
    source = beginning(model, END_S[model])
    return source, simulate.fly(source, SEEDS, running=OnboardEstimator)


def heard(source: ScenarioSource, flight: SimulatedFlight, member: int) -> list[dict[str, Any]]:
    """What massprop live says of the log that such a flight leaves."""
    text = io.BytesIO()
    pyarrow.csv.write_csv(output.log_table(flight, member, source.scenario), text)
    vehicle = vehiclefile.parse(output.vehicle_toml(flight.vehicle), "vehicle.toml")
    lines = text.getvalue().decode().splitlines(keepends=True)
    return [json.loads(line) for line in run.follow(lines, vehicle, io.StringIO().write, print)]


def first_change(flight: SimulatedFlight, member: int) -> int:
    """The cycle in which a value that gains or CG are of is another one for the first time."""
    used = flight.modelled[member][:, [0, 3, 5, 6, 7, 8]]
    return int(np.argmax((used != used[0]).any(1)))


@pytest.mark.seeds
@pytest.mark.thorough
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


@pytest.mark.thorough
@pytest.mark.seeds
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
        assert not np.array_equal(frozen.issued[member], running.issued[member, : frozen.issued.shape[1]])


def same_so_far(cut: SimulatedFlight, member: int) -> bool:
    """What is commanded and sensed in a member's flight alone that ends sooner, where values have come into use."""
    _, whole = flown("estimate")
    count = cut.issued.shape[1]
    assert (cut.modelled[0, -1] != cut.modelled[0, 0]).any()
    names = ("issued", "delta_theta_rad", "delta_v_m_s")
    return all(np.array_equal(getattr(whole, name)[member, :count], getattr(cut, name)[0]) for name in names)


@pytest.mark.seeds
@compiled
@pytest.mark.thorough
def test_a_flight_that_ends_sooner_begins_the_same() -> None:
    cut = simulate.fly(beginning("estimate", CUT_S), SEEDS[2:], running=OnboardEstimator)
    assert cut.issued.shape[1] == round(CUT_S / 0.05)
    assert same_so_far(cut, 2)
    assert np.array_equal(cut.modelled[0], flown("estimate")[1].modelled[2, : cut.modelled.shape[1]])


@pytest.mark.seeds
@pytest.mark.thorough
@compiled
def test_following_the_estimate_points_better_than_the_frozen_gains() -> None:
    """In each of the seeds, from two seconds after the plan begins to push."""

    def rms(model: str) -> Array:
        _, flight = flown(model)
        angle = 2 * np.degrees(np.linalg.norm(flight.attitude_wxyz[:, 841:1001, 1:], axis=-1))
        found: Array = np.sqrt((angle**2).mean(1))
        return found

    assert (rms("estimate") < 0.1 * rms("nominal")).all()
    assert np.abs(rms("estimate") / rms("truth") - 1).max() < 0.2


class Beside:
    """Both engines on one flight."""

    def __init__(self, resolved: Any) -> None:
        self.first, self.second, self.count = KernelEstimator(resolved), NumPyEstimator(resolved), 0

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


def said_of(name: str, cycles: int, *assignments: str, engine: type = Beside) -> list[Any]:
    """What is said of the first cycles of a sample log."""
    text = io.BytesIO()
    pyarrow.csv.write_csv(pyarrow.parquet.read_table(SAMPLES / name / "log.parquet").slice(0, cycles), text)
    source = vehiclefile.load(SAMPLES / name / "vehicle.toml", assignments)
    lines = text.getvalue().decode().splitlines(keepends=True)
    with pytest.MonkeyPatch.context() as other:
        other.setattr(estimator, "KernelEstimator", engine)
        return [json.loads(line) for line in run.follow(lines, source, io.StringIO().write, print)]


@compiled
@pytest.mark.parametrize("name", ["free-flyer", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("air-bearing", "docking"))])
def test_numpy_says_cycle_by_cycle_what_the_kernel_says(name: str) -> None:
    """Delays of two cycles, a gap between phases."""
    said = said_of(name, 200, 'phases=[{name="a", start_s=0.0, end_s=2.0}, {name="b", start_s=2.5, end_s=100.0}]')
    assert {one["phase"] for one in said} == {"a", "b"}
    assert sum(e["verdict"] == "converged" for e in said[-1]["estimates"].values()) > 0


@pytest.mark.thorough
@compiled
def test_both_say_that_what_is_flown_is_another_vehicle() -> None:
    """Delay of a twentieth of a cycle less than flown: every value that is told is contradicted, none ever called converged."""
    said = said_of("free-flyer", 120, "cycle.command_delay_cycles=1.95")
    verdicts = [[e["verdict"] for e in one["estimates"].values()] for one in said]
    assert set(verdicts[-1]) - {"untold"} == {"contradicted"}
    assert not any("converged" in each for each in verdicts)


@compiled
@pytest.mark.parametrize("key", ["gyro_noise_rad_s", "accel_noise_m_s2"])
@pytest.mark.parametrize(("too_small", "contradicted"), [(1.1, False), (1.4, True)])
def test_either_sensors_noise_contradicts_where_it_is_stated_a_fifth_too_small_or_more(
    key: str, too_small: float, contradicted: bool
) -> None:
    """1.5 in variance; over some hundred cycles 1.1 and 1.4 in sigma are three sigma of chance from that, and more."""
    noise = getattr(vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml").vehicle.imu, key)
    said = said_of("free-flyer", 160, f"imu.{key}={noise / too_small}", engine=KernelEstimator)
    assert any(e["verdict"] == "contradicted" for e in said[-1]["estimates"].values()) == contradicted


@compiled
def test_a_contradicted_sigma_is_wider_by_what_the_innovations_show() -> None:
    """Gyro noise stated 1.4 times too small: the moments' sigmas are those of the right noise, within the chance of some hundred cycles."""
    noise = vehiclefile.load(SAMPLES / "free-flyer" / "vehicle.toml").vehicle.imu.gyro_noise_rad_s
    assert noise is not None
    right, small = (
        said_of("free-flyer", 300, f"imu.gyro_noise_rad_s={one}", engine=KernelEstimator)[-1]["estimates"] for one in (noise, noise / 1.4)
    )
    for name in ("ixx", "iyy", "izz"):
        assert small[name]["verdict"] == "contradicted"
        assert small[name]["sigma"] == pytest.approx(right[name]["sigma"], rel=0.15)


@pytest.mark.seeds
@pytest.mark.thorough
@compiled
def test_without_a_compiler_numpy_flies_the_same_and_does_not_look_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimator, "kernel", lambda: Kernel(None, "NumPy"))
    again = simulate.fly(beginning("estimate", CUT_S), SEEDS[2:], running=OnboardEstimator)
    assert same_so_far(again, 2)
    assert again.modelled[0] == pytest.approx(flown("estimate")[1].modelled[2, : again.modelled.shape[1]], rel=1e-8)


REFUSED = {
    "vehicle.cycle.command_delay_cycles=auto": "cycle.command_delay_cycles must be stated",
    "vehicle.imu.gyro_noise_rad_s=0.0": "imu.gyro_noise_rad_s must be stated",
    "vehicle.drift.mass=0.1": "[drift] is stated, but the kernel does not support it",
    "vehicle.imu.gyro_filter={order=1, cutoff_hz=40.0}": "needs unfiltered IMU increments",
    "vehicle.cycle.command_delay_cycles=25.0": "a delay of 25 cycles, but the limit of the kernel is 19",
    "vehicle.estimator.method=thesis": "estimator.method is 'thesis', but the kernel supports only the default method",
    "vehicle.cycle.command_delay_sigma_cycles=0.1": "the kernel assumes exact values",
}


@pytest.mark.parametrize("setting", REFUSED)
def test_a_vehicle_that_no_running_estimate_can_hold_is_refused(setting: str) -> None:
    source = scenario.load("docked-hold", [setting, *(["actuators.delay_cycles=2.0"] if "auto" in setting else [])])
    with pytest.raises(InputError) as refused:
        simulate.fly(source, SEEDS, running=OnboardEstimator)
    assert REFUSED[setting] in str(refused.value)
    assert 'control.model = "estimate"' in str(refused.value)


def test_its_refusal_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    setting = next(iter(REFUSED))
    found = massprop(tmp_path, *("simulate", "docked-hold", "--out", "flown", "--set", setting, "--set", "actuators.delay_cycles=2.0"))
    assert found.returncode == 3
    assert REFUSED[setting] in found.stderr
    assert len(found.stderr.strip().splitlines()) <= 1 + found.stderr.count("warning")
    assert not (tmp_path / "flown").exists()


def test_the_estimator_is_handed_one_vehicle_for_each_member() -> None:
    vehicle = scenario.load("docked-hold").scenario.logged
    found = OnboardEstimator(vehicle, "here", 3)
    assert [phase.name for phase in vehicle.phases] == ["single", "combined"]
    assert len(found.estimators) == 3
