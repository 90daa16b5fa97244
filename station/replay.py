"""Replay of flight records on the web pages, as a live flight would be shown, by the times in the records."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from heapq import merge
from pathlib import Path
from time import monotonic
from typing import NamedTuple

from radron.agent.errors import FlightRecordError
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.topics import MESSAGE, PUBLICATION, decode_message
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Authority
from radron.protocol.signing import Verifier
from radron.station.hub import Hub
from radron.station.picture.history import FRAME_MS

ALIVE_NS = 2_000_000_000  # a drone heard within this time counts as alive: records hold no liveliness tokens
KNOWN_NS = 30_000_000_000
REPLACED = ("pose", "plan", "frame", "estimate")  # frequent kinds: only the newest message counts
SLICE_S = 0.02  # of work, before pages are served
_TELL_S = 0.5


class Heard(NamedTuple):
    """A message in a flight record. ``at_ns``: its time by the clock of the recording drone."""

    at_ns: int
    key: str
    payload: bytes


class Records:
    """Flight records of one mission, by one or more of its drones.

    ``mission``: the mission of all records. ``verifier``: checks the signatures of the log; None in a swarm without certificates.
    ``judges_exposures``: whether overlapping exposures are ignored (see ``FlightHeader``).
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        """Open the records.

        Raises:
            FlightRecordError: not a recorded flight, or not all of one mission.
        """
        self._flights = [RecordedFlight(path, whole=False) for path in paths]
        first = self._flights[0].header
        for path, flight in zip(paths, self._flights, strict=True):
            if flight.header.mission.mission_id != first.mission.mission_id:
                raise FlightRecordError(f"{path}: a flight of another mission than {paths[0]}: open them one by one")
        self.mission, self.judges_exposures = first.mission, first.judges_exposures
        try:
            authority = Authority.read(first.authority.encode()) if first.authority else None
        except ProtocolError as error:
            raise FlightRecordError(f"{paths[0]}: the certificate of the authority in the record {error}") from None
        self.verifier = Verifier(authority) if authority is not None else None

    @property
    def share(self) -> float:
        """Share of the records that has been read so far, from 0 to 1."""
        size = sum(flight.size_bytes for flight in self._flights)
        return sum(flight.read_bytes for flight in self._flights) / size if size else 1.0

    @property
    def files(self) -> tuple[Path, ...]:
        """All files of these records."""
        return tuple(file for flight in self._flights for file in flight.files)

    @property
    def flaws(self) -> tuple[str, ...]:
        """Missing parts of the records, by file; known after reading."""
        return tuple(flaw for flight in self._flights for flaw in flight.incomplete)

    def messages(self) -> Iterator[Heard]:
        """Yield all messages that the drones received or sent, in the order of their times; a repeated message comes once."""
        once = _Once()
        return merge(*(_messages(flight, once) for flight in self._flights), key=lambda heard: heard.at_ns)


class _Once:
    """Filter of messages repeated within ``KNOWN_NS``: after that time, the log itself recognises its entries."""

    def __init__(self) -> None:
        self._known: set[bytes] = set()
        self._older: set[bytes] = set()
        self._turn_ns = 0

    def is_new(self, data: bytes, at_ns: int) -> bool:
        """Return whether a message is new, and remember it."""
        if data in self._known or data in self._older:
            return False
        if at_ns > self._turn_ns:
            self._known, self._older, self._turn_ns = set(), self._known, at_ns + KNOWN_NS
        self._known.add(data)
        return True


async def play(hub: Hub, records: Records, every_ms: int = FRAME_MS) -> None:
    """Read flight records into the history of the web pages, which are served meanwhile.

    ``every_ms``: interval of the shown states of the swarm.
    """
    began_s = told_s = monotonic()
    picture, shown_ns, now_ns = hub.picture, 0, 0
    last_ns: dict[str, int] = {}
    newest: dict[str, Heard] = {}  # of the replaced kinds: only messages for the next frame are decoded
    for heard in records.messages():
        now_ns = heard.at_ns
        if not shown_ns:
            shown_ns = now_ns
        while now_ns - shown_ns >= every_ms * 1_000_000:
            shown_ns += every_ms * 1_000_000
            picture.appear([name for name, at_ns in last_ns.items() if shown_ns - at_ns < ALIVE_NS])
            for one in newest.values():
                picture.receive(one.key, one.payload, one.at_ns)
            newest.clear()
            _settle(hub, shown_ns)
            hub.show(shown_ns)
        _, _, _, sender, kind, *_ = heard.key.split("/")
        if kind in REPLACED:
            newest[heard.key] = heard
        else:
            picture.receive(heard.key, heard.payload, now_ns)
        last_ns[sender] = now_ns
        if monotonic() - began_s > SLICE_S:
            if monotonic() - told_s > _TELL_S:
                told_s = monotonic()
                hub.report(records.share)
            await asyncio.sleep(0.0)
            began_s = monotonic()
    for one in newest.values():
        picture.receive(one.key, one.payload, one.at_ns)
    hub.report(1.0)


def _settle(hub: Hub, now_ns: int) -> None:
    """Complete the estimate for a time."""
    hub.picture.advance(now_ns)
    while hub.picture.log.pending:
        hub.picture.advance(now_ns)


def _messages(flight: RecordedFlight, once: _Once) -> Iterator[Heard]:
    latest_ns = 0
    for record in flight.records((MESSAGE, PUBLICATION)):
        latest_ns = max(latest_ns, record.log_ns)
        if once.is_new(record.data, latest_ns):
            yield Heard(latest_ns, *decode_message(record.data))
