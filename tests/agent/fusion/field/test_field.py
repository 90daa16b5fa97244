"""The estimator ``field``: totals, blocks, decision and limits over small lawns, and its purity."""

import math
from dataclasses import replace as replace_fit

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from shapely import box

from radron.agent.config.estimators import FieldEstimatorConfig
from radron.agent.config.mission import GroundConfig
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.deferred import Deferred, Folder
from radron.agent.fusion.field.analysis import Analysis
from radron.agent.fusion.field.fit import FLAT, MEAN_BQM2, Problem, Smoothness
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.kernel import MiniPix, kernels_of
from radron.agent.fusion.field.model import CountModel, Priors, Solution, of_drones
from radron.agent.fusion.field.positive import PositiveMap
from radron.agent.fusion.field.report import total_of
from radron.agent.fusion.field.sums import Sums
from radron.agent.terrain.ground import Ground
from radron.protocol.contamination import Contamination, Finding

LEVEL = 1e6
NS = 1_000_000_000
SIDE_M = 60.0
GRID = Grid.around(box(0.0, 0.0, SIDE_M, SIDE_M))
MINIPIX = MiniPix(response_of("Cs-137", "soil"))


def patch(x, y):
    return LEVEL * ((np.abs(x - 22.0) < 8.0) & (np.abs(y - 18.0) < 8.0))


def told(lawn, observations, **field):
    estimator = lawn.estimator_of(**field)
    state = lawn.folded(estimator, observations)
    return estimator.contamination(state, lawn.step_of(0))


@pytest.fixture(scope="module")
def observations(lawn):
    return lawn.survey(patch)


@pytest.fixture(scope="module")
def of_patch(lawn, observations):
    return told(lawn, observations)


def test_total_of_a_patch(of_patch):
    true_bq = LEVEL * 16.0**2
    assert of_patch.finding is Finding.AREA
    assert of_patch.evidences[Finding.AREA] > 50.0
    assert of_patch.total_bq.low < true_bq < of_patch.total_bq.high
    assert of_patch.total_bq.median == pytest.approx(true_bq, rel=0.2)


def test_blocks_of_a_patch(of_patch):
    """Most of the intervals hold the true mean, also those of the hot blocks alone; the highest block is in the patch."""
    side, across = of_patch.block_m, of_patch.across
    assert side == pytest.approx(10.0)
    held, hot = [], []
    fine = (np.arange(20) + 0.5) / 20.0 * side
    for place, block in enumerate(of_patch.blocks):
        up, along = divmod(place, across)
        x, y = np.meshgrid(of_patch.corner_m[0] + along * side + fine, of_patch.corner_m[1] + up * side + fine)
        true = float(patch(x, y).mean())
        held.append((block.low - 1) * of_patch.unit_bqm2 <= true <= (block.high + 1) * of_patch.unit_bqm2)
        hot.append(true > 0.5 * LEVEL)
    assert np.mean(held) >= 0.8
    assert np.mean(np.array(held)[hot]) >= 0.75
    assert math.dist(of_patch.highest_m[:2], (22.0, 18.0)) < 11.0
    assert of_patch.highest_bqm2.low <= 0.9 * LEVEL


def test_dose_above_a_patch(of_patch):
    """1 m above the middle of a square of 16 m: 0.42 of an infinite plane's 3.08e-12 Sv/h per Bq/m2 (quadrature)."""
    wanted = 0.42 * 3.08e-12 * LEVEL
    assert of_patch.dose_svph.low < wanted < of_patch.dose_svph.high
    assert of_patch.dose_svph.median == pytest.approx(wanted, rel=0.3)
    assert math.dist(of_patch.dose_m[:2], (22.0, 18.0)) < 8.0


def test_nothing_is_told_as_nothing(lawn):
    report = told(lawn, lawn.survey(lambda x, y: 0.0 * x, seed=4))
    assert report.finding is Finding.NOTHING
    assert report.total_bq.low == 0.0
    assert report.total_bq.median < 0.1 * LEVEL * 16.0**2


def uniform(x, y):
    return LEVEL + 0.0 * x


def test_total_of_uniform_ground(lawn):
    """The truth is uniform for 10 m beyond the area, where the estimator's cells end."""
    report = told(lawn, lawn.survey(uniform, seed=2, times=1))
    assert report.finding is Finding.AREA
    assert report.total_bq.low < LEVEL * lawn.side_m**2 < report.total_bq.high
    assert report.total_bq.median == pytest.approx(LEVEL * lawn.side_m**2, rel=0.25)


@pytest.fixture(scope="module")
def analysis():
    return Analysis(GRID, MINIPIX, Ground(GroundConfig()), "Cs-137", FieldEstimatorConfig())


def flat_sums(level_bqm2, seed=1, spacing_m=8.0, height_m=5.0):
    """Sums of hovers over uniform ground, with counts by the estimator's own kernels: they test the fit, not the kernels."""
    live, line, rows = 4_500_000_000, np.arange(2, int(SIDE_M), spacing_m), []
    for x in line:
        for y in line:
            place = [int(1e3 * part) * live for part in (x, y, height_m)]
            rows.append([int(2 * x / SIDE_M), 2, int(x), int(y), 1, live, *place, 0, 0, 0, 0])
    sums = Sums.none(2).plus(rows)
    kernels = kernels_of(sums, np.full(len(sums), height_m), GRID, MINIPIX)
    rate = MINIPIX.background_ps + (kernels.direct + kernels.scattered).astype(float) @ np.full(GRID.size, level_bqm2)
    table = sums.table.copy()
    table[:, 11:] = np.random.default_rng(seed).poisson(rate * sums.live_s[:, None])
    return Sums(table)


@pytest.mark.parametrize("level_bqm2", [1e6, 1e7, 1e8])
def test_strong_contamination_is_not_told_as_background(analysis, level_bqm2):
    """Below the truth by 3e-8 at 30 MBq/m2, and an exception at 100 MBq/m2, if a fit begins with all counts as background."""
    report = analysis.anew(flat_sums(level_bqm2), [0.2, 0.2]).contamination
    true_bq = level_bqm2 * SIDE_M**2
    assert report.finding is Finding.AREA
    assert report.total_bq.median == pytest.approx(true_bq, rel=0.15)
    assert report.total_bq.low < true_bq < report.total_bq.high


def problem_of(sums):
    height = np.full(len(sums), 5.0)
    model = CountModel(sums, height, kernels_of(sums, height, GRID, MINIPIX), GRID, MINIPIX)
    return Problem(model, Priors(0.3, of_drones([0.2, 0.2]), 0.05))


CLEAN = Solution.nothing(2)


def test_map_of_activity_far_above_its_scale(analysis):
    """Beyond 709 scales e^x is no number; a mean of many scales sets the scale."""
    sums = flat_sums(1e6)
    level = replace_fit(analysis.anew(sums, [0.2, 0.2]).level, smoothness=Smoothness(1e3, 14.0))
    positive = PositiveMap(problem_of(sums).model, level)
    assert positive.scale > 1e5
    positive.scale = 1e3
    activity = positive.activity(positive.start())
    assert np.isfinite(activity).all()
    assert float(activity @ GRID.inside_m2) == pytest.approx(1e6 * SIDE_M**2, rel=0.2)


def test_six_steps_are_enough():
    """A fit of 20 steps is the same one: within a tenth of its uncertainty."""
    problem = problem_of(flat_sums(1e6))
    start = problem.with_ground(CLEAN)
    (few, sigma), (many, _) = (total_of(problem.fitted(start, steps), problem.model) for steps in (6, 20))
    assert abs(few - many) < 0.1 * sigma


def test_steps_of_the_background_are_limited_and_never_downhill(monkeypatch):
    problem = problem_of(flat_sums(1e8))
    assert 0.0 < np.abs(problem.fitted(CLEAN, 1).solution.background).max() <= 1.0
    monkeypatch.setattr(problem, "_density", lambda solution, _: 0.0 if solution is CLEAN else -1.0)
    fisher, pull = problem._normal(CLEAN)
    assert problem._stepped(CLEAN, fisher, pull, FLAT) is CLEAN


def test_ground_beyond_may_be_as_active_as_the_area():
    problem = problem_of(flat_sums(1e6))
    start = problem.with_ground(CLEAN)
    precision = np.diag(problem.precision(start, Smoothness(1e3, 14.0)))[: len(start.ground)]
    assert precision[[0, -1]] == pytest.approx(MEAN_BQM2**-2, rel=1e-3)


def test_counts_out_of_range_leave_the_map_empty_and_are_counted(lawn, observations, monkeypatch):
    estimator = lawn.estimator_of()

    def singular(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(estimator._analysis, "anew", singular)
    state = lawn.folded(estimator, observations)
    assert estimator.contamination(state, lawn.step_of(0)) is None
    assert estimator.failed == 1


def test_exposures_before_the_start_near_the_ground_and_far_away_do_not_count(lawn):
    estimator = lawn.estimator_of()
    kept = lawn.observation("a", 1, (5.0, 5.0, 3.0), (5, 1), 1.0)
    others = [
        replace(kept, stamp_ns=lawn.start_ns - NS, middle_ns=lawn.start_ns - NS - NS // 4),
        replace(kept, position=(5.0, 5.0, 0.5)),
        replace(kept, position=(lawn.side_m + 160.0, 5.0, 3.0)),
    ]
    state = estimator.step(estimator.initial(lawn.start_ns), lawn.step_of(0), [*others, kept])
    assert state.pending == (kept,)


def test_a_replay_fits_once(lawn, observations, monkeypatch):
    """States in between are of no interest to a replay."""
    estimator = lawn.estimator_of()
    fits, anew = [], estimator._analysis.anew
    monkeypatch.setattr(estimator._analysis, "anew", lambda *given: fits.append(given) or anew(*given))
    state = lawn.folded(estimator, observations)
    assert not fits
    assert estimator.contamination(state, lawn.step_of(0)) == estimator.contamination(state, lawn.step_of(0))
    assert len(fits) == 1


def test_same_measurements_in_any_order_give_the_same_bits(lawn, observations, of_patch):
    again = told(lawn, lawn.shuffled(observations))
    assert msgspec.msgpack.encode(again) == msgspec.msgpack.encode(of_patch)


def test_a_refinement_uses_later_measurements_and_leaves_no_trace(lawn, observations):
    estimator = lawn.estimator_of()
    early = [one for one in observations if one.stamp_ns - lawn.start_ns < 46 * 10**9]
    state = lawn.folded(estimator, early, until_s=46)
    assert state.refinement is not None
    before = state.fit.analysed.contamination
    assert estimator.contamination(state, lawn.step_of(0)) != before
    assert state.fit.analysed.contamination is before


def test_report_is_compact_and_checked(of_patch):
    data = msgspec.msgpack.encode(of_patch)
    assert len(data) < 1000
    assert msgspec.msgpack.decode(data, type=Contamination) == of_patch


def test_the_process_beside_the_agent_gives_the_same_map(lawn, observations, of_patch):
    deferred = Deferred(lawn.estimator_of())
    state = lawn.folded(deferred, observations)
    at = lawn.step_of(0)
    assert deferred.hypothesis(state, at) is None
    assert deferred.contamination(state, at) is None
    deferred.take(1, Folder(lawn.estimator_of()).answer(deferred, 1))
    assert deferred.contamination(state, at) == of_patch
