"""Delivery to the event loop: order, and amount at a time."""

import asyncio
import threading
import time
from collections import Counter
from collections.abc import Callable
from itertools import pairwise

import pytest

from radron.protocol.codec import MAX_ENTRY_BYTES, MAX_NEWS_BYTES
from radron.protocol.keys import command_key, drone_key
from radron.protocol.mesh import inbox as inbox_module
from radron.protocol.mesh.inbox import MAX_ANSWERED_ENTRIES, MAX_QUEUES, NEWS_IN_TURN, NEWS_PER_S, SLICE_MESSAGES, Inbox
from support.mesh.meshes import until

CONE = drone_key("s", "d1", "cone")
POSE = drone_key("s", "d1", "pose")
COMMAND = command_key("s", "gcs")


class Received:
    """An inbox and its deliveries; ``turns``: how often it was this loop's turn to do something else meanwhile."""

    def __init__(
        self, act: Callable[[str, bytes], None] = lambda key, payload: None, members: tuple[str, ...] | None = None
    ) -> None:
        self.messages: list[tuple[str, bytes]] = []
        self.counters: Counter[str] = Counter()
        self.bursts: list[int] = []
        self._act = act
        self.inbox = Inbox(asyncio.get_running_loop(), "s", self._receive, self._drained, self.counters, members)

    def _receive(self, key: str, payload: bytes) -> None:
        self.messages.append((key, payload))
        self._act(key, payload)

    def _drained(self) -> None:
        self.bursts.append(len(self.messages))


def test_entries_of_many_threads_come_complete_and_in_order() -> None:
    async def run() -> None:
        received = Received()
        keys = [drone_key("s", f"d{i}", "exposure") for i in range(4)]

        def publish(key: str) -> None:
            for i in range(1000):
                received.inbox.put(key, b"%d" % i)

        threads = [threading.Thread(target=publish, args=(key,)) for key in keys]
        for thread in threads:
            thread.start()
        await until(lambda: len(received.messages) == 4000)
        for thread in threads:
            thread.join()
        for key in keys:
            assert [int(payload) for there, payload in received.messages if there == key] == list(range(1000))
        assert received.counters == {"received": 4000}
        assert received.bursts[-1] == 4000

    asyncio.run(run())


def test_of_news_the_newest_comes_and_the_others_are_counted() -> None:
    async def run() -> None:
        received = Received()
        for i in range(100):
            received.inbox.put(POSE, b"%d" % i)
            received.inbox.put(drone_key("s", "d2", "pose"), b"%d" % i)
        await until(lambda: received.messages)
        assert received.messages == [(POSE, b"99"), (drone_key("s", "d2", "pose"), b"99")]
        assert received.counters["superseded"] == 198

    asyncio.run(run())


def test_commands_come_first_and_entries_last() -> None:
    async def run() -> None:
        received = Received()
        for key in (CONE, POSE, COMMAND, CONE):
            received.inbox.put(key, b"")
        await until(lambda: len(received.messages) == 4)
        assert [key for key, _ in received.messages] == [COMMAND, POSE, CONE, CONE]

    asyncio.run(run())


def test_a_flood_is_delivered_in_slices_between_which_the_loop_does_other_things() -> None:
    async def run() -> None:
        received = Received()
        for i in range(1500):
            received.inbox.put(CONE, b"%d" % i)
        seen = [0]
        while seen[-1] < 1500:
            await asyncio.sleep(0)
            seen.append(len(received.messages))
        assert max(after - before for before, after in pairwise(seen)) <= SLICE_MESSAGES
        assert [int(payload) for _, payload in received.messages] == list(range(1500))

    asyncio.run(run())


def test_who_answers_with_the_entries_of_others_takes_up_its_own_share() -> None:
    """Before, an answer with junk blamed the drone named by the key, and kept that drone's own messages out."""

    async def run() -> None:
        received = Received()
        theirs = drone_key("s", "d2", "cone")
        for i in range(MAX_ANSWERED_ENTRIES + 10):
            received.inbox.put(theirs, b"%d" % i, by="d3")
        received.inbox.put(theirs, b"own")
        assert [line.split()[0] for line in received.inbox.problems] == ["d3"]
        await until(lambda: (theirs, b"own") in received.messages)

    asyncio.run(run())


def test_who_waits_for_the_entries_has_them_all_or_waits_no_longer_than_it_wants() -> None:
    async def run() -> None:
        received = Received()
        for i in range(1000):
            received.inbox.put(CONE, b"%d" % i)
        await received.inbox.delivered(0.0)
        assert len(received.messages) < 1000
        await received.inbox.delivered(60.0)
        assert len(received.messages) == 1000

    asyncio.run(run())


def test_a_slice_of_slow_messages_is_short_and_news_overtake() -> None:
    async def run() -> None:
        received = Received(lambda key, payload: time.sleep(0.002))
        for i in range(100):
            received.inbox.put(CONE, b"%d" % i)
        await until(lambda: received.messages)
        assert len(received.messages) < 10  # of 100 that a slice may have: 5 ms are over
        received.inbox.put(POSE, b"")
        await until(lambda: len(received.messages) == 101)
        assert received.messages.index((POSE, b"")) < 50

    asyncio.run(run())


def test_what_is_no_message_of_this_swarm_is_counted_and_dropped() -> None:
    async def run() -> None:
        received = Received()
        received.inbox.put(drone_key("other", "d1", "cone"), b"")
        received.inbox.put("radron/2/s/d1/nonsense", b"")
        received.inbox.put("no key at all", b"")
        received.inbox.put(CONE, bytes(MAX_ENTRY_BYTES + 1))
        received.inbox.put(POSE, bytes(MAX_NEWS_BYTES + 1))
        received.inbox.put(CONE, None)
        received.inbox.put(CONE, bytes(MAX_ENTRY_BYTES))
        received.inbox.put(POSE, bytes(MAX_NEWS_BYTES))
        await until(lambda: len(received.messages) == 2)
        assert received.counters == {"received": 2, "other_swarm": 1, "unknown_key": 2, "oversized": 3}

    asyncio.run(run())


def test_of_one_publisher_what_is_beyond_the_bounds_is_dropped_and_told_and_nothing_of_the_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(inbox_module, "MAX_PUBLISHED", 1000)

    async def run() -> None:
        received = Received()
        for i in range(1000 + 10):
            received.inbox.put(CONE, b"%d" % i)
        others = [drone_key("s", f"d{k}", kind) for k in (2, 3) for kind in ("cone", "pose")]
        for key in others:
            received.inbox.put(key, b"")
        await until(lambda: len(received.messages) >= 8)
        assert [key for key, _ in received.messages[:8] if key != CONE] == [others[1], others[3], others[0], others[2]]
        await until(lambda: received.counters["received"] == 1000 + 4)
        assert received.counters["overflow"] == 10
        assert received.inbox.problems == ("d1 floods the mesh: 10 of its messages were too many",)

    asyncio.run(run())


def test_entries_of_one_publisher_come_at_a_bounded_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox_module, "PUBLISHED_BURST", 100.0)

    async def run() -> None:
        received, loop = Received(), asyncio.get_running_loop()
        begun_s = loop.time()
        while loop.time() < begun_s + 1.0:
            for _ in range(100):
                received.inbox.put(CONE, b"")
            await asyncio.sleep(0.005)
        assert 100 < len(received.messages) <= 101 + (loop.time() - begun_s) * inbox_module.PUBLISHED_PER_S
        assert received.counters["overflow"] > 0

    asyncio.run(run())


def test_more_news_than_any_drone_sends_are_told() -> None:
    async def run() -> None:
        received = Received()
        for _ in range(3 * NEWS_PER_S):
            received.inbox.put(POSE, b"")
        await until(lambda: received.messages)
        assert len(received.messages) == 1
        assert "d1 floods" in received.inbox.problems[0]

    asyncio.run(run())


def test_unknown_drones_are_ignored_and_too_many_operators_take_turns() -> None:
    async def run() -> None:
        received = Received(members=("d1",))
        for k in range(3 * MAX_QUEUES):
            received.inbox.put(drone_key("s", f"x{k}", "cone"), b"")
            received.inbox.put(command_key("s", f"gcs{k}"), b"")
        received.inbox.put(CONE, b"")
        await until(lambda: received.counters["received"] == MAX_QUEUES)
        assert received.counters["unknown_drone"] == 3 * MAX_QUEUES
        received.inbox.put(CONE, b"here")
        await until(lambda: (CONE, b"here") in received.messages)

    asyncio.run(run())


def test_an_error_of_the_receiver_concerns_one_message() -> None:
    def refuse(key: str, payload: bytes) -> None:
        if payload == b"1":
            raise RuntimeError("no")

    async def run() -> None:
        errors: list[object] = []
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: errors.append(context["exception"]))
        received = Received(refuse)
        for i in range(4):
            received.inbox.put(CONE, b"%d" % i)
        await until(lambda: len(received.messages) == 4)
        assert len(errors) == 1

    asyncio.run(run())


def test_a_closed_inbox_delivers_nothing() -> None:
    async def run() -> None:
        received = Received(lambda key, payload: received.inbox.close())
        for i in range(4):
            received.inbox.put(CONE, b"%d" % i)
        await until(lambda: received.messages)
        await asyncio.sleep(0.02)
        assert received.messages == [(CONE, b"0")]

    asyncio.run(run())


def test_putting_after_the_end_of_the_loop_is_harmless() -> None:
    async def make() -> Inbox:
        return Received().inbox

    asyncio.run(make()).put(CONE, b"")


def test_news_that_never_end_keep_no_entry_back_and_without_them_entries_come_at_once() -> None:
    async def run() -> None:
        def renew(key: str, payload: bytes) -> None:
            if key == POSE and len(received.messages) < 10 * NEWS_IN_TURN:
                received.inbox.put(POSE, b"again")

        received = Received(renew)
        received.inbox.put(POSE, b"first")
        for number in range(3):
            received.inbox.put(drone_key("s", "d2", "cone"), b"%d" % number)
        await until(lambda: len(received.messages) >= 10 * NEWS_IN_TURN)
        places = [place for place, (key, _) in enumerate(received.messages) if key != POSE]
        assert places == [NEWS_IN_TURN, 2 * NEWS_IN_TURN + 1, 3 * NEWS_IN_TURN + 2]

    asyncio.run(run())
