"""The mesh: the Zenoh session of a drone or an operator, and its bridge to asyncio.

Publications never block: all messages have congestion control DROP and a priority that Zenoh's own blocking traffic
(queries and recovery of the advanced publishers, priority DATA) does not use. Dropped log entries are recovered.
Zenoh calls that can block are made in separate threads. A process with a session must not fork: spawn.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence

import zenoh
from zenoh import CongestionControl, Locality, Priority, ext
from zenoh.handlers import Callback

from radron.protocol.codec import MAX_PAYLOAD_BYTES
from radron.protocol.codes import Code
from radron.protocol.errors import MeshError, ProtocolError
from radron.protocol.keys import ROOT, drone_key, log_query_key, parse_key, read_token, station_key, token_keys
from radron.protocol.mesh.answers import Answer, Answers
from radron.protocol.mesh.inbox import ENTRY_KINDS, NEWS_KINDS, Inbox, Receive
from radron.protocol.mesh.joining import session_of
from radron.protocol.mesh.link import MeshConfig, close_session, in_thread
from radron.protocol.mesh.outgoing import Outgoing
from radron.protocol.mesh.presence import Presence
from radron.protocol.mesh.queries import Pace, Serving, fetch, query
from radron.protocol.messages import STATION_KINDS
from radron.protocol.texts import CodedText
from radron.protocol.units import STATION

__all__ = ["Mesh", "MeshConfig"]

CACHE_ENTRIES = 500  # of each kind, 1.2 kB each, for peers after a late start or a lost link; older entries: by the log query
PUBLISHER_HEARTBEAT_S = 0.5  # the loss of a last entry is noticed after this time
ASK_S = 1.0
RELINKED_S = 1.0  # until the peers are linked again with a reopened session
MAX_HELD_BACK = 1_000  # entries, while the session is reopened


class Mesh:
    """The connection of a drone or an operator to the swarm's network, through which it publishes, receives and queries messages.

    All calls and callbacks are made in the thread of the event loop that opened the connection. ``counters``: the counts of
    ``Inbox``; ``publish_failed``; ``entries_missed`` (log entries that Zenoh could not recover, so that a log query must fetch
    them); of log queries ``log_asked``, ``log_replies``, ``log_ask_failed``, ``log_answered``, ``log_answer_failed``,
    ``log_answer_refused``.
    """

    def __init__(
        self,
        swarm: str,
        drone: str | None,
        receive: Receive,
        drained: Callable[[], None] | None,
        answer: Answer | None,
        members: Collection[str] | None,
    ) -> None:
        """Use :meth:`open` to connect."""
        self.counters: Counter[str] = Counter()
        self._session: zenoh.Session | None = None  # None also while the session is reopened
        self._swarm = swarm
        self._drone = drone
        self._loop = asyncio.get_running_loop()
        self._inbox = Inbox(self._loop, swarm, receive, drained or (lambda: None), self.counters, members)
        self._outgoing = Outgoing(lambda: self._to_loop(self._count, "publish_failed"))
        self._publishers: dict[str, zenoh.Publisher | ext.AdvancedPublisher] = {}
        self._declared: list[object] = []  # Zenoh undeclares unreferenced objects
        self._presence = Presence(self.counters)
        self._members = members
        self._failure: str | None = None  # error of the last attempt to reopen the session
        self._holds_back = False  # True: entries wait for the reopened session
        self._held_back: deque[tuple[str, bytes]] = deque(maxlen=MAX_HELD_BACK)
        self._pace = Pace()
        self._answers = Answers(self._loop, answer, self.counters) if answer is not None else None

    @classmethod
    async def open(
        cls,
        config: MeshConfig,
        swarm: str,
        drone: str | None,
        *,
        receive: Receive,
        drained: Callable[[], None] | None = None,
        answer: Answer | None = None,
        members: Collection[str] | None = None,
    ) -> Mesh:
        """Connect to the network of a swarm.

        Args:
            config: endpoints.
            swarm: name of the swarm.
            drone: own id; None: an operator, who gets no history, is not listed in ``alive`` and has no log to query.
            receive: called with key and payload of every message of the swarm except the own messages; an operator's session gets
                its own orders, too. Entries and commands come without loss (within the bounds of ``Inbox``) and, for one key, in
                order; of other kinds only the newest message.
            drained: called after each burst of ``receive``.
            answer: maps a peer's summary to the (key, payload) of the entries missing there.
            members: the drones of the swarm: messages under other names are counted and ignored; None: all names are accepted.

        Raises:
            MeshError: the session cannot be opened as configured.
        """
        drone_key(swarm, drone or "any", "alive")  # invalid names are refused
        mesh = cls(swarm, drone, receive, drained, answer, members)
        try:
            await mesh._join(config)
        except BaseException:
            mesh._inbox.close()
            raise
        return mesh

    async def reopen(self, config: MeshConfig) -> None:
        """Replace the network session by a new session with another configuration.

        The rights of members can only change in this way, since Zenoh fixes them at the opening. Log entries published meanwhile
        wait until the peers are linked again, for a second at most; other messages are dropped, as their successors replace them.

        Raises:
            MeshError: the session cannot be opened as configured. Until another call succeeds, no message is received or
                published.
        """
        session, self._session = self._session, None
        before, self._holds_back = self._presence.alive - config.revoked, True
        self._publishers, self._declared = {}, []
        if session is not None:
            await close_session(session)
        self._presence.clear()
        try:
            await self._join(config)
        except MeshError as error:
            self._failure = str(error)
            raise
        self._failure = None
        until_s = self._loop.time() + RELINKED_S
        while not before <= self._presence.alive and self._loop.time() < until_s:
            await asyncio.sleep(0.02)
        self._holds_back = False
        while self._held_back:
            self.publish(*self._held_back.popleft())

    async def _join(self, config: MeshConfig) -> None:
        session = await session_of(config, self._swarm, self._drone)
        declaring = in_thread(lambda: self._declare(session))
        try:
            await asyncio.shield(declaring)
        except asyncio.CancelledError:
            await asyncio.wait((declaring,))
            await close_session(session)
            raise
        except zenoh.ZError as error:
            await close_session(session)
            raise MeshError(f"mesh: {str(error)[:160]}") from None
        self._session = session

    @property
    def alive(self) -> frozenset[str]:
        """Ids of the other drones that are connected to the network.

        A killed process disappears from this set at once; a stopped process, or one without a network, after 1 s.
        """
        return frozenset(self._presence.alive)

    @property
    def differing(self) -> tuple[CodedText, ...]:
        """Drones with another version of the protocol, one line of text each; they cannot fly together with this drone."""
        return self._presence.differing

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems of the network for the operator, one line each.

        Reported are a missing session, flooding publishers, names with two sessions, and peers that query too much.
        """
        shut = () if self._failure is None else (CodedText(Code.NETWORK_CLOSED, f"no other drone is reached: {self._failure}"),)
        asked = () if self._answers is None else self._answers.problems
        return shut + self._inbox.problems + asked

    def publish(self, key: str, payload: bytes) -> None:
        """Send a message to the swarm, or drop it if the link is congested.

        The call neither blocks nor fails because of the network.

        Raises:
            ProtocolError: not a key of this swarm.
        """
        if self._holds_back and parse_key(key).kind in ENTRY_KINDS:
            self._held_back.append((key, payload))
            return
        if self._session is None:
            self.counters["publish_failed"] += 1
            return
        publisher = self._publishers.get(key)
        try:
            if publisher is None:
                publisher = self._publishers[key] = self._publisher(key, self._session)
            if isinstance(publisher, ext.AdvancedPublisher):
                self._outgoing.put(publisher, payload)
            else:
                publisher.put(payload, source_info=zenoh.SourceInfo(publisher.id, 0))  # without it, the message states no session
        except zenoh.ZError:
            self.counters["publish_failed"] += 1

    async def ask(self, drone: str, summary: bytes) -> int:
        """Fetch from a drone the log entries that a ``summary`` of the own log lacks.

        The call waits until the entries have been delivered to ``receive``. An earlier repetition would fetch entries still in
        transit twice, and delay both answers.

        Returns:
            The number of received entries, of which some may not be delivered yet if they are many. 0 for an unreachable drone.
        """
        replies = await self._query(drone, summary, lambda sample: self._take(sample, by=drone))
        self.counters["log_replies"] += replies
        await self._inbox.delivered(replies)
        return replies

    async def summary_of(self, drone: str) -> bytes | None:
        """Query a drone for the summary of its log (which entries it contains); None without an answer."""
        found: list[zenoh.Sample] = []
        await self._query(drone, b"", found.append)
        payloads = [sample.payload for sample in found]
        return next((payload.to_bytes() for payload in payloads if len(payload) <= MAX_PAYLOAD_BYTES), None)

    async def _query(self, drone: str, payload: bytes, take_sample: Callable[[zenoh.Sample], object]) -> int:
        """Query the log of a drone and return the number of replies. ``take_sample`` is called in Zenoh's threads."""
        replies = 0
        session = self._session
        if session is None:
            return 0

        def take(reply: zenoh.Sample) -> None:
            nonlocal replies
            replies += 1
            take_sample(reply)

        def failed() -> None:
            self._to_loop(self._count, "log_ask_failed")

        await self._pace.turn(drone)
        self._count("log_asked")
        try:
            await query(session, log_query_key(self._swarm, drone, self._drone or STATION), payload, ASK_S, take, failed)
        except (TimeoutError, zenoh.ZError):
            self._count("log_ask_failed")
        return replies

    async def serve_mission(self, station: str, parts: Sequence[bytes]) -> None:
        """Offer the parts of an uploaded mission to the drones, until the session ends or another mission replaces this mission.

        Raises:
            MeshError: no session, or the session refuses.
        """
        if self._session is None:
            raise MeshError("mesh: there is no session from which a mission could be served")
        serving = Serving(self._session, station_key(self._swarm, station, "mission"), parts)
        try:
            for former in [one for one in self._declared if isinstance(one, Serving)]:
                self._declared.remove(former)
                await former.close()
            await serving.open()
        except zenoh.ZError as error:
            raise MeshError(f"mesh: {str(error)[:160]}") from None
        self._declared.append(serving)

    async def fetch_mission(self, station: str, hashes: Sequence[bytes]) -> bytes | None:
        """Fetch an uploaded mission from an operator's station; None if a part cannot be obtained.

        ``hashes``: the BLAKE2b-256 hash of each part, in order.
        """
        if self._session is None:
            return None
        return await fetch(self._session, station_key(self._swarm, station, "mission"), hashes)

    async def close(self) -> None:
        """Disconnect from the network, within the time of ``close_session``.

        Afterwards publications fail, and no message is received.
        """
        self._inbox.close()
        await in_thread(self._outgoing.close)
        if self._session is not None:
            await close_session(self._session)
        self._presence.clear()

    def _declare(self, session: zenoh.Session) -> None:
        """Declare subscribers, publishers and answers; the token last, so that a drone with a token already listens."""
        on_sample = Callback(self._take, indirect=False)
        orders_of = Locality.REMOTE if self._drone is not None else Locality.ANY  # a page shows its own operator's orders, too
        origins = {f"*/{kind}": Locality.REMOTE for kind in NEWS_KINDS}
        origins |= {f"{STATION}/*/{kind}": orders_of for kind in STATION_KINDS}
        for place, origin in origins.items():
            key = f"{ROOT}/{self._swarm}/{place}"
            self._declared.append(session.declare_subscriber(key, on_sample, allowed_origin=origin))
        history = recovery = None  # operators have the log query alone: caches answer without bounds
        if self._drone is not None:
            history = ext.HistoryConfig(max_samples=CACHE_ENTRIES)
            recovery = ext.RecoveryConfig(periodic_queries=None, heartbeat=True)
        for kind in ENTRY_KINDS:
            subscriber = ext.declare_advanced_subscriber(
                session,
                f"{ROOT}/{self._swarm}/*/{kind}",
                on_sample,
                allowed_origin=Locality.REMOTE,
                history=history,
                recovery=recovery,
            )
            missed = subscriber.sample_miss_listener(Callback(self._take_miss, indirect=False))
            self._declared += [subscriber, missed]
        liveliness = session.liveliness()
        on_token = Callback(self._take_token, indirect=False)
        self._declared.append(liveliness.declare_subscriber(token_keys(self._swarm), on_token, history=True))
        if self._drone is None:
            return
        for kind in (*ENTRY_KINDS, *NEWS_KINDS):
            key = drone_key(self._swarm, self._drone, kind)
            self._publishers[key] = self._publisher(key, session)
        if self._answers is not None:
            key = f"{drone_key(self._swarm, self._drone, 'log')}/*"
            self._declared.append(session.declare_queryable(key, Callback(self._take_query, indirect=False)))
        self._declared.append(liveliness.declare_token(drone_key(self._swarm, self._drone, "alive")))

    def _publisher(self, key: str, session: zenoh.Session) -> zenoh.Publisher | ext.AdvancedPublisher:
        address = parse_key(key)
        if address.swarm != self._swarm:
            raise ProtocolError(f"key {str(key)!r} is not of the swarm {self._swarm!r}")
        if address.kind in ENTRY_KINDS:
            return ext.declare_advanced_publisher(
                session,
                key,
                congestion_control=CongestionControl.DROP,
                priority=Priority.DATA_HIGH,
                cache=ext.CacheConfig(CACHE_ENTRIES),
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=PUBLISHER_HEARTBEAT_S),
            )
        # With a separate priority, commands are not dropped in favour of frequent messages.
        priority = Priority.INTERACTIVE_HIGH if address.kind in STATION_KINDS else Priority.INTERACTIVE_LOW
        return session.declare_publisher(key, congestion_control=CongestionControl.DROP, priority=priority)

    # Called in Zenoh's threads; they must not make Zenoh calls that leave the process.

    def _take(self, sample: zenoh.Sample, by: str | None = None) -> None:
        payload, source = sample.payload, sample.source_info
        content = payload.to_bytes() if len(payload) <= MAX_PAYLOAD_BYTES else None
        self._inbox.put(str(sample.key_expr), content, by, str(source.source_id.zid) if source is not None else "")

    def _take_miss(self, miss: ext.Miss) -> None:
        self._to_loop(self._count, "entries_missed", miss.nb)

    def _take_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        drone, _ = read_token(key)
        if drone == self._drone:
            return
        if self._members is not None and drone not in self._members:
            self._inbox.drop("unknown_drone")
        else:
            self._to_loop(self._presence.take, key, sample.kind == zenoh.SampleKind.PUT)

    def _take_query(self, query: zenoh.Query) -> None:
        asker = str(query.key_expr).rpartition("/")[2]
        if self._members is not None and asker not in self._members:
            asker = STATION
        if self._answers is not None:
            self._to_loop(self._answers.reply, query, asker)

    def _to_loop(self, call: Callable[..., object], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(call, *arguments)

    # Called in the loop's thread.

    def _count(self, name: str, number: int = 1) -> None:
        self.counters[name] += number
