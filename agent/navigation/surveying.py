"""Search of one drone for a source: by lanes over the uncovered area, or by waypoints of the greatest expected information; and
its reports of coverage.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.config.beyond import outside_texts
from radron.agent.config.mission import MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.fusion.estimator import Outlook
from radron.agent.geometry import Point2
from radron.agent.motion.detour import Detours
from radron.agent.motion.informative import LARGEST_M2, Belief, Waypoints
from radron.agent.motion.path import PathFollower
from radron.agent.motion.survey import Area, left, survey_path
from radron.agent.navigation.covered import Covered, Path
from radron.agent.navigation.unheard.contact import Wall
from radron.agent.navigation.unheard.lines import KEPT_M
from radron.protocol.codes import Code
from radron.protocol.entries import Coverage
from radron.protocol.texts import CodedText

COVERAGE_S = 5.0  # period of the coverage reports
POINT_M = 1.0  # distance between the points of a coverage path
LOOK_NS = 1_000_000_000  # period in which the search state is computed, and a waypoint chosen
_PORTION = 3.0  # work on new coverage in one step (``Covered.work``)
_LONGEST_SHARE = 1.5  # a reported path longer than the way at the speed limit times this is refused
_INSIDE_M = 5.0  # least distance from the fence to the waypoints of a search for a source outside the area
_OUTSIDE = 0.2  # waypoints may lie outside the area if a source is there with more than this probability, and than inside
_TURN_SHARE = 0.75  # share of the acceleration limit that is assumed for turns
# A drone may come to a standstill beside a corner at which its path reverses, or behind another drone. If it moves by less than
# the first distance in a step without progress, its progress along the path is increased by the second one. A gap in the coverage
# left by that is covered after the next division of the area.
_STILL_M, _ONWARD_M = 0.02, 0.05
_OPPOSITE = 0.95  # cosine from which a way leads against the direction of a lane


class Search:
    """Search by lanes. The uncovered area is divided among the drones that take part, and again when these change, or this drone
    has flown its share.

    Division and completeness follow from the coverage in the log alone, so drones with the same log divide alike, and end the
    search alike. All positions in the mission frame.
    """

    def __init__(
        self,
        mission: MissionConfig,
        drone: str,
        frames: FrameGraph,
        spacing_m: float | None = None,
        height_m: float | None = None,
    ) -> None:
        """Begin without any coverage. ``drone``: the own id; ``frames``: of all drones.

        ``spacing_m``: greatest distance between lanes, and width that each covers; coverage of another width does not count.
        ``height_m``: height of the lanes above the ground. None: as the mission's survey.
        """
        self._area = Polygon(mission.area.polygon_m)
        self._region: Area = self._area  # to be covered
        self._survey = mission.survey
        self.swath_m = mission.survey.lane_spacing_m if spacing_m is None else spacing_m
        self.height_m = mission.survey.height_m if height_m is None else height_m
        self._drone = drone
        self._frames, self._revision = frames, frames.revision
        longest_m = _LONGEST_SHARE * COVERAGE_S * max(mission.limits.speed_mps, mission.survey.speed_mps) + POINT_M
        self._covered = Covered(self._path_of, self.swath_m, longest_m)
        self._launch: dict[str, Point2] = {one.id: (one.origin_m[0], one.origin_m[1]) for one in mission.drones}
        self._shared_by: tuple[str, ...] = ()
        self._follower: PathFollower | None = None
        self._progress = 0.0
        self._position: Point2 | None = None  # at the last step
        self._again = False  # the division is older than the known coverage
        self._judged = False  # is_complete accounts for all known coverage
        self.is_complete = False  # all of the area has been covered

    def begin(self, started_ns: int) -> None:
        """Begin a mission at this stamp; only later coverage counts."""
        self._covered.begin(started_ns)
        self._follower, self._judged, self.is_complete = None, False, False

    def restrict(self, region: Area) -> None:
        """Cover only this part of the area from now on."""
        self._region, self._follower, self._judged, self.is_complete = region, None, False, False

    def take(self, entry: Coverage) -> None:
        """Add a coverage entry of the log; the order of the entries does not matter."""
        self._covered.take(entry)
        self._judged = False

    def recount(self, drone: str, entries: Iterable[Coverage]) -> None:
        """Replace all coverage of a drone by these entries, and divide the uncovered area anew."""
        self._covered.recount(drone, entries)
        self._judged = self.is_complete = False
        self.divide_anew()

    def reference(
        self, active: Sequence[str], position: Point2, steps: int, step_s: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the positions and velocities, (steps + 1, 2) each, to follow from here along the lanes of this drone's share.

        Args:
            active: ids of the drones that share the area, this one included, sorted.
            position: of this drone.
            steps: number of steps of the reference.
            step_s: time between its points.
        """
        self._keep_up()
        if self._follower is None or tuple(active) != self._shared_by or self._progress >= self._follower.length_m:
            self._shared_by, self._progress = tuple(active), 0.0
            self._follower = self._divide(active, position)
        progress = self._follower.advance(self._progress, position)
        if progress == self._progress and self._position is not None and _apart(position, self._position) < _STILL_M:
            progress += _ONWARD_M
        self._progress, self._position = progress, position
        return self._follower.reference(self._progress, position, self._survey.speed_mps, steps, step_s)

    def divide_anew(self) -> None:
        """Divide the uncovered area anew, as soon as all known coverage is counted."""
        self._again = True

    def _keep_up(self) -> None:
        """Count new coverage, a bounded part of it in each step. Until all is counted, the present division stays in use."""
        for (drone, _), from_ns in self._frames.changes(self._revision).items():
            self._covered.moved(drone, from_ns)
        self._revision = self._frames.revision
        self._covered.work(_PORTION)
        if self._covered.pending:
            return
        if self._again:
            self._again, self._follower = False, None
        if not self._judged and not self.is_complete:
            self._judged, self.is_complete = True, self._left().is_empty

    def _left(self) -> Area:
        return left(self._region, self._covered.area, self.swath_m)

    def _path_of(self, coverage: Coverage) -> Path | None:
        transform = self._frames.mission_from_local(coverage.drone, coverage.epoch, coverage.stamp_ns)
        if transform is None:
            return None
        return transform.apply(np.array([(x, y, 0.0) for x, y in coverage.path_m]))[:, :2]

    def _divide(self, active: Sequence[str], position: Point2) -> PathFollower:
        self._again = self._again or self._covered.pending
        ends = {drone: self._covered.end(drone) or self._launch[drone] for drone in active}  # positions that all drones know
        path = survey_path(self._area, self._left(), self._drone, active, self.swath_m, ends)
        if len(path) == 0:  # all is covered without a source: start again
            path = survey_path(self._area, self._region, self._drone, active, self.swath_m, ends)
        return PathFollower(_with_approach(position, path, self.swath_m))


def _with_approach(position: Point2, path: Path, swath_m: float) -> NDArray[np.float64]:
    """Return a path of lanes (K, 2) with the way to its first lane.

    A way that would lead along the first lane to the lane's begin leads along the next lane instead: a plan to and fro on one
    line turns before its end, and a drone that follows it stands.
    """
    here, begin, end = np.asarray(position), path[0], path[min(1, len(path) - 1)]
    way, lane = begin - here, end - begin
    way_m, lane_m = float(np.hypot(*way)), float(np.hypot(*lane))
    if min(way_m, lane_m) < swath_m or way @ lane > -_OPPOSITE * way_m * lane_m:
        return np.vstack([here, path])
    aside = path[2] - end if len(path) > 2 else np.array((-lane[1], lane[0]))
    aside *= swath_m / max(float(np.hypot(*aside)), swath_m)
    return np.vstack([here, begin + aside, path])


class Prospect:
    """Search state of the estimator (where a source may still be), computed at most once a second because it is costly."""

    def __init__(self, outlook: Callable[[], Outlook | None]) -> None:
        self._outlook = outlook
        self._known: Outlook | None = None
        self._due_ns = 0

    def at(self, now_ns: int) -> Outlook | None:
        """Return the present search state; None once there is a source estimate, or if the estimator gives no search state."""
        if now_ns >= self._due_ns or self._due_ns - now_ns > LOOK_NS:
            self._due_ns = now_ns + LOOK_NS
            self._known = self._outlook()
        return self._known


class InformedSearch:
    """Search by waypoints: to the waypoint of the greatest expected information, chosen anew each second; mission frame."""

    def __init__(self, mission: MissionConfig, prospect: Prospect) -> None:
        survey, area = mission.survey, Polygon(mission.area.polygon_m)
        west, south, east, north = area.bounds
        chosen = (
            survey.strategy == "information"
            and mission.encirclement.law != "paper"
            and (east - west) * (north - south) <= LARGEST_M2
        )
        self._prospect = prospect
        self._speed_mps = min(survey.search_speed_mps, mission.limits.speed_mps)
        flown_m = max(0.0, mission.area.fence_margin_m - _INSIDE_M)
        self._regions = tuple(self._region(mission, region) for region in (area, area.buffer(flown_m, quad_segs=2)) if chosen)
        self._follower: PathFollower | None = None
        self._progress = 0.0
        self._due_ns = 0

    def reference(
        self,
        now_ns: int,
        position: Point2,
        velocity: Point2,
        others: Sequence[Point2],
        steps: int,
        step_s: float,
        walls: Sequence[Wall] = (),
        covered: bool = False,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Return the positions and velocities, (steps + 1, 2) each, to follow from here to the waypoint; None: fly lanes instead.

        Args:
            now_ns: own time.
            position: of this drone.
            velocity: its velocity.
            others: positions of the other searching drones.
            steps: number of steps of the reference.
            step_s: time between its points.
            walls: separation lines to missing drones; this drone keeps to its own side.
            covered: lanes have covered the whole area. An estimator of several sources needs that first, because its search state
                changes too slowly for waypoints.
        """
        outlook = self._prospect.at(now_ns) if self._regions else None
        outlook = outlook.lead if outlook is not None and outlook.lead is not None else outlook
        if outlook is not None and outlook.exclusion is not None and not (covered and outlook.exclusion.left.any()):
            outlook = None
        if outlook is None:
            self._follower = None
            return None
        if self._follower is None or now_ns >= self._due_ns:
            self._due_ns, self._progress = now_ns + LOOK_NS, 0.0
            self._follower = self._way(outlook, position, velocity, others, walls)
        length_m = self._follower.length_m
        self._progress = min(self._follower.advance(self._progress, position), length_m)
        travelled = self._progress + self._speed_mps * step_s * np.arange(steps + 2.0)
        points = self._follower.at(np.minimum(travelled, length_m))  # then a wait for the next waypoint
        return points[:-1], np.diff(points, axis=0) / step_s

    def _way(
        self,
        outlook: Outlook,
        position: Point2,
        velocity: Point2,
        others: Sequence[Point2],
        walls: Sequence[Wall],
    ) -> PathFollower:
        """Return the way to the waypoint of the greatest expected information. It lies in the area, or between area and fence if
        the source is probably outside the area.
        """
        weight = outlook.weight if outlook.exclusion is None else outlook.weight * outlook.exclusion.left
        inside = float(weight[outlook.inside].sum())
        is_outside = float(weight.sum()) - inside > max(inside, _OUTSIDE)
        waypoints, detours = self._regions[is_outside]
        cells = outlook.inside | is_outside
        belief = Belief(outlook.places[cells], weight[cells], outlook.activity_bq[cells], outlook.none)
        behind = [(*wall.normal, wall.offset + KEPT_M) for wall in walls]
        start, end = np.array(position), np.array(waypoints.choose(belief, position, velocity, others, behind))
        return PathFollower(np.vstack([start, detours.between(start, end), end]))

    def _region(self, mission: MissionConfig, region: Polygon) -> tuple[Waypoints, Detours]:
        acceleration_mps2 = _TURN_SHARE * mission.limits.acceleration_mps2
        return Waypoints(region, mission.survey.height_m, self._speed_mps, acceleration_mps2), Detours(region)


def conclusion(mission: MissionConfig, searched_s: float, outlook: Outlook | None) -> CodedText | None:
    """Return the result of a search without a find, as a text for the operator; None while the search continues.

    The text gives the exclusion limit, or the direction to a probable source beyond the fence. ``searched_s``: duration of the
    search so far.
    """
    excluded_bq = outlook.excluded_bq if outlook is not None else None
    survey, least_bq = mission.survey, mission.survey.least_activity_bq
    if outlook is not None and outlook.exclusion is not None:
        enough = not outlook.exclusion.left.any()
    else:
        enough = excluded_bq is not None and least_bq is not None and excluded_bq <= least_bq
    if not enough and (survey.duration_s is None or searched_s < survey.duration_s):
        return None
    outside = [] if outlook is None or outlook.beyond is None else outside_texts(mission.area, [outlook.beyond])
    if outside:
        return CodedText(Code.SOURCE_OUTSIDE, f"nothing found in the area; {outside[0]}")
    if excluded_bq is None:
        return CodedText(Code.NOTHING_FOUND, f"nothing found in {searched_s:.0f} s; no activity can be excluded")
    return CodedText(Code.NOTHING_FOUND, f"nothing found; a source of {excluded_bq:.2g} Bq or more is excluded")


class CoverageLog:
    """Path of this drone since its last coverage report, in the local frame."""

    def __init__(self, swath_m: float) -> None:
        self.swath_m = swath_m
        self._points: list[Point2] = []
        self._since_ns = 0
        self._epoch = 0

    def add(self, now_ns: int, epoch: int, position: Point2) -> tuple[int, int, tuple[Point2, ...]] | None:
        """Add the own position. Return a report every 5 s: stamp, epoch and points of the path; else None.

        A new epoch ends a path, because a path cannot lead from one local frame into another.
        """
        told = None
        if self._points and epoch != self._epoch:
            told = self._since_ns, self._epoch, tuple(self._points)
            self._points = []
        if not self._points:
            self._since_ns, self._epoch = now_ns, epoch
        if not self._points or _apart(self._points[-1], position) >= POINT_M:
            self._points.append(position)
        if told is not None or now_ns - self._since_ns < COVERAGE_S * 1e9 or len(self._points) < 2:
            return told
        told, self._points = (self._since_ns, epoch, tuple(self._points)), [self._points[-1]]
        self._since_ns = now_ns
        return told


def _apart(one: Point2, other: Point2) -> float:
    return float(np.hypot(one[0] - other[0], one[1] - other[1]))
