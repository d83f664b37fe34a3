"""A wrong assumption is told by the log where a look at all that is left tells nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import flow
from massprop_cli.conclude import assumptions, score
from massprop_cli.conclude.verdict import in_doubt
from massprop_cli.estimate.rows import AssumptionResponse
from massprop_cli.flow import Analysis
from massprop_cli.inputs.telemetry import Log
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource, changed
from massprop_cli.prepare.actuators import along_one_line, channel_names
from tests.flown import RANDOM, fly, sound

SEED = 3
pytestmark = pytest.mark.numerical


def examined(log: Log, used: Vehicle) -> Analysis:
    return flow.examine(log, VehicleSource(used, "t", ""))


def scores(found: Analysis, monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """The largest of each kind, sigmas."""
    assert found.examination is not None
    monkeypatch.setattr(score, "IN_DOUBT", 0.0)
    told: dict[str, float] = {}
    for doubt in score.doubts(found.examination, [jet.name for jet in found.vehicle.jets]):
        told.setdefault(doubt.assumption, doubt.sigmas)
    monkeypatch.undo()
    return told


def left(found: Analysis) -> float:
    """Chi-square of the off-line fits."""
    assert found.examination is not None
    return sum(float(response.gram[0, 0]) for response in found.examination.responses if response is not None)


def moved(used: Vehicle, by: tuple[float, float, float]) -> Vehicle:
    position = tuple(float(x) for x in np.add(used.imu.position_m, by))
    return used.model_copy(update={"imu": used.imu.model_copy(update={"position_m": position})})


@pytest.mark.seeds
@pytest.mark.thorough
def test_what_is_right_is_doubted_as_chance_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of twenty seeds, each assumption's score is a standard normal deviate's: root mean square within a third of one, none beyond 4."""
    flight = fly("free-flyer", *RANDOM, seeds=tuple(range(1, 21)))
    told = [scores(examined(flight.log(i), flight.vehicle), monkeypatch) for i in range(20)]
    jets = np.array([[one[f"thrust of {jet.name}"] for jet in flight.vehicle.jets] for one in told])
    for own in (*jets.T, np.array([one["gyro-scale"] for one in told]), np.array([one["command-delay"] for one in told])):
        assert own.max() < 4.0
        assert 0.5 < np.sqrt((own**2).mean()) < 1.5
    assert np.sqrt((jets**2).mean()) == pytest.approx(1.0, abs=0.2)


def test_the_score_is_what_the_fit_gains_by_the_likeliest_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its square against the drop of chi-square when the log is estimated again with that value (a likelihood ratio, Wilks 1938)."""
    flight = fly("free-flyer", *RANDOM, seeds=(SEED,))
    wrong = moved(flight.vehicle, (0.004, 0.0, 0.0))
    found = examined(flight.log(0), wrong)
    told = scores(found, monkeypatch)["imu-position"]
    gains = [left(found) - left(examined(flight.log(0), moved(wrong, (-by, 0.0, 0.0)))) for by in (0.003, 0.004, 0.005)]
    curve = np.polyfit([0.003, 0.004, 0.005], gains, 2)
    assert told**2 == pytest.approx(curve[2] - curve[1] ** 2 / (4 * curve[0]), rel=0.05)


@pytest.mark.thorough
def test_an_error_that_no_channel_shows_is_doubted_and_leaves_nothing_standing_that_it_moves() -> None:
    """The accelerometer shows 15 % too much, which mass takes up but for the lever arm's part: no channel is beyond its noise by half."""
    flight = fly("free-flyer", *RANDOM, seeds=(SEED,))
    log = flight.log(0)
    scaled = examined(replace(log, delta_v_imu_m_s=1.15 * log.delta_v_imu_m_s), flight.vehicle)
    for found, wrong in ((sound(SEED), False), (scaled, True)):
        assert np.allclose(found.settled[0].normalised[20:].var(0), 1.0, atol=0.5)
        assert [doubt.assumption for doubt in found.doubts if doubt.refuted][:1] == ["accelerometer-scale"] * wrong
        for true, estimate in zip(flight.truth[0, 0], found.conclusions[0].estimates.values(), strict=True):
            off = abs((estimate.value or 0.0) - true) / (estimate.sigma or np.inf)
            assert off < 4.5 or estimate.verdict == "contradicted"
        assert (found.conclusions[0].estimates["mass"].verdict == "contradicted") == wrong


@pytest.mark.thorough
def test_pulses_that_scatter_hide_no_wrong_assumption() -> None:
    """With thrust.pulse_sigma stated nothing was tested: pitch jets at 90 % left iyy over eight sigma off and converged."""
    keys = (*RANDOM, "vehicle.thrust.pulse_sigma=0.02")
    clean = fly("free-flyer", *keys, seeds=(0,))
    found = examined(clean.log(0), clean.vehicle)
    assert {one.verdict for one in found.conclusions[0].estimates.values()} == {"converged"}
    assert not [one for one in found.doubts if one.refuted]
    # nine tenths of what is stated, told of the same flight
    pitch = [i for i, jet in enumerate(clean.vehicle.jets) if jet.name.startswith("pitch")]
    weak = changed(clean.vehicle, [f"jets.{i}.force_n={[f / 0.9 for f in clean.vehicle.jets[i].force_n]}" for i in pitch])
    wrong = examined(clean.log(0), weak)
    assert abs(wrong.histories[0].values[-1, 3] - clean.truth[0, 0, 3]) > 8 * wrong.histories[0].sigmas[-1, 3]
    assert wrong.conclusions[0].estimates["iyy"].verdict != "converged"


def test_a_step_of_a_sensors_scale_is_one_of_each_of_its_axes() -> None:
    found = sound(SEED).examination
    assert found is not None
    (response,) = (one for one in found.responses if one is not None)
    count = response.shift.shape[1]
    axes = [one for one in found.assumed if one.part_of == "gyro-scale"]
    (gyro,), (accelerometer,) = ([one for one in found.assumed if one.code == f"{name}-scale"] for name in ("gyro", "accelerometer"))
    np.testing.assert_array_equal(found.step(gyro, count), sum(found.step(axis, count) for axis in axes))
    assert len(axes) == 3
    assert [one.code for one in found.varied].index(axes[0].code) == np.flatnonzero(found.step(gyro, count))[0]
    # the accelerometer's stand behind all variants, before each channel's thrust
    first = len(found.varied)
    np.testing.assert_array_equal(np.flatnonzero(found.step(accelerometer, count)), [first, first + 1, first + 2])


def test_jets_alike_are_doubted_together_where_each_alone_would_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two that are wrong alike; the square of their score against the drop of chi-square with the right file."""
    flight = fly("free-flyer", *RANDOM, seeds=(SEED,))
    jets = [jet.name for jet in flight.vehicle.jets]
    pair = tuple(jets.index(name) for name in ("divert_xp", "divert_xn"))
    keys = [f"jets.{i}.force_n={[1.005 * f for f in flight.vehicle.jets[i].force_n]}" for i in pair]
    found = examined(flight.log(0), changed(flight.vehicle, keys))
    assert found.examination is not None
    groups = along_one_line(found.log, found.vehicle)
    assert pair in groups
    monkeypatch.setattr(score, "IN_DOUBT", 0.0)
    told = {doubt.assumption: doubt for doubt in score.doubts(found.examination, channel_names(found.log, found.vehicle), groups)}
    alone = np.array([told[f"thrust of {jets[i]}"].sigmas for i in pair])
    together = told[f"thrust of {jets[pair[0]]}, {jets[pair[1]]}"]
    assert together.sigmas**2 == pytest.approx(left(found) - left(sound(SEED)), rel=0.15)
    assert together.sigmas > alone.max()
    assert together.joint
    assert not told[f"thrust of {jets[pair[0]]}"].joint


@pytest.mark.parametrize(
    ("sigmas", "moves", "faint", "hangs"),
    [
        (3.5, 0.02, False, True),
        (3.5, 0.001, False, False),  # of less than half a percent nobody's gains depend
        (3.5, 0.02, True, False),
        (5.5, 0.02, False, False),  # that is a contradiction
    ],
)
def test_what_hangs_on_an_assumption_in_doubt_is_not_called_converged(sigmas: float, moves: float, faint: bool, hangs: bool) -> None:
    conclusion, sizes = sound(SEED).conclusions[0], sound(SEED).settled[0].natural_sizes
    shift = np.zeros((10, 1))
    mass = conclusion.estimates["mass"].sigma or np.nan
    shift[0], shift[9] = moves * conclusion.values[0], 1.5 * mass / conclusion.values[9] ** 2
    reasons = score.doubtful_values(conclusion, 0, [score.Doubt("gyro-scale", sigmas, 5.0, (shift,), faint)], sizes)
    assert set(reasons) == ({"ixx"} if hangs else set())  # the mass by less than two of its sigmas
    told = in_doubt(conclusion, reasons)
    assert (told.estimates["ixx"].verdict, told.estimates["iyy"].verdict) == ("not_converged" if hangs else "converged", "converged")
    if hangs:
        sigma = conclusion.estimates["ixx"].sigma or np.nan
        assert f"would move ixx by {moves * conclusion.values[0] / sigma:.2g} of its sigmas" in str(told.estimates["ixx"].reason)
        assert told.estimates["ixx"].final_at_s is None


def test_what_a_refuted_error_may_move_unseen_hangs_on_it() -> None:
    """As much along an axis that the log does not show; what it does show is in the sigmas, and what is in doubt alone is not meant."""
    conclusion, sizes = sound(SEED).conclusions[0], sound(SEED).settled[0].natural_sizes
    shown, hidden = np.zeros((10, 2)), np.zeros((10, 1))
    shown[6] = hidden[7] = 1.5 * conclusion.sigmas[7] + 0.006 * sizes[7]
    for sigmas, named in ((5.5, {"cg_y"}), (4.5, set[str]())):
        doubt = score.Doubt("imu-position", sigmas, 5.0, (np.hstack([shown, hidden]),), unseen_shifts=(hidden,))
        assert set(score.unseen_changes(conclusion, 0, [doubt], sizes)) == named


def test_of_clean_logs_nothing_hangs_on_chance() -> None:
    assert all(estimate.reason.code != "assumption-in-doubt" for estimate in sound(SEED).conclusions[0].estimates.values())


@pytest.mark.parametrize("part", ["gram", "shift"])
def test_a_response_that_grew_without_end_says_nothing(part: str) -> None:
    """Of a body that is none, as of a mass below its bearing's."""
    response = AssumptionResponse(np.zeros((10, 2)), np.eye(3))
    found = assumptions.SensitivityAnalysis((), (response,), 1, (np.ones(6),))
    assert assumptions.without_invalid(found, sound(SEED).settled[:1]).responses == (response,)
    endless = replace(response, **{part: np.nan * getattr(response, part)})
    assert assumptions.without_invalid(replace(found, responses=(endless,)), sound(SEED).settled[:1]).responses == (None,)


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(("scale", "named"), [(1.0, False), (1.12, False), (1.3, True)])
def test_wheels_and_jets_that_contradict_each_other_beyond_the_thrusts_sigma_give_no_scale(scale: float, named: bool) -> None:
    """Speeds make the momentum with the stated spin inertia, and 3 % of the thrust are 3.6 and 7.7 sigma off."""
    speeds = [f'vehicle.wheels.{i}.column="speed"' for i in range(3)]
    flight = fly("wheels-and-jets", f"actuators.wheel_scale={scale}", "vehicle.thrust.scale_sigma=0.03", *speeds)
    found = examined(flight.log(0), flight.vehicle)
    verdicts = {found.conclusions[0].estimates[name].verdict for name in ("ixx", "iyy", "izz", "mass")}
    assert verdicts == ({"contradicted"} if named else {"converged"} if scale == 1 else {"not_converged"})
    said = [fault.notice.message for fault in found.faults]
    assert len(said) == named
    if named:
        assert "jets roll_p1" in said[0]
        assert "wheels x, y, skew give +1.3 times" in said[0]
