"""Entries retracted by their own drone, after stamps of a wrong clock, stay in the log and do not count."""

import random
from functools import partial

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.fusion.log import ObservationLog, Outcome
from radron.protocol.codec import encode
from radron.protocol.entries import Retraction
from support.flights.fusions import fusion_of

END_NS = 30_000_000_000


@pytest.fixture(scope="session")
def entries(kit, mission):
    """Cones of 25 s; each drone's are numbered from 0 on."""
    return kit.flight(mission, np.random.default_rng(5), 25.0, lambda time_s: (40.0 + time_s, 60.0))


def retraction(kit, mission, first, last, sequence=900, drone="a", **changes):
    at = {"mission": mission.mission_id, "stamp_ns": kit.T0_NS, "boot": kit.BOOT, **changes}
    return Retraction(drone=drone, sequence=sequence, first=first, last=last, **at)


def log_of(mission, entries):
    log = ObservationLog(mission.mission_id, [drone.id for drone in mission.drones])
    for entry in entries:
        log.add(entry, encode(entry))
    return log


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32))
def test_a_log_counts_the_same_entries_whenever_it_learns_what_is_taken_back(kit, mission, entries, seed):
    back = [retraction(kit, mission, 3, 9, 900), retraction(kit, mission, 8, 12, 901), retraction(kit, mission, 5, 6, 902)]
    arrivals = [*entries, *back]
    random.Random(seed).shuffle(arrivals)
    log = log_of(mission, arrivals)
    gone = {entry.entry_id for entry in entries if entry.drone == "a" and 3 <= entry.sequence <= 12}
    assert {entry.entry_id for entry in entries if not log.counts(entry.entry_id)} == gone
    assert log.digest == log_of(mission, [*entries, *back]).digest
    told = [identity for identity, counts in log.recounted if not counts]
    assert len(told) == len(set(told)) == len(log.recounted)
    assert set(told) <= gone


def test_nobody_takes_back_what_others_have_measured_or_another_boot_of_the_drone(kit, mission, entries):
    others = [entry for entry in entries if entry.drone != "a"]
    log = log_of(mission, [*others, retraction(kit, mission, 0, 800), retraction(kit, mission, 0, 800, drone="b", boot="f" * 16)])
    assert all(log.counts(entry.entry_id) for entry in others)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32))
def test_what_is_taken_back_leaves_no_trace_in_the_hypothesis(kit, mission, entries, seed):
    """Known before, in time, or late, and with a little of the work in each call."""
    rng = random.Random(seed)
    arrivals, budget = [*entries, retraction(kit, mission, 2, 9), retraction(kit, mission, 0, 3, drone="b")], rng.randint(1, 60)
    rng.shuffle(arrivals)
    fusion, never = fusion_of(mission), fusion_of(mission)
    for place, entry in enumerate(arrivals):
        kit.feed(fusion, [entry])
        if place % 5 == 0:
            fusion.advance(kit.T0_NS + round(END_NS * place / len(arrivals)), budget)
    kit.feed(never, [entry for entry in entries if fusion.log.counts(entry.entry_id)])
    assert len(never.log) < len(entries)
    assert kit.same_bits(kit.settle(fusion, kit.T0_NS + END_NS, budget), kit.settle(never, kit.T0_NS + END_NS))
    assert all((fusion.place(entry.entry_id) is None) != fusion.log.counts(entry.entry_id) for entry in entries)


@pytest.mark.parametrize("settled", [True, False])
def test_where_the_retraction_itself_does_not_count_any_more_the_entries_do(kit, mission, entries, settled):
    """Its drone has contradicted itself before it, as reported late."""
    fusion, never = fusion_of(mission), fusion_of(mission)
    kit.feed(fusion, [*entries, retraction(kit, mission, 2, 9, sequence=900)])
    kit.feed(never, entries)
    if settled:
        kit.settle(fusion, kit.T0_NS + END_NS)
    liar = kit.cone_entry(mission, 1.0, (0.0, 0.0, 3.0), (0.0, 0.0, 1.0), 1.0, sequence=800)
    for entry in (liar, msgspec.structs.replace(liar, separation_mm=2.0)):
        taken = fusion.log.add(entry, encode(entry))
    assert taken is Outcome.CONTRADICTION
    fusion.forget(fusion.log.beyond("a", partial(fusion.log.last_counted, "a")))
    assert kit.same_bits(kit.settle(fusion, kit.T0_NS + END_NS), kit.settle(never, kit.T0_NS + END_NS))
    assert all(fusion.log.counts(entry.entry_id) for entry in entries)


def test_one_that_takes_back_all_that_it_says_keeps_nobody_from_folding_the_others(kit, mission):
    """Each second it takes back the last 20 s: the hypothesis is never older than a call, and nothing waits for long."""
    fusion, waited, longest = fusion_of(mission), 0, 0
    flown = kit.flight(mission, np.random.default_rng(6), 60.0, lambda time_s: (40.0 + time_s, 60.0), rate_hz=8.0)
    flown.sort(key=lambda entry: entry.stamp_ns, reverse=True)
    for tick in range(60 * 20):
        now_ns = kit.T0_NS + tick * 50_000_000
        while flown and flown[-1].stamp_ns <= now_ns:
            kit.feed(fusion, [flown.pop()])
        if tick % 20 == 0:
            second = tick // 20
            liar = kit.cone_entry(
                mission, max(0.0, second - 20.0), (0.0, 0.0, 3.0), (0.0, 0.0, 1.0), 1.0, sequence=5000 + 2 * second
            )
            kit.feed(fusion, [liar, retraction(kit, mission, 0, liar.sequence, sequence=liar.sequence + 1)])
        fusion.advance(now_ns, 30)
        waited = waited + 1 if fusion.pending else 0
        longest = max(longest, waited)
        assert fusion.hypothesis is None or now_ns - fusion.hypothesis.stamp_ns <= 700_000_000
    assert longest <= 100
    assert fusion.hypothesis is not None


def test_many_retractions_that_do_not_count_any_more_are_worked_off_together(kit, mission, entries):
    """A retraction for each number: a new selection after each of them would take seconds."""
    back = [retraction(kit, mission, number, number, sequence=20_000 + number) for number in range(5000)]
    log = log_of(mission, [*entries, *back])
    own = [entry.entry_id for entry in entries if entry.drone == "a"]
    assert not any(map(log.counts, own))
    for entry in back:
        log.forget(entry.entry_id)
    assert [identity for identity, counts in log.recounted if counts] == sorted(own, key=lambda identity: identity.sequence)
    assert all(map(log.counts, own))


def test_what_comes_when_its_retraction_has_ceased_to_count_is_not_told_as_changed(kit, mission, entries):
    log = log_of(mission, [back := retraction(kit, mission, 0, 9)])
    log.forget(back.entry_id)
    for entry in entries:
        log.add(entry, encode(entry))
    assert list(log.recounted) == []
    assert all(log.counts(entry.entry_id) for entry in entries)
