"""Collection of the drones' messages that the scores of a flight need: cones, hits, plans and poses, estimates."""

from __future__ import annotations

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace

from radron.protocol.contamination import Contamination
from radron.protocol.entries import Cone, Exposure
from radron.protocol.messages import AnyMessage, Estimate, Plan, Pose, Source, Stage
from radron.sim.result import ConeTrace, EstimateTrace
from radron.sim.scoring.following import Following
from radron.sim.world.frame import LocalFrames

UNKNOWN = "unknown"  # nuclide of a source that matches no candidate
KINDS = ("/cone", "/exposure", "/plan", "/pose", "/estimate")  # ends of the keys of scored messages


class Heard:
    """Collects the messages of all drones that the scores of a flight need.

    cones: in the mission frame. last_cone_s: time of the last cone. estimates: of the drone that represents the swarm, each
    source with its nuclide. contamination, map_first_s: its newest map of contaminated ground, and the time of the first one.
    """

    def __init__(self, frames: LocalFrames, nuclide: str | None) -> None:
        """``frames``: the vehicles' true local frames. ``nuclide``: nuclide of the mission, for estimated sources that state
        none.
        """
        self._frames = frames
        self._nuclide = nuclide
        self.following = Following()
        self.hits = 0
        self.cones: list[ConeTrace] = []
        self.last_cone_s = 0.0
        self.estimates: list[EstimateTrace] = []
        self.contamination: Contamination | None = None
        self.map_first_s: float | None = None

    def take(self, time_s: float, drone: int, message: AnyMessage, stage: Stage, judged: bool) -> None:
        """Record a message of a drone in this mission stage. ``judged``: this drone represents the swarm."""
        if isinstance(message, Exposure):
            self.hits += message.counts.hits
        elif isinstance(message, Plan):
            self.following.plan(message)
        elif isinstance(message, Pose):
            self.following.pose(message, stage)
        elif isinstance(message, Estimate) and judged:
            self._take_estimate(time_s, message)
        elif isinstance(message, Cone):
            self.last_cone_s = time_s
            self.cones.append(self._cone(time_s, drone, message))

    def _take_estimate(self, time_s: float, estimate: Estimate) -> None:
        if estimate.sources:
            self.estimates.append(EstimateTrace(time_s, tuple(self._told(source) for source in estimate.sources)))
        if estimate.contamination is not UNSET:
            self.contamination = estimate.contamination
            self.map_first_s = time_s if self.map_first_s is None else self.map_first_s

    def _told(self, source: Source) -> Source:
        if source.lines_kev is not UNSET:
            return replace(source, nuclide=UNKNOWN)
        return source if source.nuclide is not None else replace(source, nuclide=self._nuclide)

    def _cone(self, time_s: float, drone: int, cone: Cone) -> ConeTrace:
        matrix, origin = self._frames.matrix[drone], self._frames.origin[drone]
        orders = sorted(cone.orders, key=lambda order: -order.probability)
        return ConeTrace(
            time_s=time_s,
            drone=drone,
            apex_m=matrix @ cone.apex_m + origin,
            axis=np.array([order.axis for order in orders]) @ matrix.T,
            theta_rad=np.array([order.theta_rad for order in orders]),
        )
