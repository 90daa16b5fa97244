"""The survey as one drone flies it: what the swarm has covered, this drone's path, and its own coverage entries."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from agent.config import MissionConfig
from agent.frames.graph import FrameGraph
from agent.motion.path import PathFollower
from agent.motion.survey import Swath, survey_paths
from protocol.messages import Coverage

Point2 = tuple[float, float]
COVERAGE_S = 5.0  # a drone reports what it has covered this often
POINT_M = 1.0  # distance between the points of a coverage path


class Search:
    """Divides what is not covered among the drones that take part: when their number changes, and at the end of the own path.

    A division follows from the log's coverage alone, so drones that hold the same log divide alike. Mission frame throughout.
    """

    def __init__(
        self, mission: MissionConfig, drone: str, frames: FrameGraph, coverage: Callable[[], Iterable[Coverage]]
    ) -> None:
        """``coverage``: gives all coverage entries of the log, in the order of their identities."""
        self._area = Polygon(mission.area.polygon_m)
        self._survey = mission.survey
        self._drone = drone
        self._frames = frames
        self._coverage = coverage
        self._launch: dict[str, Point2] = {one.id: (one.origin_m[0], one.origin_m[1]) for one in mission.drones}
        self._shared_by: tuple[str, ...] = ()
        self._follower: PathFollower | None = None
        self._progress = 0.0

    def reference(
        self, active: Sequence[str], position: Point2, steps: int, step_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions and velocities (steps + 1, 2) to follow from here.

        Args:
            active: the drones that share the area, this one included, sorted.
            position: where this drone is.
            steps: of the reference.
            step_s: between its points.
        """
        if self._follower is None or tuple(active) != self._shared_by or self._progress >= self._follower.length_m:
            self._shared_by, self._progress = tuple(active), 0.0
            self._follower = self._divide(active, position)
        self._progress = self._follower.advance(self._progress, position)
        return self._follower.reference(self._progress, position, self._survey.speed_mps, steps, step_s)

    def divide_anew(self) -> None:
        """What was covered has turned out to be more than the division rests on."""
        self._follower = None

    def _divide(self, active: Sequence[str], position: Point2) -> PathFollower:
        swaths: list[Swath] = []
        ends = {drone: self._launch[drone] for drone in active}  # where everybody knows the drones to be
        for coverage in self._coverage():
            transform = self._frames.mission_from_local(coverage.drone, coverage.epoch)
            if transform is None:
                continue
            path = transform.apply(np.array([(x, y, 0.0) for x, y in coverage.path_m]))[:, :2]
            swaths.append((path, coverage.swath_m))
            if coverage.drone in ends:
                ends[coverage.drone] = (float(path[-1, 0]), float(path[-1, 1]))
        spacing_m = self._survey.lane_spacing_m
        path = survey_paths(self._area, active, swaths, spacing_m, ends)[self._drone]
        if len(path) == 0:  # all is covered and nothing was found: once more from the beginning
            path = survey_paths(self._area, active, [], spacing_m, ends)[self._drone]
        return PathFollower(np.vstack([position, path]))  # the way to the first lane is part of the path


class CoverageLog:
    """Collects where this drone has searched, in its local frame, until the next report is due."""

    def __init__(self, swath_m: float) -> None:
        self.swath_m = swath_m
        self._points: list[Point2] = []
        self._since_ns = 0

    def add(self, now_ns: int, position: Point2) -> tuple[int, tuple[Point2, ...]] | None:
        """Note where the drone searches now; every few seconds the stamp and path of a report, else None."""
        if not self._points:
            self._since_ns = now_ns
        if not self._points or _apart(self._points[-1], position) >= POINT_M:
            self._points.append(position)
        if now_ns - self._since_ns < COVERAGE_S * 1e9 or len(self._points) < 2:
            return None
        path, self._points = tuple(self._points), [self._points[-1]]
        stamp_ns, self._since_ns = self._since_ns, now_ns
        return stamp_ns, path


def _apart(one: Point2, other: Point2) -> float:
    return float(np.hypot(one[0] - other[0], one[1] - other[1]))
