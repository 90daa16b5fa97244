"""Centre of the circle: the source estimate, extrapolated to now by its velocity; the effect of a wrong velocity is limited."""

from __future__ import annotations

from math import exp, hypot, isfinite

import shapely
from shapely import Point, Polygon
from shapely.ops import nearest_points

from radron.agent.config.mission import AreaConfig
from radron.agent.geometry import Point2

_LONGEST_S = 1.0  # longest extrapolation of a source estimate
_SMOOTHING_S = 0.7  # time constant of the velocity: without smoothing, the circle would jerk at every update
_CORRECTION_S = 0.5  # time constant of position corrections
_CORRECTION_MPS = 4.0  # speed limit of corrections: neighbours that all turn at full speed at once come too close to each other
_SURELY = 0.999  # factor on clearances, for rounding errors
_FORGET_S = 2.0  # smoothed values older than this are discarded


class Leading:
    """Prediction of the present position of a moving source, as the centre of one drone's circle; mission frame."""

    def __init__(self, area: AreaConfig, most_mps: float, room_m: float) -> None:
        """Set the limits.

        ``most_mps``: greatest speed assumed for a source. ``room_m``: clearance that the circle needs around its centre inside
        the fence.
        """
        self._most_mps = max(0.0, most_mps)
        self._within = Polygon(area.polygon_m).buffer(max(0.0, area.fence_margin_m - room_m))
        shapely.prepare(self._within)
        self._clear = (0.0, 0.0, 0.0)  # a position inside, and its clearance
        self._velocity = (0.0, 0.0)
        self._place: Point2 | None = None
        self._known_ns = 0

    def centre(self, now_ns: int, stamp_ns: int, place: Point2, velocity: Point2) -> tuple[Point2, Point2]:
        """Return position (m) and velocity (m/s) of the circle's centre now.

        Args:
            now_ns: own time.
            stamp_ns: time of the source estimate, own time.
            place: position of the source at that time, m.
            velocity: of the source, m/s.
        """
        if not isfinite(sum(place) + sum(velocity)):
            return self._place or (0.0, 0.0), (0.0, 0.0)
        elapsed_s = (now_ns - self._known_ns) * 1e-9
        self._known_ns = now_ns
        if elapsed_s > _FORGET_S:
            self._place = None
        u, v = self._velocity = self._smoothed(velocity, elapsed_s)
        lead_s = min(max(0.0, (now_ns - stamp_ns) * 1e-9), _LONGEST_S)
        x, y = self._place = self._moved((place[0] + lead_s * u, place[1] + lead_s * v), elapsed_s)
        if self._inside(x, y):
            return (x, y), (u, v)
        nearest, _ = nearest_points(self._within, Point(x, y))  # a circle further out would lie beyond the fence
        return (nearest.x, nearest.y), (0.0, 0.0)

    def _inside(self, x: float, y: float) -> bool:
        """Whether a circle around this position lies inside the fence. The outline is queried only if the last known clearance
        does not decide.
        """
        known_x, known_y, clear_m = self._clear
        if hypot(x - known_x, y - known_y) < clear_m:
            return True
        inside = bool(shapely.contains_xy(self._within, x, y))
        if inside:
            self._clear = (x, y, _SURELY * self._within.boundary.distance(Point(x, y)))
        return inside

    def _smoothed(self, velocity: Point2, elapsed_s: float) -> Point2:
        share = min(1.0, self._most_mps / max(hypot(*velocity), 1e-9))
        keep = 0.0 if self._place is None else exp(-elapsed_s / _SMOOTHING_S)
        new = (1.0 - keep) * share
        return keep * self._velocity[0] + new * velocity[0], keep * self._velocity[1] + new * velocity[1]

    def _moved(self, wanted: Point2, elapsed_s: float) -> Point2:
        """Return the last centre, moved on by its velocity, and corrected towards ``wanted`` at a limited speed."""
        if self._place is None:
            return wanted
        (x, y), (u, v) = self._place, self._velocity
        x, y = x + elapsed_s * u, y + elapsed_s * v
        dx, dy = wanted[0] - x, wanted[1] - y
        share = min(1.0 - exp(-elapsed_s / _CORRECTION_S), _CORRECTION_MPS * elapsed_s / max(hypot(dx, dy), 1e-9))
        return x + share * dx, y + share * dy
