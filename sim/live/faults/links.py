"""Impaired links between the agents of a live flight."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from sim.faults.agents import Cut, Lag, Partition, RadioRange
from sim.faults.schedule import Schedule
from sim.live.relays.linkstate import LinkState

CUT = LinkState(cut=True)


def impairments(schedule: Schedule, drones: Sequence[str], sender: str, receiver: str, away_m: float) -> Iterator[LinkState]:
    """What the active faults do to what ``sender`` sends to ``receiver``, which is ``away_m`` away."""
    for split, _ in schedule.active(Partition):
        if not any(sender in group and receiver in group for group in split.groups):
            yield CUT
    for cut, _ in schedule.active(Cut):
        if _concerns(cut, drones, sender, receiver):
            yield CUT
    for lag, _ in schedule.active(Lag):
        if _concerns(lag, drones, sender, receiver):
            yield LinkState(delay_s=lag.delay_s, jitter_s=lag.jitter_s)
    if away_m > min((fault.range_m for fault, _ in schedule.active(RadioRange)), default=math.inf):
        yield CUT


def _concerns(fault: Cut | Lag, drones: Sequence[str], sender: str, receiver: str) -> bool:
    """Whether a fault of links concerns what ``sender`` sends to ``receiver``."""
    targets = fault.strikes(drones)
    peers = drones if fault.peers is None else fault.names_of_peers()
    sends, receives = sender in targets and receiver in peers, receiver in targets and sender in peers
    return (sends and fault.direction != "receive") or (receives and fault.direction != "send")
