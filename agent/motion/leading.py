"""Where the centre of the circle is now: the hypothesis carried on by its velocity, within what a wrong one may do."""

from __future__ import annotations

from math import exp, hypot

import shapely
from shapely import Point, Polygon
from shapely.ops import nearest_points

from agent.config import AreaConfig

Point2 = tuple[float, float]

_LONGEST_S = 1.0  # an older hypothesis is not carried on further
_SMOOTHING_S = 0.7  # time constant of the velocity: what jumps with each measurement drives the circle about
_FORGET_S = 2.0  # after so long without a look the smoothed velocity is worth nothing


class Leading:
    """Leads the source of one drone's circle. Mission frame."""

    def __init__(self, area: AreaConfig, most_mps: float, room_m: float) -> None:
        """``most_mps``: a source is taken as no faster. ``room_m``: what the circle needs around its centre inside the fence."""
        self._most_mps = max(0.0, most_mps)
        self._within = Polygon(area.polygon_m).buffer(max(0.0, area.fence_margin_m - room_m))
        shapely.prepare(self._within)
        self._velocity = (0.0, 0.0)
        self._known_ns: int | None = None

    def centre(self, now_ns: int, stamp_ns: int, place: Point2, velocity: Point2) -> tuple[Point2, Point2]:
        """Place and velocity of the centre now.

        Args:
            now_ns: UTC.
            stamp_ns: of the hypothesis.
            place: where the source was then.
            velocity: of the source.
        """
        (x, y), (u, v) = place, self._smoothed(now_ns, velocity)
        lead_s = min(max(0.0, (now_ns - stamp_ns) * 1e-9), _LONGEST_S)
        x, y = x + lead_s * u, y + lead_s * v
        if shapely.contains_xy(self._within, x, y):
            return (x, y), (u, v)
        nearest, _ = nearest_points(self._within, Point(x, y))  # a circle out there would lie beyond the fence
        return (nearest.x, nearest.y), (0.0, 0.0)

    def _smoothed(self, now_ns: int, velocity: Point2) -> Point2:
        u, v = velocity
        share = min(1.0, self._most_mps / max(hypot(u, v), 1e-9))
        elapsed_s = _FORGET_S if self._known_ns is None else (now_ns - self._known_ns) * 1e-9
        self._known_ns = now_ns
        keep = exp(-max(elapsed_s, 0.0) / _SMOOTHING_S) if elapsed_s < _FORGET_S else 0.0
        new = (1.0 - keep) * share
        self._velocity = keep * self._velocity[0] + new * u, keep * self._velocity[1] + new * v
        return self._velocity
