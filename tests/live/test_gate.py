"""Single bad readings in flight: they neither enter the estimate nor hide a misfit, and a clean flight loses none."""

import math
from functools import cache

import numpy as np
import pytest

from massprop_cli.base.arrays import Array, BoolArray
from massprop_cli.diagnosis.outliers import SIGMAS
from massprop_cli.estimate import kernelflight
from massprop_cli.estimate.kernelflight import VERDICTS, Reported
from massprop_cli.export import resolve
from massprop_cli.inputs import vehiclefile
from massprop_cli.kernel import kernel
from massprop_cli.live import estimator
from massprop_cli.live.cycles import RecordedCycle
from massprop_cli.live.estimator import FlightEstimator
from tests.analysed import SAMPLES
from tests.live.test_aboard import Beside

pytestmark = pytest.mark.skipif(kernel().library is None, reason=f"the causal pass runs on {kernel().name}")
THETA, VELOCITY = slice(2, 5), slice(5, 8)
UNTOLD, CONTRADICTED = VERDICTS.index("untold"), VERDICTS.index("contradicted")


@cache
def resolved(name: str) -> resolve.FlightConstants:
    return resolve.from_log(vehiclefile.load(SAMPLES / name / "vehicle.toml"), SAMPLES / name / "log.parquet")


def cycles(name: str) -> Array:
    """A sample log as it was flown, to the end of its first phase."""
    constants = resolved(name)
    assert constants.log is not None
    own = constants.phases[0].cycles
    return kernelflight.cycles_of(constants.log, slice(0, min(own.stop + 1, constants.log.cycles)), own)


def flown(name: str, fed: Array) -> Reported:
    phase = resolved(name).phases[0]
    return kernelflight.Flight(resolved(name).commands, phase.vehicle, phase.rule).step(fed, last=True)


def beyond(found: Reported) -> BoolArray:
    """(K, 2) whether the innovation of gyro and of accelerometer is beyond the gate."""
    far: BoolArray = np.linalg.norm(found.rows.normalised.reshape(-1, 2, 3), axis=2) > SIGMAS
    return far


@pytest.mark.parametrize("name", ["free-flyer", "docking", "air-bearing"])
@pytest.mark.parametrize(("column", "by"), [(2, 0.01), (4, -0.1), (5, 1.0), (7, 450.0)])
@pytest.mark.parametrize("part", [0.5, 0.75])
def test_one_bad_reading_moves_no_value_by_more_than_a_fifth_of_a_sigma(name: str, column: int, by: float, part: float) -> None:
    fed = cycles(name)
    clean = flown(name, fed)
    fed[int(part * len(fed)), column] += by
    found = flown(name, fed)
    assert beyond(found).sum() == 1
    assert not beyond(clean).any()
    assert (np.abs(found.values[-1] - clean.values[-1]) < 0.2 * clean.sigmas[-1]).all()
    assert found.sigmas[-1] == pytest.approx(clean.sigmas[-1], rel=0.01)
    assert (found.verdicts == clean.verdicts).all()


def test_a_bad_reading_in_the_first_seconds_is_forgotten_within_thirty_cycles() -> None:
    """Few cycles have been counted by then, and one counts as much as 24 others."""
    fed = cycles("free-flyer")
    clean = flown("free-flyer", fed)
    fed[60, 2] += 0.01
    found = flown("free-flyer", fed)
    differ = np.flatnonzero((found.verdicts != clean.verdicts).any(1))
    assert len(differ) <= 30
    assert differ.max() < 60 + 30
    assert (np.abs(found.values[-1] - clean.values[-1]) < 0.2 * clean.sigmas[-1]).all()


@pytest.mark.parametrize(("part", "by"), [(VELOCITY, 0.05), (THETA, 0.001)])
@pytest.mark.parametrize(("every", "within"), [(1, 6), (20, 160)])
def test_what_stays_or_comes_again_contradicts(part: slice, by: float, every: int, within: int) -> None:
    """More than the first two of a run are used; of bad readings one in twenty is too many to be chance."""
    fed = cycles("free-flyer")
    fed[600::every, part] += by
    found = flown("free-flyer", fed)
    assert beyond(found).sum() >= len(fed[600::every])
    assert set(found.verdicts[600 + within :].ravel().tolist()) <= {UNTOLD, CONTRADICTED}


def test_the_gate_is_beyond_the_chance_of_any_flight() -> None:
    """Of three normalised innovations: the tail of chi-square. On the ground all readings are used that its own test leaves."""
    chance = math.erfc(SIGMAS / 2**0.5) + (2 / math.pi) ** 0.5 * SIGMAS * math.exp(-(SIGMAS**2) / 2)
    assert chance == pytest.approx(1.5e-21, rel=0.05)
    rule = resolved("free-flyer").phases[0].rule
    assert rule[12] == SIGMAS
    assert kernelflight.rule_of(resolved("free-flyer").vehicle, (0.0, 0.0, 0.0))[12] == 0


def test_numpy_leaves_out_the_same_readings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycle by cycle: of one sensor, of both, two in a row, and three."""
    monkeypatch.setattr(estimator, "KernelEstimator", Beside)
    fed = cycles("air-bearing")[:150]
    fed[60, 2], fed[70, 6], fed[80:82, 4], fed[90, [3, 7]] = fed[60, 2] + 0.01, 1.0, fed[80:82, 4] - 0.004, 0.1
    fed[100:103, 2] += 0.002
    both = FlightEstimator(resolved("air-bearing"))
    found = [one.reported.verdicts[-1] for row in fed for one in both.add(RecordedCycle(float(row[0]), row))]
    assert len(found) == len(fed) - 2
    assert (found[-1] == CONTRADICTED).any()
