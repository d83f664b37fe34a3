"""What is contradicted must not look good: every case here gave green ticks once."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massprop_cli import CG, QUANTITIES
from massprop_cli.conclude import contradict
from massprop_cli.conclude.analysis import CorrectedEstimate
from massprop_cli.conclude.contradict import divergence_contradiction, known_value_contradiction
from massprop_cli.conclude.judge import judged
from massprop_cli.conclude.reason import Reason
from massprop_cli.diagnosis.corrections import Correction
from massprop_cli.diagnosis.fault import Fault
from massprop_cli.flow import Analysis
from massprop_cli.inputs.notice import Notice
from massprop_cli.inputs.vehicle import Known, Phase
from tests import faulty
from tests.analysed import analysed
from tests.flown import RANDOM, fly

TRUTH = faulty.truth("free-flyer")
WRENCH = Path(__file__).parents[2] / "benchmarks" / "vehicles" / "wrench.toml"
SEGMENT = '{{motion = "random", axes = [{axes}], every_cycles = 5, max_cycles = 4, start_cycle = {start}, end_cycle = {end}}}'
ONE_BY_ONE = [(f'"{axis}"', 60 * i, 60 * i + 60) for i, axis in enumerate(("roll", "pitch", "yaw"))]
TOGETHER = [('"x", "y", "z"', 200, 500), ('"roll", "pitch", "yaw"', 370, 500)]
EACH_WAY = "plan = [" + ", ".join(SEGMENT.format(axes=a, start=s, end=e) for a, s, e in (*ONE_BY_ONE, *TOGETHER)) + "]"


@pytest.fixture(scope="module")
def late() -> Analysis:
    """A command delay stated as one cycle where it is two."""
    flight = fly("free-flyer", *RANDOM, seeds=(3,))
    return faulty.examined(flight.log(0), faulty.stated(flight.vehicle, "cycle.command_delay_cycles=1.0"))


def test_nothing_of_a_log_with_a_wrong_delay_is_called_converged(late: Analysis) -> None:
    assert "delay-mismatch" in [notice.code for notice in late.notices]
    assert set(faulty.verdicts(late).values()) == {"contradicted"}
    shown = late.conclusions[0].contradiction.split("the command delay is ")[1]
    assert float(shown.split(" ±")[0]) == pytest.approx(2.0, abs=2e-3)


def test_the_mended_answer_stands_beside_a_wrong_delay_and_is_right(late: Analysis) -> None:
    (answer,) = late.mended
    assert answer.settings[0].startswith("cycle.command_delay_cycles=")
    assert float(answer.settings[0].partition("=")[2]) == pytest.approx(2.0, abs=2e-3)
    (conclusion,) = answer.conclusions
    assert conclusion.contradiction == ""
    truth = fly("free-flyer", *RANDOM, seeds=(3,)).truth[0, 0]
    for (name, estimate), true in zip(conclusion.estimates.items(), truth, strict=True):
        assert estimate.value is not None
        assert estimate.sigma is not None
        assert abs(estimate.value - true) < 4 * estimate.sigma, name
    # the result's own values stand as found, far off
    assert abs(late.histories[0].values[-1, 9] - truth[9]) > 4 * late.histories[0].sigmas[-1, 9]


def test_the_settings_of_a_mended_answer_give_it_when_set(late: Analysis) -> None:
    flight = fly("free-flyer", *RANDOM, seeds=(3,))
    again = faulty.examined(flight.log(0), faulty.stated(flight.vehicle, "cycle.command_delay_cycles=1.0", *late.mended[0].settings))
    for name, estimate in again.conclusions[0].estimates.items():
        assert estimate.value == pytest.approx(late.mended[0].conclusions[0].estimates[name].value, rel=1e-9)
        assert estimate.sigma == pytest.approx(late.mended[0].conclusions[0].estimates[name].sigma, rel=1e-9)


@pytest.mark.seeds
@pytest.mark.slow
def test_two_strong_jets_contradict_what_they_turn_and_not_what_the_others_push() -> None:
    log, used = faulty.sample("free-flyer")
    found = faulty.examined(log, faulty.pushing(used, {"roll_p1": 1 / 1.12, "roll_n2": 1 / 1.12}))
    history = found.histories[0]
    assert abs(history.values[-1, 0] - TRUTH[0]) > 20 * history.sigmas[-1, 0]
    assert faulty.verdicts(found)["ixx"] == "contradicted"
    assert faulty.looks_good_and_is_wrong(found, TRUTH) == []


@pytest.mark.seeds
@pytest.mark.thorough
def test_a_disturbance_beyond_the_commands_is_doubt_of_the_data() -> None:
    """Two gyro axes in units that nobody uses: what they show would need newton metres where jets give a tenth of one."""
    log, used = faulty.sample("free-flyer", 20.0)
    found = faulty.examined(replace(log, delta_theta_imu_rad=log.delta_theta_imu_rad * [40.0, -13.0, 1.0]), used)
    assert [cause.code for cause in found.conclusions[0].causes] == ["beyond-commands", "fit-lost"]
    told = [one for one in found.conclusions[0].estimates.values() if one.value is not None]
    assert told
    assert {one.verdict for one in told} == {"contradicted"}
    (said,) = [notice.message for notice in found.notices if notice.code == "disturbance-torque"]
    assert "no disturbance does: it would be" in said
    assert "Check the data before the vehicle" in said
    assert "model-discrepancy" not in [notice.code for notice in found.notices]


def test_so_many_sigmas_that_nobody_believes_them_are_many() -> None:
    few, many = (Reason.of("assumption-in-doubt", sigmas=by, assumption="delay", quantity="mass", moved=2.0) for by in (5.0, 1500.0))
    assert "by 5 sigma" in str(few)
    assert "by more than 100 sigma" in str(many)


def test_a_reversed_jet_contradicts_and_is_mended() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    found = faulty.examined(log, faulty.pushing(used, {"yaw_p1": -1.0}))
    verdicts = faulty.verdicts(found)
    assert verdicts["mass"] == verdicts["cg_x"] == "contradicted"
    assert "jet-sign" in [notice.code for notice in found.notices]
    assert [cause.code for cause in found.conclusions[0].causes] == ["named-fault"]
    (answer,) = found.mended
    (setting,) = answer.settings
    number = [jet.name for jet in used.jets].index("yaw_p1")
    assert setting.startswith(f"jets.{number}.force_n=[")
    np.testing.assert_allclose(json.loads(setting.partition("=")[2]), used.jets[number].force_n, rtol=1e-5)
    assert abs((answer.conclusions[0].estimates["izz"].value or 0.0) - TRUTH[5]) < 4 * (answer.conclusions[0].estimates["izz"].sigma or 0.0)


@pytest.mark.thorough
def test_an_accelerometer_behind_a_low_pass_has_no_converged_mass() -> None:
    log, used = faulty.sample("free-flyer")
    found = faulty.examined(faulty.low_passed(log, 5.0), used)
    assert faulty.z_scores(found, TRUTH)["mass"] < 4  # 40 of its noise's
    assert faulty.verdicts(found)["mass"] != "converged"
    assert faulty.looks_good_and_is_wrong(found, TRUTH) == []


@pytest.mark.parametrize(
    "assignments",
    [
        pytest.param(
            tuple(f"jets.{i}.{key}=0.013" for i in range(18) for key in ("rise_s", "fall_s")),
            id="a rise of 13 ms for 3",
            marks=pytest.mark.thorough,
        ),
        pytest.param(("imu.position_m=[0.1, -0.06, 0.22]",), id="an IMU 10 cm off"),
        pytest.param(("cycle.command_delay_cycles=2.3",), id="a delay 0.3 cycles off", marks=pytest.mark.thorough),
    ],
)
def test_no_wrong_value_is_converged_under(assignments: tuple[str, ...]) -> None:
    flight = fly("free-flyer", *RANDOM, seeds=(3,))
    found = faulty.examined(flight.log(0), faulty.stated(flight.vehicle, *assignments))
    assert found.notices
    assert faulty.looks_good_and_is_wrong(found, flight.truth[0, 0]) == []


@pytest.mark.slow
def test_a_steady_torque_on_a_bearing_that_nobody_stated_is_not_taken_for_mass() -> None:
    flight = fly("testbed", "disturbance.constant_n_m=[0.01, 0.0, 0.0]")
    found = faulty.examined(flight.log(0), flight.vehicle)
    assert faulty.looks_good_and_is_wrong(found, flight.truth[0, 0]) == []


def test_a_known_value_that_the_log_denies_contradicts_what_is_proportional_to_it() -> None:
    log, used = faulty.sample("free-flyer")
    found = faulty.examined(log, used.model_copy(update={"known": {"mass": Known(value=44.0, sigma=0.1)}}))
    verdicts = faulty.verdicts(found)
    assert {verdicts[name] for name in ("ixx", "iyy", "izz", "mass")} == {"contradicted"}
    assert {verdicts[name] for name in ("cg_x", "cg_y", "cg_z")} <= {"converged", "not_converged"}
    assert "known.mass = 44" in found.conclusions[0].contradiction


@pytest.mark.thorough
def test_a_contradicted_docked_object_names_its_phase_once() -> None:
    log, used = faulty.sample("docking")
    single = used.phases[0].model_copy(update={"known": {"mass": Known(value=44.0, sigma=0.1)}})
    found = faulty.examined(log, used.model_copy(update={"phases": (single, *used.phases[1:])}))
    assert found.docked is not None
    assert found.docked.contradiction.startswith(f"phase {single.name}: known.mass = 44 ")
    assert found.docked.contradiction.count(f"phase {single.name}") == 1


def test_a_weighed_mass_leaves_the_log_its_own_part_of_each_sigma() -> None:
    """What the scale leaves open was taken off in full, though the mass had calibrated it: nothing was left that a misfit could touch."""
    log, used = faulty.sample("free-flyer")
    weighed = faulty.examined(log, faulty.stated(used, "thrust.scale_sigma=0.05", "known.mass={value=22.0, sigma=1e-4}"))
    plain = analysed("free-flyer")
    own = np.sqrt(contradict._noise_variance(weighed.conclusions[0], weighed.vehicle))
    bare = np.sqrt(np.diag(plain.conclusions[0].covariance))
    inertia, mass = plain.conclusions[0].values[:6], plain.conclusions[0].values[9]
    # by the weighed mass inertia is as uncertain as the log's own mass
    np.testing.assert_allclose(own[[0, 3, 5]], np.hypot(bare[:6], inertia * bare[9] / mass)[[0, 3, 5]], rtol=0.05)
    assert own[9] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.thorough
def test_what_is_known_of_one_phase_enters_that_phase_alone() -> None:
    log, used = faulty.sample("docking")
    single = used.phases[0].model_copy(update={"known": {"mass": Known(value=20.0, sigma=0.05)}})
    plain, found = analysed("docking"), faulty.examined(log, used.model_copy(update={"phases": (single, *used.phases[1:])}))
    own = plain.conclusions[0].estimates["mass"].sigma or 0.0
    both = 1 / np.hypot(1 / own, 1 / 0.05)  # two independent weighings
    assert found.conclusions[0].estimates["mass"].sigma == pytest.approx(both, rel=1e-6)
    assert found.conclusions[1].estimates == plain.conclusions[1].estimates
    # the docked object takes the weighed mass: m2 = m12 − m1
    assert found.docked is not None
    mass, sigma = found.docked.estimates["mass"].value, found.docked.estimates["mass"].sigma
    assert mass == pytest.approx(15.0, abs=4 * (sigma or 0.0))
    combined = plain.conclusions[1].estimates["mass"].sigma or 0.0
    assert sigma == pytest.approx(np.hypot(combined, both), rel=1e-3)


def test_a_thrust_scale_common_to_both_phases_does_not_hide_the_docked_object() -> None:
    log, used = faulty.sample("docking")
    wide = faulty.stated(used.model_copy(update={"docking": None}), "thrust.scale_sigma=0.2")
    found = faulty.examined(log, wide)
    assert found.docked is not None
    sigma = found.docked.estimates["mass"].sigma
    assert sigma == pytest.approx(0.2 * 15.0, rel=0.1)  # the scale's, not the difference of two of its kind


def test_the_split_at_a_change_takes_a_docking_that_names_the_split_phase_with_it() -> None:
    from massprop_cli.conclude.correctedestimate import split

    _, used = faulty.sample("docking")
    before, after = (used.phases[0].name, used.phases[1].name)
    named = faulty.stated(used, f'docking.before="{before}"', f'docking.after="{after}"')
    middle = (named.phases[1].start_s + named.phases[1].end_s) / 2
    cut = split(named, named.phases, middle)
    assert [phase.name for phase in cut.phases] == [before, f"{after}-1", f"{after}-2"]
    assert cut.docking is not None
    assert (cut.docking.before, cut.docking.after) == (before, f"{after}-1")
    early = split(named, named.phases, (named.phases[0].start_s + named.phases[0].end_s) / 2)
    assert early.docking is not None
    assert (early.docking.before, early.docking.after) == (f"{before}-2", after)


def test_what_was_known_of_a_split_phase_is_of_neither_part() -> None:
    from massprop_cli.conclude.correctedestimate import split

    _, used = faulty.sample("free-flyer")
    known = used.model_copy(update={"known": {"mass": Known(value=22.0, sigma=0.1)}})
    cut = split(known, [Phase(name="all", start_s=0.0, end_s=60.0)], 30.0)
    assert [cut.in_phase(phase).known for phase in cut.phases] == [{}, {}]


@pytest.mark.thorough
def test_what_several_causes_agree_on_is_less_certain_where_none_of_them_is_sure() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    clean = faulty.examined(log, used)
    good = {name for name, verdict in faulty.verdicts(clean).items() if verdict == "converged"}
    assert len(good) > 5

    def told(code: str) -> Analysis:
        fault = Fault(Notice(code, "the log fits if this, or if that"), Correction(()))
        # what corrects it gives the same values, and so do its rivals
        answer = CorrectedEstimate(fault, (), clean.conclusions, clean.vehicle, ([clean.conclusions[0].values],))
        return judged(replace(clean, faults=(fault,)), [answer])

    named, unnamed = told("jet-sign"), told("cause-unknown")
    assert {name for name, verdict in faulty.verdicts(named).items() if verdict == "converged"} == good
    wider = unnamed.conclusions[0].sigmas[:9] / clean.conclusions[0].sigmas[:9]
    assert wider.min() > 1
    assert np.median(wider) > 10


@pytest.mark.thorough
@pytest.mark.seeds
@pytest.mark.parametrize(
    ("scatter_s", "most", "seed"),
    [(1e-3, 3.0, 0), pytest.param(2e-3, 4.5, 1, marks=pytest.mark.thorough)],
)
def test_times_that_scatter_make_no_inertia_too_small(scatter_s: float, most: float, seed: int) -> None:
    """Of pulses that fill their cycles the overlap had been lost: 9 to 30 sigma, and converged."""
    log, used = faulty.sample("free-flyer")
    scattered = log.time_s + scatter_s * np.random.default_rng(seed).standard_normal(len(log.time_s))
    found = faulty.examined(replace(log, time_s=scattered, interval_s=np.diff(scattered, prepend=scattered[0] - 0.05)), used)
    z = faulty.z_scores(found, TRUTH)
    assert max(abs(z[name]) for name in ("ixx", "iyy", "izz", "mass")) < most
    assert faulty.looks_good_and_is_wrong(found, TRUTH) == []


@pytest.mark.thorough
def test_forces_in_another_unit_than_torques_give_no_converged_cg() -> None:
    """They look like an IMU out of place: of k times the force the CG c looks like k c, with the IMU (k - 1) c away."""
    flight = fly(str(WRENCH), EACH_WAY)
    log = flight.log(0)
    wrong = replace(log, command=log.command * np.repeat([1.0, 1 / 8.0], 3))
    found = faulty.examined(wrong, flight.vehicle)
    (notice,) = [notice for notice in found.notices if notice.code == "thrust-scale"]
    shown = notice.message.split("cmd_force_x_n, cmd_force_y_n, cmd_force_z_n give ")[1]
    assert float(shown.split(" times")[0]) == pytest.approx(8.0, rel=0.25)
    assert "the IMU sits" in notice.message
    verdicts = faulty.verdicts(found)
    assert {verdicts[name] for name in (*CG, "mass")} == {"contradicted"}
    assert verdicts["izz"] == "contradicted"  # as well the torques are in another unit, and the inertia an eighth
    (answer,) = [answer for answer in found.mended if answer.fault.notice is notice]
    for name, true in zip(QUANTITIES, flight.truth[0, 0], strict=True):
        if name in (*CG, "mass"):  # no better than the rivals agree: the IMU out of place gives other values
            one = answer.conclusions[0].estimates[name]
            assert one.value is None or abs(one.value - true) < 4 * (one.sigma or 0.0)


@pytest.mark.thorough
def test_diverts_that_are_all_off_by_the_same_part_are_no_imu_out_of_place() -> None:
    factor = 1.25
    log, used = faulty.sample("free-flyer")
    diverts = [jet.name for jet in used.jets if jet.name.startswith("divert")]
    found = faulty.examined(log, faulty.pushing(used, dict.fromkeys(diverts, 1 / factor)))
    (notice,) = [notice for notice in found.notices if notice.code == "thrust-scale"]
    assert f"jets {', '.join(diverts)} give " in notice.message
    assert float(notice.message.split(" give ")[1].split(" times")[0]) == pytest.approx(factor, rel=0.1)
    assert faulty.looks_good_and_is_wrong(found, TRUTH) == []
    assert faulty.verdicts(found)["mass"] == "contradicted"


def test_a_clean_log_is_not_contradicted() -> None:
    log, used = faulty.sample("free-flyer", 20.0)
    found = faulty.examined(log, used)
    assert [c.contradiction for c in found.conclusions] == [""]
    assert found.mended == ()
    assert set(faulty.verdicts(found).values()) <= {"converged", "not_converged", "not_excited"}
    assert len(QUANTITIES) == len(faulty.verdicts(found))


def test_a_causal_estimate_that_lost_its_way_is_contradicted_by_the_fit_of_the_same_data() -> None:
    found = analysed("free-flyer")
    causal, settled = found.histories[0], found.settled[0]
    assert divergence_contradiction(causal, settled) is None
    values, covariance = causal.bare
    away = values.copy()
    away[3] += 3.5 * np.sqrt(covariance[3, 3])
    against = divergence_contradiction(replace(causal, bare=(away, covariance)), settled)
    assert against is not None
    assert [name for name, hit in zip(QUANTITIES, against.affected, strict=True) if hit] == ["iyy"]
    assert [cause.code for cause in against.causes] == ["causal-estimate-lost"]
    broken = divergence_contradiction(causal, replace(settled, bare=(np.full(10, np.nan), np.full((10, 10), np.nan))))
    assert broken is not None
    assert broken.affected.all()
    assert [cause.code for cause in broken.causes] == ["fit-lost"]


@pytest.mark.thorough
def test_a_gyros_scale_beside_a_fault_of_the_accelerometer_leaves_no_inertia_converged() -> None:
    """The accelerometer's bias alone was named, and as it moves no inertia, this stayed converged, 11 to 16 sigma off."""
    flight = fly("free-flyer", *RANDOM, seeds=(3,))
    log, noise = flight.log(0), 2e-3
    turned = log.delta_theta_imu_rad + noise * log.interval_s[:, None] * np.random.default_rng(2).standard_normal((log.rows, 3))
    felt = log.delta_v_imu_m_s + np.array([0.05, -0.05, 0.05]) * log.interval_s[:, None]
    found = faulty.examined(
        faulty.with_increments(log, 1.01 * turned, felt), faulty.stated(flight.vehicle, f"imu.gyro_noise_rad_s={noise}")
    )
    assert "accel-bias" in [notice.code for notice in found.notices]
    verdicts, z = faulty.verdicts(found), faulty.z_scores(found, flight.truth[0][0])
    assert [name for name in QUANTITIES if verdicts[name] == "converged" and abs(z[name]) > 4] == []


@pytest.mark.thorough
def test_on_times_of_another_scale_leave_no_mass_converged() -> None:
    """They look like commands that act later, which moves no mass: it was converged, and a fifth too small."""
    log, used = faulty.sample("free-flyer")
    found = faulty.examined(replace(log, command=0.8 * log.command), used)
    assert faulty.verdicts(found)["mass"] == "contradicted"
    assert faulty.looks_good_and_is_wrong(found, TRUTH) == []


def test_a_known_mass_that_the_log_belies_takes_what_it_moves_with_it() -> None:
    """What goes with the thrust in any case; a CG where it is correlated with the mass, as beneath rotors."""
    found = analysed("free-flyer")
    history, place = found.histories[0], QUANTITIES.index("cg_z")
    alone = history.values[-1] + 3 * history.sigmas[-1] * (np.arange(10) == place)
    belied = known_value_contradiction(replace(history, contradicted={"mass": "known.mass"}, bare=(alone, history.bare[1])), found.vehicle)
    assert belied is not None
    assert [name for name, hit in zip(QUANTITIES, belied.affected, strict=True) if not hit] == ["cg_x", "cg_y"]
