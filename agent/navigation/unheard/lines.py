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


class _Line(NamedTuple):
    """Separation line, the stamp of the last contact, and the validity after it."""

    wall: Wall
    stamp_ns: int
    for_ns: int

    def holds(self, now_ns: int) -> bool:
        """Whether the line is valid at present."""
        return 0 <= now_ns - self.stamp_ns < self.for_ns


class Lines:
    """The last contact with each peer, and the separation line that follows from it."""

    def __init__(self, mission: MissionConfig) -> None:
        self._tracked_ns = min(APART_NS, SILENT_NS + round(ring_change_s(mission) * 1e9))
        self._contacts: dict[str, Contact] = {}
        self._lines: dict[str, _Line] = {}

    def forget(self, name: str) -> None:
        """Forget the last contact with a drone, and the line: it has a two-way link again, or is on the ground."""
        self._contacts.pop(name, None)
        self.drop(name)

    def drop(self, name: str) -> None:
        """Forget the line to a drone; the last contact stays."""
        self._lines.pop(name, None)

    def recall(self, name: str, heard_ns: int, wall: Wall) -> None:
        """Restore the line from before a restart of this agent; ``heard_ns``: stamp of the last contact."""
        self._lines[name] = _Line(wall, heard_ns, APART_NS)

    def wall(self, name: str) -> Wall | None:
        """The line that follows from the last contact, valid at present or expired."""
        return self._lines[name].wall if name in self._lines else None

    def contact(self, name: str) -> Contact | None:
        """The last contact."""
        return self._contacts.get(name)

    def noted(self, name: str, contact: Contact) -> Contact:
        """Return the last known contact; this one, if none is known yet."""
        return self._contacts.setdefault(name, contact)

    def at(self, now_ns: int) -> dict[str, Wall]:
        """Return the lines that are valid at present, by id."""
        return {name: line.wall for name, line in sorted(self._lines.items()) if line.holds(now_ns)}

    def of(self, name: str, contact: Contact, me: Viewer) -> Wall | None:
        """Return the separation line to a peer if it is valid now. None without a line: both were on the circle at the last
        contact, or one of them did not take part then (this drone may have begun since). None, too, after its end. Between two
        drones in tracking, while this one still tracks, it ends as soon as both can be on their own circles.
        """
        for_ns = self._tracked_ns if contact.tracked and me.circle is not None else APART_NS
        known = self._lines.get(name)
        if known is not None and known.stamp_ns == contact.stamp_ns:
            line = known._replace(for_ns=for_ns)
        else:
            mine = me.motion_at(contact.stamp_ns)
            is_new = 0 <= me.now_ns - contact.stamp_ns < for_ns
            if mine is None or not is_new or contact.stage not in TAKING_PART or contact.circled:
                return None
            line = _Line(wall_between(mine, contact.theirs), contact.stamp_ns, for_ns)
        self._lines[name] = line
        return line.wall if line.holds(me.now_ns) else None
