"""Separation lines: borders half-way between this drone and each drone with a lost or one-way link; each keeps to its own side.

There is a line if both drones took part at the last contact, and were not both on the circle around the source. Two drones on the
circle change to circles of different radius instead (``sharing``). Two tracking drones that were not both on the circle yet do
both: the line ends when each has had the time to get to the circle of its network component.
"""

from __future__ import annotations

from typing import NamedTuple

from radron.agent.config.mission import MissionConfig
from radron.agent.motion.orbit import ring_change_s
from radron.agent.navigation.unheard.contact import SILENT_NS, Contact, Wall, wall_between
from radron.agent.navigation.unheard.viewer import Viewer
from radron.protocol.stages import TAKING_PART

APART_NS = 60_000_000_000  # validity of a separation line after the last contact
KEPT_M = 4.5  # least distance of a search waypoint from the line


class Line(NamedTuple):
    """Separation line ``wall``, the stamp of the last contact, and the time for which the line is valid from then on."""

    wall: Wall
    stamp_ns: int
    for_ns: int

    def holds(self, now_ns: int) -> bool:
        """Whether the line is valid at present."""
        return now_ns - self.stamp_ns < self.for_ns


def tracked_line_ns(mission: MissionConfig) -> int:
    """Return the time (ns) for which a line between two tracking drones is valid after their last contact. Each needs it to
    notice the loss, and to get to its own circle.
    """
    return min(APART_NS, SILENT_NS + round(ring_change_s(mission) * 1e9))


def line_of(known: Line | None, contact: Contact, tracked_ns: int, me: Viewer) -> Line | None:
    """Return the separation line to a peer, valid or expired. None if both were on the circle at the last contact, or one of them
    did not take part then.

    ``known``: the line so far, None without one; ``tracked_ns``: validity of a line between two tracking drones
    (``tracked_line_ns``); it applies while this drone still tracks. ``me``: state of this drone.
    """
    for_ns = tracked_ns if contact.tracked and me.circle is not None else APART_NS
    if known is not None and known.stamp_ns == contact.stamp_ns:
        return known._replace(for_ns=for_ns)
    mine = me.motion_at(contact.stamp_ns)
    is_new = 0 <= me.now_ns - contact.stamp_ns < for_ns
    if mine is None or not is_new or contact.stage not in TAKING_PART or contact.circled:
        return None
    return Line(wall_between(mine, contact.theirs), contact.stamp_ns, for_ns)
