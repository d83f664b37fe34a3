"""What a plan calculates once or coarsely, and what it asks for before it calculates anything."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massprop_cli.base.arrays import Array
from massprop_cli.inputs.vehiclefile import VehicleSource
from massprop_cli.plan import guess
from massprop_cli.plan.motions import Manoeuvre
from massprop_cli.plan.planner import MotionLibrary
from massprop_cli.plan.rehearsal import Rehearsal, rehearsal
from massprop_cli.testbed import bound, output, scenario, simulate
from tests.commandline import massprop

SAMPLED = ['vehicle.imu.measures="sample"', "vehicle.imu.gyro_filter={ order = 2, cutoff_hz = 30.0 }"]
PLAN = '[{motion="random",axes=["roll","pitch","yaw","x","y","z"],start_s=0.0,end_s=3.0}]'


def test_few_bins_show_of_a_sampled_imu_what_many_show() -> None:
    """A plan uses few: it takes a fifth of the time, and sigmas are the same to a thousandth."""
    source = scenario.load("free-flyer", ["duration_s=3.0", f"plan={PLAN}", *SAMPLED])
    flown = simulate.fly(source, [3])
    few, many = (bound.information(source, flown.issued, flown.truth[0], fine=fine)[0].sum(0) for fine in (False, True))
    few_sigma, many_sigma = (np.sqrt(np.diag(np.linalg.inv(told)))[:10] for told in (few, many))
    np.testing.assert_allclose(few_sigma, many_sigma, rtol=1e-3)
    assert (few_sigma != many_sigma).any()


def test_a_motion_is_flown_and_examined_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each attempt at a plan asks for all motions again, most of them at the level of the attempt before."""
    sample = scenario.load("free-flyer").scenario
    known = guess.Guess(guess.GuessFile(body=sample.truth), "guess.toml", sample.truth.values[None] * np.ones((2, 1)))
    library = MotionLibrary(rehearsal(VehicleSource(sample.vehicle, "vehicle.toml", ""), known))
    push, turn = Manoeuvre("steady", ("x",)), Manoeuvre("steady", ("roll",))
    flown: list[str] = []
    plain_flown, plain_information = Rehearsal.flown, Rehearsal.information

    def fly(self: Rehearsal, *told: Any) -> tuple[Array, dict[str, float]]:
        flown.append("flown")
        return plain_flown(self, *told)

    def examine(self: Rehearsal, *told: Any) -> Array:
        flown.append("examined")
        return plain_information(self, *told)

    monkeypatch.setattr(Rehearsal, "flown", fly)
    monkeypatch.setattr(Rehearsal, "information", examine)
    for motions in ([push], [push, turn], [turn]):
        for motion in motions:
            assert library.used(motion, 12)["impulse_n_s"] > 0
        for group in library.pending(motions, 12):
            library.calculate(group, 12)
    assert flown == ["flown", "examined"] * 2
    apart = MotionLibrary(library.rehearsal)
    apart.used(turn, 12)
    apart.used(push, 12)
    apart.calculate([turn, push], 12)
    for motion in (push, turn):
        np.testing.assert_array_equal(library.information(motion, 12), apart.information(motion, 12))


def test_all_that_a_drafted_vehicle_file_leaves_open_is_asked_for_at_once(tmp_path: Path) -> None:
    text = output.vehicle_toml(scenario.load("free-flyer").scenario.vehicle)
    lines = [line for line in text.splitlines() if not line.startswith(("gyro_noise", "accel_noise", "command_delay"))]
    open_ = "\n".join(lines).replace("[cycle]", '[cycle]\ncommand_delay_cycles = "auto"')
    (tmp_path / "vehicle.toml").write_text(open_)
    done = massprop(tmp_path, "plan", "--vehicle", "vehicle.toml", "--want", "mass 2 %")
    assert (done.returncode, len(done.stderr.splitlines())) == (3, 1)
    for said in (
        "or name a file with --guess",
        "imu.gyro_noise_rad_s and imu.accel_noise_m_s2 are not stated",
        'command_delay_cycles is "auto"',
    ):
        assert said in done.stderr
