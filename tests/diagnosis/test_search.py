"""In which order causes are followed, and which are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massprop_cli.diagnosis import hypotheses, refit, search
from massprop_cli.diagnosis.comparison import Fitted
from massprop_cli.diagnosis.diagnose import _pair
from massprop_cli.diagnosis.refit import Refit, chi_square_limit, corrected_alone, drift_is_unneeded, hopeless, refitted
from massprop_cli.diagnosis.screening import Screening
from massprop_cli.diagnosis.search import _by_promise, codes, searched
from tests import faulty
from tests.diagnosis.test_diagnose import LAG
from tests.diagnosis.test_screening import look_at, look_of, otherwise
from tests.flown import PLAN


def of(screening: Screening, code: str) -> tuple[float, Fitted]:
    return next((score, found) for score, found in screening.ranked.fitted_so_far if found.hypothesis.code == code)


def delay_alone(screening: Screening) -> Refit:
    trial = refitted(screening, of(screening, "delay-mismatch")[1])
    assert trial is not None
    return trial


def test_a_cause_that_leaves_other_channels_is_no_first_of_two(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is known of the coefficients of one testbed says nothing of those of another: such pairs had ended in a traceback."""
    screening = look_at("free-flyer", *PLAN, LAG)
    _, found = of(screening, "delay-mismatch")
    assert corrected_alone(screening, found) is not None
    silent = screening.case.log.command.copy()
    silent[:, 0] = 0.0
    assert 0 in screening.free.fired
    other = screening.case._replace(log=replace(screening.case.log, command=silent))
    monkeypatch.setattr(refit, "applied", lambda *_: other)
    assert corrected_alone(screening, found) is None


@pytest.mark.thorough
def test_a_lag_is_followed_first_though_other_late_causes_seem_likelier() -> None:
    screening = look_at("free-flyer", *PLAN, LAG)
    score, _ = of(screening, "thrust-lag")
    likelier = [found.hypothesis.code for rough, found in screening.ranked.fitted_so_far if rough < score]
    assert "delay-mismatch" in likelier  # by one reduction
    first, begun = _by_promise(screening, None, screening, min(rough for rough, _ in screening.ranked.fitted_so_far))[-1]
    assert first.hypothesis.code == "thrust-lag"
    assert begun is not None
    found = searched(screening, [], (6, 6), chi_square_limit(screening))
    assert codes(found[0]) == {"thrust-lag"}
    assert [codes(trial) for trial in found if trial.fits] == [{"thrust-lag"}]


@pytest.mark.parametrize(("key", "no_more"), [("cycle.command_delay_cycles=1.5", True), ("imu.clock_drift_ppm=1500.0", False)])
def test_a_drift_of_the_clocks_is_followed_where_it_explains_more_than_a_delay(key: str, no_more: bool) -> None:
    screening = otherwise(key)
    trial = delay_alone(screening)
    assert trial.fits is no_more
    assert drift_is_unneeded(trial, of(screening, "clock-drift")[1]) is no_more


@pytest.mark.seeds
@pytest.mark.thorough
def test_what_would_leave_a_multiple_of_what_another_leaves_is_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two jets that fail on a bearing, where a low-pass is curved, so that one screening doesn't rule it out."""
    failed = 'actuators.failures=[{jet="roll_p1", thrust=0.0}, {jet="pitch_n1", thrust=0.9}]'

    def tried_of() -> tuple[set[str], float]:
        screening = look_at("testbed", failed)
        found = searched(screening, [], (20, 20), chi_square_limit(screening))
        assert not any(trial.fits for trial in found)
        return {code for trial in found for code in codes(trial)}, min(trial.excess for trial in found)

    few, least = tried_of()
    monkeypatch.setattr(search, "IN_VAIN", np.inf)
    all_of_them, same = tried_of()
    assert least == pytest.approx(same)
    assert "accel-filter" in all_of_them - few


@pytest.mark.parametrize(("name", "bent"), [("free-flyer", False), ("air-bearing", True)])
def test_what_a_gyro_gets_wrong_bends_what_is_measured_on_a_bearing_alone(name: str, bent: bool) -> None:
    """There it moves the vertical. A unit makes another motion within the cycles, and nothing that is late follows a straight line."""
    screening = look_of(*faulty.sample(name))
    supposed = {
        one.code: one for one in (*hypotheses.listed(screening.model, screening.names), *hypotheses.units(screening.model, 0.05, True))
    }
    expected = {"gyro-scale": bent, "gyro-bias": bent, "gyro-units": True, "jet-position": False, "clock-drift": True}
    for code, curved in expected.items():
        found = Fitted(supposed[code], screening.model, screening.stated.x, screening.stated.chi_square, np.zeros(0))
        assert hopeless(screening, found, 0.0) is not curved, code


def test_a_cause_that_fits_alone_is_the_answer_though_it_was_first_tried_to_find_a_second_beside_it() -> None:
    screening = otherwise("jets.12.position_m=[0.0, 0.06, 0.0]")
    trial = refitted(screening, next(found for _, found in screening.ranked))
    assert trial is not None
    # one that says the same, begun elsewhere, was tried before and led nowhere
    before = replace(trial, fits=False, fitted=replace(trial.fitted, hypothesis=replace(trial.fitted.hypothesis)))
    found = _pair(screening, [before], np.inf)
    assert found is not None
    assert [(one.notice.code, "divert_xp" in one.notice.message) for one in found.faults] == [("jet-position", True)]
