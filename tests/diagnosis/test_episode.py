"""A jet that fails for a time is named, with the time and what it gives; stated in the vehicle file, its log is right."""

from __future__ import annotations

import numpy as np
import pytest

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.diagnosis import design, episode
from massprop_cli.diagnosis.episode import episodes
from massprop_cli.diagnosis.refit import refitted
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.windows import WindowRegression
from massprop_cli.estimate.whitening import Disturbance
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.prepare import actuators, align
from tests import faulty
from tests.diagnosis.test_screening import look_at, look_of, otherwise
from tests.flown import PLAN, fly

NONE = Disturbance(0.0, 0.0)


def failing(jet: str, thrust: float, start_s: float | None = None, end_s: float | None = None) -> str:
    span = "".join(f", {key}={value}" for key, value in (("start_s", start_s), ("end_s", end_s)) if value is not None)
    return f'actuators.failures=[{{jet="{jet}", thrust={thrust}{span}}}]'


def pulses(screening: Screening, jet: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """When each of a jet's pulses begins."""
    log, vehicle, timing, *_ = screening.case
    column = [one.name for one in vehicle.jets].index(jet)
    begun = log.cycle_end_s + (timing.delay - 1) * vehicle.cycle.period_s
    return np.asarray(begun[log.command[:, column] > 0])


def test_what_a_window_explains_is_what_regression_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: ordinary least squares on all six axes, beside what another body changes: the window's column, or one of the whole log."""
    monkeypatch.setattr(design, "COUPLING", 0.0)  # no white noise by the rates' products
    flown = fly("free-flyer", *PLAN, failing("divert_xp", 0.7, 8.0))
    screening = look_of(flown.log(0), flown.vehicle)
    reduced = WindowRegression(screening, screening, NONE)
    root, cycle = np.sqrt(reduced.weight), np.arange(len(reduced.design.mean))
    growth = np.vstack([np.zeros((1, reduced.design.growth.shape[1])), np.cumsum(reduced.design.growth, 0)])
    columns, rate = growth - growth.mean(0), reduced.design.rate - reduced.design.rate.mean(0)
    slopes = [np.einsum("kp,pan->kan", c, s) for c, s in zip((columns, reduced.design.mean), reduced.slopes, strict=True)]
    body = np.concatenate([one.reshape(-1, one.shape[-1]) for one in slopes])
    left = (rate - columns @ reduced.by[:, :3]) * root[:3], (reduced.design.force - reduced.design.mean @ reduced.by[:, 3:]) * root[3:]
    rest = np.concatenate([part.ravel() for part in left])

    def regression(channel: int, within: BoolArray) -> tuple[float, float]:
        """What part of a channel explains the most, and the squares that it leaves."""
        rising, falling, _ = (part[:, channel] * within for part in reduced.design.impulses)
        own = reduced.by[reduced.design.places["channels"].start + channel] * root
        # rates without a disturbance are sums of their growth, less their own mean; specific force is as it stands
        steps = np.concatenate([[0.0], np.cumsum(rising[:-1] + falling[1:])])
        turning, pushing = steps - steps.mean(), (rising + falling) / reduced.design.duration_s
        window = np.concatenate([np.outer(turning, own[:3]).ravel(), np.outer(pushing, own[3:]).ravel()])
        solved, squares, *_ = np.linalg.lstsq(np.column_stack([body, window]), rest, rcond=None)
        return float(solved[-1]), float(squares[0])

    for channel in (0, 12):
        found = reduced.best_window(channel)
        assert found is not None
        part, after = regression(channel, (cycle >= found.first) & (cycle < found.stop))
        _, throughout = regression(channel, cycle >= 0)
        assert found.thrust - 1 == pytest.approx(part, rel=1e-4)
        assert found.gain == pytest.approx(len(rest) * np.log(throughout / after), rel=0.02)


@pytest.mark.parametrize("seeds", [range(2), pytest.param(range(2, 8), marks=[pytest.mark.thorough, pytest.mark.seeds])])
def test_the_time_and_the_thrust_of_a_failure_are_as_certain_as_is_said(seeds: range) -> None:
    z = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        jet, thrust, start = (
            str(rng.choice(["divert_xp", "divert_yn", "yaw_p1", "pitch_n2", "roll_p2"])),
            rng.uniform(0.4, 0.9),
            rng.uniform(6, 12),
        )
        flown = fly("free-flyer", *PLAN, failing(jet, thrust, start), seeds=(seed,))
        screening = look_of(flown.log(0), flown.vehicle)
        first = next(t for t in pulses(screening, jet) if t >= start)
        found = next(one for one in episodes(screening) if one.failure.jet == jet)
        assert found.failure.end_s is None
        assert first - 0.1 < (found.failure.start_s or 0.0) <= first
        z.append((found.failure.thrust - thrust) / found.sigma)
    assert np.abs(z).max() < 4
    # of n squares of standard normals the mean is within four of its sigmas
    assert np.mean(np.square(z)) < 1 + 4 * np.sqrt(2 / len(z))


@pytest.mark.parametrize("key", ["", "cycle.command_delay_cycles=1.4"])
def test_what_is_wrong_all_along_or_not_at_all_is_no_failure_for_a_time(key: str) -> None:
    assert episodes(otherwise(*([key] if key else []))) == []


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_failure_that_ends_with_its_phase_is_none_of_the_next() -> None:
    """Dead until the vehicle docks, whole again afterwards: nothing of the first phase tells when it ends."""
    plan = [
        "duration_cycles=500",
        'plan=[{motion="random", axes=["roll", "pitch", "yaw", "y"], start_cycle=0, end_cycle=500}]',
        'events=[{kind="dock", cycle=250, motion="rates_kept", phase="combined"}]',
    ]
    flown = fly("docking", *plan, failing("yaw_p1", 0.0, 6.0, 12.5), seeds=(4,))
    found = faulty.examined(flown.log(0), flown.vehicle)
    (mended,) = found.mended
    stated, *_ = mended.settings
    assert float(stated.split("end_s = ")[1].split("}")[0]) == pytest.approx(12.5, abs=0.3)
    for number, conclusion in enumerate(mended.conclusions):
        for one, true in zip(conclusion.estimates.values(), flown.truth[0, number], strict=True):
            assert abs((one.value or 0.0) - true) < 4.5 * (one.sigma or 0.0)


def test_pulses_begin_when_the_vehicle_file_says_that_they_fail() -> None:
    """Under a clock that drifts by two cycles in twenty seconds."""
    screening = otherwise("imu.clock_drift_ppm=6000.0")
    log, vehicle, timing, *_ = screening.case
    begun = list[Array]()

    def seen(start_s: Array, _: Vehicle) -> None:
        begun.append(start_s)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(actuators, "strengths", seen)
        align.impulses(log, vehicle, timing.delay, 0.0)
    np.testing.assert_allclose(episode._pulses(screening, 0), begun[0][: log.cycles][log.command[:, screening.free.fired[0]] > 0])


@pytest.mark.parametrize(
    ("keys", "code", "words", "setting"),
    [
        (
            (failing("yaw_p1", 0.0, 12.0),),
            "jet-dead",
            "jet yaw_p1 does not push at all from 1",
            '{jet = "yaw_p1", thrust = 0.0, start_s = 1',
        ),
        pytest.param(
            (failing("divert_zn", -1.0, 14.0),),
            "jet-sign",
            "jet divert_zn pushes opposite to the stated direction from 1",
            'jet = "divert_zn", thrust = -1.0, ',
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            (failing("pitch_p1", 0.7, None, 10.0),),
            "thrust-scale",
            "of the stated thrust until ",
            'jet = "pitch_p1", thrust = 0.',
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            (failing("divert_yp", 0.0, 9.0, 13.0), "disturbance.walk_n_m=1e-4"),
            "jet-dead",
            "jet divert_yp does not push at all from ",
            'jet = "divert_yp", thrust = 0.0, start_s = ',
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_a_jet_that_fails_for_a_time_is_named_and_mended(keys: tuple[str, ...], code: str, words: str, setting: str) -> None:
    flown = fly("free-flyer", *PLAN, *keys)
    found = faulty.examined(flown.log(0), flown.vehicle)
    (said,) = [notice.message for notice in found.notices if notice.code == code]
    assert words in said
    (mended,) = found.mended
    stated, *_ = mended.settings
    assert stated.startswith("thrust.failures=[")
    assert setting in stated
    for (name, one), value in zip(mended.conclusions[0].estimates.items(), flown.truth[0, 0], strict=True):
        assert abs((one.value or 0.0) - value) < 4.5 * (one.sigma or 0.0), name
    # what is said is what the vehicle file takes
    mended_log = faulty.examined(flown.log(0), faulty.stated(flown.vehicle, stated))
    assert {notice.code for notice in mended_log.notices} <= {"disturbance-torque"}


@pytest.mark.thorough
def test_jets_that_always_fire_together_are_named_side_by_side_where_the_log_cannot_tell() -> None:
    """On a bearing two jets of a couple differ in what they push alone, which moves the rotor hardly."""
    found = episodes(look_at("testbed", failing("roll_n1", 0.0, 14.0)))
    assert {one.failure.jet for one in found} >= {"roll_n1"}
    assert all(one.code == "jet-dead" for one in found)


def test_what_a_jet_gives_all_along_tells_when_it_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the body that a dead jet has spoilt others seem to fail. With a part of its thrust all along it gives all of it before it died."""
    flown = fly("free-flyer", *PLAN, failing("pitch_n2", 0.0, 4.0))
    screening = look_of(flown.log(0), flown.vehicle)
    weak = next(one for _, one in screening.ranked if (one.hypothesis.code, one.hypothesis.subject) == ("thrust-scale", ("pitch_n2",)))
    cause = refitted(screening, weak)
    assert cause is not None
    likeliest = episode._windows
    monkeypatch.setattr(episode, "_windows", lambda one, beside: [] if one is screening else likeliest(one, beside))
    (found,) = episodes(screening, (), cause)
    begun_s = pulses(screening, "pitch_n2")
    assert (found.failure.jet, found.failure.thrust, found.failure.end_s) == ("pitch_n2", 0.0, None)
    assert begun_s[begun_s < 4.0][-1] < (found.failure.start_s or 0.0) < begun_s[begun_s >= 4.0][0]
