"""Radius and height of the circle around the source, from the accuracy of the source estimate.

The information that a camera gains falls with about the fourth power of the distance, so a smaller circle is better. But a circle
smaller than the error of the estimate may not contain the source.
"""

from __future__ import annotations

from math import sqrt

from radron.agent.config.mission import EncirclementConfig, MissionConfig
from radron.agent.motion.encirclement import MARGIN_M, minimum_radius
from radron.agent.motion.informative import BACKGROUND_PS, HITS_PER_BQ

_RADIUS_MPS = 2.0  # greatest change of the radius: the tracker can follow it, and neighbours that change later stay apart
_HEIGHT_MPS = 0.5  # greatest change of the height
_TIME_S = 1.5  # time constant of the approach to the wanted radius and height
_LONGEST_S = 1.0  # longest time step
_OVER_FLOOR_M = 0.8  # least height above the floor of the fence: gusts and turns take up to 0.5 m
_WIDEST_M = 40.0  # largest radius
_CLEAR_OF_BACKGROUND = 4.0  # least count rate by the source on the circle, in multiples of the background's


def ring_radius_m(mission: MissionConfig, ring: int, fits_hypothesis: bool) -> float:
    """Return the radius (m) of a circle around the source. Each network component flies a circle of its own.

    The circles are apart by twice the separation, so that the vehicles' deviations do not bring drones together. ``ring``: number
    of the circle, 0 is the innermost, which all drones share while all links work; ``fits_hypothesis``: the radius of the
    innermost circle follows the accuracy of the source estimate.
    """
    config, limits = mission.encirclement, mission.limits
    shared_m = min(config.nearest_m, config.radius_m) if fits_hypothesis else config.radius_m
    room_m = minimum_radius(len(mission.drones), limits.separation_m + MARGIN_M)
    return max(shared_m, room_m) + 2.0 * limits.separation_m * ring


def ring_change_s(mission: MissionConfig) -> float:
    """Return the longest time (s) that a drone needs from the innermost circle to any other one."""
    outermost_m = ring_radius_m(mission, len(mission.drones) - 1, fits_hypothesis=True)
    return (outermost_m - ring_radius_m(mission, 0, fits_hypothesis=True)) / _RADIUS_MPS + 2.0 * _TIME_S


def ring_lift_m(mission: MissionConfig, ring: int) -> float:
    """Return by how much (m) a circle is higher than the innermost one: every second circle by the separation, else 0.

    Network components have different source estimates, several metres apart if one component has few cameras. So their circles
    may cross.
    """
    return mission.limits.separation_m * (ring % 2)


def highest_circle_m(mission: MissionConfig) -> float:
    """Return the greatest height (m) above the ground of any drone's circle around a source."""
    return mission.encirclement.height_m + ring_lift_m(mission, 1)


def lowest_circle_m(mission: MissionConfig) -> float:
    """Return the height (m) above the ground below which no drone's circle around a source lies."""
    config = mission.encirclement
    return max(_lowest_m(config, mission.area.floor_m), config.height_m * min(config.nearest_m / config.radius_m, 1.0))


def _lowest_m(config: EncirclementConfig, floor_m: float) -> float:
    return min(floor_m + _OVER_FLOOR_M, config.height_m)


def second_height_m(mission: MissionConfig) -> float | None:
    """Return the height (m) above the ground for the second half of a turn around a source; None if one height suffices.

    One height suffices if all sources lie on the ground. Otherwise counts from one height alone cannot distinguish a source above
    the cameras from its mirror image below them. The second height is at most that of the highest circle, over which crossing and
    returning drones pass, and stays below the lowest altitude layer by the separation.
    """
    if mission.source_height_m[1] <= 0.0:
        return None
    below_layers_m = min(mission.return_heights_m) - mission.limits.separation_m
    return min(highest_circle_m(mission), below_layers_m, mission.area.ceiling_m - _OVER_FLOOR_M)


class Orbit:
    """Radius and height of one drone's circle around the source; they start at the configured values and change gradually."""

    def __init__(self, config: EncirclementConfig, floor_m: float) -> None:
        """Start at the configured circle. ``floor_m``: least height above the ground."""
        self._config = config
        self._lowest_m = _lowest_m(config, floor_m)
        self._nearest_m = min(config.nearest_m, config.radius_m)
        self.radius_m, self.height_m = config.radius_m, config.height_m
        self._stamp_ns: int | None = None

    def update(
        self,
        now_ns: int,
        rms_m: float,
        activity_bq: float | None,
        lost: bool = False,
        ring_m: float | None = None,
        lift_m: float = 0.0,
        least_m: float = 0.0,
    ) -> None:
        """Change radius and height gradually towards the circle that is best for the present source estimate.

        Args:
            now_ns: own time.
            rms_m: RMS position error of the source estimate.
            activity_bq: activity of the source; None if not known.
            lost: the source is lost, and only known to be within ``rms_m``: the circle may be wider than configured.
            ring_m: prescribed radius, whatever the accuracy; None: by the accuracy.
            lift_m: added to the height.
            least_m: minimum height above the ground before ``lift_m`` is added.
        """
        passed_s = 0.0 if self._stamp_ns is None else (now_ns - self._stamp_ns) * 1e-9
        elapsed_s = min(passed_s, _LONGEST_S)
        self._stamp_ns = now_ns
        radius_m = ring_m or self._wanted(rms_m, activity_bq, lost)
        height_m = max(self._lowest_m, least_m, self._config.height_m * min(radius_m / self._config.radius_m, 1.0))
        self.radius_m += _step(radius_m - self.radius_m, _RADIUS_MPS, elapsed_s)
        self.height_m += _step(height_m + lift_m - self.height_m, _HEIGHT_MPS, elapsed_s)

    def _wanted(self, rms_m: float, activity_bq: float | None, lost: bool) -> float:
        return min(max(rms_m, self._nearest_m), _WIDEST_M) if lost else self._radius(rms_m, activity_bq)

    def _radius(self, rms_m: float, activity_bq: float | None) -> float:
        """Return the radius (m) by the accuracy of the source estimate; smaller for a source too weak to be seen from there."""
        most = self._config.radius_m
        if activity_bq is not None:
            most = min(most, sqrt(HITS_PER_BQ * activity_bq / (_CLEAR_OF_BACKGROUND * BACKGROUND_PS)))
        return max(self._nearest_m, min(self._nearest_m + rms_m, most))


def _step(way: float, most_mps: float, elapsed_s: float) -> float:
    """Return the change within ``elapsed_s`` towards a value that is ``way`` away: at ``most_mps`` at most, and exponentially
    slower near the end, so that it does not overshoot.
    """
    return min(max(way / _TIME_S, -most_mps), most_mps) * elapsed_s
