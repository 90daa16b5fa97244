"""Overlapping exposures of a drone do not count; too long ones are not taken."""

import itertools
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from radron.agent.fusion.log import ObservationLog, Outcome
from radron.agent.fusion.registry import estimator_named
from radron.protocol.codec import encode
from radron.protocol.entries import MAX_LOGGED_EXPOSURE_NS, Counts, Retraction
from support.flights import fusions

OTHER_BOOT = "00000000000000b2"


def log_of(mission, entries, **rules):
    log = ObservationLog(mission.mission_id, [drone.id for drone in mission.drones], **rules)
    for entry in entries:
        log.add(entry, encode(entry))
    return log


def exposures(kit, mission, spans, drone="a"):
    """An exposure for each span (begin, end), s; of two boots in turn."""
    made = [
        kit.exposure_entry(mission, begin_s, (0.0, 0.0, 3.0), drone=drone, sequence=number, duration_s=end_s - begin_s)
        for number, (begin_s, end_s) in enumerate(spans)
    ]
    short = [replace(one, poses=one.poses[:1]) for one in made]
    return [replace(one, boot=OTHER_BOOT) if number % 2 else one for number, one in enumerate(short)]


def overlap(one, other):
    return one is not other and one.stamp_ns < other.end_ns and other.stamp_ns < one.end_ns


def counted(log, entries):
    return {entry.entry_id for entry in entries if log.counts(entry.entry_id)}


spans = st.lists(
    st.tuples(st.integers(0, 40), st.integers(1, 8)).map(lambda one: (0.25 * one[0], 0.25 * sum(one))), min_size=1, max_size=14
)


@settings(max_examples=150)
@given(spans=spans, seed=st.integers(0, 2**32), back=st.tuples(st.integers(0, 13), st.integers(0, 13)))
def test_overlapping_exposures_do_not_count_in_whatever_order_they_come(kit, mission, spans, seed, back):
    """Some are taken back, and some are removed again."""
    rng = random.Random(seed)
    held = exposures(kit, mission, spans)
    first, last = min(back), max(back)
    retraction = Retraction(
        mission=mission.mission_id, stamp_ns=kit.T0_NS, drone="a", boot=kit.BOOT, sequence=900, first=first, last=last
    )
    removed = rng.sample(held, rng.randint(0, len(held) // 3))
    arrivals = [*held, retraction]
    rng.shuffle(arrivals)
    log = log_of(mission, arrivals)
    gone = rng.sample([*removed, retraction], rng.randint(0, len(removed) + 1))
    for entry in gone:
        log.forget(entry.entry_id)
    is_back = retraction not in gone
    left = [one for one in held if one not in gone]
    kept = [one for one in left if not (is_back and one.boot == kit.BOOT and first <= one.sequence <= last)]
    assert counted(log, left) == {one.entry_id for one in kept if not any(overlap(one, other) for other in kept)}
    states = {one.entry_id: [] for one in held}
    for identity, counts in log.recounted:
        states[identity].append(counts)
    for told in states.values():  # each change is reported once
        assert all(before != after for before, after in itertools.pairwise(told))


def test_exposures_of_other_drones_and_those_that_touch_count(kit, mission):
    own = exposures(kit, mission, [(0.0, 0.5), (0.5, 1.0), (1.0, 1.5)])
    other = exposures(kit, mission, [(0.25, 0.75), (1.0, 1.5)], drone="b")
    log = log_of(mission, [*own, *other])
    assert len(counted(log, [*own, *other])) == 5
    assert log.misexposed(0) == []


def test_drones_whose_exposures_overlap_or_are_too_long_are_named(kit, mission):
    overlapping = exposures(kit, mission, [(0.0, 0.5), (0.25, 0.75)], drone="b")
    longer = exposures(kit, mission, [(3.0, 3.0 + 1.001e-9 * MAX_LOGGED_EXPOSURE_NS)], drone="c")
    log = log_of(mission, [*overlapping, *longer])
    assert log.counters[Outcome.TOO_LONG.value] == 1
    assert len(log) == 2
    assert log.misexposed(kit.T0_NS) == [("b", "overlap"), ("c", "are too long")]
    assert log.misexposed(kit.T0_NS + 1_000_000_000) == [("c", "are too long")]
    assert log.misexposed(kit.T0_NS + 6_000_000_000) == []


def test_logs_of_older_records_take_longer_ones_and_count_those_that_overlap(kit, mission):
    former = exposures(kit, mission, [(0.0, 30.0), (10.0, 10.5)])
    log = log_of(mission, former, judges_exposures=False)
    assert len(counted(log, former)) == 2


@pytest.mark.parametrize("estimator", ["bayes", "sources"])
def test_the_hypothesis_is_as_without_those_that_overlap(kit, estimator):
    """Whichever of two comes first, and however late the second one."""
    mission = kit.mission_of()
    rng = random.Random(4)
    flight = [
        replace(
            kit.exposure_entry(mission, 0.5 * number, (10.0 + number, 30.0, 3.0), drone=drone, sequence=number, duration_s=0.5),
            counts=Counts(40, 9, 4),
        )
        for number in range(40)
        for drone in ("a", "b", "c")
    ]
    forged = [
        replace(
            kit.exposure_entry(mission, at_s, (30.0, 30.0, 0.0), drone="c", sequence=500 + number, duration_s=1.2),
            counts=Counts(0, 0, 0),
        )
        for number, at_s in enumerate((3.1, 8.0, 15.3))
    ]
    kept = [one for one in flight if not any(one.drone == "c" and overlap(one, other) for other in forged)]
    assert len(flight) - len(kept) == 9
    poisoned, without = (fusions.fusion_of(mission, estimator_named(estimator, mission)) for _ in range(2))
    arrivals = [*flight, *forged]
    rng.shuffle(arrivals)
    for place, entry in enumerate(arrivals):
        kit.feed(poisoned, [entry])
        if place % 10 == 0:
            poisoned.advance(kit.T0_NS + 20_000_000_000, 500)
    kit.feed(without, kept)
    told = [kit.settle(one, kit.T0_NS + 22_000_000_000, 10**6) for one in (poisoned, without)]
    assert kit.same_bits(*told)
    outlooks = [one.outlook for one in (poisoned, without)]
    if outlooks[1] is not None:
        assert outlooks[0].weight.tobytes() == outlooks[1].weight.tobytes()
