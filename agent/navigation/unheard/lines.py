"""The lines half-way between this drone and those that it does not hear, or that do not hear it: each keeps to its own side.

Where one of the two searched, or was on its way to the circle (even if it was just crossing it), when they last heard each other.
Where both were on the circle, they leave for circles of their own instead (``sharing``). Where both tracked, but were not both on
it yet, they do both: the line lasts until each has had the time to get to the circle of its side.
"""

from __future__ import annotations

from typing import NamedTuple

from msgspec.structs import replace

from agent.config.mission import MissionConfig
from agent.motion.orbit import ring_change_s
from agent.navigation.unheard.contact import SILENT_NS, Contact, Wall, wall_between
from agent.navigation.unheard.viewer import Viewer
from protocol.stages import TAKING_PART

APART_NS = 60_000_000_000  # drones that do not hear each other keep to their own sides for this long after their last contact
KEPT_M = 4.5  # least distance of a waypoint from that line


class _Line(NamedTuple):
    """A line, the stamp of the last contact, and for how long after that it is kept to."""

    wall: Wall
    stamp_ns: int
    for_ns: int

    def holds(self, now_ns: int) -> bool:
        """Whether it is kept to at present."""
        return 0 <= now_ns - self.stamp_ns < self.for_ns


class Lines:
    """Of each, the last contact with it, and the line that follows from it."""

    def __init__(self, mission: MissionConfig) -> None:
        self._tracked_ns = min(APART_NS, SILENT_NS + round(ring_change_s(mission) * 1e9))
        self._contacts: dict[str, Contact] = {}
        self._lines: dict[str, _Line] = {}

    def shift(self, by_ns: int) -> None:
        """Move all stamps: the own clock was set."""
        self._contacts = {name: replace(one, stamp_ns=one.stamp_ns + by_ns) for name, one in self._contacts.items()}
        self._lines = {name: line._replace(stamp_ns=line.stamp_ns + by_ns) for name, line in self._lines.items()}

    def forget(self, name: str) -> None:
        """Forget the last contact with a drone, and the line: it is in contact again, or on the ground."""
        self._contacts.pop(name, None)
        self.drop(name)

    def drop(self, name: str) -> None:
        """Forget the line to a drone; the last contact stays."""
        self._lines.pop(name, None)

    def recall(self, name: str, heard_ns: int, wall: Wall) -> None:
        """Take the line of before a restart of this agent; ``heard_ns``: stamp of the last contact."""
        self._lines[name] = _Line(wall, heard_ns, APART_NS)

    def wall(self, name: str) -> Wall | None:
        """The line that follows from the last contact, kept to at present or not any more."""
        return self._lines[name].wall if name in self._lines else None

    def contact(self, name: str) -> Contact | None:
        """The last one."""
        return self._contacts.get(name)

    def noted(self, name: str, contact: Contact) -> Contact:
        """The last contact: this one, unless one is known already."""
        return self._contacts.setdefault(name, contact)

    def at(self, now_ns: int) -> dict[str, Wall]:
        """Those that are kept to at present, by id."""
        return {name: line.wall for name, line in sorted(self._lines.items()) if line.holds(now_ns)}

    def of(self, name: str, contact: Contact, me: Viewer) -> Wall | None:
        """The line between the two of them that is kept to now. None where both were on the circle when they last heard of each
        other, or where the other one did not take part then, or this one has begun to do so since: then one of them keeps to no
        line. None, too, once it has ended: of two that tracked, and while this one does, when both can be on their own circles.
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
