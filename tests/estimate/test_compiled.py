"""The compiled kernel says what NumPy says, cycle by cycle."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import job
from massprop_cli.base.arrays import Array
from massprop_cli.estimate import compiled, engine, kernelflight
from massprop_cli.estimate.history import History
from massprop_cli.inputs.vehicle import Phase, Vehicle
from massprop_cli.kernel import kernel
from massprop_cli.model import kernelargs, regressors
from massprop_cli.model.plant import Reference
from massprop_cli.model.resolved import Resolved
from massprop_cli.model.sensitivity import Consider
from massprop_cli.prepare.compensate import Source
from massprop_cli.prepare.stream import Stream
from massprop_cli.prepare.timing import Timing
from tests import flown
from tests.analysed import SAMPLES, analysed
from tests.flight import resolved

pytestmark = [
    pytest.mark.numerical,
    pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}"),
]
AGREE = 1e-6
"""Sigmas."""
LOGS = [
    *("free-flyer/log", "air-bearing/log", "docking/log", "high-rate/log"),
    pytest.param("crazyflie/roll-pitch", marks=[pytest.mark.thorough, pytest.mark.seeds]),
]
"""Not crazyflie/yaw: there a change of 1e-13 of what is measured moves values by sigmas, in NumPy from processor to processor as well."""


class _Both:
    """Each causal pass of an estimate, by both."""

    def __init__(self) -> None:
        self.pairs: list[tuple[History, History]] = []

    def replay(
        self,
        samples: Source,
        cycles: slice,
        phase: Phase,
        vehicle: Resolved,
        consider: Consider,
        *_: object,
    ) -> History:
        if not compiled.supports(samples, vehicle, consider):  # a log that fits nothing is tried in other ways, too
            return replayed(samples, cycles, phase, vehicle, consider)
        own = replayed(samples, cycles, phase, vehicle, consider)
        with pytest.MonkeyPatch.context() as numpy_alone:
            numpy_alone.setattr(compiled, "supports", lambda *_: False)
            self.pairs.append((own, replayed(samples, cycles, phase, vehicle, consider)))
        return own


replayed = engine.replay


def apart(a: Array, b: Array, sigma: Array) -> float:
    """The largest difference in sigmas; both must be said of the same cycles."""
    assert np.array_equal(np.isnan(a), np.isnan(b))
    return float(np.nanmax(np.abs(a - b) / sigma))


def same_reference(own: Reference | None, other: Reference | None) -> None:
    """What the equations are linearised about in the end, every part of it."""
    assert own is not None
    assert other is not None
    for name in (
        "inertia",
        "cg",
        "mu",
        "gyro_bias",
        "acceleration",
        "scale",
        "damping",
        *(["response"] if other.response is not None else []),
    ):
        ours, theirs = np.asarray(getattr(own, name), dtype=float), np.asarray(getattr(other, name), dtype=float)
        assert ours.shape == theirs.shape, name
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6 * max(1.0, np.abs(theirs).max(initial=0.0)), err_msg=name)


@cache
def both(log: str, *assignments: str) -> list[tuple[History, History]]:
    found = _Both()
    with pytest.MonkeyPatch.context() as each:
        each.setattr(engine, "replay", found.replay)
        job.of_file(SAMPLES / f"{log}.parquet", None, assignments)
    assert found.pairs, "NumPy would be compared with itself"
    return found.pairs


@pytest.mark.parametrize("log", LOGS)
def test_every_value_of_every_cycle_agrees(log: str) -> None:
    for own, other in both(log):
        assert np.isfinite(own.values[-1]).any()
        assert apart(own.values, other.values, other.sigmas) < AGREE
        assert apart(own.sigmas, other.sigmas, other.sigmas) < AGREE
        assert apart(own.innovation, other.innovation, other.innovation_sigma) < AGREE
        assert apart(own.normalised, other.normalised, np.ones(1)) < AGREE
        assert np.abs(own.covariance - other.covariance).max() < AGREE * np.abs(other.covariance).max()
        same_reference(own.reference, other.reference)


PHASE = Phase(name="all", start_s=0.0, end_s=60.0)
SCALES = {"thrust": {"scale_sigma": 0.02}}
"""What a log tells beside wheels."""


@pytest.mark.parametrize(
    ("scenario", "kind"),
    [
        pytest.param("pedestal", "pedestal", marks=pytest.mark.thorough),
        pytest.param("wheels-and-jets", "free", marks=[pytest.mark.thorough, pytest.mark.seeds]),
        pytest.param("wheels-and-jets", "air_bearing", marks=pytest.mark.thorough),
        pytest.param("wheels-and-jets", "pedestal", marks=[pytest.mark.thorough, pytest.mark.seeds]),
    ],
)
def test_wheels_agree_in_every_environment(scenario: str, kind: str) -> None:
    """Whether or not the motion is that of this environment: both are to say the same of any log."""
    flight = flown.fly(scenario, *flown.BY_SPEED)
    support = {"kind": kind} if kind == scenario else {"kind": kind, "bearing_position_m": [0.01, 0.0, -0.02]}
    environment = support | ({"bearing_mass_kg": 4.0} if kind == "air_bearing" else {})
    stated = flight.vehicle.model_dump(mode="json", by_alias=True, exclude_unset=True)
    wheels = [wheel | {"spin_inertia_sigma_kg_m2": 0.01 * wheel["spin_inertia_kg_m2"]} for wheel in stated["wheels"]]
    used = resolved(Vehicle.model_validate(stated | SCALES | {"wheels": wheels, "environment": environment}))
    samples = Stream.of(flight.log(0), used, Timing(float(used.cycle.command_delay_cycles), 0.0))
    given = samples, slice(2, 400), PHASE, used
    assert compiled.supports(samples, used, Consider())
    own = engine.replay(*given)
    with pytest.MonkeyPatch.context() as numpy_alone:
        numpy_alone.setattr(compiled, "supports", lambda *_: False)
        numpy_alone.setattr(regressors, "in_kernel", lambda _: False)
        other = engine.replay(*given)
    assert np.isfinite(own.values[-1]).any()
    assert apart(own.values, other.values, other.sigmas) < AGREE
    assert apart(own.sigmas, other.sigmas, other.sigmas) < AGREE
    assert apart(own.normalised, other.normalised, np.ones(1)) < AGREE
    same_reference(own.reference, other.reference)


@pytest.mark.parametrize(
    ("log", "assignments"),
    [
        ("free-flyer/log", ()),
        pytest.param(
            "free-flyer/log",
            ("environment.disturbance_torque_n_m=0.002", "environment.disturbance_walk_n_m=1e-4"),
            marks=pytest.mark.thorough,
        ),
        pytest.param("air-bearing/log", ("imu.gyro_bias_sigma_rad_s=1e-4", "imu.accel_bias_sigma_m_s2=1e-3"), marks=pytest.mark.thorough),
        ("docking/log", ()),
    ],
)
def test_what_is_off_line_agrees(log: str, assignments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    """Fits, what they leave, and what each assumption does to them."""
    own = analysed(log.split("/")[0]) if not assignments else job.of_file(SAMPLES / f"{log}.parquet", None, assignments).analysis
    with monkeypatch.context() as numpy_alone:
        numpy_alone.setattr(kernelargs, "unsupported", lambda *_: "anything")
        other = job.of_file(SAMPLES / f"{log}.parquet", None, assignments).analysis
    for mine, theirs in zip(own.settled, other.settled, strict=True):
        assert mine.residual is not None
        assert theirs.residual is not None
        sigma = np.sqrt(np.diag(theirs.bare[1]))
        assert apart(mine.bare[0], theirs.bare[0], sigma) < AGREE
        assert np.abs(mine.bare[1] - theirs.bare[1]).max() < AGREE * np.abs(theirs.bare[1]).max()
        assert apart(mine.normalised, theirs.normalised, np.ones(1)) < AGREE
        assert apart(mine.residual.value, theirs.residual.value, theirs.residual.sigma) < AGREE
        assert apart(mine.residual.sigma, theirs.residual.sigma, theirs.residual.sigma) < AGREE
    assert own.examination is not None
    assert other.examination is not None
    for ours, its in zip(own.examination.responses, other.examination.responses, strict=True):
        assert ours is not None
        assert its is not None
        size = np.sqrt(np.diag(its.gram))
        both_seen = np.outer(size, size) > 0
        assert (np.abs(ours.gram - its.gram)[both_seen] / np.outer(size, size)[both_seen]).max() < AGREE
        some = size[1:] > 0
        # in sigmas, of a change of each assumption that the log would notice
        sigma = np.sqrt(np.diag(own.settled[0].bare[1]))
        moved = np.abs(ours.shift - its.shift)[:, some] / size[1:][some] / sigma[:, None]
        assert moved.max() < AGREE


@pytest.mark.parametrize("log", ["free-flyer/log", "air-bearing/log"])
def test_the_body_found_at_the_end_agrees(log: str) -> None:
    """Off-line fits begin about it."""
    for own, other in both(log):
        mine, theirs = own.reference, other.reference
        assert mine is not None
        assert theirs is not None
        for name in ("gyro_bias", "scale", "damping"):
            assert np.array_equal(getattr(mine, name), getattr(theirs, name))
        for name in ("inertia", "cg", "mu"):
            np.testing.assert_allclose(getattr(mine, name), getattr(theirs, name), rtol=1e-9, atol=1e-12)
        assert mine.response is not None  # NumPy has one only where the log tells it better than the body does
        if theirs.response is not None:
            np.testing.assert_allclose(mine.response, theirs.response, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    "settings",
    [
        ("imu.gyro_bias_sigma_rad_s=0.001", "imu.gyro_bias_walk_rad_s_sqrt_s=1e-4", "imu.accel_bias_sigma_m_s2=0.05"),
        ("environment.disturbance_torque_n_m=0.004", "thrust.pulse_sigma=0.02"),
        ("environment.disturbance_walk_n_m=0.0005", "known.mass={value=20.0, sigma=0.1}"),
    ],
    ids=["biases", "noise of torque and pulses", "slow torque"],
)
@pytest.mark.parametrize("log", ["free-flyer/log", pytest.param("air-bearing/log", marks=pytest.mark.thorough)])
def test_every_nuisance_agrees(log: str, settings: tuple[str, ...]) -> None:
    for own, other in both(log, *settings):
        assert apart(own.values, other.values, other.sigmas) < AGREE
        assert apart(own.sigmas, other.sigmas, other.sigmas) < AGREE


@pytest.mark.parametrize(
    ("column", "value", "status"),
    [(2, np.nan, "1"), (31, np.inf, "1"), (1, 0.0, "2"), (0, 0.0, "2")],
    ids=["a rate", "an impulse", "no length", "time goes back"],
)
def test_what_is_no_cycle_leaves_the_state_as_it_was(column: int, value: float, status: str) -> None:
    found = analysed("high-rate")
    run = compiled.Pass(found.samples, found.histories[0].cycles, resolved(found.vehicle))
    good = kernelargs.cycle_numbers(found.samples.part(slice(100, 103)))
    run.step(good[:2])
    before, bad = run._memory.tobytes(), good[2:].copy()
    bad[0, column] = value
    with pytest.raises(RuntimeError, match=f"status {status}"):
        run.step(bad)
    assert run._memory.tobytes() == before
    run.step(good[2:])
    assert run._memory.tobytes() != before


def begun(name: str) -> tuple[kernelflight.Flight, Array]:
    """A sample log's flight before its first cycle, and its cycles."""
    found = analysed(name)
    vehicle, history = found.vehicle, found.histories[0]
    commands = kernelflight.commands_of(found.log, True, vehicle, found.timing, found.log.records_per_cycle)
    rule = kernelflight.rule_of(vehicle, (0.01, 0.01, 0.01))
    flight = kernelflight.Flight(commands, compiled.vehicle_numbers(found.samples, resolved(vehicle)), rule)
    return flight, kernelflight.cycles_of(found.log, slice(0, found.log.cycles), history.cycles)


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing"])
@pytest.mark.parametrize(("column", "by"), [(2, 0.5), (2, 10.0), (4, -1e300), (5, 1e4), (7, 1e155)])
def test_a_spike_that_no_vehicle_moves_by_is_no_reading(name: str, column: int, by: float) -> None:
    """Of one cycle, in the gyro's or the accelerometer's increment: not a sigma of the values at the end, where it had ended them all."""
    flight, fed = begun(name)
    untouched = flight.step(fed, last=True)
    flight, fed = begun(name)
    fed[len(fed) // 3, column] += by
    found = flight.step(fed, last=True)
    assert (np.isfinite(found.values) == np.isfinite(found.sigmas)).all()
    assert (np.abs(found.values[-1] - untouched.values[-1]) < untouched.sigmas[-1]).all()
    assert (found.verdicts[-1] == untouched.verdicts[-1]).all()


@pytest.mark.parametrize("name", ["free-flyer", "air-bearing"])
def test_what_is_flown_is_what_is_reported_to_the_last_bit(name: str) -> None:
    """The kernel's own quantities, cycle after cycle handed over alone, against the history that an estimate has."""
    found = analysed(name)
    history, (flight, fed) = found.histories[0], begun(name)
    parts = [flight.step(fed[k : k + 1], k + 1 == len(fed)) for k in range(len(fed))]
    assert np.array_equal(np.concatenate([part.values for part in parts]), history.values, equal_nan=True)
    assert np.array_equal(np.concatenate([part.sigmas for part in parts]), history.sigmas, equal_nan=True)
    last = [kernelflight.VERDICTS[int(number)] for number in parts[-1].verdicts[-1]]
    reported = [estimate.verdict for estimate in found.conclusions[0].estimates.values()]
    assert last == [verdict if verdict != "unobservable" else "not_excited" for verdict in reported]


SOURCES = Path(compiled.__file__).parents[1] / "kernel"


@pytest.mark.parametrize(
    ("single", "how"), [(False, "-fsyntax-only"), (True, "-fsyntax-only"), pytest.param(True, "-O2", marks=pytest.mark.thorough)]
)
def test_the_sources_stand_every_warning(single: bool, how: str, tmp_path: Path) -> None:
    """Those, too, of what only the optimiser sees."""
    flags = ["-std=c99", how, "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off", *["-DMP_SINGLE"] * single]
    subprocess.run(["cc", *flags, "-c", *map(str, sorted(SOURCES.glob("*.c")))], cwd=tmp_path, check=True)


REFUSED = {
    "an on-time of a hundred cycles": ((11, 5.0), 1),
    "a negative on-time": ((11, -1e-3), 1),
    "a cycle that began before the last one": ((1, 0.1), 2),
    "a cycle of a hundred periods": ((1, 5.0), 2),
    "a length that makes nothing of a rate": ((1, 1e300), 2),
    "a length that is none": ((1, -0.05), 2),
    "a time that goes back": ((0, 0.0), 2),
}
LATER = ("a time that goes back", "a cycle that began before the last one")
"""Not in the first cycle."""


@pytest.mark.parametrize(("kind", "at"), [*((kind, 400) for kind in REFUSED), *((kind, 0) for kind in REFUSED if kind not in LATER)])
def test_a_cycle_that_cannot_be_is_refused_and_changes_nothing(kind: str, at: int) -> None:
    """The same cycle as it was flown then goes on to the last bit."""
    (column, value), status = REFUSED[kind]
    flight, fed = begun("free-flyer")
    untouched = flight.step(fed[:500])
    flight, _ = begun("free-flyer")
    flight.step(fed[:at])
    bad = fed[at : at + 1].copy()
    bad[0, column] = value
    with pytest.raises(kernelargs.StatusError, match=f"status {status}"):
        flight.step(bad)
    found = flight.step(fed[at:500])
    assert np.array_equal(found.values[-50:], untouched.values[-50:], equal_nan=True)
    assert np.array_equal(found.sigmas[-50:], untouched.sigmas[-50:], equal_nan=True)


def test_stamps_that_scatter_and_cycles_that_are_lacking_are_taken() -> None:
    """By a fifth of a period; and one cycle in between, of which nobody has told."""
    flight, fed = begun("free-flyer")
    fed[:, 0] += np.random.default_rng(1).uniform(-0.1, 0.1, len(fed)) * 0.05
    found = flight.step(np.delete(fed, 300, 0), last=True)
    assert np.isfinite(found.values[-1]).all()
