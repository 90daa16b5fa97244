"""Whose coordinates are these: the transforms from the drones' local frames into the mission frame, by drone, epoch and time."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

from agent.config import MissionConfig
from agent.frames.transform import Transform

LAUNCH_EPOCH = 0  # the epoch in which a drone's localisation starts

Known = tuple[int, Transform | None]  # from this stamp on; None: lost


@dataclass(slots=True)
class _Line:
    """One epoch of one drone: transforms by the stamps from which they hold; from where on which revisions changed them."""

    stamps_ns: list[int] = field(default_factory=list)
    transforms: list[Transform | None] = field(default_factory=list)
    changes: list[tuple[int, int]] = field(default_factory=list)  # (revision, stamp), both ascending


class FrameGraph:
    """``mission_from_local`` of every drone and epoch that is known, piecewise constant in time.

    ``revision`` grows with every change, so that whoever has used a transform can notice cheaply that one is new.
    """

    def __init__(self) -> None:
        self._lines: dict[tuple[str, int], _Line] = {}
        self.revision = 0

    @classmethod
    def from_launch_layout(cls, mission: MissionConfig) -> FrameGraph:
        """The layout of the mission file: where the first epoch of each drone lies whose frame is known exactly."""
        graph = cls()
        for drone in mission.drones:
            if drone.is_exact:
                graph.place(drone.id, LAUNCH_EPOCH, Transform(math.radians(drone.yaw_deg), drone.origin_m))
        return graph

    def place(self, drone: str, epoch: int, mission_from_local: Transform) -> None:
        """Make a frame known for all times; a newer transform replaces the older ones, they are never averaged."""
        self.replace_from(drone, epoch, 0, [(0, mission_from_local)])

    def replace_from(self, drone: str, epoch: int, stamp_ns: int, known: Sequence[Known]) -> None:
        """Let that epoch's frame from ``stamp_ns`` on be what is given, in the order of time. What is the same as before is no
        change."""
        line = self._lines.setdefault((drone, epoch), _Line())
        first = bisect_left(line.stamps_ns, stamp_ns)
        same = 0
        for (stamp, transform), held_ns, held in zip(known, line.stamps_ns[first:], line.transforms[first:], strict=False):
            if stamp != held_ns or not _same(transform, held):
                break
            same += 1
        first += same
        rest = known[same:]
        if not rest and first == len(line.stamps_ns):
            return
        # Before the first stamp known the first transform holds: it changes back to the beginning.
        stamps = [*line.stamps_ns[first : first + 1], *(stamp for stamp, _ in rest[:1])]
        changed_ns = min(stamps) if first else 0
        line.stamps_ns[first:] = [stamp for stamp, _ in rest]
        line.transforms[first:] = [transform for _, transform in rest]
        self.revision += 1
        while line.changes and line.changes[-1][1] >= changed_ns:
            line.changes.pop()
        line.changes.append((self.revision, changed_ns))

    def mission_from_local(self, drone: str, epoch: int, stamp_ns: int | None = None) -> Transform | None:
        """Transform of a local frame in that epoch at ``stamp_ns`` (none: now), or None while nobody knows it.

        What is known first holds for all times before, too: so observations that waited for it can be placed.
        """
        line = self._lines.get((drone, epoch))
        if line is None or not line.transforms:
            return None
        if stamp_ns is None:
            return line.transforms[-1]
        return line.transforms[max(bisect_right(line.stamps_ns, stamp_ns) - 1, 0)]

    def changes(self, revision: int) -> dict[tuple[str, int], int]:
        """By drone and epoch: from which stamp on its transform is another one than at that revision."""
        found = {}
        for key, line in self._lines.items():
            newer = line.changes[bisect_right(line.changes, revision, key=lambda change: change[0]) :]
            if newer:
                found[key] = newer[0][1]
        return found


def _same(a: Transform | None, b: Transform | None) -> bool:
    if a is b:
        return True
    if a is None or b is None or (a.yaw_rad, a.translation) != (b.yaw_rad, b.translation):
        return False
    if a.covariance is None or b.covariance is None:
        return a.covariance is b.covariance
    return a.covariance.tobytes() == b.covariance.tobytes()
