"""Places beyond the fence, in words for operators."""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2, degrees, isfinite

from shapely import Point, Polygon

from radron.agent.config.mission import AreaConfig
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText


def bearing_beyond(area: AreaConfig, x: float, y: float) -> float | None:
    """Return the bearing (degrees, clockwise from north) from the area's centre to a place (m, mission frame) beyond the fence.

    Return None for a place within the fence.
    """
    polygon = Polygon(area.polygon_m)
    if not isfinite(x + y) or polygon.distance(Point(x, y)) <= area.fence_margin_m:
        return None
    return degrees(atan2(x - polygon.centroid.x, y - polygon.centroid.y)) % 360.0


def outside_texts(area: AreaConfig, places: Iterable[tuple[float, float]]) -> list[CodedText]:
    """Return a line of text for the operator for each place (m, mission frame) of a source that lies beyond the fence."""
    bearings = [bearing_beyond(area, x, y) for x, y in places]
    text = "source outside the fence, {}"
    return [CodedText(Code.SOURCE_OUTSIDE, text.format(towards(one))) for one in bearings if one is not None]


def towards(bearing_deg: float) -> str:
    """Return a bearing in words for the operator, such as "towards 045 degrees"."""
    return f"towards {round(bearing_deg) % 360:03d} degrees"
