"""Who follows a remedy gets the corrected estimate: the same values, sigmas and verdicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.configfile import literal, written
from massprop_cli.base.errors import InputError
from massprop_cli.base.rigidbody import rotation
from massprop_cli.conclude import correctedestimate
from massprop_cli.conclude.analysis import CorrectedEstimate
from massprop_cli.conclude.estimated import estimated
from massprop_cli.conclude.pivot import with_pivot
from massprop_cli.diagnosis import UNKNOWN
from massprop_cli.diagnosis.fault import Fault
from massprop_cli.flow import Analysis
from massprop_cli.inputs import vehiclefile
from massprop_cli.inputs.logfile import read_table
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.telemetry import Log, read
from massprop_cli.inputs.vehicle import Vehicle
from massprop_cli.inputs.vehiclefile import VehicleSource
from tests import faulty
from tests.flown import fly

TRUTH = faulty.truth("free-flyer")
PART_S = 20.0
WHOLE = ("jet-canted", "imu-displaced", "accel-scale", "accel-filter")
"""Kinds that take all of the log to be told."""
SCALED = {f"delta_theta_{axis}_rad": 1.02 for axis in "xyz"}
"""Of the gyro's columns, by a recorder that scales them."""
GYRO = tuple(f'columns.{name}={{ from = "{name}", scale = {scale} }}' for name, scale in SCALED.items())
ACCELEROMETER = 'columns.delta_v_y_m_s={ from = "delta_v_y_m_s", scale = 0.8 }'
MOUNTED = np.array(faulty.sample("free-flyer")[1].imu.body_from_imu)
SMALL, LARGE = (written((rotation(np.radians(angle) * np.array([0.6, 0.0, 0.8])) @ MOUNTED).tolist()) for angle in (0.8, 5.0))
FAULTS = {
    "delay": ("cycle.command_delay_cycles=1.4",),
}
MORE = {
    "jet-weak": ("jets.4.force_n=[1.2, 0.0, 0.0]",),
    "gyro-scale": GYRO,
    "jet-displaced": ("jets.0.position_m=[0.0, 0.17, 0.01]",),
    "jet-canted": ("jets.1.force_n=[0.15, 0.0, -1.1]",),
    "imu-displaced": ("imu.position_m=[0.4, -0.06, 0.1]",),
    "lag": ("thrust.lag_s=0.02",),
    "rise": tuple(f"jets.{i}.rise_s=0.008" for i in range(12)),
    "droop": ("thrust.droop=0.05",),
    "clock": ("imu.clock_drift_ppm=3000",),
    "imu-turned-a-little": (f"imu.body_from_imu={SMALL}",),
    "imu-turned": (f"imu.body_from_imu={LARGE}",),
    "gyro-filter": ("imu.gyro_lag_s=0.01",),
    "accel-filter": ("imu.accel_lag_s=0.1",),
    "accel-scale": (ACCELEROMETER,),
    "gyro-unit": tuple(f'columns.{name}={{ from = "{name}", scale = 57.29577951308232 }}' for name in SCALED),
}


def recorded(used: Vehicle, whole: bool = False) -> Log:
    """The beginning of the sample log, or all of it, read by a vehicle file."""
    found = read(read_table(faulty.SAMPLES / "free-flyer" / "log.parquet"), used)
    return found if whole else found.part(0, round(PART_S / used.cycle.period_s))


def followed(stated: Vehicle, found: Analysis, whole: bool = False) -> tuple[Analysis, Analysis]:
    """The corrected estimate, and what its settings give where they are put into the vehicle file and the log is read anew."""
    (answer, *_) = found.mended
    after = faulty.stated(stated, *answer.settings)
    assert answer.complete
    return replace(found, conclusions=answer.conclusions), faulty.examined(recorded(after, whole), after)


@pytest.mark.parametrize("kind", [*FAULTS, *(pytest.param(kind, marks=pytest.mark.thorough) for kind in MORE)])
def test_following_a_remedy_reproduces_the_corrected_estimate(kind: str) -> None:
    stated = faulty.stated(faulty.sample("free-flyer")[1], *(FAULTS | MORE)[kind])
    found = faulty.examined(recorded(stated, kind in WHOLE), stated)
    corrected, again = followed(stated, found, kind in WHOLE)
    assert not again.faults
    told = 0
    for one, other in zip(corrected.conclusions[0].estimates.items(), again.conclusions[0].estimates.items(), strict=True):
        (name, expected), (_, got) = one, other
        assert got.verdict == expected.verdict, name
        if expected.value is None or expected.sigma is None:
            assert got.value is None
            continue
        assert got.value == pytest.approx(expected.value, abs=1e-6 * expected.sigma)
        assert got.sigma == pytest.approx(expected.sigma, rel=1e-6)
        told += 1
    assert told >= 9
    off = faulty.z_scores(corrected, TRUTH)
    assert max(abs(off[name]) for name, verdict in faulty.verdicts(corrected).items() if verdict == "converged") < 4


def test_a_name_whose_remedy_leaves_the_misfit_is_none() -> None:
    """The remedy of a wrong delay for a log with a reversed jet; that of the jet names it still."""
    late, turned = (
        faulty.stated(faulty.sample("free-flyer")[1], one) for one in ("cycle.command_delay_cycles=1.4", "jets.4.force_n=[-1.0, 0.0, 0.0]")
    )
    cures = []
    for used in (late, turned):
        found = estimated(recorded(used), VehicleSource(used, "", ""), (), lambda *_: None)
        cures += [fault.cure for fault in found.faults]
    (fault,) = found.faults
    named, answers = correctedestimate.with_corrections(found, lambda *_: None)
    assert (named.faults, named.unknown, len(answers)) == ((fault,), "", 1)
    vain, answers = correctedestimate.with_corrections(
        replace(found, faults=(replace(fault, cure=cures[0], around=(), rivals=()),)), lambda *_: None
    )
    assert (vain.faults, answers) == ((), [])
    assert fault.notice.message in vain.unknown
    assert vain.notices[0].code == UNKNOWN


def test_what_is_restated_as_uncertain_is_estimated_as_by_its_own_key() -> None:
    """A jet's thrust that is a thousandth uncertain, as another value of its key and as its sigma."""
    used = faulty.sample("free-flyer")[1]
    log = recorded(used, whole=True)
    force = written((1.001 * np.array(used.jets[4].force_n)).tolist())
    settings = f'uncertain=[{{"jets.4.force_n" = {force}}}]', "jets.4.thrust_sigma=0.001", "jets.4.thrust_sigma=0.0"
    restated, by_key, exact = (faulty.examined(log, faulty.stated(used, one)).conclusions[0] for one in settings)
    assert (by_key.sigmas > 1.02 * exact.sigmas).any()
    np.testing.assert_allclose(restated.sigmas, by_key.sigmas, rtol=0.002)
    np.testing.assert_allclose((restated.values - by_key.values) / by_key.sigmas, 0.0, atol=0.01)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ('{"jets.4.forcen" = [0.0, 1.0, 0.0]}', "unknown key"),
        ('{"imu.gyro_bias_sigma_rad_s" = 0.01}', "changes which quantities are estimated"),
        ('{"columns.time_s" = {from = "time_s", scale = 2.0}}', "not read again"),
        ("{gyro_factors = [1.0, 1.0, 1.0]}", "shape"),
    ],
)
def test_what_cannot_be_uncertain_is_refused(values: str, said: str) -> None:
    used = faulty.sample("free-flyer")[1]
    with pytest.raises(InputError, match=said):
        faulty.examined(recorded(used), faulty.stated(used, f"uncertain=[{values}]"))


def test_a_setting_of_what_is_uncertain_reads_as_it_was_written() -> None:
    entry = {"jets.4.force_n": [0.0, 1.2, 0.0], "gyro_factors": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.01, 1.0]]}
    assert literal(written([entry])) == [entry]
    used = vehiclefile.changed(faulty.sample("free-flyer")[1], [f"uncertain={written([entry])}"])
    assert used.uncertain == (entry,)


@pytest.mark.thorough
@pytest.mark.seeds
def test_on_a_pedestal_a_remedy_that_drops_the_mass_leaves_the_cg_untold() -> None:
    """What is known of a phase is of no part of it once it is split."""
    flown = fly("pedestal", seeds=(1,))
    weighed = faulty.stated(flown.vehicle, "known.mass={value=12.0, sigma=0.01}")
    found = faulty.examined(flown.log(0), weighed)
    assert found.conclusions[0].estimates["cg_x"].value is not None
    fault = Fault(Notice("mass-change", "at once"), None)
    split = CorrectedEstimate(fault, (), found.conclusions, found.vehicle.model_copy(update={"known": {}}))
    (answer,) = with_pivot(replace(found, mended=(split,))).mended
    assert {name for name, one in answer.conclusions[0].estimates.items() if one.verdict == "unobservable"} == {*QUANTITIES}
    assert answer.conclusions[0].about_pivot["ixx"].value is not None
