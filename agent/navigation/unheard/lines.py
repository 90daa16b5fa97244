"""The lines half-way between this drone and those that it does not hear, or that do not hear it: each keeps to its own side.

Where one of the two searched, or was on its way to the circle (even if it was just crossing it), when they last heard each other.
Where both were on the circle, they leave for circles of their own instead (``sharing``).
"""

from __future__ import annotations

from msgspec.structs import replace

from agent.navigation.unheard.agentless import CIRCLING
from agent.navigation.unheard.contact import Contact, Wall, wall_between
from agent.navigation.unheard.viewer import Viewer
from protocol.messages import Stage

TAKING_PART = (Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.REACQUIRE)
MAY_TAKE_PART = (*TAKING_PART, Stage.HOLD)  # one that holds goes on when the operator says so
APART_NS = 60_000_000_000  # drones that do not hear each other keep to their own sides for this long after their last contact
KEPT_M = 4.5  # least distance of a waypoint from that line


class Lines:
    """Of each, the last contact with it, and the line that follows from it."""

    def __init__(self) -> None:
        self._contacts: dict[str, Contact] = {}
        self._walls: dict[str, tuple[int, Wall]] = {}  # with the stamp of the last contact

    def shift(self, by_ns: int) -> None:
        """Move all stamps: the own clock was set."""
        self._contacts = {name: replace(one, stamp_ns=one.stamp_ns + by_ns) for name, one in self._contacts.items()}
        self._walls = {name: (stamp_ns + by_ns, wall) for name, (stamp_ns, wall) in self._walls.items()}

    def forget(self, name: str) -> None:
        """Forget the last contact with a drone, and the line: it is in contact again, or on the ground."""
        self._contacts.pop(name, None)
        self.drop(name)

    def drop(self, name: str) -> None:
        """Forget the line to a drone; the last contact stays."""
        self._walls.pop(name, None)

    def recall(self, name: str, heard_ns: int, wall: Wall) -> None:
        """Take the line of before a restart of this agent; ``heard_ns``: stamp of the last contact."""
        self._walls[name] = heard_ns, wall

    def wall(self, name: str) -> Wall | None:
        """The line that follows from the last contact, kept to at present or not any more."""
        return self._walls[name][1] if name in self._walls else None

    def contact(self, name: str) -> Contact | None:
        """The last one."""
        return self._contacts.get(name)

    def noted(self, name: str, contact: Contact) -> Contact:
        """The last contact: this one, unless one is known already."""
        return self._contacts.setdefault(name, contact)

    def at(self, now_ns: int) -> dict[str, Wall]:
        """Those that are kept to at present, by id."""
        return {name: wall for name, (stamp_ns, wall) in sorted(self._walls.items()) if 0 <= now_ns - stamp_ns < APART_NS}

    def of(self, name: str, contact: Contact, me: Viewer) -> Wall | None:
        """The line between the two of them; None where both were on the circle when they last heard of each other, or where the
        other one did not take part then, or this one has begun to do so since: then one of them keeps to no line.
        """
        known = self._walls.get(name)
        if known is not None and known[0] == contact.stamp_ns:
            return known[1]
        mine, stage = me.motion_at(contact.stamp_ns), contact.stage
        if mine is None or stage not in TAKING_PART or (stage in CIRCLING and contact.circled):
            return None
        wall = wall_between(mine, contact.theirs)
        self._walls[name] = contact.stamp_ns, wall
        return wall
