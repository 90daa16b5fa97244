"""Impairments of the links between the agents of a live flight."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from radron.sim.faults.agents import Cut, Lag, LinkFault, Partition, RadioRange, Stall, Throttle
from radron.sim.faults.machines import MavlinkImpaired, MavlinkLoss
from radron.sim.faults.schedule import Schedule
from radron.sim.live.relays.linkstate import LinkState

CUT = LinkState(cut=True)


def impairments(schedule: Schedule, drones: Sequence[str], sender: str, receiver: str, away_m: float) -> Iterator[LinkState]:
    """Yield the impairments that the active faults cause for messages from ``sender`` to ``receiver``.

    ``away_m``: distance of the two drones.
    """
    for split, _ in schedule.active(Partition):
        if not any(sender in group and receiver in group for group in split.groups):
            yield CUT
    for cut, _ in schedule.active(Cut):
        if _concerns(cut, drones, sender, receiver):
            yield CUT
    for lag, _ in schedule.active(Lag):
        if _concerns(lag, drones, sender, receiver):
            yield LinkState(delay_s=lag.delay_s, jitter_s=lag.jitter_s)
    for stall, _ in schedule.active(Stall):
        if _concerns(stall, drones, sender, receiver):
            yield LinkState(frozen=True)
    for throttle, _ in schedule.active(Throttle):
        if _concerns(throttle, drones, sender, receiver):
            yield LinkState(rate_bytes_ps=throttle.rate_kilobytes_ps * 1e3)
    if away_m > min((fault.range_m for fault, _ in schedule.active(RadioRange)), default=math.inf):
        yield CUT


def vehicle_impairments(schedule: Schedule, index: int, *, to_agent: bool) -> Iterator[LinkState]:
    """Yield the impairments that the active faults cause for one direction of a drone's MAVLink link."""
    for loss, _ in schedule.active(MavlinkLoss, index):
        yield LinkState(loss=loss.probability)
    for bad, _ in schedule.active(MavlinkImpaired, index):
        if bad.direction != ("to-vehicle" if to_agent else "to-agent"):
            yield LinkState(
                cut=bad.cut,
                delay_s=bad.delay_s,
                jitter_s=bad.jitter_s,
                reorder=bad.reorder,
                held_s=bad.held_s,
                duplicate=bad.duplicate,
                within_s=bad.within_s,
                corrupt=bad.corrupt,
            )


def _concerns(fault: LinkFault, drones: Sequence[str], sender: str, receiver: str) -> bool:
    """Return whether a fault of links concerns messages from ``sender`` to ``receiver``."""
    targets = fault.strikes(drones)
    peers = drones if fault.peers is None else fault.names_of_peers()
    sends, receives = sender in targets and receiver in peers, receiver in targets and sender in peers
    return (sends and fault.direction != "receive") or (receives and fault.direction != "send")
