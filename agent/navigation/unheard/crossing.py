"""From one circle to another, or home, while drones that are not heard may fly on those in between, anywhere: over them.

Such a drone climbs where it is to the height of its own at which its autopilot would return (``MissionConfig.return_heights_m``),
or, where the lowest of these is not well above all circles, higher, as all others; goes across, and comes down where it belongs.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import dist

from agent.config.mission import MissionConfig
from agent.geometry import Point2
from agent.motion.orbit import highest_circle_m

_NEAR_M = 1.0  # so near to its height or its circle it has arrived
# So near to home, and to come to rest there, it is home, until it is carried so far away from there. One that was told to return
# as it left home at 4 m/s flew on low for 15 m, past those that circled (2.7 m).
_OVER_HOME_M, _AWAY_M = 2.0, 6.0
_CEILING_SHARE = 0.9  # of the ceiling, which plans keep from: no layer is higher
CLEAR_M = 5.0  # from a circle that it may not touch, while it climbs: the separation, and the margin of plans


def is_over_m(mission: MissionConfig, drone: str) -> float:
    """From this height (m) above the ground on a drone is above all that fly low."""
    return crossing_height_m(mission, drone) - _NEAR_M


def low_m(mission: MissionConfig) -> float:
    """Below this height (m) above the ground a drone is among those that search and track."""
    return mission.survey.height_m + _NEAR_M


def crossing_height_m(mission: MissionConfig, drone: str) -> float:
    """Height (m) above the ground at which a drone crosses: that of its autopilot's return, all of them higher by as much as the
    lowest needs to be above all circles, or by less where the ceiling does not allow as much.
    """
    layers_m, height_m = mission.return_heights_m, mission.return_height_m(drone)
    lift_m = highest_circle_m(mission) + mission.limits.separation_m + _NEAR_M - min(layers_m)
    if lift_m <= 0.0:
        return height_m
    highest_m = max(*layers_m, _CEILING_SHARE * mission.area.ceiling_m)
    lowest_m, highest_m = min(min(layers_m) + lift_m, highest_m), min(max(layers_m) + lift_m, highest_m)
    share = (height_m - min(layers_m)) / max(max(layers_m) - min(layers_m), 1e-9)
    return lowest_m + share * (highest_m - lowest_m)


class Crossing:
    """The crossing of one drone. ``climbs``: it has to cross, and is too low yet; ``is_outside``: then, that it is outside of all
    circles that it has to cross; ``is_over``: it is above all circles.
    """

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        self._height_m = crossing_height_m(mission, drone)
        self._held_m: float | None = None  # the radius at which it climbs, from the begin of a crossing to its end
        self.climbs = self.is_outside = self.is_over = False

    def end(self) -> None:
        """Nothing to cross any more."""
        self._held_m = None
        self.climbs = self.is_outside = self.is_over = False

    def course(self, far_m: float, height_m: float, radius_m: float, taken_m: Sequence[float]) -> tuple[float, float | None]:
        """Radius to fly on, and height above the ground; None: that of the circle.

        ``far_m``: present distance from the centre; ``height_m``: above ground; ``radius_m``: of the circle where it belongs;
        ``taken_m``: of those that others may fly on.
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
    """The return of one drone. ``climbs``: it has to cross, and is too low yet. ``comes_down``: from its height, over home, or
    waits there until it can.
    """

    def __init__(self, mission: MissionConfig, drone: str) -> None:
        self._height_m = crossing_height_m(mission, drone)
        self._low_m = low_m(mission)
        self.begin()

    def begin(self) -> None:
        """A return begins, or the local frame is another one."""
        self._held: Point2 | None = None  # where it climbs
        self._crosses = self._is_over = self._is_home = self.climbs = self.comes_down = False

    def course(
        self, here: Point2, rest: Point2, height_m: float, home: Point2, *, unheard: bool, taken: bool = False
    ) -> tuple[Point2, float | None]:
        """Where to go, and at which height above the ground; None: that of the search.

        ``here``, ``home``, and ``rest``, where it would come to rest: in one frame; ``unheard``: there are drones that are not
        heard and may fly anywhere on the way; ``taken``: below home, too: it waits above. Once above them it stays there to the
        end, as it may be over one that is heard again. Over home it comes down by setpoints, three times as fast as autopilots
        land.
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
        self._is_over = self._is_over or height_m > self._height_m - _NEAR_M
        self.climbs = not self._is_over
        return (self._held if self.climbs else home), self._height_m
