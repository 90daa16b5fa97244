"""Whose coordinates are these: the known transforms from the drones' local frames into the mission frame."""

from __future__ import annotations

import math

from agent.config import MissionConfig
from agent.frames.transform import Transform

LAUNCH_EPOCH = 0  # the epoch in which a drone's localisation starts


class FrameGraph:
    """``mission_from_local`` of every drone and epoch that is known.

    ``revision`` grows with every change, so that whoever has used a transform can notice cheaply that one is new.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[str, int], Transform] = {}
        self.revision = 0

    @classmethod
    def from_launch_layout(cls, mission: MissionConfig) -> FrameGraph:
        """The layout of the mission file: where each drone's first epoch lies, known exactly."""
        graph = cls()
        for drone in mission.drones:
            graph.place(drone.id, LAUNCH_EPOCH, Transform(math.radians(drone.yaw_deg), drone.origin_m))
        return graph

    def place(self, drone: str, epoch: int, mission_from_local: Transform) -> None:
        """Make a frame known; a newer transform replaces the older one, the two are never averaged."""
        self._known[drone, epoch] = mission_from_local
        self.revision += 1

    def mission_from_local(self, drone: str, epoch: int, stamp_ns: int | None = None) -> Transform | None:
        """Transform of a local frame in that epoch at ``stamp_ns`` (none: now), or None while nobody knows it."""
        return self._known.get((drone, epoch))
