"""Messages from Zenoh's threads to the event loop: entries and commands lossless and in order, of other kinds only the newest.

A burst costs the loop one call from another thread. Delivery is in slices, commands first and log entries last, so that a
backlog of recovered entries neither delays the control step nor makes poses stale. Every publisher has separate queues, which
take turns: a flooding publisher loses only its own messages. Published and answered messages of a drone have separate queues,
too: its camera sets the rate of the former, the asker the rate of the latter.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import Counter, deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from radron.protocol.bucket import Bucket
from radron.protocol.codec import size_limit
from radron.protocol.codes import Code
from radron.protocol.entries import Entry
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import Key, parse_key
from radron.protocol.mesh.publishers import Publishers
from radron.protocol.messages import DRONE_KINDS, STATION_KINDS
from radron.protocol.texts import CodedText

ENTRY_KINDS = tuple(kind for kind, message in DRONE_KINDS.items() if issubclass(message, Entry))
NEWS_KINDS = tuple(kind for kind in DRONE_KINDS if kind not in ENTRY_KINDS)
SLICE_MESSAGES = 100
DELIVERY_SLICE_S, DELIVERY_PAUSE_S = 0.005, 0.005
ENTRIES_PAUSE_S = 0.015  # after a slice of entries: the entries and their consequences take a quarter of the loop's time
MAX_ANSWERED_ENTRIES = 5_000  # answered by a drone, waiting for delivery; more are dropped, and recovered by the log query
MAX_PUBLISHED = 2_000  # published by a drone, likewise: with the entries delivered at once, the size of its caches
PUBLISHED_PER_S, PUBLISHED_BURST = 200.0, 1_500.0  # entries of a drone, which publishes 30 to 100 a second
ANSWERED_PER_S = 1_000.0  # an hour's log in less than a minute
MAX_COMMANDS = 100  # of a publisher
FLOOD_COMMANDS_PER_S = 10  # of a publisher; more are a flood, of which `rights` lets few through
MAX_NEWS = 64  # of a publisher, waiting for delivery: one for each kind and session
MAX_QUEUES = 128  # a swarm has up to 64 drones
NEWS_IN_TURN = 20  # delivered before a waiting entry: a flood of news must not block all entries
NEWS_PER_S = 200  # of a publisher; only the newest counts; honest publishers send 15
FLOOD_REPORTED_S = 10.0  # a flood is reported for this long
DELIVERED_S = 1.0  # longest wait for the delivery of the replies to one query; a flooding peer must not delay the next query

_Name = tuple[str, bool]  # of a publisher; True: for its answers to queries
Receive = Callable[[Key, bytes], object]  # its result is ignored


@dataclass(slots=True)
class _Share:
    """Waiting messages of one publisher. ``credit``: for entries to deliver; ``flood_s``: time of its last lost message."""

    credit: Bucket
    commands: deque[tuple[Key, bytes]] = field(default_factory=deque)
    news: dict[tuple[Key, str], bytes] = field(default_factory=dict)  # by session: no session replaces another session's news
    entries: deque[tuple[Key, bytes]] = field(default_factory=deque)
    second: int = 0
    heard: int = 0  # news or commands in this second
    lost: int = 0
    flood_s: float = float("-inf")


class Inbox:
    """Queue of received messages between the network's threads and the event loop.

    The inbox takes messages in any thread, reads their keys once, and delivers them in the event loop's thread. It counts
    ``received`` (delivered) and ``superseded`` (replaced by a newer message before delivery), and dropped messages as
    ``overflow`` (beyond the bounds of this module), ``oversized``, ``other_swarm``, ``unknown_key`` and ``unknown_drone``.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        swarm: str,
        receive: Receive,
        drained: Callable[[], None],
        counters: Counter[str],
        members: Collection[str] | None = None,
    ) -> None:
        """Start an empty inbox.

        ``receive``: called with key and payload of each delivered message. ``drained``: called after each burst of deliveries.
        ``members``: drones whose messages are accepted; None: all.
        """
        self._loop = loop
        self._swarm = swarm
        self._receive = receive
        self._drained = drained
        self._counters = counters
        self._members = members
        self._lock = threading.Lock()  # of all following fields, which all threads change
        self._shares: dict[_Name, _Share] = {}  # the first has waited longest for its turn
        self._publishers = Publishers()
        self._dropped: Counter[str] = Counter()
        self._news_run = 0  # news delivered since the last entry
        self._scheduled = False
        self._closed = False

    def put(self, key: str, payload: bytes | None, by: str | None = None, session: str = "") -> None:
        """Add a received message to the queue, in any thread.

        ``payload``: None stands for bytes beyond the size limit. ``by``: the drone that has sent the message in an answer to a
        query; the message counts against this drone's limit, also if another drone is the author. ``session``: id of the
        publishing network session, as the message states it.
        """
        try:
            address = parse_key(key)
        except ProtocolError:
            address = None
        with self._lock:
            self._take(address, payload, by, session)
            wakes, self._scheduled = not self._scheduled, True
        if wakes:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self._deliver)

    async def delivered(self, replies: int) -> None:
        """Wait until all log entries received in answer to a query have been delivered, for at most ``DELIVERED_S`` seconds.

        ``replies``: number of entries in the answer.
        """
        end_s = self._loop.time() + DELIVERED_S
        while replies and self._holds_entries() and self._loop.time() < end_s and not self._closed:
            await asyncio.sleep(DELIVERY_SLICE_S)

    def _holds_entries(self) -> bool:
        with self._lock:
            return any(share.entries for share in self._shares.values())

    def close(self) -> None:
        """Stop delivering messages."""
        self._closed = True

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems of reception, one line each: peers that flood the network, and names with two publishing sessions."""
        now_s = self._loop.time()
        with self._lock:
            copied = self._publishers.problems(now_s)
            told = Counter[str]()
            for (name, _), share in self._shares.items():
                if now_s - share.flood_s < FLOOD_REPORTED_S:
                    told[name] += share.lost
        text = "{} floods the mesh: {} of its messages were too many"
        return *copied, *(CodedText(Code.FLOOD, text.format(name, lost), name) for name, lost in sorted(told.items()))

    def _take(self, key: Key | None, payload: bytes | None, by: str | None, session: str) -> None:
        if key is None:
            self._dropped["unknown_key"] += 1
            return
        if key.swarm != self._swarm:
            self._dropped["other_swarm"] += 1
            return
        if self._members is not None and key.kind not in STATION_KINDS and key.sender not in self._members:
            self._dropped["unknown_drone"] += 1
            return
        share = self._share_of((f"operator {key.sender}" if key.kind in STATION_KINDS else by or key.sender, by is not None))
        if share is None:
            self._dropped["overflow"] += 1
            return
        if payload is None or len(payload) > size_limit(key.kind):
            self._lose(share, "oversized")
        elif key.kind in ENTRY_KINDS:
            self._keep(share, share.entries, MAX_PUBLISHED if by is None else MAX_ANSWERED_ENTRIES, key, payload)
        elif key.kind in STATION_KINDS:
            self._keep(share, share.commands, MAX_COMMANDS, key, payload)
            self._note_rate(share, FLOOD_COMMANDS_PER_S)
        else:
            self._renew(share, key, payload, session)

    def _share_of(self, name: _Name) -> _Share | None:
        """Return a publisher's share; beyond ``MAX_QUEUES`` it replaces an idle share. None if no share is idle."""
        share = self._shares.get(name)
        if share is not None:
            return share
        if len(self._shares) >= MAX_QUEUES:
            idle = next((name for name, one in self._shares.items() if not (one.commands or one.news or one.entries)), None)
            if idle is None:
                return None
            del self._shares[idle]
        rate, burst = (ANSWERED_PER_S, MAX_ANSWERED_ENTRIES) if name[1] else (PUBLISHED_PER_S, PUBLISHED_BURST)
        share = self._shares[name] = _Share(Bucket(rate, burst, self._loop.time()))
        return share

    def drop(self, reason: str) -> None:
        """Count a message that was dropped for this ``reason``, in any thread."""
        with self._lock:
            self._dropped[reason] += 1

    def _renew(self, share: _Share, key: Key, payload: bytes, session: str) -> None:
        self._publishers.note(key.sender, session, self._loop.time())
        if (key, session) in share.news:
            self._dropped["superseded"] += 1
        elif len(share.news) >= MAX_NEWS:
            self._lose(share, "overflow")
            return
        share.news[key, session] = payload
        self._note_rate(share, NEWS_PER_S)

    def _note_rate(self, share: _Share, most_per_s: int) -> None:
        second = int(self._loop.time())
        share.second, share.heard = second, share.heard + 1 if second == share.second else 1
        if share.heard > most_per_s:
            share.lost, share.flood_s = share.lost + 1, self._loop.time()

    def _keep(self, share: _Share, queue: deque[tuple[Key, bytes]], most: int, key: Key, payload: bytes) -> None:
        if len(queue) < most:
            queue.append((key, payload))
        else:
            self._lose(share, "overflow")

    def _lose(self, share: _Share, reason: str) -> None:
        self._dropped[reason] += 1
        share.lost, share.flood_s = share.lost + 1, self._loop.time()

    def _deliver(self) -> None:
        """Deliver one slice; the next slice follows after a pause, in which the loop processes all other due work."""
        until_s = self._loop.time() + DELIVERY_SLICE_S
        delivered = entries = 0
        try:
            while delivered < SLICE_MESSAGES and not self._closed:
                message = self._next()
                if message is None:
                    break
                delivered += 1
                entries += message[0].kind in ENTRY_KINDS
                self._counters["received"] += 1
                self._receive(*message)
                if self._loop.time() > until_s:
                    break
        finally:  # an exception of the receiver affects one message only
            self._schedule(ENTRIES_PAUSE_S if entries else DELIVERY_PAUSE_S)
        if delivered and not self._closed:
            self._drained()

    def _schedule(self, pause_s: float) -> None:
        with self._lock:
            self._counters.update(self._dropped)
            self._dropped.clear()
            waits = any(share.commands or share.news or share.entries for share in self._shares.values())
            self._scheduled = waits and not self._closed
        if self._scheduled:
            self._loop.call_later(pause_s, self._deliver)

    def _next(self) -> tuple[Key, bytes] | None:
        """Return the next message, of the publisher with the longest wait for its turn; commands first, entries last."""
        now_s = self._loop.time()
        later = (_news, _entry) if self._news_run < NEWS_IN_TURN else (_entry, _news)
        with self._lock:
            for choose in (_command, *later):
                for name, share in self._shares.items():
                    message = choose(share, now_s)
                    if message is not None:
                        self._shares[name] = self._shares.pop(name)
                        self._news_run = 0 if choose is _entry else self._news_run + (choose is _news)
                        return message
        return None


def _command(share: _Share, now_s: float) -> tuple[Key, bytes] | None:
    return share.commands.popleft() if share.commands else None


def _news(share: _Share, now_s: float) -> tuple[Key, bytes] | None:
    if not share.news:
        return None
    key, session = next(iter(share.news))
    return key, share.news.pop((key, session))


def _entry(share: _Share, now_s: float) -> tuple[Key, bytes] | None:
    return share.entries.popleft() if share.entries and share.credit.take(now_s) else None
