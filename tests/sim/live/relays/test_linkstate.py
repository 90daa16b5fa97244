"""Effect of one direction of an impaired link on packets."""

from __future__ import annotations

from random import Random

import pytest

from radron.sim.live.relays.linkstate import PASSING, LinkState, Packets, combined, corrupted

PACKET = bytes(range(40))
SENT = 20_000


def carried(state: LinkState, seed: int = 1, count: int = SENT) -> list[list[tuple[float, bytes]]]:
    packets = Packets(Random(seed))
    packets.state = state
    return [packets.carry(PACKET, float(number)) for number in range(count)]


def share(arrivals: list[list[tuple[float, bytes]]], happened: int) -> float:
    return sum(len(copies) == happened for copies in arrivals) / len(arrivals)


def test_a_passing_link_changes_nothing_and_a_cut_one_carries_nothing() -> None:
    assert carried(PASSING, count=3) == [[(float(number), PACKET)] for number in range(3)]
    assert carried(LinkState(cut=True), count=3) == [[], [], []]


@pytest.mark.parametrize(("state", "copies"), [(LinkState(loss=0.2), 0), (LinkState(duplicate=0.2, within_s=0.5), 2)])
def test_probabilities_are_those_of_packets(state: LinkState, copies: int) -> None:
    assert share(carried(state), copies) == pytest.approx(0.2, abs=0.012)  # four standard deviations
    assert carried(state, seed=7, count=200) == carried(state, seed=7, count=200)
    assert carried(state, seed=7, count=200) != carried(state, seed=8, count=200)


def test_delay_and_jitter_are_within_what_is_asked_and_jitter_reorders() -> None:
    arrivals = [copies[0][0] - number for number, copies in enumerate(carried(LinkState(delay_s=0.1, jitter_s=0.05)))]
    assert 0.1 <= min(arrivals) < 0.101
    assert 0.149 < max(arrivals) <= 0.15
    close = Packets(Random(1))
    close.state = LinkState(jitter_s=0.05)
    due = [close.carry(PACKET, 0.001 * number)[0][0] for number in range(100)]
    assert due != sorted(due)


def test_a_reordered_packet_is_overtaken_and_a_duplicate_follows_in_time() -> None:
    held = [copies[0][0] - number for number, copies in enumerate(carried(LinkState(reorder=0.3, held_s=0.25)))]
    assert {round(each_s, 6) for each_s in held} == {0.0, 0.25}
    for (first_s, _), (second_s, _) in carried(LinkState(duplicate=1.0, within_s=0.5), count=100):
        assert 0.0 <= second_s - first_s <= 0.5


def test_a_corrupted_packet_is_another_one_of_about_its_length() -> None:
    random = Random(1)
    broken = [corrupted(PACKET, random) for _ in range(300)]
    assert all(packet != PACKET for packet in broken)
    assert {len(packet) > len(PACKET) for packet in broken} == {True, False}
    assert min(len(packet) for packet in broken) < len(PACKET)
    assert corrupted(b"", random) != b""


def test_several_states_at_once() -> None:
    both = combined([LinkState(loss=0.5, delay_s=0.1), LinkState(loss=0.5, delay_s=0.2, cut=True, rate_bytes_ps=5.0), PASSING])
    assert both == LinkState(loss=0.75, delay_s=pytest.approx(0.3), cut=True, rate_bytes_ps=5.0)
    assert combined([]) == PASSING
