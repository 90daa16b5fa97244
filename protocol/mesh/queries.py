"""Queries to peers, and the content of a mission, which drones query part by part from an operator's station."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from hashlib import blake2b

import zenoh
from zenoh import CongestionControl, Priority
from zenoh.handlers import Callback

from radron.protocol.errors import ProtocolError
from radron.protocol.mesh.link import in_thread
from radron.protocol.mesh.rights import LOG_QUERIES_PER_S
from radron.protocol.messages import MAX_PARTS, PART_BYTES

PART_S = 5.0  # for one part, over a slow radio
QUERY_ATTEMPTS = 3
MAX_OPEN_ANSWERS = 8  # parts sent at the same time
ASKED_S = 2.0 / LOG_QUERIES_PER_S  # between two queries of one drone's log: it drops earlier queries


class Pace:
    """Limits how often each drone's log is queried, since a drone drops queries beyond a certain rate."""

    def __init__(self) -> None:
        self._next_s: dict[str, float] = {}

    async def turn(self, drone: str) -> None:
        """Wait until the next query of this drone's log is allowed."""
        now_s = asyncio.get_running_loop().time()
        at_s = max(now_s, self._next_s.get(drone, now_s))
        self._next_s[drone] = at_s + ASKED_S
        await asyncio.sleep(at_s - now_s)


async def query(
    session: zenoh.Session,
    key: str,
    payload: bytes,
    within_s: float,
    take: Callable[[zenoh.Sample], object],
    failed: Callable[[], object],
) -> None:
    """Send a query to all peers that answer for a key, and wait until all answers have arrived.

    Args:
        session: of the mesh.
        key: the key for which the peers have declared that they answer.
        payload: payload of the query.
        within_s: bound of Zenoh's wait, in seconds; ours is a fifth longer.
        take: called with each answer, in Zenoh's threads.
        failed: called for each error in place of an answer, in Zenoh's threads, too.

    Raises:
        TimeoutError, zenoh.ZError: no answer, or not in time.
    """
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[None] = loop.create_future()

    def reply(one: zenoh.Reply) -> None:
        if one.ok is None:
            failed()
        else:
            take(one.ok)

    def end() -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            loop.call_soon_threadsafe(_settle, ended)

    async with asyncio.timeout(1.2 * within_s):  # Zenoh's own timeout comes first
        await in_thread(
            lambda: session.get(
                key,
                Callback(reply, end, indirect=False),
                payload=payload,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,  # all entries of one kind have the same key
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                timeout=within_s,
                congestion_control=CongestionControl.BLOCK,  # also for the replies, which are sent in a separate thread
                priority=Priority.DATA_LOW,
            )
        )
        await ended


def split(content: bytes) -> tuple[bytes, ...]:
    """Split the content of a mission into parts that fit into one message each, for an upload to the drones.

    Raises:
        ProtocolError: the content has more than ``MAX_PARTS`` parts.
    """
    parts = tuple(content[start : start + PART_BYTES] for start in range(0, len(content), PART_BYTES))
    if len(parts) > MAX_PARTS:
        most_mb = MAX_PARTS * PART_BYTES / 1e6
        raise ProtocolError(f"{len(content) / 1e6:.1f} MB are too much to be uploaded: at most {most_mb:.1f} MB")
    return parts


def hash_of(part: bytes) -> bytes:
    """Return the BLAKE2b-256 hash that identifies one part of an uploaded mission."""
    return blake2b(part, digest_size=32).digest()


async def fetch(session: zenoh.Session, key: str, hashes: Sequence[bytes]) -> bytes | None:
    """Fetch an uploaded mission part by part from the peers that answer for a key; None if a part cannot be obtained.

    ``hashes``: the expected BLAKE2b-256 hash of each part, in order.
    """
    parts = []
    for place, expected in enumerate(hashes):
        part = await _fetched(session, key, place, expected)
        if part is None:
            return None
        parts.append(part)
    return b"".join(parts)


async def _fetched(session: zenoh.Session, key: str, place: int, expected: bytes) -> bytes | None:
    found: list[bytes] = []

    def take(sample: zenoh.Sample) -> None:
        if not found and len(sample.payload) <= PART_BYTES and hash_of(part := sample.payload.to_bytes()) == expected:
            found.append(part)

    for _ in range(QUERY_ATTEMPTS):
        with contextlib.suppress(TimeoutError, zenoh.ZError):
            await query(session, key, str(place).encode(), PART_S, take, lambda: None)
        if found:
            return found[0]
    return None


class Serving:
    """Answers the drones' queries for the parts of one uploaded mission, until closed.

    Create and call it in the event loop's thread.
    """

    def __init__(self, session: zenoh.Session, key: str, parts: Sequence[bytes]) -> None:
        self._loop = asyncio.get_running_loop()
        self._session, self._key, self._parts = session, key, parts
        self._answers = 0
        self._queryable: zenoh.Queryable[None] | None = None

    async def open(self) -> None:
        """Start answering queries. Raises zenoh.ZError."""
        self._queryable = await in_thread(
            lambda: self._session.declare_queryable(self._key, Callback(self._take, indirect=False))
        )

    async def close(self) -> None:
        """Stop answering queries. Raises zenoh.ZError."""
        if self._queryable is not None:
            await in_thread(self._queryable.undeclare)

    def _take(self, asked: zenoh.Query) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._reply, asked)

    def _reply(self, asked: zenoh.Query) -> None:
        place = asked.payload.to_bytes() if asked.payload is not None and len(asked.payload) <= 4 else b""
        wanted = int(place) if place.isdigit() else len(self._parts)
        part = self._parts[wanted] if wanted < len(self._parts) and self._answers < MAX_OPEN_ANSWERS else None

        def send() -> None:
            with asked:  # leaving the block ends the query for the peer
                if part is not None:
                    asked.reply(self._key, part)

        self._answers += 1
        in_thread(send).add_done_callback(self._replied)

    def _replied(self, sending: asyncio.Future[None]) -> None:
        self._answers -= 1
        if not sending.cancelled():
            sending.exception()  # the link to the peer was lost; the peer repeats its query


def _settle(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)
