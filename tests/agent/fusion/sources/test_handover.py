"""A moving source among sources at rest: the time of its handover to a track, the hypothesis then, and the time of its return."""

import random

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.frames.transform import Transform
from radron.agent.fusion.bayes.exposed import Exposed
from radron.agent.fusion.bayes.state import BayesState
from radron.agent.fusion.deferred import Deferred, Folder
from radron.agent.fusion.observation import observe
from radron.agent.fusion.registry import estimator_named
from radron.agent.fusion.sources.handover import FollowingEstimator
from radron.agent.fusion.sources.looking import led
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.tracker import Track
from radron.agent.navigation.focus import focus
from support.flights.fusions import fusion_of

SPEED_MPS, WALKS_S = 0.8, 30.0
END_S = 120.0  # up to 40 s until it clearly rests; taken back 30 s later, with the next moves


IR_APART = [("Ir-192", 8.0, 10.0, 1e9), ("Ir-192", 30.0, 30.0, 1e9), ("Cs-137", 12.0, 30.0, 1e9)]


def walker(time_s):
    """From west to east for ``WALKS_S``, then at rest."""
    return "Cs-137", 8.0 + SPEED_MPS * min(time_s, WALKS_S), 20.0, 1e10


def alone(time_s):
    return [walker(time_s)]


def beside_another(time_s):
    return [walker(time_s), ("Ir-192", 28.0, 10.0, 5e8)]


def carried_off(time_s):
    return [walker(time_s)] if time_s < 30.0 else []


def after(kit, mission, entries, seconds):
    fusion = fusion_of(mission)
    assert all(kit.feed(fusion, entries))
    kit.settle(fusion, kit.T0_NS + round(seconds * 1e9))
    return fusion


def off_m(hypothesis, time_s):
    _, x, y, _ = walker(time_s)
    return float(np.hypot(*(hypothesis.position[:2] - (x, y))))


@pytest.fixture(scope="module")
def walk(among):
    mission = among.mission_of()
    return mission, among.entries_of(mission, np.random.default_rng(1), END_S, alone)


def until(kit, entries, seconds):
    return [entry for entry in entries if entry.stamp_ns < kit.T0_NS + seconds * 1e9]


def test_a_source_that_walks_is_followed_and_told_alone(kit, walk):
    """As from ``bayes``: its velocity, and no turns of the circle."""
    mission, entries = walk
    told = after(kit, mission, until(kit, entries, 25.0), 25.0).hypothesis
    assert (told.nuclide, told.others, told.watched_s) == ("Cs-137", (), None)
    assert off_m(told, 25.0) < 1.0
    assert told.velocity[:2] == pytest.approx((SPEED_MPS, 0.0), abs=0.3)
    assert told.activity_bq == pytest.approx(1e10, rel=0.2)


def test_until_it_is_handed_over_the_drones_look_where_it_has_walked_to(kit, walk):
    """Sources at rest are published as fitted: it walks away from there."""
    mission, entries = walk
    told = after(kit, mission, until(kit, entries, 10.0), 10.0).hypothesis
    assert off_m(told, 10.0) > 2.5
    assert off_m(told.look, 10.0) < 1.0
    assert focus(told, mission).rms_m == told.look.rms_m


def test_a_search_leads_to_one_source_that_is_told_and_not_to_one_of_several(kit, among):
    """From when it was doubtful on; its middle is between several of its nuclide."""
    mission = among.mission_of()
    fusion = fusion_of(mission)
    kit.feed(fusion, among.entries_of(mission, np.random.default_rng(3), 16.0, IR_APART))
    told = kit.settle(fusion, kit.T0_NS + 16_000_000_000)
    track, step, known = fusion.state.track, fusion._now_step, fusion.state.rest.outlook
    assert track.is_lost
    assert track.doubted_ns > 0
    assert sorted(one.nuclide for one in (told, *told.others)) == ["Cs-137", "Ir-192", "Ir-192"]
    assert told.look is None
    assert fusion.outlook is known
    bayes = fusion.estimator._tracker(track.nuclide).bayes
    lead = led(known, ["Cs-137", "Ir-192"], track, bayes, "Ir-192", step).lead
    assert np.array_equal(lead.weight, bayes.outlook(track.state, step).weight)
    late = replace(step, start_ns=track.doubted_ns + 61_000_000_000)
    assert led(known, ["Cs-137", "Ir-192"], track, bayes, "Ir-192", late) is known


@pytest.fixture(scope="module")
def weak(among):
    mission = among.mission_of()
    return mission, among.entries_of(mission, np.random.default_rng(7), 30.0, [("Cs-137", 30.0, 30.0, 4e8)])


def test_before_anything_is_told_the_search_leads_the_drones_for_a_while(kit, weak):
    """The exclusion limit stays the fit's."""
    fusion = after(kit, weak[0], until(kit, weak[1], 12.0), 12.0)
    assert fusion.hypothesis is None
    outlook, track, rest = fusion.outlook, fusion.state.track, fusion.state.rest.outlook
    assert outlook.exclusion is rest.exclusion
    assert outlook.excluded_bq == rest.excluded_bq
    mean = outlook.lead.weight @ outlook.lead.places / outlook.lead.weight.sum()
    assert mean == pytest.approx((30.0, 30.0), abs=8.0)
    bayes, step = fusion.estimator._tracker(track.nuclide).bayes, fusion._now_step
    late = replace(step, start_ns=track.begun_ns + 61_000_000_000)
    assert led(rest, [], track, bayes, "Cs-137", late) is rest
    assert led(None, [], track, bayes, "Cs-137", step).excluded_bq is None


def test_what_the_track_finds_first_is_told_at_the_next_refinement(kit, weak):
    """Not only with the moves at 20 s."""
    fusion = after(kit, weak[0], until(kit, weak[1], 15.0), 15.0)
    assert (fusion.state.track.is_lost, fusion.hypothesis) == (True, None)
    fusion = after(kit, weak[0], until(kit, weak[1], 17.9), 17.9)
    assert not fusion.state.track.is_lost
    assert fusion.hypothesis.position[:2] == pytest.approx((30.0, 30.0), abs=2.0)
    assert fusion.outlook.lead is None


def test_a_track_begins_with_what_was_measured_before_there_was_one(kit, weak, monkeypatch):
    """Until the moves at 5 s nothing was fitted, and the track began with the moves at 10 s."""
    begin, given = FollowingEstimator._begun, []
    monkeypatch.setattr(FollowingEstimator, "_begun", lambda *every: given.append(every[2]) or begin(*every))
    fusion = after(kit, weak[0], until(kit, weak[1], 4.9), 4.9)
    assert (fusion.state.track, fusion.state.untracked) == (None, ())
    fusion = after(kit, weak[0], until(kit, weak[1], 9.9), 9.9)
    assert fusion.state.track is None
    early = {entry.entry_id for entry in until(kit, weak[1], 4.5)}
    assert {one.identity for one in fusion.state.untracked} >= early
    fusion = after(kit, weak[0], until(kit, weak[1], 11.0), 11.0)
    assert {one.identity for one in given[0]} >= early
    assert (fusion.state.track.begun_ns - kit.T0_NS, fusion.state.untracked) == (10_000_000_000, ())


def test_another_nuclide_at_rest_is_told_beside_it(kit, among):
    mission = among.mission_of()
    entries = among.entries_of(mission, np.random.default_rng(2), 30.0, beside_another)
    told = after(kit, mission, entries, 30.0).hypothesis
    assert off_m(told, 30.0) < 2.5
    assert [one.nuclide for one in told.others] == ["Ir-192"]
    assert told.others[0].position[:2] == pytest.approx((28.0, 10.0), abs=1.5)
    assert told.others[0].stamp_ns == told.stamp_ns


@pytest.mark.parametrize(
    "sources",
    [
        [("Cs-137", 12.0, 20.0, 3e9)],
        [("Ir-192", 8.0, 10.0, 6e8), ("Ir-192", 30.0, 30.0, 1e9)],
        IR_APART,
    ],
)
def test_sources_at_rest_are_not_handed_over(kit, among, sources):
    """Drones fly from one to another, and a single track of either nuclide would have to follow them: so it never becomes clear
    that they are at rest, but after a while the check ends.
    """
    mission = among.mission_of()
    fusion = after(kit, mission, among.entries_of(mission, np.random.default_rng(3), 40.0, sources), 42.0)
    assert fusion.state.track is not None
    assert not fusion.state.track.moves
    assert 1 + len(fusion.hypothesis.others) == len(sources)
    assert fusion.hypothesis.look is None


@pytest.mark.parametrize(
    ("seed", "activity_bq", "way"),
    [
        (1, 3e9, lambda time_s: (6.0 + 1.2 * time_s, 20.0)),
        (2, 3e9, lambda time_s: (12.0 + 0.5 * time_s, 20.0)),
        (1, 2e9, lambda time_s: (20.0 + 10.0 * np.cos(time_s / 12.0), 20.0 + 10.0 * np.sin(time_s / 12.0))),
    ],
    ids=["fast", "slow", "ring"],
)
def test_places_along_its_way_that_have_had_their_turns_do_not_hide_that_it_moves(kit, among, seed, activity_bq, way):
    """The places are published as sources at rest meanwhile, and circled."""
    mission = among.mission_of()
    mission = replace(mission, track=replace(mission.track, each_s=1.0))
    flown = among.entries_of(mission, np.random.default_rng(seed), 60.0, lambda s: [("Cs-137", *way(s), activity_bq)])
    fusion = after(kit, mission, until(kit, flown, 30.0), 30.0)
    assert fusion.state.track.moves
    assert fusion.hypothesis.others == ()


def test_it_is_taken_back_once_it_has_been_at_rest(kit, walk):
    fusion = fusion_of(walk[0])
    kit.feed(fusion, walk[1])
    kit.settle(fusion, kit.T0_NS + 45_000_000_000)
    assert fusion.state.track.moves
    told = kit.settle(fusion, kit.T0_NS + round((END_S + 1.0) * 1e9))
    assert not fusion.state.track.moves
    assert (told.nuclide, told.others) == ("Cs-137", ())
    assert off_m(told, END_S) < 0.3
    assert told.activity_bq == pytest.approx(1e10, rel=0.2)
    assert told.watched_s > 0.0
    assert fusion.state.rest.rows.live_s.sum() < 2 * (END_S - WALKS_S)  # of two cameras, without the walk
    assert fusion.state.track.mark is not None  # it may be handed over again


def test_after_one_that_is_lost_sources_at_rest_are_fitted_anew(kit, among):
    """The source is carried off after 30 s, and earlier fits say nothing any more."""
    mission = among.mission_of()
    entries = among.entries_of(mission, np.random.default_rng(6), 90.0, carried_off)
    fusion = fusion_of(mission)
    kit.feed(fusion, entries)
    kit.settle(fusion, kit.T0_NS + 28_000_000_000)
    assert fusion.state.track.moves
    assert kit.settle(fusion, kit.T0_NS + 60_000_000_000) is None
    assert fusion.outlook is not None  # the track's search
    told = kit.settle(fusion, kit.T0_NS + 91_000_000_000)
    assert fusion.state.track is None
    assert told is None
    assert 0.0 < fusion.state.rest.rows.live_s.sum() < 2 * 60.0


def test_the_order_of_arrival_does_not_matter(kit, walk):
    """All at once, and mixed up in parts with the fusion advancing in between; through looks, hand-over and return."""
    mission, entries = walk
    mixed = random.Random(1).sample(entries, len(entries))
    fusion = fusion_of(mission)
    part = len(mixed) // 4 + 1
    for number, start in enumerate(range(0, len(mixed), part)):
        kit.feed(fusion, mixed[start : start + part])
        fusion.advance(kit.T0_NS + round(0.25 * END_S * 1e9 * number))
    for time_s in (10.0, 30.0, END_S + 1.0):
        in_order = after(kit, mission, until(kit, entries, time_s), time_s).hypothesis
        late = fusion if time_s > 90.0 else after(kit, mission, until(kit, mixed, time_s), time_s)
        told = kit.settle(late, kit.T0_NS + round(time_s * 1e9))
        assert kit.same_bits(told, in_order)
        assert kit.same_bits(told.look, in_order.look)
        assert (told.look is not None) == (time_s < 15.0)


def test_computed_elsewhere_it_tells_the_same(kit, walk):
    mission, entries = walk
    deferred = Deferred(estimator_named("sources", mission))
    fusion = fusion_of(mission, deferred)
    kit.feed(fusion, until(kit, entries, 25.0))
    fusion.advance(kit.T0_NS + 25_000_000_000, 10**9)
    folder = Folder(estimator_named("sources", mission))
    task = deferred.task(folder.held)
    fusion.answered(task.question, folder.answer(deferred, task.question))
    fusion.advance(kit.T0_NS + 25_000_000_000)
    assert kit.same_bits(fusion.hypothesis, after(kit, mission, until(kit, entries, 25.0), 25.0).hypothesis)


def test_where_sources_may_be_above_the_ground_none_is_handed_over(kit, among):
    mission = among.mission_of(source_height_m=(0.0, 10.0))
    entries = among.entries_of(mission, np.random.default_rng(4), 12.0, alone)
    assert after(kit, mission, entries, 12.0).state.track is None


def test_the_tracker_expects_what_the_tables_say(kit, among):
    """Counts of a source and of one of another nuclide beside it, in the mean of many exposures: to 5 %."""
    mission = among.mission_of()
    estimator = estimator_named("sources", mission)
    tracker = estimator._tracker(among.NUCLIDES.index("Cs-137"))
    other = Solution((among.NUCLIDES.index("Ir-192"),), np.array([(30.0, 15.0)]), np.zeros(1), 0.0, np.zeros((2, 3)))
    entries = among.entries_of(mission, np.random.default_rng(5), 400.0, [("Ir-192", 30.0, 15.0, 1e9)], cones=False)
    seen = [tracker.seen(observe(entry, Transform()), other) for entry in entries]
    counted = sum(tracker._response.apart(one.counts) for one in seen)
    expected = sum(one.beside + tracker._response.background_ps * one.live_time_s for one in seen)
    assert expected == pytest.approx(counted, rel=0.05)


def test_an_exposure_that_waits_for_the_next_one_counts_where_its_evidence_does(kit):
    """Before a mark it enters the evidence after it; in the end it has not entered it yet."""
    mission = kit.mission_of()
    seen = [observe(kit.exposure_entry(mission, 0.5 * n, (float(n), 0.0, 3.0), sequence=n), Transform()) for n in range(4)]
    track = Track(0, tracked(waiting_for(seen[0])), Solution.nothing(1), 0, newest=((seen[0], seen[0]),))
    assert track.counted == ()
    track = track.marked(seen[0].stamp_ns + 1)
    assert [one for one, _ in track.newest] == seen[:1]
    track = replace(track, newest=(*track.newest, *zip(seen[1:], seen[1:], strict=True)), state=tracked(waiting_for(seen[3])))
    assert [one for one, _ in track.counted] == seen[:3]
    track = track.marked(seen[3].stamp_ns + 1)
    assert [one for one, _ in track.newest] == seen[3:]
    track = replace(track, state=tracked(BayesState()))
    assert [one for one, _ in track.counted] == seen[3:]
    assert track.marked(seen[3].stamp_ns + 2).newest == ()


def tracked(state):
    """An estimator state with a track; all else is irrelevant."""
    return replace(state, track=object())


def waiting_for(observation):
    """A track's state in which an exposure of the first vehicle waits for the next one."""
    nothing = np.zeros(2)
    exposed = Exposed(0, observation.position, observation.live_time_s, nothing, nothing, observation.middle_ns)
    return BayesState(waiting={0: exposed})
