"""Cost of late log entries for the source estimate: an agent's log processed as it arrived, and without delays of entries.

Both estimates belong to one flight, so that only the delays differ: two flights with equal seeds differ by half of their errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.live_flight import messages
from radron.agent.config.mission import MissionConfig
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.agent.fusion.registry import estimator_named
from radron.agent.mission.worldmodel import WorldModel
from radron.protocol.codec import decode_from
from radron.protocol.entries import Entry
from radron.protocol.messages import DRONE_KINDS, Stage, Status

_EVERY_NS = 100_000_000
_ON_ITS_WAY_NS = 100_000_000  # entries sent within this time before an agent's last one may be on their way
_ENTRIES = {name for name, kind in DRONE_KINDS.items() if issubclass(kind, Entry)}


class _Arrival(NamedTuple):
    """An entry at an agent, by its clock."""

    at_ns: int
    payload: bytes
    entry: Entry


class Lateness(NamedTuple):
    """delays_s: of all entries at all other agents (median, 99 %, largest). missing: entries that an agent never had, without
    entries on their way at the end. moved_m: distances by which the delays moved the hypotheses while all tracked (median,
    largest). None: no data, as after an early end or without tracking.
    """

    delays_s: tuple[float, float, float] | None
    missing: int
    moved_m: tuple[float, float] | None


def lateness(found: dict[str, RecordedFlight]) -> Lateness:
    """Of one flight, from the records of its agents, by drone."""
    own = {drone: dict(_entries(flight, topics.PUBLICATION)) for drone, flight in found.items()}
    heard = {drone: dict(_entries(flight, topics.MESSAGE)) | own[drone] for drone, flight in found.items()}
    sent = {payload: arrival for entries in own.values() for payload, arrival in entries.items()}
    delays_s = [
        1e-9 * (arrivals[payload].at_ns - arrival.at_ns)
        for drone, arrivals in heard.items()
        for payload, arrival in sent.items()
        if payload in arrivals and payload not in own[drone]
    ]
    return Lateness(
        (float(np.median(delays_s)), float(np.quantile(delays_s, 0.99)), max(delays_s)) if delays_s else None,
        sum(_missing(sent, arrivals) for arrivals in heard.values()),
        _moved_m(found, list(sent.values()), [list(arrivals.values()) for arrivals in heard.values()]),
    )


def _missing(sent: dict[bytes, _Arrival], arrivals: dict[bytes, _Arrival]) -> int:
    """How many of the entries sent an agent lacks."""
    until_ns = max((arrival.at_ns for arrival in arrivals.values()), default=0) - _ON_ITS_WAY_NS
    return sum(payload not in arrivals and arrival.at_ns < until_ns for payload, arrival in sent.items())


def _moved_m(found: dict[str, RecordedFlight], sent: list[_Arrival], heard: list[list[_Arrival]]) -> tuple[float, float] | None:
    """Distance (median, largest) between the hypotheses by received and by sent entries of each agent; None: never both."""
    swarm = next(iter(found.values())).header.mission
    statuses = [status for flight in found.values() for status in _statuses(flight)]
    started_ns = max((status.started_ns or 0 for _, status in statuses), default=0)
    tracking = [[at_ns for at_ns, told in _statuses(one) if told.stage is Stage.TRACK] for one in found.values()]
    if not all(tracking):
        return None
    during = range(started_ns, min(times[-1] for times in tracking), _EVERY_NS)
    skipped = sum(now_ns < max(times[0] for times in tracking) for now_ns in during)
    at_once = _hypotheses(swarm, started_ns, sent, during)[skipped:]
    moved_m = np.array(
        [np.linalg.norm(_hypotheses(swarm, started_ns, arrivals, during)[skipped:] - at_once, axis=1) for arrivals in heard]
    )
    return None if np.isnan(moved_m).all() else (float(np.nanmedian(moved_m)), float(np.nanmax(moved_m)))


def _entries(flight: RecordedFlight, topic: str) -> Iterator[tuple[bytes, _Arrival]]:
    """The entries that an agent heard or published, by their bytes; the first arrival of each comes last."""
    found = []
    for record, sender, kind, payload in messages(flight, topic):
        if kind in _ENTRIES:
            entry = decode_from(f"radron/2/{flight.header.mission.swarm}/{sender}/{kind}", payload)
            if isinstance(entry, Entry):
                found.append((payload, _Arrival(record.log_ns, payload, entry)))
    return reversed(found)


def _statuses(flight: RecordedFlight) -> Iterator[tuple[int, Status]]:
    for record, sender, kind, payload in messages(flight, topics.PUBLICATION):
        if kind == "status":
            status = decode_from(f"radron/2/{flight.header.mission.swarm}/{sender}/{kind}", payload)
            if isinstance(status, Status):
                yield record.log_ns, status


def _hypotheses(mission: MissionConfig, started_ns: int, arrivals: list[_Arrival], during: range) -> NDArray[np.float64]:
    """(N, 2) place of the hypothesis at these times, NaN where there is none."""
    world, due = WorldModel(mission, (), estimator_named), sorted(arrivals, key=lambda one: one.at_ns, reverse=True)
    world.start(started_ns)
    places = np.full((len(during), 2), np.nan)
    for place, now_ns in zip(places, during, strict=True):
        while due and due[-1].at_ns <= now_ns:
            arrival = due.pop()
            world.take(arrival.entry, arrival.payload, now_ns)
        world.advance(now_ns)
        while world.pending:
            world.advance(now_ns)
        if world.fusion.hypothesis is not None:
            place[:] = world.fusion.hypothesis.position[:2]
    return places
