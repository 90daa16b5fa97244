"""The engine: in whatever order and with whatever delay entries come, the same bits in the end."""

import random

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.fusion.engine import BEFORE_START_NS
from radron.protocol.codec import encode
from radron.protocol.entries import Cone
from support.flights.fusions import fusion_of


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32))
def test_what_is_forgotten_changes_nothing_in_the_end(kit, mission, entries, in_order, seed):
    """Forged entries among the others, forgotten in portions at any time, whether folded, late or waiting."""
    rng = random.Random(seed)
    forged = [msgspec.structs.replace(one, sequence=5000 + k) for k, one in enumerate(rng.sample(entries, 12))]
    forged = [msgspec.structs.replace(one, apex_m=(1.0, 1.0, 3.0)) if isinstance(one, Cone) else one for one in forged]
    arrivals = [*entries, *forged]
    rng.shuffle(arrivals)
    fusion, budget = fusion_of(mission), rng.randint(1, 60)
    for place, entry in enumerate(arrivals):
        kit.feed(fusion, [entry])
        if place % 20 == 0:
            fusion.advance(kit.T0_NS + round(kit.END_NS * place / len(arrivals)), budget)
    for start in range(0, len(forged), 5):
        fusion.advance(kit.T0_NS + kit.END_NS, budget)
        gone = [one.entry_id for one in forged[start : start + 5]]
        assert fusion.forget(gone) == gone
    kit.settle(fusion, kit.T0_NS + kit.END_NS, budget)
    assert kit.agrees(fusion, in_order)
    assert fusion.forget([one.entry_id for one in forged]) == []


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32))
def test_any_permutation_duplication_delay_and_slicing_ends_in_the_same_bits(kit, mission, entries, in_order, seed):
    rng = random.Random(seed)
    calls, budget = rng.randrange(40), rng.randint(1, 60)
    arrivals = entries + rng.choices(entries, k=rng.randrange(30))
    rng.shuffle(arrivals)
    advances = sorted(rng.uniform(0.0, kit.END_NS) for _ in range(calls))
    cuts = sorted(rng.randrange(len(arrivals) + 1) for _ in range(calls))
    fusion, taken = fusion_of(mission), 0
    for cut, now_ns in zip(cuts, advances, strict=True):
        kit.feed(fusion, arrivals[taken:cut])
        taken = cut
        fusion.advance(kit.T0_NS + round(now_ns), budget)
    kit.feed(fusion, arrivals[taken:])
    kit.settle(fusion, kit.T0_NS + kit.END_NS, budget)
    assert kit.agrees(fusion, in_order)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32))
def test_radio_delays_in_a_running_flight(kit, mission, entries, in_order, seed):
    """Arrivals 0 to 3 s late in a 20 Hz loop: at its end, and at every moment at which all is there, the reference's bits."""
    rng = random.Random(seed)
    arrivals = sorted(((entry.stamp_ns + round(rng.uniform(0.0, 3e9)), entry) for entry in entries), key=lambda a: a[0])
    fusion = fusion_of(mission)
    now_ns = kit.T0_NS
    while now_ns < kit.T0_NS + kit.END_NS:
        while arrivals and arrivals[0][0] <= now_ns:
            entry = arrivals.pop(0)[1]
            fusion.receive(entry, encode(entry))
        fusion.advance(now_ns)
        now_ns += 50_000_000
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    assert kit.agrees(fusion, in_order)


@pytest.mark.parametrize("now_s", [5.0, 12.3, 29.9])
def test_the_hypothesis_of_any_moment_is_that_of_its_grid_step(kit, mission, entries, now_s):
    """A log that knows more already (stamps ahead of now) says the same as a log with the due entries only."""
    ahead, due = fusion_of(mission), fusion_of(mission)
    now_ns = kit.T0_NS + round(now_s * 1e9)
    end_ns = (now_ns // 500_000_000 + 1) * 500_000_000
    kit.feed(ahead, entries)
    kit.feed(due, [entry for entry in entries if entry.stamp_ns < end_ns])
    assert kit.same_bits(kit.settle(ahead, now_ns), kit.settle(due, now_ns))
    assert ahead.hypothesis is not None


def test_a_cone_reaches_the_hypothesis_with_the_next_call(kit, mission, entries):
    fusion = fusion_of(mission)
    kit.feed(fusion, entries)
    now_ns = entries[-1].stamp_ns + 1
    before = kit.settle(fusion, now_ns)
    new = kit.cone_entry(mission, (now_ns - kit.T0_NS) / 1e9, (60.0, 40.0, 3.0), (0.0, 1.0, 0.0), 0.4, sequence=900)
    kit.feed(fusion, [new])
    fusion.advance(now_ns + 1)
    assert not fusion.pending
    assert fusion.hypothesis.cones == before.cones + 1
    assert not np.array_equal(fusion.hypothesis.position, before.position)


def test_a_late_entry_replays_in_slices_while_the_older_hypothesis_serves(kit, mission, entries):
    fusion, whole = fusion_of(mission), fusion_of(mission)
    now_ns = kit.T0_NS + kit.END_NS
    late = next(entry for entry in entries if isinstance(entry, Cone))
    kit.feed(fusion, [entry for entry in entries if entry is not late])
    older = kit.settle(fusion, now_ns)
    kit.feed(fusion, [late])
    slices = 0
    while True:
        fusion.advance(now_ns, budget=10)
        slices += 1
        if not fusion.pending:
            break
        assert fusion.hypothesis is older
    assert slices >= 4
    kit.feed(whole, entries)
    assert kit.same_bits(fusion.hypothesis, kit.settle(whole, now_ns))
    assert not kit.same_bits(fusion.hypothesis, older)


def test_another_mission_changes_nothing(kit, mission, entries, in_order):
    fusion = fusion_of(mission)
    kit.feed(fusion, entries)
    foreign = [msgspec.structs.replace(entry, mission="f" * 16) for entry in entries]
    assert not any(kit.feed(fusion, foreign))
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    assert kit.agrees(fusion, in_order)
    assert fusion.log.counters["foreign"] == len(entries)


@pytest.mark.parametrize("into_step_s", [0.0, 0.1, 0.2, 0.3, 0.4])
def test_a_start_leaves_out_the_same_whenever_it_is_told(kit, mission, entries, in_order, into_step_s):
    """Also of the step of the grid in which the bound lies."""
    start_ns = kit.T0_NS + BEFORE_START_NS + round((10.0 + into_step_s) * 1e9)
    told_first, told_last = fusion_of(mission), fusion_of(mission)
    told_first.start(start_ns)
    for fusion in (told_first, told_last):
        kit.feed(fusion, entries)
        kit.settle(fusion, kit.T0_NS + kit.END_NS)
    told_last.start(start_ns)
    kit.settle(told_last, kit.T0_NS + kit.END_NS)
    assert kit.agrees(told_first, told_last)
    assert not kit.agrees(told_first, in_order)


@pytest.mark.parametrize("back_s", [0.5, 7.0, 25.0, 45.0])
def test_where_time_goes_back_so_does_the_hypothesis(kit, mission, entries, in_order, back_s):
    """The swarm's common time was ahead: the log's entries up to the present time count, and later ones again once due."""
    fusion, never = fusion_of(mission), fusion_of(mission)
    for one in (fusion, never):
        kit.feed(one, entries)
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    back_ns = kit.T0_NS + kit.END_NS - round(back_s * 1e9)
    assert kit.same_bits(kit.settle(fusion, back_ns, budget=40), kit.settle(never, back_ns))
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    assert kit.agrees(fusion, in_order)
