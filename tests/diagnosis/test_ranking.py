"""Hypotheses that are fitted when their turn comes stand in the order that they stand in when all are fitted."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np

from massprop_cli.diagnosis import hypotheses
from massprop_cli.diagnosis.comparison import ROUGHLY, fitted
from massprop_cli.diagnosis.design import Case
from massprop_cli.diagnosis.refit import chi_square_limit
from massprop_cli.diagnosis.screening import Screening, screened
from massprop_cli.inputs.vehiclefile import changed
from massprop_cli.prepare.timing import Timing
from tests import flight
from tests.flight import resolved


def weak(jet: int) -> Screening:
    """A log of which a jet gave but 80 % of what is stated."""
    flown = flight.standard()
    log = flown.log(np.random.default_rng(1))
    used = changed(flown.used, [f"jets.{jet}.force_n={[1.25 * x for x in flown.used.jets[jet].force_n]}"])
    found = screened(Case(log, resolved(used), Timing(2.0, 0.0)), slice(4, log.cycles))
    assert found is not None
    return found


def test_the_order_is_that_of_all_fitted_at_once() -> None:
    screening = weak(3)
    supposed = [*hypotheses.listed(screening.model, screening.names), *screening._likely_imu_hypotheses(), *screening._force_scales()]
    kinds = [one.code for one in supposed]
    every = fitted(screening.model, screening.free, screening.free.variance, supposed, tolerance=ROUGHLY)
    scores = sorted((screening.score(one.chi_square, one, kinds.count(one.hypothesis.code)), i) for i, one in enumerate(every))
    lazy = list(islice(replace(screening).ranked, 12))
    # two that always act together come in either order
    np.testing.assert_allclose([score for score, _ in lazy], [score for score, _ in scores[:12]], atol=0.5)
    own = {(kinds[i], supposed[i].subject): score for score, i in reversed(scores)}
    np.testing.assert_allclose([own[found.hypothesis.code, found.hypothesis.subject] for _, found in lazy], [s for s, _ in lazy], atol=0.5)


def test_a_channel_left_free_leaves_no_more_than_any_of_its_own_suppositions() -> None:
    screening = weak(3)
    for channel in range(len(screening.names)):
        own = [one for one in hypotheses.listed(screening.model, screening.names) if screening.model.channel(one) == channel]
        assert {one.code for one in own} == {"thrust-scale", "jet-position", "jet-direction"}
        bound, *each = fitted(screening.model, screening.free, screening.free.variance, [screening.model.without(channel), *own])
        assert all(one.chi_square.sum() > bound.chi_square.sum() - 1.0 for one in each)


def test_those_of_channels_beyond_hope_are_left_out() -> None:
    screening = weak(3)
    within = list(screening.ranked.within(chi_square_limit(screening)))
    about = {found.hypothesis.subject for _, found in within if screening.model.channel(found.hypothesis) is not None}
    assert (screening.names[3],) in about
    assert len(about) < len(screening.names)


def test_beyond_reach_nothing_that_is_about_a_channel_is_fitted() -> None:
    screening = weak(3)
    every = replace(screening).ranked
    others = {id(found) for _, found in every.fitted_so_far}
    assert {id(found) for _, found in every.within(np.inf, lambda: -np.inf)} == others
    best, _ = next(iter(every))
    reached = replace(screening).ranked
    (_, found), *_ = reached.within(np.inf, lambda: best)
    assert found.hypothesis.subject == (screening.names[3],)
    assert len(others) < len(reached.fitted_so_far) < len([*every])


def test_rivals_of_the_first_come_though_they_be_too_faint_to_be_named() -> None:
    screening = weak(3)
    best, _ = next(iter(screening.ranked))
    faint = replace(screening).ranked
    faint._most = best + 1e-6  # the first alone is likely enough
    assert len(list(faint.within(np.inf))) == 1
    near = [score for score, _ in faint.within(np.inf, rivals=1e6)]
    assert near == [score for score, _ in replace(screening).ranked.within(np.inf, rivals=1e6)]
    assert len(near) > 100


def test_one_that_came_by_another_way_than_as_a_rival_is_not_too_faint() -> None:
    screening = weak(3)
    ranked = replace(screening).ranked
    (_, first), *_ = ranked.within(np.inf)
    ranked._most = -np.inf  # whatever its rough score, which on a bearing says nothing of a turned gyro
    assert not ranked.only_rival(first.hypothesis)


def test_jets_that_are_swapped_back_are_no_hypothesis() -> None:
    """A second exchange may undo the first: then nothing is wired otherwise than stated."""
    screening = weak(3)
    first, count = hypotheses.swapped(screening.model, screening.names), len(screening.names)
    assert len(first) == count * (count - 1) // 2
    again = hypotheses.swapped(screening.model, screening.names, first[0].wiring)
    assert len(again) == len(first) - 1
    assert all(len(one.subject) > 1 for one in again)
