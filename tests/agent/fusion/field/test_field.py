"""The estimator ``field``: totals, blocks, decision and limits over small lawns, and its purity."""

import math

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.fusion.deferred import Deferred, Folder
from radron.protocol.contamination import Contamination, Finding

LEVEL = 1e6


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
    """Most of the blocks' intervals hold the true mean; the highest block is in the patch."""
    side, across = of_patch.block_m, of_patch.across
    assert side == pytest.approx(10.0)
    inside, wrong = 0, 0
    fine = (np.arange(20) + 0.5) / 20.0 * side
    for place, block in enumerate(of_patch.blocks):
        up, along = divmod(place, across)
        x, y = np.meshgrid(of_patch.corner_m[0] + along * side + fine, of_patch.corner_m[1] + up * side + fine)
        true = float(patch(x, y).mean())
        inside += block.low * of_patch.unit_bqm2 - 1.0 <= true <= block.high * of_patch.unit_bqm2
        wrong += 1
    assert inside / wrong >= 0.8
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


def test_reference_hover_lowers_the_detection_limit(lawn):
    """Two minutes of both drones over clean ground measure the background; without them it is known to 30 %."""
    rng = np.random.default_rng(1)
    clean = [
        lawn.observation(drone, 10_000 + k, (2.0, 2.0, 3.0), rng.poisson((2.51, 0.025)), 0.4 + 0.001 * k)
        for k in range(240)
        for drone in ("a", "b")
    ]
    observations = lawn.survey(lambda x, y: 0.0 * x, seed=6, times=1)
    later = [replace(one, stamp_ns=one.stamp_ns + 10**9, middle_ns=one.middle_ns + 10**9) for one in observations]
    without, known = told(lawn, later), told(lawn, [*clean, *later], reference_s=0.9)
    assert 0.4 < known.least_bqm2 / without.least_bqm2 < 0.7


def test_same_measurements_in_any_order_give_the_same_bits(lawn, observations, of_patch):
    again = told(lawn, lawn.shuffled(observations))
    assert msgspec.msgpack.encode(again) == msgspec.msgpack.encode(of_patch)


def test_a_refinement_uses_later_measurements_and_leaves_no_trace(lawn, observations):
    estimator = lawn.estimator_of()
    early = [one for one in observations if one.stamp_ns - lawn.start_ns < 46 * 10**9]
    state = lawn.folded(estimator, early, until_s=46)
    assert state.refinement is not None
    before = state.analysed.contamination
    assert estimator.contamination(state, lawn.step_of(0)) != before
    assert state.analysed.contamination is before


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
