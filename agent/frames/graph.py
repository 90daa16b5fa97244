"""Transforms from the drones' local frames into the mission frame, by drone, epoch and time."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.transform import Transform, same
from radron.agent.geometry import Vector3

LAUNCH_EPOCH = 0  # the epoch in which a drone's localisation starts

_LATER_NS = 10_000_000_000  # by then near peers have been seen
_DRIFT_MPS = 0.2  # of a local frame after the launch, at most

Known = tuple[int, Transform | None]  # first stamp of validity, transform; None: lost


@dataclass(slots=True)
class _Line:
    """An epoch of a drone: transforms by their first stamps, and the first stamp changed by each revision."""

    stamps_ns: list[int] = field(default_factory=list)
    transforms: list[Transform | None] = field(default_factory=list)
    changes: list[tuple[int, int]] = field(default_factory=list)  # (revision, stamp), both ascending


class FrameGraph:
    """Stores the transform from each drone's local frame into the mission frame, over time and for each epoch.

    An epoch is a period without a jump of the drone's localisation. The transforms are piecewise constant in time. ``revision``
    grows with every change, so that users of a transform can check cheaply whether it is still current.
    """

    def __init__(self) -> None:
        self._lines: dict[tuple[str, int], _Line] = {}
        self._surest: dict[
            tuple[str, int, int], tuple[int, tuple[Transform, float] | None]
        ] = {}  # with the revision by which it was found
        self.revision = 0

    @classmethod
    def from_launch_layout(cls, mission: MissionConfig) -> FrameGraph:
        """Return a store with the frames that the mission file gives exactly: the first epoch (period without a jump of the
        localisation) of each drone with exact localisation.
        """
        graph = cls()
        for drone in mission.drones:
            if drone.is_exact:
                graph.place(drone.id, LAUNCH_EPOCH, Transform(math.radians(drone.yaw_deg), drone.origin_m))
        return graph

    def place(self, drone: str, epoch: int, mission_from_local: Transform) -> None:
        """Set the transform of one drone's local frame for all times of an epoch.

        A newer transform replaces the older one; they are not averaged.
        """
        self.replace_from(drone, epoch, 0, [(0, mission_from_local)])

    def replace_from(self, drone: str, epoch: int, stamp_ns: int, known: Sequence[Known]) -> None:
        """Replace the transforms of one drone's local frame in one epoch from ``stamp_ns`` on.

        known: pairs of the time from which a transform holds and the transform (None: the frame is lost), in order of time. Equal
        values count as no change.
        """
        line = self._lines.setdefault((drone, epoch), _Line())
        first = bisect_left(line.stamps_ns, stamp_ns)
        kept = 0
        for (stamp, transform), held_ns, held in zip(known, line.stamps_ns[first:], line.transforms[first:], strict=False):
            if stamp != held_ns or not same(transform, held):
                break
            kept += 1
        first += kept
        rest = known[kept:]
        if not rest and first == len(line.stamps_ns):
            return
        # Before the first known stamp the first transform holds, so the change reaches back to the beginning.
        stamps = [*line.stamps_ns[first : first + 1], *(stamp for stamp, _ in rest[:1])]
        changed_ns = min(stamps) if first else 0
        line.stamps_ns[first:] = [stamp for stamp, _ in rest]
        line.transforms[first:] = [transform for _, transform in rest]
        self.revision += 1
        while line.changes and line.changes[-1][1] >= changed_ns:
            line.changes.pop()
        line.changes.append((self.revision, changed_ns))

    def mission_from_local(self, drone: str, epoch: int, stamp_ns: int | None = None) -> Transform | None:
        """Return the transform from a drone's local frame of an epoch into the mission frame at ``stamp_ns`` (None: now); None if
        unknown.

        The first known transform also holds for all times before, so that observations that waited for it can be used.
        """
        line = self._lines.get((drone, epoch))
        if line is None or not line.transforms:
            return None
        if stamp_ns is None:
            return line.transforms[-1]
        return line.transforms[max(bisect_right(line.stamps_ns, stamp_ns) - 1, 0)]

    def surest(self, drone: str, epoch: int, stamp_ns: int, position_m: Vector3) -> tuple[Transform, float] | None:
        """Return the transform that places a drone's position with the smallest error in the mission frame, and 1 sigma of the
        place (m).

        position_m: local position, reached at ``stamp_ns``. Candidates are the transforms of ``stamp_ns`` and of the next
        seconds, although the frame may have drifted by then: until other drones are seen a frame follows the launch layout, and
        the layout's error stays in the transforms of that period. Return None while the frame is unknown.
        """
        revision, found = self._surest.get((drone, epoch, stamp_ns), (-1, None))
        if revision != self.revision:
            later = self._between(drone, epoch, stamp_ns, stamp_ns + _LATER_NS)
            placed = ((one, _sigma_m(from_ns, one, stamp_ns, position_m)) for from_ns, one in later)
            found = min(placed, key=lambda one: one[1], default=None)
            self._surest[drone, epoch, stamp_ns] = self.revision, found
        return found

    def _between(self, drone: str, epoch: int, begin_ns: int, end_ns: int) -> list[tuple[int, Transform]]:
        """The known transforms that hold from one stamp to the other, with their first stamps."""
        line = self._lines.get((drone, epoch), _Line())
        first = max(bisect_right(line.stamps_ns, begin_ns) - 1, 0)
        last = max(bisect_right(line.stamps_ns, end_ns), first + 1)
        held = zip(line.stamps_ns[first:last], line.transforms[first:last], strict=True)
        return [(stamp_ns, one) for stamp_ns, one in held if one is not None]

    def changes(self, revision: int) -> dict[tuple[str, int], int]:
        """Return, by drone and epoch, the first time stamp of a transform that has changed since ``revision``."""
        found = {}
        for key, line in self._lines.items():
            newer = line.changes[bisect_right(line.changes, revision, key=lambda change: change[0]) :]
            if newer:
                found[key] = newer[0][1]
        return found


def _sigma_m(first_ns: int, transform: Transform, stamp_ns: int, position_m: Vector3) -> float:
    """1 sigma of a place by a transform that holds from ``first_ns`` on, if the place was reached at another stamp."""
    sigma_m = 0.0 if transform.covariance is None else transform.sigmas_at(position_m)[0]
    return math.hypot(sigma_m, _DRIFT_MPS * 1e-9 * max(0, first_ns - stamp_ns))
