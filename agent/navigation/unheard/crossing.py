"""Way across circles on which missing drones may fly, to another circle or home: above all of them, in the own altitude layer.

A crossing drone first climbs on the spot to its altitude layer, which is the return height of its autopilot
(``MissionConfig.return_heights_m``). Then it crosses, and descends at its destination. If the lowest layer is not well above all
circles, all layers are higher than the return heights.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import dist

from radron.agent.config.mission import MissionConfig
from radron.agent.geometry import Point2
from radron.agent.motion.orbit import highest_circle_m, lowest_circle_m

_NEAR_M = 1.0  # tolerance for arrival at a height or on a circle
# Home is reached when position and stopping point are both within the first distance of it; left beyond the second one
# (hysteresis). The stopping point counts because a drone that flies outward over its home at 4 m/s when it is ordered to return
# would otherwise fly on low for 15 m.
_OVER_HOME_M, _AWAY_M = 2.0, 6.0
_CEILING_SHARE = 0.9  # greatest height of a lifted altitude layer, as a share of the ceiling, from which plans keep clear
CLEAR_M = 5.0  # distance of a climbing drone from a circle of missing drones: the separation, and the margin of plans
_CLIMBS_LATE_S = 2.0  # for the climbs of other drones: they may notice a loss later, and need time to reach their climb rate


def is_over_m(mission: MissionConfig, drone: str) -> float:
    """Return the height (m) above the ground from which on a drone counts as in its altitude layer, above all low flight."""
    return crossing_height_m(mission, drone) - _NEAR_M


def low_m(mission: MissionConfig) -> float:
    """Return the height (m) above the ground below which a drone counts as low, among searching and tracking drones."""
    return mission.survey.height_m + _NEAR_M


def crossing_height_m(mission: MissionConfig, drone: str) -> float:
    """Return the height (m) above the ground of a drone's altitude layer: the return height of its autopilot.

    If the lowest layer is not well above all circles, all layers are lifted by as much; if the ceiling does not allow that, the
    layers are also closer together.
    """
    layers_m, height_m = mission.return_heights_m, mission.return_height_m(drone)
    lift_m = highest_circle_m(mission) + mission.limits.separation_m + _NEAR_M - min(layers_m)
    if lift_m <= 0.0:
        return height_m
    highest_m = max(*layers_m, _CEILING_SHARE * mission.area.ceiling_m)
    lowest_m, highest_m = min(min(layers_m) + lift_m, highest_m), min(max(layers_m) + lift_m, highest_m)
    share = (height_m - min(layers_m)) / max(max(layers_m) - min(layers_m), 1e-9)
    return lowest_m + share * (highest_m - lowest_m)


def climb_s(mission: MissionConfig, drone: str) -> float:
    """Return the time (s) from the begin of this drone's climb until all drones that began to climb at the same time have passed
    its altitude layer. Until then it stays at the place of its climb, so that it meets no climbing drone on its way.
    """
    layers_m = [crossing_height_m(mission, member.id) for member in mission.drones]
    passed_m = min(crossing_height_m(mission, drone) + mission.limits.separation_m + _NEAR_M, max(layers_m))
    return max(0.0, passed_m - _lowest_m(mission)) / mission.limits.climb_mps + _CLIMBS_LATE_S


def _lowest_m(mission: MissionConfig) -> float:
    """Return the least height (m) above the ground of a search or a circle, from which a climb may begin."""
    survey = mission.survey
    return min(survey.height_m, survey.low_height_m or survey.height_m, lowest_circle_m(mission))


class Crossing:
    """Way of one drone to its own circle, across the circles of missing drones.

    climbs: the drone has to cross, and climbs on the spot, not high enough yet. is_outside: in addition, its way leads inward.
    is_over: the crossing has begun, and the drone is above all circles.
    """

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        self._height_m = crossing_height_m(mission, drone)
        self._held_m: float | None = None  # radius of the climb, from the begin of a crossing to its end
        self.climbs = self.is_outside = self.is_over = False

    def end(self) -> None:
        """Note that no circle is left to be crossed."""
        self._held_m = None
        self.climbs = self.is_outside = self.is_over = False

    def course(self, far_m: float, height_m: float, radius_m: float, taken_m: Sequence[float]) -> tuple[float, float | None]:
        """Return the radius (m) to fly on, and the height (m) above the ground; None for the height of the own circle.

        ``far_m``: present distance from the centre; ``height_m``: above ground; ``radius_m``: of the own circle;
        ``taken_m``: radii of the circles on which other drones may fly.
        """
        between_m = [taken for taken in taken_m if (far_m - taken) * (radius_m - taken) < 0.0]
        if self._held_m is None and between_m:
            outward = radius_m > far_m
            self._held_m = min(far_m, min(between_m) - CLEAR_M) if outward else max(far_m, max(between_m) + CLEAR_M)
        if self._held_m is None or (not between_m and abs(far_m - radius_m) < _NEAR_M):
            self.end()
            return radius_m, None
        self.is_over = height_m > self._height_m - _NEAR_M
        self.climbs = bool(between_m) and not self.is_over
        self.is_outside = self.climbs and radius_m < far_m
        return (self._held_m if self.climbs else radius_m), self._height_m


class WayHome:
    """Way home of one drone.

    climbs: the drone has to fly in its altitude layer, and climbs on the spot, not high enough yet.
    comes_down: it is over home, and descends from its layer, or waits there until missing drones no longer prevent the descent.
    """

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        self._height_m = crossing_height_m(mission, drone)
        self._low_m = low_m(mission)
        self.begin()

    def begin(self) -> None:
        """Begin a return, also one that goes on in another local frame."""
        self._held: Point2 | None = None  # position of the climb
        self._crosses = self._is_over = self._is_home = self.climbs = self.comes_down = False

    def course(
        self,
        here: Point2,
        rest: Point2,
        height_m: float,
        home: Point2,
        *,
        unheard: bool,
        taken: bool = False,
        are_climbing: bool = False,
    ) -> tuple[Point2, float | None]:
        """Return the destination, in the frame of the arguments, and the height (m) above the ground; None for the height of the
        search.

        Once in its layer the drone stays there up to its home, also if no drone is missing any more: a drone with a new link may
        be right below. Over home it descends by setpoints, three times as fast as autopilots land.

        Args:
            here: position of the drone.
            rest: its stopping point.
            height_m: its height above the ground.
            home: destination of the return.
            unheard: missing drones may fly anywhere on the way, so the drone has to fly in its layer.
            taken: they may search around home, too: the drone waits above it.
            are_climbing: missing drones may still climb through its layer, so it stays at the place of its climb.
        """
        self._crosses = unheard or (self._crosses and self._is_over)
        arrives = max(dist(here, home), dist(rest, home)) < _OVER_HOME_M
        if self._is_home and dist(here, home) >= _AWAY_M:
            self._is_home = self._is_over = False
        self._is_home = self._is_home or arrives
        self.comes_down = self._crosses and self._is_home and height_m > self._low_m
        if not self._crosses or self._is_home:
            self.climbs, self._held = False, None
            return home, self._height_m if taken and self.comes_down else None
        self._held = self._held or rest
        self._is_over = self._is_over or (height_m > self._height_m - _NEAR_M and not are_climbing)
        self.climbs = not self._is_over
        return (self._held if self.climbs else home), self._height_m
