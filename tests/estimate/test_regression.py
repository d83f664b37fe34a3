"""The one causal pass: what it keeps, what it looks at again, and whether its values hold while they are still being learned."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from massprop_cli import QUANTITIES
from massprop_cli.base.arrays import Array
from massprop_cli.estimate import compiled, engine, noiselevels, offline, triangle
from massprop_cli.estimate.causal import LEARNING, LONGEST
from massprop_cli.estimate.history import History, phase_cycles
from massprop_cli.estimate.initial import fallback
from massprop_cli.estimate.regression import Regression
from massprop_cli.estimate.triangle import Run
from massprop_cli.inputs.vehicle import Phase
from massprop_cli.model.sensitivity import Consider
from massprop_cli.model.system import System, system_of
from massprop_cli.prepare.timing import Timing
from massprop_cli.testbed import scenario, simulate
from tests import flight
from tests.analysed import SAMPLES, analysed
from tests.model.test_linearise import reference

ALL = Phase(name="all", start_s=0, end_s=1e9)


@cache
def causal(name: str, first: int, count: int) -> list[tuple[History, Array]]:
    """Every phase of logs of a packaged scenario with its truth (10,)."""
    flown = simulate.fly(scenario.load(name), range(first, first + count))
    found = []
    for i in range(count):
        log, used = flown.log(i), flown.vehicle
        samples = Timing(float(used.cycle.command_delay_cycles), 0.0).of(log, used)
        phases = [(p, phase_cycles(p, samples.executed.end_s, samples.executed.usable)) for p in used.phases or (ALL,)]
        levelled, _ = noiselevels.with_noise_levels(samples, [cycles for _, cycles in phases], used)
        for (phase, cycles), truth in zip(phases, flown.truth[i], strict=True):
            found.append((engine.replay(samples, cycles, phase, levelled.in_phase(phase)), truth))
    return found


def of_sample(name: str) -> list[tuple[History, Array]]:
    """The same of a sample log, which another engine flew."""
    truths = json.loads((SAMPLES / name / "truth.json").read_text())["phases"]
    told = [np.array([truth[quantity] for quantity in QUANTITIES]) for truth in truths]
    return list(zip(analysed(name).histories, told, strict=True))


def errors_on_the_way(found: list[tuple[History, Array]]) -> Array:
    """All values given at all cycles, in their own sigmas, without their signs."""
    z = np.concatenate([(np.abs(history.values - truth) / history.sigmas).ravel() for history, truth in found])
    given: Array = z[np.isfinite(z)]
    return given


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["refined", pytest.param("free-flyer", marks=pytest.mark.numerical), "air-bearing", "docking"])
def test_values_hold_from_the_first_that_is_given(name: str) -> None:
    """The estimator before this one: up to 9,800 sigma on the way on such logs."""
    z = errors_on_the_way(causal(name, 1, 2) if name == "refined" else of_sample(name))
    assert (z > 4).mean() < 0.002
    assert z.max() < 8


@pytest.mark.seeds
@pytest.mark.thorough
@pytest.mark.parametrize("name", ["refined", "free-flyer", "testbed", "docking"])
def test_values_hold_on_the_way_over_many_logs(name: str) -> None:
    """Of 40: what a log is off by, it is off by for long, so that of 20 logs chance makes some percents."""
    z = errors_on_the_way(causal(name, 1, 40))
    assert (z > 4).mean() < 0.001
    assert z.max() < 8
    assert 0.92 < (z < 1.96).mean() < 0.985


def test_values_are_given_for_most_of_the_log() -> None:
    """Honest on the way does not mean silent on the way."""
    for history, _ in [*causal("refined", 1, 2), *of_sample("docking")]:
        assert np.isfinite(history.values).mean() > 0.9


@pytest.mark.numerical
def test_what_is_kept_does_not_grow_with_the_log() -> None:
    flown = flight.standard("free", 320)
    samples = flown.samples(np.random.default_rng(1))
    one = Regression(samples, slice(2, 320), flown.resolved, Consider())
    run, sizes = one.begin(reference(flight.TRUTH)), []
    for end in (50, 150, 320):
        run, _ = one.process(run, end)
        assert run.state is not None
        sizes.append((run.triangle.shape, run.state.mean.shape, run.state.root.shape))
    assert len(set(sizes)) == 1


@pytest.mark.numerical
def test_no_cycle_is_looked_at_again_but_those_of_the_ring(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted in cycles that are linearised: each once, and at most the ring as often as the estimate moves."""
    found = analysed("free-flyer")
    spans: list[slice] = []

    def counted(samples: object, cycles: slice, *rest: object) -> System:
        spans.append(cycles)
        return system_of(samples, cycles, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(triangle, "system_of", counted)
    monkeypatch.setattr(compiled, "supports", lambda *_: False)
    samples = found.samples
    engine.replay(samples, slice(2, len(samples)), ALL, flight.resolved(found.vehicle))
    assert max(span.stop - span.start for span in spans) <= LEARNING + LONGEST
    late = [span for span in spans if span.start > 700]
    again = [span for span in late if span.stop - span.start > LONGEST + 1]
    assert len(again) <= 3
    assert sum(span.stop - span.start for span in spans) < 6 * len(samples)


@pytest.mark.numerical
def test_the_triangle_holds_what_batch_least_squares_holds() -> None:
    """Everything linear: the coefficients that fit best, block by block, against all rows at once."""
    flown = flight.standard("free", 320)
    samples, about = flown.samples(np.random.default_rng(5)), reference(flight.TRUTH)
    one = Regression(samples, slice(2, 320), flown.resolved, Consider())
    run, kept = one.begin(about), []
    for end in (20, 90, 91, 200, 320):
        run, whitened = one.process(run, end)
        kept.append(one.ordered(whitened))
    rows = np.vstack([one.begin(about).triangle, *kept])
    size = one.unknowns + one.phi_map.size
    scale = np.sqrt((rows[:, :size] ** 2).sum(0))
    batch = np.linalg.lstsq(rows[:, :size] / scale, rows[:, size], rcond=None)[0]
    held = np.linalg.lstsq(run.triangle[:, :size] / scale, run.triangle[:, size], rcond=None)[0]
    np.testing.assert_allclose(held, batch, rtol=1e-6, atol=1e-6 * np.abs(batch).max())


@pytest.mark.numerical
def test_the_coupling_stays_free_until_each_axis_has_been_driven() -> None:
    """Two axes driven: noise must not stand in for the third."""
    on = flight.pulses(300, seed=4)
    on[:, 8:] = 0.0  # no couple about Z, and no force that would turn about it by the CG's offset
    flown = flight.fly(flight.vehicle("free"), on, flight.TRUTH)
    samples = flown.samples(np.random.default_rng(2))
    one = Regression(samples, slice(2, 300), flown.resolved, Consider())
    run = one.begin(fallback(flown.used))
    run, _ = one.process(run, 300)
    assert not one.solved(run).tied
    history = engine.replay(samples, slice(2, 300), ALL, flown.resolved)
    z = np.abs((history.values - flight.TRUTH) / history.sigmas)
    assert np.nanmax(z[:, :6]) < 6
    assert history.sigmas[-1, QUANTITIES.index("izz")] > 0.2 * flight.TRUTH[5]


@pytest.mark.numerical
def test_a_rate_long_past_may_be_forgotten_without_a_misfit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors of where the rate began grow along the motion; started anew again and again, little is lost and nothing jars."""
    flown = flight.standard("free", 320)
    samples = flown.samples(np.random.default_rng(7))
    whole = offline.fit(samples, slice(2, 320), ALL, reference(flight.TRUTH), flown.resolved).history
    renewed: list[int] = []
    once = Regression._with_rate_reset

    def counted(self: Regression, run: Run) -> Run:
        found = once(self, run)
        renewed.extend([run.at] * (found is not run))
        return found

    monkeypatch.setattr(Regression, "_with_rate_reset", counted)
    monkeypatch.setattr(triangle, "FORGOTTEN", 0.9)
    monkeypatch.setattr(offline, "BLOCK", 32)
    pieces = offline.fit(samples, slice(2, 320), ALL, reference(flight.TRUTH), flown.resolved).history
    assert len(renewed) >= 8
    assert (pieces.sigmas[-1] >= whole.sigmas[-1] * (1 - 1e-6)).all()
    assert (pieces.sigmas[-1] < 3 * whole.sigmas[-1]).all()
    assert (np.abs(pieces.values[-1] - whole.values[-1]) < 3 * pieces.sigmas[-1]).all()
    z = np.abs(pieces.values[-1] - flight.TRUTH) / pieces.sigmas[-1]
    assert z.max() < 4
    assert (pieces.normalised[1:] ** 2).mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / pieces.normalised[1:].size))
