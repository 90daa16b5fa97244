"""The Bayesian estimator on synthetic flights, whose cones and counts come from an independent model."""

from __future__ import annotations

import dataclasses
import math
import random

import msgspec
import numpy as np
import pytest

from radron.agent.frames.carried import told
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.swarm import SwarmFrames
from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.search import SearchState
from radron.agent.fusion.bayes.state import BayesState
from radron.agent.fusion.engine import Fusion
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.registry import estimator_named
from radron.protocol.codec import encode
from radron.protocol.entries import Counts, Exposure, PoseSample
from support.flights.bayes import entries_of, errors_of, fusion_of, hypotheses


def test_a_static_source_is_found_with_its_activity(kit):
    """Two minutes of three drones at 12 m: the counts allow 0.1-0.2 m (reference: Fisher bound 0.11 m)."""
    mission = kit.mission_of()
    medians, shares = [], []
    for seed in range(3):
        entries = entries_of(kit, mission, np.random.default_rng(seed), 120.0, lambda _: (35.0, 62.0), 2e9)
        found = hypotheses(kit, mission, entries, 120.0)
        medians.append(np.median(np.linalg.norm(errors_of(found[-100:], lambda _: np.array([35.0, 62.0])), axis=1)))
        shares.append(found[-1][1].activity_bq / 2e9)
    assert np.median(medians) < 0.3
    assert np.all(np.abs(np.array(shares) - 1.0) < 0.25)  # the assumed areas differ from the areas behind these counts


def test_a_measured_background_is_no_source(kit):
    """A background beyond all levels of the prior, 1.95 times the tables', counts as a source beyond the fence."""
    mission = kit.mission_of()
    measured = with_background(mission, 6.0)
    none = []
    for one in (mission, measured):
        entries = entries_of(kit, one, np.random.default_rng(1), 60.0, None, 0.0, background=4.0)
        fusion = fusion_of(one)
        kit.feed(fusion, entries)
        kit.settle(fusion, kit.T0_NS + 60_000_000_000)
        none.append(fusion.outlook.none)
    assert none[0] < 1e-3
    assert none[1] > 0.8
    assert measured.mission_id != mission.mission_id


def with_background(mission, per_s):
    bayes = msgspec.structs.replace(mission.fusion.bayes, background_per_s=per_s)
    return msgspec.structs.replace(mission, fusion=msgspec.structs.replace(mission.fusion, bayes=bayes))


def test_a_frame_that_is_put_right_leaves_no_bias_behind(kit):
    """For a minute drone a's frame is believed 3 m off, within its sigma; then it is put where it is. The bias learnt until
    then no longer holds.
    """
    mission = kit.mission_of()
    left = []
    for seed in range(6, 9):
        entries = entries_of(kit, mission, np.random.default_rng(seed), 90.0, lambda _: (35.0, 62.0), 2e9)
        graph, right_ns = FrameGraph.from_launch_layout(mission), kit.T0_NS + 60_000_000_000
        for drone in mission.drones:
            graph.place(drone.id, 0, Transform(covariance=np.diag([0.01, 0.01, 0.01, 1e-6])))
        wrong = Transform(0.0, (3.0, 0.0, 0.0), np.diag([9.0, 9.0, 0.1, 1e-6]))
        known = Transform(covariance=np.diag([0.01, 0.01, 0.01, 1e-6]))
        graph.replace_from("a", 0, 0, [(0, wrong), (right_ns, known)])
        fusion = Fusion(mission, graph, estimator_named("bayes", mission))
        kit.feed(fusion, [entry for entry in entries if entry.stamp_ns < right_ns - 500_000_000])
        before = kit.settle(fusion, right_ns - 500_000_000)
        assert (before.sight_of("a").position - before.position)[0] > 1.5  # as it was learnt
        kit.feed(fusion, entries)
        after = kit.settle(fusion, kit.T0_NS + 90_000_000_000)
        left.append((after.sight_of("a").position - after.position)[0])
        assert math.dist(after.position[:2], (35.0, 62.0)) < 0.3
    assert np.mean(left) == pytest.approx(0.0, abs=0.3)  # each is known to 0.25 m


def jumped(entry, error_m, sigma_m):
    """An entry after its drone's own position has jumped by (20, -5) m, and the frame of that epoch as published by the drone:
    off by ``error_m`` to the east, which it knows to ``sigma_m`` in each axis.
    """
    if not isinstance(entry, Exposure):
        x, y, z = entry.apex_m
        return msgspec.structs.replace(entry, epoch=1, apex_m=(x + 20.0, y - 5.0, z))
    poses = [(pose.offset_ns, *pose.position_m, pose.quaternion) for pose in entry.poses]
    poses = tuple(PoseSample(offset_ns, (x + 20.0, y - 5.0, z), q) for offset_ns, x, y, z, q in poses)
    frame = Transform(0.0, (error_m - 20.0, 5.0, 0.0), np.diag([sigma_m**2, sigma_m**2, 0.01, 1e-4]))
    return msgspec.structs.replace(entry, epoch=1, poses=poses, carried=told(frame))


@pytest.mark.parametrize(("drones", "error_m"), [("abc", 0.5), ("a", 4.0)], ids=["all of them", "one, far off"])
def test_what_drones_measure_after_a_jump_counts_by_what_they_know_of_their_frame(kit, drones, error_m):
    """After 30 s the localisation of the drones has jumped. All go on; a drone that is far off, and says so, moves nothing."""
    mission, source, jump_ns, end_ns = kit.mission_of(), (35.0, 62.0), kit.T0_NS + 30 * 10**9, kit.T0_NS + 90 * 10**9
    entries = [
        jumped(entry, error_m, error_m) if entry.drone in drones and entry.stamp_ns >= jump_ns else entry
        for entry in entries_of(kit, mission, np.random.default_rng(3), 90.0, lambda _: source, 2e9)
    ]
    frames = SwarmFrames(mission)
    fusion = Fusion(mission, frames.graph, estimator_named("bayes", mission))
    for entry in entries:
        frames.receive(entry, encode(entry))
    kit.feed(fusion, entries)
    found = kit.settle(fusion, end_ns)
    assert found.cones == sum(not isinstance(entry, Exposure) for entry in entries)
    assert math.dist(found.position[:2], source) < (0.3 if drones == "a" else error_m + 0.3)
    off = found.position[:2] - np.array(source)
    assert off @ np.linalg.solve(found.covariance[:2, :2], off) < 3.0**2


def test_a_moving_source_is_followed_without_lag(kit):
    """1 m/s on the paper's circle. The paper's filter is 4-14 m behind (test_convergence)."""
    mission = kit.mission_of()

    def source_at(time_s):
        return np.array([50.0 + 40.0 * math.cos(time_s / 40.0), 50.0 + 40.0 * math.sin(time_s / 40.0)])

    entries = entries_of(kit, mission, np.random.default_rng(5), 150.0, source_at, 3e9)
    found = hypotheses(kit, mission, entries, 150.0)[-150:]
    errors = errors_of(found, source_at)
    assert np.median(np.linalg.norm(errors, axis=1)) < 1.5
    speeds = [np.linalg.norm(hypothesis.velocity) for _, hypothesis in found]
    assert np.median(speeds) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(
    "background", [pytest.param(0.8, marks=pytest.mark.slow), 1.0, pytest.param(2.0, marks=pytest.mark.slow)]
)
def test_background_alone_is_no_source_however_strong_it_is(kit, background):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(7), 180.0, None, 0.0, background)
    assert hypotheses(kit, mission, entries, 180.0) == []


def test_the_outlook_excludes_what_would_have_shown(kit):
    mission = kit.mission_of()
    fusion = fusion_of(mission)
    fusion.advance(kit.T0_NS)
    assert fusion.outlook.none == pytest.approx(0.5, abs=0.01)
    assert fusion.outlook.excluded_bq is None
    kit.feed(fusion, entries_of(kit, mission, np.random.default_rng(3), 120.0, None, 0.0))
    kit.settle(fusion, kit.T0_NS + 121_000_000_000)
    outlook = fusion.outlook
    assert outlook.none > 0.6
    assert outlook.weight.sum() + outlook.none == pytest.approx(1.0, abs=1e-3)
    assert 1e8 < outlook.excluded_bq < 1e10  # circled at 12 m and more
    middle = np.hypot(*(outlook.places - 50.0).T)
    density = outlook.weight / outlook.cell_m**2
    edge = (middle > 45.0) & (outlook.cell_m == outlook.cell_m.min())  # of the area
    assert density[middle < 12.0].mean() < 0.3 * density[edge].mean()


def test_a_source_that_runs_is_kept(kit):
    """3 m/s around the corners of a square: it turns on the spot."""
    mission = kit.mission_of()
    corners = np.array([[20.0, 20.0], [80.0, 20.0], [80.0, 80.0], [20.0, 80.0], [20.0, 20.0]])

    def source_at(time_s):
        side, part = divmod(time_s / 20.0 % 4.0, 1.0)
        return corners[int(side)] * (1.0 - part) + corners[int(side) + 1] * part

    entries = entries_of(kit, mission, np.random.default_rng(2), 120.0, source_at, 3e9)
    found = hypotheses(kit, mission, entries, 120.0)
    errors = np.linalg.norm(errors_of(found[-160:], source_at), axis=1)
    claimed = np.median([hypothesis.rms_m for _, hypothesis in found[-160:]])
    assert np.median(errors) < claimed < 2.6  # seen from 12 m, twice as far as it would be flown
    assert errors.max() < 12.0


def test_a_source_that_is_gone_is_given_up(kit):
    mission = kit.mission_of()

    def source_at(time_s):
        return (40.0, 60.0) if time_s < 60.0 else None

    entries = entries_of(kit, mission, np.random.default_rng(4), 150.0, source_at, 3e9)
    times = [time_s for time_s, _ in hypotheses(kit, mission, entries, 150.0)]
    assert 45.0 < max(times) < 110.0


def test_what_the_vehicles_say_of_their_errors_is_believed(kit):
    """The same flight by vehicles that are good to 0.1 m and to 1.4 m (of the distance)."""
    mission = kit.mission_of()
    exact = entries_of(kit, mission, np.random.default_rng(8), 90.0, lambda _: (45.0, 55.0), 3e9)
    rough = [
        msgspec.structs.replace(entry, position_sigma_m=2.0**0.5)
        if hasattr(entry, "position_sigma_m")
        else msgspec.structs.replace(entry, apex_sigma_m=2.0**0.5)
        for entry in exact
    ]
    _, sure = hypotheses(kit, mission, exact, 90.0)[-1]
    _, unsure = hypotheses(kit, mission, rough, 90.0)[-1]
    assert sure.rms_m < 0.3
    assert unsure.rms_m == pytest.approx((2.0 / len(mission.drones)) ** 0.5, rel=0.2)  # the biases' mean stays unknown
    sight = unsure.sight_of(mission.drones[0].id)
    assert np.trace(sight.covariance) < 0.3 * unsure.rms_m**2  # but not where each of them sees the source


def test_the_order_of_arrival_leaves_no_trace(kit):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(9), 40.0, lambda _: (40.0, 60.0), 3e9)
    end_ns = kit.T0_NS + 41_000_000_000
    once = fusion_of(mission)
    kit.feed(once, sorted(entries, key=lambda entry: entry.entry_id))
    assert kit.settle(once, end_ns) is not None
    shuffled = entries + entries[:40]
    random.Random(1).shuffle(shuffled)
    pieces = fusion_of(mission)
    for number, entry in enumerate(shuffled):
        kit.feed(pieces, [entry])
        if number % 50 == 0:
            pieces.advance(kit.T0_NS + number * 100_000_000, 30)
    kit.settle(pieces, end_ns, 70)
    assert once.digest == pieces.digest
    assert kit.same_bits(once.hypothesis, pieces.hypothesis)


@pytest.mark.parametrize("activity_bq", [0.0, 3e9])
def test_a_camera_on_the_ground_stops_nothing(kit, activity_bq):
    """Before takeoff, right over the middle of a cell, and later over the estimated place of the source."""
    mission = kit.mission_of()
    source_at = None if activity_bq == 0.0 else lambda _: (50.0, 50.0)
    entries = entries_of(kit, mission, np.random.default_rng(6), 60.0, source_at, activity_bq)
    place = (48.75, 51.25, 0.0)
    for time_s, boot in ((0.5, 1), (55.0, 2)):
        exposure = kit.exposure_entry(mission, time_s, place, drone=mission.drones[0].id, sequence=5000 + boot, duration_s=0.5)
        entries.append(msgspec.structs.replace(exposure, counts=Counts(100_000, 9000, 9000)))
        entries.append(
            kit.cone_entry(mission, time_s + 0.2, place, (0.0, 0.0, -1.0), 0.0, drone=mission.drones[0].id, sequence=6000 + boot)
        )
    for _, hypothesis in hypotheses(kit, mission, entries, 60.0):
        assert np.isfinite(hypothesis.position).all()
        assert np.isfinite(hypothesis.covariance).all()


def test_one_burst_makes_no_source_and_moves_none(kit):
    """300 hits more in one exposure, as a noisy pixel gives; photopeak and coincidences as ever."""
    mission = kit.mission_of()
    for source_at, activity_bq in ((None, 0.0), (lambda _: (50.0, 50.0), 3e9)):
        entries = entries_of(kit, mission, np.random.default_rng(11), 60.0, source_at, activity_bq)
        place = next(k for k, entry in enumerate(entries) if hasattr(entry, "counts") and entry.stamp_ns > kit.T0_NS + 50 * 10**9)
        counts = entries[place].counts
        entries[place] = msgspec.structs.replace(entries[place], counts=msgspec.structs.replace(counts, hits=counts.hits + 300))
        found = hypotheses(kit, mission, entries, 60.0)
        if source_at is None:
            assert found == []
        else:
            assert np.linalg.norm(errors_of(found[-15:], lambda _: np.array([50.0, 50.0])), axis=1).max() < 1.5


def test_a_camera_that_dies_in_flight_moves_nothing(kit):
    """From 60 s on one of three counts nothing at all: that is not how little a source further away would give."""
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(14), 100.0, lambda _: (50.0, 50.0), 1e10)  # as 3 GBq from 7 m
    dead = mission.drones[0].id
    alive = []
    for entry in entries:
        if entry.drone == dead and entry.stamp_ns > kit.T0_NS + 60 * 10**9:
            if hasattr(entry, "counts"):
                alive.append(msgspec.structs.replace(entry, counts=Counts(0, 0, 0)))
        else:
            alive.append(entry)
    found = hypotheses(kit, mission, alive, 100.0)
    assert np.linalg.norm(errors_of(found[-40:], lambda _: np.array([50.0, 50.0])), axis=1).max() < 0.6


def test_a_wall_that_nobody_knows_of_moves_nothing(kit):
    """Concrete of 0.2 m takes 97 % of the direct radiation from a source to cameras in its north-west: one place in four."""
    mission = kit.mission_of()
    rng = np.random.default_rng(15)
    entries = []
    for entry in entries_of(kit, mission, rng, 70.0, lambda _: (50.0, 50.0), 1e10):  # as 3 GBq from 7 m
        counted = hasattr(entry, "counts")
        x, y, _ = entry.poses[0].position_m if counted else entry.apex_m
        if x >= 50.0 or y <= 50.0:
            entries.append(entry)
        elif counted:
            full, pairs = (int(rng.binomial(events, 0.03)) for events in (entry.counts.photopeak, entry.counts.coincidences))
            hits = int(rng.binomial(entry.counts.hits, 0.23)) + full + pairs  # most of them are of scattered photons
            entries.append(msgspec.structs.replace(entry, counts=Counts(hits, full, pairs)))
        elif rng.random() < 0.03:
            entries.append(entry)
    found = hypotheses(kit, mission, entries, 70.0)
    errors = np.linalg.norm(errors_of(found[-40:], lambda _: np.array([50.0, 50.0])), axis=1)
    assert errors.max() < 0.4  # 0.13 m; without the chain it is metres


@pytest.mark.parametrize("away_m", [6e4, 9.9e4])
def test_exposures_from_very_far_away_move_nothing(kit, away_m):
    """A localisation that has diverged, or a member that makes it up: as far as a message may say."""
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(16), 50.0, lambda _: (50.0, 50.0), 3e9)
    for number in range(3):
        far = kit.exposure_entry(mission, 40.0 + number, (away_m, 0.0, 3.0), drone="b", sequence=7000 + number, duration_s=0.5)
        entries.append(msgspec.structs.replace(far, counts=Counts(3, 0, 0), boot="b" * 16))
    found = hypotheses(kit, mission, entries, 50.0)
    assert [time_s for time_s, _ in found if time_s > 39.0] == np.arange(39.5, 50.0, 0.5).tolist()
    assert np.linalg.norm(errors_of(found[-8:], lambda _: np.array([50.0, 50.0])), axis=1).max() < 1.0


@pytest.mark.parametrize(("later_s", "epoch"), [(0.5, 1), (5.0, 0)])
def test_an_exposure_that_waits_is_left_out_where_the_next_one_says_nothing_of_it(kit, later_s, epoch):
    """That of a new epoch has other biases, that after a gap another view."""
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(17), 40.0, lambda _: (50.0, 50.0), 3e9)
    low = kit.exposure_entry(mission, 40.0, (62.0, 50.0, 3.0), sequence=7000, duration_s=0.5)
    lows = [msgspec.structs.replace(low, counts=Counts(hits, 0, 0)) for hits in (0, 3)]
    last = kit.exposure_entry(mission, 40.0 + later_s, (62.0, 50.0, 3.0), sequence=7001, duration_s=0.5)
    last = msgspec.structs.replace(last, counts=Counts(30, 5, 3), epoch=epoch)

    def state(*more):
        fusion = fusion_of(mission)
        kit.feed(fusion, [*entries, *more])
        fusion.advance(kit.T0_NS + 60 * 10**9, 10**6)
        return fusion.state

    assert all(0 in state(low).waiting for low in lows)
    assert np.array_equal(*(state(low, last).track.mean for low in lows))


@pytest.mark.parametrize("live_time_s", [5e-324, 1e-300])
def test_an_exposure_of_no_time_says_nothing(kit, live_time_s):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(12), 30.0, None, 0.0)
    entries[7] = msgspec.structs.replace(entries[7], live_time_s=live_time_s, counts=Counts(0, 0, 0))
    assert hypotheses(kit, mission, entries, 30.0) == []


def test_what_lies_long_before_the_start_is_left_out(kit):
    mission = kit.mission_of()
    entries = entries_of(kit, mission, np.random.default_rng(13), 40.0, lambda _: (45.0, 55.0), 3e9)
    old = kit.exposure_entry(mission, -3600.0, (10.0, 10.0, 3.0), drone=mission.drones[0].id, sequence=9000, duration_s=0.5)
    old = msgspec.structs.replace(old, counts=Counts(400, 40, 30))
    end_ns = kit.T0_NS + 41_000_000_000
    results = []
    for extra, first in (([], True), ([old], True), ([old], False)):
        fusion = fusion_of(mission)
        if first:
            fusion.start(kit.T0_NS)
        kit.feed(fusion, [*extra, *entries])
        fusion.start(kit.T0_NS)
        results.append(kit.settle(fusion, end_ns))
    assert results[0] is not None
    assert kit.same_bits(results[0], results[1])
    assert kit.same_bits(results[0], results[2])


def test_an_outlook_after_years_costs_no_more_than_after_a_minute(kit):
    """One drone's clock stood still at 1970: the motion since then counts as a minute's."""
    mission = kit.mission_of()
    estimator = estimator_named("bayes", mission)
    state = estimator.step(estimator.initial(None), GridStep(0, 0, 100_000_000), [])
    search = SearchState.prior(estimator._grid, 0.0)
    assert np.array_equal(search.later(estimator._grid, 60.0).weight, search.later(estimator._grid, 1.7e9).weight)
    assert estimator.hypothesis(state, GridStep(1, 100_000_000, 200_000_000)) is None


def test_of_the_prior_nine_tenths_are_in_the_area_itself(kit):
    mission = kit.mission_of()
    corner = msgspec.structs.replace(mission.area, polygon_m=((0.0, 0.0), (100.0, 0.0), (0.0, 100.0)))
    mission = msgspec.structs.replace(mission, area=corner)
    fusion = fusion_of(mission)
    fusion.advance(kit.T0_NS)
    outlook = fusion.outlook
    beyond = outlook.places.sum(axis=1) > 105.0
    assert outlook.weight[beyond].sum() < 0.05 + 1e-3
    corner, other = (outlook.places - place for place in ((20.0, 20.0), (80.0, 80.0)))
    near = [float((outlook.weight / outlook.cell_m**2)[np.hypot(*apart.T).argmin()]) for apart in (corner, other)]
    assert near[1] < 0.02 * near[0]  # the corner has as much around it as far away
    assert outlook.weight.sum() == pytest.approx(0.5, abs=1e-3)


def test_a_track_that_has_become_too_wide_is_searched_for_from_where_it_was(kit):
    """Nothing is heard for a while of a source that moves, then of three drones again."""
    mission = kit.mission_of()

    def source_at(time_s):
        return np.array([30.0 + 0.5 * time_s, 50.0])

    entries = entries_of(kit, mission, np.random.default_rng(14), 100.0, source_at, 3e9)
    silent = [entry for entry in entries if not 45.0 < (entry.stamp_ns - kit.T0_NS) * 1e-9 < 80.0]
    found = hypotheses(kit, mission, silent, 100.0)
    times = np.array([time_s for time_s, _ in found])
    assert (times < 46.0).any()
    assert np.linalg.norm(errors_of(found[-20:], source_at), axis=1).max() < 2.0


@pytest.mark.parametrize(("east_m", "begins"), [(60.0, True), (120.0, True), (150.0, False)])
def test_a_track_begins_up_to_the_fence_and_not_beyond_it(kit, east_m, begins):
    """All of a search's probability is in one cell of the area, of the 30 m up to the fence, or beyond."""
    estimator = estimator_named("bayes", kit.mission_of())
    step = GridStep(1, kit.T0_NS, kit.T0_NS + 100_000_000)
    places = estimator.outlook(estimator.initial(None), step).places
    search = SearchState.prior(estimator._grid, kit.T0_NS / 1e9)
    weight = np.zeros_like(search.weight)
    weight[:, :, np.hypot(*(places - (east_m, 50.0)).T).argmin()] = 1.0
    search = dataclasses.replace(search, weight=weight / weight.sum() * (1.0 - 1e-9), none=1e-9)
    state = estimator.step(BayesState(search, bias_variance=np.zeros(4 * len(kit.mission_of().drones))), step, [])
    assert (state.track is not None) is begins
    assert (estimator.outlook(state, step) is None) is begins
