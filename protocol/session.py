"""The mesh: the Zenoh session of a drone or an operator, and its bridge to asyncio.

Publications never block: everything is sent with congestion control DROP, at a priority that Zenoh's own blocking traffic
(queries and recovery of the advanced publishers, priority DATA) does not use. Log entries that are dropped are recovered.
Zenoh calls that can block are made in separate threads. A process with a session must not fork: spawn.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable, Collection

import zenoh
from zenoh import CongestionControl, Locality, Priority, ext
from zenoh.handlers import Callback

from protocol.codec import MAX_PAYLOAD_BYTES
from protocol.errors import MeshError, ProtocolError
from protocol.identity import CERTIFICATE_FILE, Identity, Role
from protocol.inbox import ENTRY_KINDS, NEWS_KINDS, Inbox, Receive
from protocol.keys import ROOT, VERSION, drone_key, parse_key, read_token, token_keys
from protocol.link import MeshConfig, close_session, in_thread, open_session
from protocol.outgoing import Outgoing
from protocol.rights import access_control
from protocol.units import STATION

__all__ = ["Mesh", "MeshConfig"]

CACHE_ENTRIES = 2_000  # of each kind, for peers that join late or were cut off; older ones come by the log query
HEARTBEAT_S = 0.5  # the loss of a last entry is noticed after this time
ASK_S = 1.0
MOST_ALIVE = 256  # names with a liveliness token that are kept
ANSWER_SHARE = 0.1  # of the loop's time goes into answers at most, however often somebody asks
MOST_ANSWERS = 8  # log queries answered at the same time

Answer = Callable[[bytes], list[tuple[str, bytes]]]


class Mesh:
    """An open session. All calls, and all calls back, are made in the thread of the event loop that opened it.

    ``counters``: those of ``Inbox``; ``publish_failed``; ``entries_missed`` (beyond Zenoh's recovery: left to the log query);
    of the log query ``log_asked``, ``log_replies``, ``log_ask_failed``, ``log_answered``, ``log_answer_failed``,
    ``log_answer_refused``.
    """

    def __init__(
        self,
        session: zenoh.Session,
        swarm: str,
        drone: str | None,
        receive: Receive,
        drained: Callable[[], None] | None,
        answer: Answer | None,
        members: Collection[str] | None,
    ) -> None:
        """Use :meth:`open`."""
        self.counters: Counter[str] = Counter()
        self._session = session
        self._swarm = swarm
        self._drone = drone
        self._answer = answer
        self._loop = asyncio.get_running_loop()
        self._inbox = Inbox(self._loop, swarm, receive, drained or (lambda: None), self.counters, members)
        self._outgoing = Outgoing(lambda: self._to_loop(self._count, "publish_failed"))
        self._publishers: dict[str, zenoh.Publisher | ext.AdvancedPublisher] = {}
        self._declared: list[object] = []  # Zenoh undeclares what is not referenced
        self._alive: set[str] = set()
        self._differing: dict[str, str] = {}  # versions of the protocol of drones that speak another one
        self._members = members
        self._answers = 0
        self._credit_s, self._credited_s = ANSWER_SHARE, self._loop.time()  # for answers

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
        """Join a swarm.

        Args:
            config: endpoints.
            swarm: its name.
            drone: own id; None for an operator, who gets no history, is not listed in ``alive`` and is not asked for a log.
            receive: called with key and payload of every message of the swarm except the own ones. Entries and commands come
                without loss (within the bounds of ``Inbox``) and, for one key, in order; of other kinds only the newest.
            drained: called after each burst of ``receive``.
            answer: from a peer's summary to the (key, payload) of the entries missing there.
            members: the drones of the swarm: what comes under another name is counted and ignored; None: all names are taken.

        Raises:
            MeshError: the session cannot be opened as configured.
        """
        drone_key(swarm, drone or "any", "alive")  # invalid names are refused
        identity, access = config.identity, None
        if identity is not None:
            _check_owner(identity, drone)
            access = access_control(swarm, config.drones, identity.revoked.names, config.others)
        session = await open_session(config, dial_all=config.listen is None, access=access)
        mesh = cls(session, swarm, drone, receive, drained, answer, members)
        declaring = in_thread(mesh._declare)
        try:
            await asyncio.shield(declaring)
        except asyncio.CancelledError:
            await asyncio.wait((declaring,))
            await mesh.close()
            raise
        except zenoh.ZError as error:
            await mesh.close()
            raise MeshError(f"mesh: {str(error)[:160]}") from None
        return mesh

    @property
    def alive(self) -> frozenset[str]:
        """The other drones with a liveliness token: a killed process loses it at once, a stopped or disconnected one after a
        second.
        """
        return frozenset(self._alive)

    @property
    def differing(self) -> tuple[str, ...]:
        """The drones that speak another version of the protocol, one line each: none of them can fly together with this one."""
        return tuple(
            f"{drone} speaks version {version or 'unknown'} of the protocol, here {VERSION}: give all the same version of radron"
            for drone, version in sorted(self._differing.items())
        )

    @property
    def problems(self) -> tuple[str, ...]:
        """Publishers that flood the mesh, one line each."""
        return self._inbox.problems

    def publish(self, key: str, payload: bytes) -> None:
        """Send a message, or drop it on congestion; never blocks, never fails because of the network.

        Raises:
            ProtocolError: not a key of this swarm.
        """
        publisher = self._publishers.get(key)
        try:
            if publisher is None:
                publisher = self._publishers[key] = self._publisher(key)
            if isinstance(publisher, ext.AdvancedPublisher):
                self._outgoing.put(publisher, payload)
            else:
                publisher.put(payload)
        except zenoh.ZError:
            self.counters["publish_failed"] += 1

    async def ask(self, drone: str, summary: bytes) -> int:
        """Ask a drone for the log entries missing in this summary. They come through ``receive``.

        Returns:
            The number of replies, some of which may not be delivered yet. 0 also for a drone that cannot be reached.
        """
        ended: asyncio.Future[None] = self._loop.create_future()
        replies = 0

        def take(reply: zenoh.Reply) -> None:
            nonlocal replies
            if reply.ok is None:
                self._to_loop(self._count, "log_ask_failed")
            else:
                replies += 1
                self._take(reply.ok)

        def end() -> None:
            self._to_loop(_settle, ended)

        key = drone_key(self._swarm, drone, "log")
        self._count("log_asked")
        try:
            async with asyncio.timeout(1.2 * ASK_S):  # Zenoh's own timeout comes first
                await in_thread(
                    lambda: self._session.get(
                        key,
                        Callback(take, end, indirect=False),
                        payload=summary,
                        target=zenoh.QueryTarget.ALL,
                        consolidation=zenoh.ConsolidationMode.NONE,  # all entries of one kind have the same key
                        accept_replies=zenoh.ReplyKeyExpr.ANY,
                        timeout=ASK_S,
                        congestion_control=CongestionControl.BLOCK,  # also for the replies, which are sent in a separate thread
                        priority=Priority.DATA_LOW,
                    )
                )
                await ended
        except (TimeoutError, zenoh.ZError):
            self._count("log_ask_failed")
        self.counters["log_replies"] += replies
        return replies

    async def close(self) -> None:
        """Leave the swarm, within a second whatever the peers do. Afterwards nothing is received, and publications fail."""
        self._inbox.close()
        await in_thread(self._outgoing.close)
        await close_session(self._session)
        self._alive.clear()

    def _declare(self) -> None:
        """Declare everything; the token last, so that a drone that is seen alive already listens."""
        on_sample = Callback(self._take, indirect=False)
        places = [f"*/{kind}" for kind in NEWS_KINDS] + [f"{STATION}/*/command"]
        for place in places:
            key = f"{ROOT}/{self._swarm}/{place}"
            self._declared.append(self._session.declare_subscriber(key, on_sample, allowed_origin=Locality.REMOTE))
        history = ext.HistoryConfig(detect_late_publishers=True, max_samples=CACHE_ENTRIES) if self._drone is not None else None
        for kind in ENTRY_KINDS:
            subscriber = ext.declare_advanced_subscriber(
                self._session,
                f"{ROOT}/{self._swarm}/*/{kind}",
                on_sample,
                allowed_origin=Locality.REMOTE,
                history=history,
                recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
            missed = subscriber.sample_miss_listener(Callback(self._take_miss, indirect=False))
            self._declared += [subscriber, missed]
        liveliness = self._session.liveliness()
        self._declared.append(
            liveliness.declare_subscriber(
                token_keys(self._swarm),
                Callback(self._take_token, indirect=False),
                history=True,
            )
        )
        if self._drone is None:
            return
        for kind in (*ENTRY_KINDS, *NEWS_KINDS):
            key = drone_key(self._swarm, self._drone, kind)
            self._publishers[key] = self._publisher(key)
        if self._answer is not None:
            key = drone_key(self._swarm, self._drone, "log")
            self._declared.append(self._session.declare_queryable(key, Callback(self._take_query, indirect=False)))
        self._declared.append(liveliness.declare_token(drone_key(self._swarm, self._drone, "alive")))

    def _publisher(self, key: str) -> zenoh.Publisher | ext.AdvancedPublisher:
        address = parse_key(key)
        if address.swarm != self._swarm:
            raise ProtocolError(f"key {str(key)!r} is not of the swarm {self._swarm!r}")
        if address.kind in ENTRY_KINDS:
            return ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=CongestionControl.DROP,
                priority=Priority.DATA_HIGH,
                cache=ext.CacheConfig(CACHE_ENTRIES),
                sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S),
                publisher_detection=True,
            )
        # With a separate priority, commands are not dropped in favour of frequent messages.
        priority = Priority.INTERACTIVE_HIGH if address.kind == "command" else Priority.INTERACTIVE_LOW
        return self._session.declare_publisher(key, congestion_control=CongestionControl.DROP, priority=priority)

    # Called in Zenoh's threads; they must not make Zenoh calls that leave the process.

    def _take(self, sample: zenoh.Sample) -> None:
        payload = sample.payload
        self._inbox.put(str(sample.key_expr), payload.to_bytes() if len(payload) <= MAX_PAYLOAD_BYTES else None)

    def _take_miss(self, miss: ext.Miss) -> None:
        self._to_loop(self._count, "entries_missed", miss.nb)

    def _take_token(self, sample: zenoh.Sample) -> None:
        drone, version = read_token(str(sample.key_expr))
        if drone == self._drone:
            return
        if self._members is not None and drone not in self._members:
            self._inbox.drop("unknown_drone")
        elif version != str(VERSION):
            self._to_loop(self._differ, drone, version, sample.kind == zenoh.SampleKind.PUT)
        elif sample.kind == zenoh.SampleKind.PUT:
            self._to_loop(self._appear, drone)
        else:
            self._to_loop(self._alive.discard, drone)

    def _take_query(self, query: zenoh.Query) -> None:
        self._to_loop(self._reply, query)

    def _to_loop(self, call: Callable[..., object], *arguments: object) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(call, *arguments)

    # Called in the loop's thread.

    def _appear(self, drone: str) -> None:
        if len(self._alive) < MOST_ALIVE or drone in self._alive:
            self._alive.add(drone)
        else:
            self._count("overflow")

    def _differ(self, drone: str, version: str, appears: bool) -> None:
        if not appears:
            self._differing.pop(drone, None)
        elif len(self._differing) < MOST_ALIVE:
            self._differing[drone] = version

    def _count(self, name: str, number: int = 1) -> None:
        self.counters[name] += number

    def _reply(self, query: zenoh.Query) -> None:
        """Answer a log query; failures are counted."""
        entries: list[tuple[str, bytes]] = []
        begun_s = self._loop.time()
        self._credit_s = min(ANSWER_SHARE, self._credit_s + ANSWER_SHARE * (begun_s - self._credited_s))
        self._credited_s = begun_s
        if self._answers >= MOST_ANSWERS or self._credit_s <= 0.0:
            self._count("log_answer_refused")
        elif self._answer is not None:
            try:
                entries = self._answer(query.payload.to_bytes() if query.payload is not None else b"")
                self._count("log_answered")
            except Exception:
                self._count("log_answer_failed")
            self._credit_s -= self._loop.time() - begun_s

        def send() -> None:
            with query:  # leaving the block ends it for the peer
                for key, payload in entries:
                    query.reply(key, payload)

        self._answers += 1
        in_thread(send).add_done_callback(self._replied)

    def _replied(self, sending: asyncio.Future[None]) -> None:
        self._answers -= 1
        if not sending.cancelled() and sending.exception() is not None:
            self._count("log_answer_failed")


def _check_owner(identity: Identity, drone: str | None) -> None:
    own = identity.own
    place = f"{identity.folder / CERTIFICATE_FILE}: is the certificate of {own.name} ({own.role})"
    if drone is not None and (own.name, own.role) != (drone, Role.DRONE):
        raise MeshError(f"{place}, and this drone is {drone}; run `radron-deploy pki issue {drone} --role drone`")


def _settle(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)
