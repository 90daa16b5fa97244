"""Separation lines half-way between this drone and each peer with a lost or one-way link; each drone keeps to its own side.

A line applies if one of the two drones, at the last contact, searched or was on its way to the circle or across it. Two drones on
the circle change to circles of own radius instead (``sharing``). Two tracking drones, not both on the circle yet, do both. Then
the line lasts until each has had the time to get to the circle of its network component.
"""

from __future__ import annotations

from typing import NamedTuple

from radron.agent.config.mission import MissionConfig
from radron.agent.motion.orbit import ring_change_s
from radron.agent.navigation.unheard.contact import SILENT_NS, Contact, Wall, wall_between
from radron.agent.navigation.unheard.viewer import Viewer
from radron.protocol.stages import TAKING_PART

APART_NS = 60_000_000_000  # validity of a separation line after the last contact
KEPT_M = 4.5  # least distance of a waypoint from the line


class Line(NamedTuple):
    """Separation line, the stamp of the last contact, and the validity after it."""

    wall: Wall
    stamp_ns: int
    for_ns: int

    def holds(self, now_ns: int) -> bool:
        """Whether the line is valid at present."""
        return now_ns - self.stamp_ns < self.for_ns


def tracked_line_ns(mission: MissionConfig) -> int:
    """Return the validity of a line between two tracking drones: until each has had the time to get to its own circle."""
    return min(APART_NS, SILENT_NS + round(ring_change_s(mission) * 1e9))


def line_of(known: Line | None, contact: Contact, tracked_ns: int, me: Viewer) -> Line | None:
    """Return the separation line to a peer, valid or expired; ``known``: the one before.

    None without a line: both were on the circle at the last contact, or one of them did not take part then (this drone may have
    begun since). Between two drones in tracking, while this one still tracks, it ends as soon as both can be on their own circles
    (``tracked_ns``).
    """
    for_ns = tracked_ns if contact.tracked and me.circle is not None else APART_NS
    if known is not None and known.stamp_ns == contact.stamp_ns:
        return known._replace(for_ns=for_ns)
    mine = me.motion_at(contact.stamp_ns)
    is_new = 0 <= me.now_ns - contact.stamp_ns < for_ns
    if mine is None or not is_new or contact.stage not in TAKING_PART or contact.circled:
        return None
    return Line(wall_between(mine, contact.theirs), contact.stamp_ns, for_ns)
