"""An agent whose steps come rarely has little work done each second: its hypothesis follows its log all the same."""

import random

import numpy as np
import pytest

from support.flights.fusions import fusion_of

SECONDS = 50
STEP_NS = 300_000_000  # between two calls of a slow agent: three new steps of the grid, 6.6 units of work in the mean
START_S, LOG_S = 20.0, 4.0  # of a late agent, and until it has the others' log


@pytest.fixture(scope="module")
def mission(kit):
    return kit.mission_of(initial_cones=6, grid_s=0.1)


@pytest.fixture(scope="module")
def cones(kit, mission):
    return kit.flight(mission, np.random.default_rng(6), float(SECONDS), lambda time_s: (20.0 + time_s, 60.0), rate_hz=12.0)


def flown(kit, mission, arrivals, budget, from_s=0.0):
    """A fusion called every 0.3 s: yields the time, s, and the fusion. ``arrivals``: ns, and entry."""
    fusion, arrivals = fusion_of(mission), sorted(arrivals, key=lambda arrival: arrival[0])
    for now_ns in range(kit.T0_NS + round(from_s * 1e9), kit.T0_NS + SECONDS * 10**9, STEP_NS):
        while arrivals and arrivals[0][0] <= now_ns:
            kit.feed(fusion, [arrivals.pop(0)[1]])
        fusion.advance(now_ns, budget)
        yield (now_ns - kit.T0_NS) * 1e-9, fusion


def age_s(kit, time_s, stamp_ns):
    return time_s - (stamp_ns - kit.T0_NS) * 1e-9


def agrees_in_the_end(kit, mission, fusion, cones):
    now_ns, whole = kit.T0_NS + (SECONDS + 1) * 10**9, fusion_of(mission)
    for one in (fusion, whole):
        kit.feed(one, cones)
    return kit.same_bits(kit.settle(fusion, now_ns), kit.settle(whole, now_ns))


def test_who_is_hardly_ever_done_tells_what_it_has_computed(kit, mission, cones):
    """Entries that come a little late change three steps and more in each call, beside the new ones: some are always left."""
    rng = random.Random(6)
    arrivals = [(cone.stamp_ns + rng.randrange(9 * 10**8), cone) for cone in cones]
    calls = unfinished = 0
    for time_s, fusion in flown(kit, mission, arrivals, budget=7):
        calls, unfinished = calls + 1, unfinished + fusion.pending
        if time_s > 5.0:
            assert age_s(kit, time_s, fusion.hypothesis.stamp_ns) <= 1.5
            assert age_s(kit, time_s, fusion.complete_ns) <= 5.0
    assert unfinished > 0.8 * calls
    assert agrees_in_the_end(kit, mission, fusion, cones)


def test_the_hypothesis_of_an_unfinished_replay_is_not_told_if_it_is_seconds_old(kit, mission, cones):
    """An agent that is started late knows nothing better, and says nothing."""
    fusion = fusion_of(mission)
    kit.feed(fusion, [cone for cone in cones if cone.stamp_ns < kit.T0_NS + 20 * 10**9])
    told = []
    while not told or fusion.pending:
        fusion.advance(kit.T0_NS + 20 * 10**9, budget=20)
        told.append(fusion.hypothesis)
    first = next(place for place, hypothesis in enumerate(told) if hypothesis is not None)
    assert 0.6 * len(told) < first < 0.9 * len(told)
    assert told[first].stamp_ns == told[-1].stamp_ns


def test_a_clock_that_was_set_back_does_not_make_it_wait_until_the_former_time_has_come_again(kit, mission, cones):
    """By 10 s, while entries keep coming a little late."""
    fusion, rng, set_ns = fusion_of(mission), random.Random(6), kit.T0_NS + 30 * 10**9
    back_ns = set_ns - 10 * 10**9
    known = [cone for cone in cones[::2] if cone.stamp_ns < set_ns]
    kit.feed(fusion, known)
    kit.settle(fusion, set_ns)
    later = [cone for cone in (*cones[1::2], *cones[::2]) if cone.stamp_ns >= back_ns and cone not in known]
    arrivals = sorted([(cone.stamp_ns + rng.randrange(9 * 10**8), cone) for cone in later], key=lambda arrival: arrival[0])
    for now_ns in range(back_ns, set_ns, STEP_NS):
        while arrivals and arrivals[0][0] <= now_ns:
            kit.feed(fusion, [arrivals.pop(0)[1]])
        fusion.advance(now_ns, budget=7)
        if now_ns >= back_ns + 2 * 10**9:
            assert fusion.hypothesis.stamp_ns <= now_ns + 200_000_000  # of a time that has come


def test_one_that_is_started_late_begins_again_instead_of_folding_twice(kit, mission, cones):
    """The agent gets the earlier log in any order: late entries would not be in a chain that reaches the present, and a replay
    beside that chain would never catch up.
    """
    rng, start_ns = random.Random(7), kit.T0_NS + round(START_S * 1e9)
    delays_ns = [rng.randrange(round(LOG_S * 1e9)) for _ in cones]
    arrivals = [
        (start_ns + delay_ns if cone.stamp_ns < start_ns else cone.stamp_ns, cone)
        for cone, delay_ns in zip(cones, delays_ns, strict=True)
    ]
    complete_s = [
        time_s
        for time_s, fusion in flown(kit, mission, arrivals, budget=15, from_s=START_S)
        if age_s(kit, START_S + LOG_S, fusion.complete_ns) < 0.0
    ]
    assert complete_s[0] < START_S + LOG_S + 20.0


@pytest.mark.parametrize(("times", "most_s"), [(2.3, 30.0), (1.5, 25.0), (1.15, 35.0)])
def test_what_came_late_is_computed_again_however_little_time_is_left(kit, mission, cones, times, most_s):
    """25 cones come 9 s late, and the agent has time for 2.3, 1.5 or 1.15 times the new work: beside a chain that goes on without
    them, a replay would take half a minute with the first, and never end with the others. The hypothesis stays of the present.
    """
    late = {cone.stamp_ns for cone in [cone for cone in cones if cone.stamp_ns >= kit.T0_NS + 2 * 10**9][:25]}
    arrivals = [(cone.stamp_ns + (cone.stamp_ns in late) * 9 * 10**9, cone) for cone in cones]
    come_s = (max(late) - kit.T0_NS) * 1e-9 + 9.0
    complete_s = []
    for time_s, fusion in flown(kit, mission, arrivals, budget=6.6 * times):
        if time_s > 6.0:
            assert age_s(kit, time_s, fusion.hypothesis.stamp_ns) <= 1.0
        if age_s(kit, come_s, fusion.complete_ns) < 0.0:
            complete_s.append(time_s)
    assert complete_s[0] < come_s + most_s
    assert agrees_in_the_end(kit, mission, fusion, cones)
