"""Requests for missing entries: one peer after another, at once while entries arrive, rarely when none do."""

import asyncio
from collections.abc import Collection

import pytest

from radron.protocol.mesh.recovery import HURRY_S, RECOVERY_PERIOD_S, recover
from support import virtual_time


class Swarm:
    """Peers with a number of answers left, by id; records the queries: peer and time."""

    def __init__(self, left: dict[str, int]) -> None:
        self.left = left
        self.asked: list[tuple[float, str]] = []
        self.put_off = self.untaken = 0  # entries put off so far, and of each answer

    async def ask(self, peer: str, summary: bytes) -> int:
        assert summary == b"what we hold"
        self.asked.append((asyncio.get_running_loop().time(), peer))
        self.left[peer] -= 1
        self.put_off += self.untaken
        return 500 if self.left[peer] >= 0 else 0


async def ask_for_a_while(swarm: Swarm, seconds: float, alive: Collection[str] | None = None, phase: float = 0.0) -> None:
    peers = swarm.left if alive is None else alive
    asking = recover(lambda: peers, lambda: b"what we hold", swarm.ask, phase, lambda: swarm.put_off)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(asking, seconds)


def test_peers_are_asked_in_turn() -> None:
    swarm = Swarm({"d1": 0, "d3": 0, "d4": 0})
    virtual_time.run(ask_for_a_while(swarm, 4.5 * RECOVERY_PERIOD_S))
    asked = [peer for _, peer in swarm.asked]
    assert len(asked) == 3 + 5  # each as it appears, and then one in each period
    assert all(set(asked[at : at + 3]) == {"d1", "d3", "d4"} for at in range(len(asked) - 2))


def test_a_whole_log_is_fetched_without_waiting_between_its_pieces() -> None:
    swarm = Swarm({"d2": 5})
    virtual_time.run(ask_for_a_while(swarm, RECOVERY_PERIOD_S))
    times = [at_s for at_s, _ in swarm.asked]
    assert len(times) >= 6
    assert times[5] - times[0] == pytest.approx(5 * HURRY_S)


def test_peers_that_come_later_are_asked() -> None:
    swarm = Swarm({"d2": 0})
    alive: set[str] = set()

    async def late() -> None:
        asyncio.get_running_loop().call_later(1.0, alive.add, "d2")
        await ask_for_a_while(swarm, 2.0, alive)

    virtual_time.run(late())
    assert swarm.asked


def test_agents_ask_different_peers_first() -> None:
    """Three asked one for the same 600 entries at once after a partition, and the other had nothing to do."""
    first = []
    for phase in (0.4, 0.6, 0.8):
        swarm = Swarm({"d1": 2, "d2": 2})
        virtual_time.run(ask_for_a_while(swarm, 0.1, phase=phase))
        first.append(swarm.asked[0][1])
    assert first == ["d1", "d2", "d2"]


def test_a_peer_that_always_answers_keeps_no_other_out() -> None:
    """Before, a peer with only known entries in its answer was asked again and again, and no other peer."""
    swarm = Swarm({"d1": 1_000_000, "d2": 5, "d3": 0, "d4": 0})
    alive = ["d4"]

    async def late() -> None:
        asyncio.get_running_loop().call_later(0.5 * RECOVERY_PERIOD_S, alive.extend, ("d1", "d2", "d3"))
        await ask_for_a_while(swarm, 20.0 * RECOVERY_PERIOD_S, alive)

    virtual_time.run(late())
    asked_s = {peer: [at_s for at_s, who in swarm.asked if who == peer] for peer in swarm.left}
    assert asked_s["d2"][5] < 2.0 * RECOVERY_PERIOD_S  # newly appeared peers take turns
    assert len([at_s for at_s in asked_s["d4"] if at_s > RECOVERY_PERIOD_S]) >= 2  # and peers known before are asked all the same


def test_who_answers_with_what_is_put_off_is_not_asked_again_at_once() -> None:
    swarm = Swarm({"d2": 1000})
    swarm.untaken = 400
    virtual_time.run(ask_for_a_while(swarm, 4.5 * RECOVERY_PERIOD_S))
    assert len(swarm.asked) <= 1 + 5
