"""The engine's computation and memory, for any input however late: bounded, and nothing twice without need."""

import random
import tracemalloc
from itertools import pairwise

import msgspec
import numpy as np

from radron.agent.fusion.observations import MAX_HELD_OBSERVATIONS
from radron.agent.fusion.paper import PaperEstimator
from radron.agent.fusion.registry import estimator_named
from radron.agent.fusion.timeline import MAX_STEP_OBSERVATIONS
from radron.protocol.codec import decode, encode
from radron.protocol.entries import Cone
from support.flights.fusions import fusion_of


class Counting(PaperEstimator):
    """Counts the observations that are folded."""

    folded = 0

    def step(self, state, step, observations):
        self.folded += len(observations)
        return super().step(state, step, observations)


def test_a_late_entry_costs_what_is_behind_it_and_nothing_new_costs_nothing(kit, mission, entries):
    counting, fusion = counting_fusion(mission)
    cones = [entry for entry in entries if entry.boot == kit.BOOT and entry.sequence < 1000]
    late = cones[-6]
    kit.feed(fusion, [entry for entry in cones if entry is not late])
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    assert counting.folded == len(cones) - 1
    counting.folded = 0
    fusion.advance(kit.T0_NS + kit.END_NS + 5_000_000_000)
    assert counting.folded == 0
    kit.feed(fusion, [late])
    kit.settle(fusion, kit.T0_NS + kit.END_NS)
    begin_ns = late.stamp_ns // 500_000_000 * 500_000_000
    assert counting.folded == sum(cone.stamp_ns >= begin_ns for cone in cones)


def counting_fusion(mission):
    plain = estimator_named("paper", mission)
    counting = Counting(plain._config, plain._search, plain._rule)
    return counting, fusion_of(mission, counting)


def test_old_entries_again_and_again_delay_nothing_and_are_all_in_it_in_the_end(kit, mission, entries):
    """An entry each 0.3 s, enough to have everything computed again: every call costs a slice at most, and the hypothesis stays
    the newest.
    """
    cones = kit.flight(mission, np.random.default_rng(5), 120.0, lambda _: (40.0, 60.0), rate_hz=2.0)
    counting, fusion = counting_fusion(mission)
    punctual, late = [cone for cone in cones if cone.sequence % 3], [cone for cone in cones if cone.sequence % 3 == 0]
    kit.feed(fusion, punctual[:80])
    kit.settle(fusion, punctual[79].stamp_ns)
    seen, most, waits = set(), 0, len(late)
    now_ns = punctual[79].stamp_ns
    for tick in range(1, 600):
        now_ns += 50_000_000
        if tick % 6 == 0 and waits:
            waits -= 1
            kit.feed(fusion, [late[waits]])
        counting.folded = 0
        fusion.advance(now_ns, budget=40)
        most = max(most, counting.folded)
        seen.add(fusion.hypothesis.stamp_ns)
    assert most <= 2 * 40 / fusion.estimator.work(fusion.state, 1) + 1
    assert len(seen) >= 60  # of every grid step
    whole = fusion_of(mission)
    kit.feed(whole, [*punctual[:80], *late[waits:]])
    assert kit.agrees(fusion_at_rest(fusion, now_ns), fusion_at_rest(whole, now_ns))


def test_a_drone_with_old_entries_again_and_again_has_a_quota_and_the_late_ones_of_another_do_not_wait_for_it(kit, mission):
    """d "c" sends one of a minute before each 0.3 s; "b" was not heard for a minute, and then all of it comes at once."""
    cones = kit.flight(mission, np.random.default_rng(6), 180.0, lambda _: (40.0, 60.0), rate_hz=3.0)
    old = [
        kit.cone_entry(mission, 0.3 * k, (30.0, 30.0, 3.0), (0.6, 0.0, 0.8), 1.0, drone="c", sequence=10**6 + k)
        for k in range(400)
    ]
    missed = [cone for cone in cones if cone.drone == "b" and 60.0 < kit.since_s(cone) < 120.0]
    counting, fusion = counting_fusion(mission)
    kit.feed(fusion, [cone for cone in cones if kit.since_s(cone) < 60.0])
    kit.settle(fusion, kit.T0_NS + 60 * 10**9)
    counting.folded, put_off, heals_s = 0, set(), None
    for tick in range(60 * 20, 180 * 20):
        now_s, now_ns = tick / 20, kit.T0_NS + tick * 50_000_000
        kit.feed(fusion, [cone for cone in cones if now_s - 0.05 <= kit.since_s(cone) < now_s and cone not in missed])
        if tick % 6 == 0:
            kit.feed(fusion, [old[(tick - 1200) // 6]])
        if tick == 120 * 20:
            kit.feed(fusion, missed)
        fusion.advance(now_ns)
        put_off |= fusion.late.put_off
        folded = fusion._timeline.step_of(missed[0].entry_id) is not None and not fusion._chains.is_replaying
        if folded and heals_s is None:
            heals_s = now_s - 120.0
    assert put_off == {"c"}
    assert 0.0 < heals_s < 8.0  # a border, and a replay
    assert counting.folded < 12 * len(cones)  # without a quota 34 times as many
    whole = fusion_of(mission)
    kit.feed(whole, [*cones, *old])
    assert kit.agrees(fusion_at_rest(fusion, now_ns), fusion_at_rest(whole, now_ns))


def fusion_at_rest(fusion, now_ns):
    while True:
        fusion.advance(now_ns)
        if not fusion.pending:
            return fusion


def test_old_entries_all_the_time_are_in_the_hypotheses_of_all_at_the_same_times(kit):
    """An entry each 0.3 s, 6.6 s late, and up to 0.1 s later at the other agent; a replay takes twelve calls."""
    mission = kit.mission_of(initial_cones=6, grid_s=0.1)
    cones = kit.flight(mission, np.random.default_rng(4), 40.0, lambda _: (40.0, 60.0), rate_hz=10.0)
    rng, agents, same, looks = random.Random(4), (fusion_of(mission), fusion_of(mission)), 0, 0
    late_ns = {cone.sequence: 6_600_000_000 for cone in cones if cone.sequence % 3 == 0}
    ways = [[(cone.stamp_ns + late_ns.get(cone.sequence, 0), cone) for cone in cones]]
    ways.append([(ns + rng.randrange(10**8) * (cone.sequence in late_ns), cone) for ns, cone in ways[0]])
    for now_ns in range(kit.T0_NS, kit.T0_NS + 40 * 10**9, 50_000_000):
        for fusion, way in zip(agents, ways, strict=True):
            kit.feed(fusion, [cone for arrival_ns, cone in way if now_ns - 50_000_000 < arrival_ns <= now_ns])
            fusion.advance(now_ns, budget=12)
            assert now_ns - max(fusion.complete_ns, kit.T0_NS) <= 5_000_000_000  # two borders, and a replay
        if now_ns > kit.T0_NS + 10 * 10**9:
            same, looks = same + agrees_by(kit, *agents), looks + 1
    assert same > 0.6 * looks


def agrees_by(kit, one, other):
    """Whether two hypotheses agree, whatever the logs hold that is not in them."""
    return one.hypothesis.stamp_ns == other.hypothesis.stamp_ns and kit.same_bits(one.hypothesis, other.hypothesis)


def test_what_comes_a_second_late_all_the_time_has_little_computed_again(kit):
    """Half of the entries: one after the other each would have ten steps computed again."""
    mission = kit.mission_of(initial_cones=6, grid_s=0.1)
    counting, fusion = counting_fusion(mission)
    cones = kit.flight(mission, np.random.default_rng(3), 30.0, lambda _: (50.0, 50.0), rate_hz=10.0)
    arrivals = [(cone.stamp_ns + cone.sequence % 2 * 10**9, cone) for cone in cones]
    for now_ns in range(kit.T0_NS, kit.T0_NS + 32 * 10**9, 50_000_000):
        kit.feed(fusion, [cone for arrival_ns, cone in arrivals if now_ns - 50_000_000 < arrival_ns <= now_ns])
        fusion.advance(now_ns)
    assert not fusion.pending  # all are in it two seconds after the last one
    assert len(cones) < counting.folded < 3 * len(cones)
    assert fusion.hypothesis.cones == len(cones)


def test_of_one_drone_and_step_only_so_many_count_whatever_comes(kit, mission):
    flood = [
        kit.cone_entry(mission, 0.1 + 1e-6 * number, (1.0, 2.0, 3.0), (0.6, 0.0, 0.8), 0.5, sequence=number)
        for number in range(10 * MAX_STEP_OBSERVATIONS)
    ]
    other = kit.cone_entry(mission, 0.2, (1.0, 2.0, 3.0), (0.0, 0.6, 0.8), 0.5, drone="b")
    now_ns = kit.T0_NS + 10**9
    states = []
    for order in (flood, flood[::-1]):
        counting, fusion = counting_fusion(mission)
        kit.feed(fusion, [*order, other])
        fusion.advance(now_ns)
        assert counting.folded == MAX_STEP_OBSERVATIONS + 1
        assert len(fusion.log) == len(flood) + 1
        states.append(fusion.digest)
        counting.folded = 0
        again = kit.cone_entry(mission, 0.3, (1.0, 2.0, 3.0), (0.6, 0.0, 0.8), 0.5, sequence=10**6)
        kit.feed(fusion, [again])
        fusion.advance(now_ns + 1)
        assert counting.folded == 0  # entries that do not count cost nothing
    assert states[0] == states[1]


def test_an_entry_takes_a_bounded_memory(kit, mission):
    """Besides the estimator's states, whose number is bounded."""
    fusion = fusion_of(mission)
    cones = kit.flight(mission, np.random.default_rng(7), 2.5 * MAX_HELD_OBSERVATIONS / 4.0, lambda _: (50.0, 50.0), rate_hz=4.0)
    payloads, taken = [encode(cone) for cone in cones], []
    tracemalloc.start()
    try:
        for payload in payloads:
            fusion.receive(decode(payload), bytes(bytearray(payload)))
            taken.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    added = (taken[-1] - taken[MAX_HELD_OBSERVATIONS]) / (len(taken) - 1 - MAX_HELD_OBSERVATIONS)
    assert added < 1_000  # measured: 800, the bytes themselves included


def test_with_a_hold_entries_gather_and_are_folded_once(kit, mission, entries):
    """Two steps of 0.5 s: arrivals up to half a second late cost no replay, and the hypothesis is that of the earlier step."""
    plain = estimator_named("paper", mission)
    counting, held = (Counting(plain._config, plain._search, plain._rule) for _ in range(2))
    held.hold_s = 1.0
    prompt, fusion = (fusion_of(mission, one) for one in (counting, held))
    rng = random.Random(5)
    cones = [entry for entry in entries if isinstance(entry, Cone)]
    arrivals = sorted(((cone.stamp_ns + round(rng.uniform(0.0, 5e8)), cone) for cone in cones), key=lambda a: a[0])
    for now_ns in range(kit.T0_NS, kit.T0_NS + kit.END_NS, 50_000_000):
        while arrivals and arrivals[0][0] <= now_ns:
            cone = arrivals.pop(0)[1]
            kit.feed(prompt, [cone])
            kit.feed(fusion, [cone])
        prompt.advance(now_ns)
        fusion.advance(now_ns)
    assert held.folded == len(cones) < counting.folded
    newest_ns = cones[-1].stamp_ns // 500_000_000 * 500_000_000
    early, late = (fusion_of(mission, held) for _ in range(2))
    for one, now_ns in ((early, newest_ns + 999_999_999), (late, newest_ns + 1_000_000_000)):
        kit.feed(one, cones)
        kit.settle(one, now_ns)
    assert early.hypothesis.cones < late.hypothesis.cones == len(cones)
    assert kit.same_bits(kit.settle(late, kit.T0_NS + kit.END_NS), kit.settle(fusion, kit.T0_NS + kit.END_NS))


def test_checkpoints_are_thinned_and_old_ones_remain(kit, mission):
    cones = kit.flight(mission, np.random.default_rng(4), 400.0, lambda _: (50.0, 50.0), rate_hz=1.0)
    fusion, whole = fusion_of(mission), fusion_of(mission)
    for cone in cones[:20] + cones[21:]:
        kit.feed(fusion, [cone])
        fusion.advance(cone.stamp_ns)
    assert len(fusion._timeline) > 200
    held = list(fusion._chains._states)
    assert len(held) <= 12
    ages = [held[-1] + 1 - step for step in held]
    assert ages[0] > 600  # of the 800 steps since the first one
    assert max(older / younger for older, younger in pairwise(ages) if younger > 10) < 3.0  # the spacing grows with the age
    kit.feed(fusion, cones[20:21])
    kit.feed(whole, cones)
    end_ns = cones[-1].stamp_ns
    assert kit.same_bits(kit.settle(fusion, end_ns), kit.settle(whole, end_ns))


def test_an_entry_of_ages_ago_is_no_long_replay(kit, mission, entries):
    """A publisher with a broken clock must not make everybody step through decades."""
    fusion = fusion_of(mission)
    ancient = next(entry for entry in entries if isinstance(entry, Cone))
    kit.feed(fusion, [msgspec.structs.replace(ancient, stamp_ns=1), *entries])
    fusion.advance(kit.T0_NS + kit.END_NS, budget=1000)
    assert not fusion.pending
    assert fusion.hypothesis is not None
