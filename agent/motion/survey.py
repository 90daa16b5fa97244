"""Division of an area for the search before the first source estimate: N segments of equal area, each with a path that covers it
(paper, Sec. V-A).

All functions are pure: drones with the same area, coverage, members and starts compute the same paths, without a leader. So
``starts`` must be known to all drones alike, such as the ends of the last ``Coverage`` entries; a drone's own newest position is
not. All positions are horizontal, metres, in the mission frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import brentq
from shapely import LineString, MultiPolygon, Point, Polygon

from radron.agent.geometry import Point2
from radron.agent.motion.detour import Detours
from radron.agent.motion.lanes import lanes

Area: TypeAlias = Polygon | MultiPolygon
Swath: TypeAlias = tuple[NDArray[np.float64], float]  # flown path (K, 2), width that it covers

_SLIVER = 0.15  # uncovered strips narrower than this share of the swath are left out: they come from lag and cut corners
MOST_POINTS = 300  # if an uncovered area has more corners, wider strips are left out, too: lanes cost a millisecond a corner
_EQUAL = 1.02  # lengths within this ratio count as equal, so that rounding does not turn a cut


def survey_paths(
    area: Polygon,
    drones: Sequence[str],
    coverage: Sequence[Swath],
    lane_spacing_m: float,
    starts: Mapping[str, Point2] | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Return a path (M, 2) for each drone, by id; together they cover the part of the area not searched yet. (0, 2) if nothing is
    left.

    Args:
        area: simple polygon to search.
        drones: ids of the active drones, in any order.
        coverage: flown paths with the width that they cover, of any drone, including drones that dropped out.
        lane_spacing_m: largest distance between lanes.
        starts: positions of the drones, known to all drones alike; drones without a position are ordered by id.
    """
    segments = divide(uncovered(area, coverage), drones, starts)
    detours = Detours(area)
    starts = starts or {}
    return {drone: _sweep(segment, lane_spacing_m, starts.get(drone), detours) for drone, segment in segments.items()}


def survey_path(
    area: Polygon,
    rest: Area,
    drone: str,
    drones: Sequence[str],
    lane_spacing_m: float,
    starts: Mapping[str, Point2],
) -> NDArray[np.float64]:
    """Return the search path (M, 2) of one drone, as ``survey_paths`` does, if only ``rest`` of the area is left to search."""
    segment = divide(rest, drones, starts)[drone]
    return _sweep(segment, lane_spacing_m, starts.get(drone), Detours(area))


def divide(area: Area, drones: Sequence[str], starts: Mapping[str, Point2] | None = None) -> dict[str, Area]:
    """Divide an area into segments of equal area, one for each drone, on the side of the area where the drone is.

    Area and swarm are halved recursively, always by the shorter of the two cuts across the sides of the minimum rotated
    rectangle. A segment may consist of several pieces if the area is not convex.
    """
    return dict(sorted(_divide(area, sorted(set(drones)), starts or {})))


def sweep(segment: Area, lane_spacing_m: float, start: Point2 | None = None, within: Area | None = None) -> NDArray[np.float64]:
    """Return a path (M, 2) that passes every point of the segment within half the lane spacing, beginning near ``start``.

    Lanes run back and forth along each piece of the segment. The connections between lanes stay inside ``within`` (default: the
    segment), around its corners if needed.
    """
    return _sweep(segment, lane_spacing_m, start, Detours(segment if within is None else within))


def uncovered(area: Area, coverage: Sequence[Swath]) -> Area:
    """Return the part of the area that no flown path covers, without thin slivers; may be empty.

    coverage: flown paths with the width that each covers. Rounded ends are drawn with chords, so that coverage is never
    overstated.
    """
    return left(area, covered(coverage), min(width for _, width in coverage)) if coverage else area


def covered(coverage: Sequence[Swath]) -> Area:
    """Return the union of the strips that flown paths cover. coverage: flown paths with the width that each covers."""
    flown = [LineString(path) if len(path) > 1 else Point(path[0]) for path, _ in coverage]
    widths = np.array([width for _, width in coverage])
    union: Area = shapely.union_all(shapely.buffer(flown, widths / 2.0, quad_segs=4))
    return union


def left(area: Area, done: Area, swath_m: float) -> Area:
    """Return the part of the area that is not ``done``, without slivers that are thin compared to the width of a strip; may be
    empty.
    """
    if done.is_empty:
        return area
    rest = area.difference(done)
    sliver_m = _SLIVER * swath_m
    found = _opened(rest, sliver_m, 0.02)
    while shapely.get_num_coordinates(found) > MOST_POINTS and sliver_m < swath_m:
        sliver_m *= 2.0
        found = _opened(found, sliver_m, 0.1)
    return _areal(found.intersection(area), least_m2=sliver_m**2)


def _opened(shape: Area, sliver_m: float, tolerance: float) -> Area:
    """Return the shape without parts narrower than ``sliver_m``, simplified with a tolerance of ``tolerance * sliver_m``."""
    opened = shape.buffer(-sliver_m / 2.0, join_style="mitre").buffer(sliver_m / 2.0, join_style="mitre")
    simple: Area = shapely.simplify(opened, tolerance * sliver_m)
    return simple


def _divide(area: Area, drones: list[str], starts: Mapping[str, Point2]) -> list[tuple[str, Area]]:
    if len(drones) < 2 or area.is_empty:
        return [(drone, area) for drone in drones]
    first = len(drones) // 2
    cuts = [(along, *_cut(area, along, first / len(drones))) for along in _axes(area)]
    lengths = [low.length + high.length for _, low, high in cuts]
    along, low, high = cuts[0 if lengths[0] <= _EQUAL * lengths[1] else 1]
    if all(drone in starts for drone in drones):
        drones = sorted(drones, key=lambda drone: (float(np.dot(starts[drone], along)), drone))
    return _divide(low, drones[:first], starts) + _divide(high, drones[first:], starts)


def _axes(area: Area) -> list[NDArray[np.float64]]:
    """Return the unit vectors (2,) along the two sides of the minimum rotated rectangle, that nearer to the x axis first."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(area))
    side = corners[1] - corners[0]
    side = side / np.hypot(side[0], side[1])
    sides = sorted((side, np.array([-side[1], side[0]])), key=lambda along: -abs(float(along[0])))
    return [-along if (along[0], along[1]) < (0.0, 0.0) else along for along in sides]


def _cut(area: Area, along: NDArray[np.float64], share: float) -> tuple[Area, Area]:
    """Return the parts of the area on both sides of a line perpendicular to ``along``; the first has ``share`` of the area."""
    corners = shapely.get_coordinates(area)
    places = corners @ along
    start, end = float(places.min()), float(places.max())
    across = np.array([-along[1], along[0]])
    left, right = float((corners @ across).min()) - 1.0, float((corners @ across).max()) + 1.0

    def side(low: float, high: float) -> Polygon:
        return Polygon([along * x + across * y for x, y in ((low, left), (high, left), (high, right), (low, right))])

    def excess(place: float) -> float:
        if place in (start, end):  # for a line on a side of the area, an intersection can come out empty
            return float(place == end) - share
        return float(area.intersection(side(start - 1.0, place)).area / area.area - share)

    place = brentq(excess, start, end, xtol=1e-9, rtol=1e-12)
    return _areal(area.intersection(side(start - 1.0, place))), _areal(area.intersection(side(place, end + 1.0)))


def _areal(shape: shapely.Geometry, least_m2: float = 0.0) -> Area:
    """Return the polygons of a shape that are larger than ``least_m2``, without stray lines and points."""
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon" and part.area > least_m2]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)


def _sweep(segment: Area, lane_spacing_m: float, start: Point2 | None, detours: Detours) -> NDArray[np.float64]:
    found = [lane for piece in shapely.get_parts(segment) for lane in lanes(piece, lane_spacing_m)]
    if not found:
        return np.empty((0, 2))
    path: list[NDArray[np.float64]] = []
    for number, backward in _order(found, start):
        lane = found[number][::-1] if backward else found[number]
        if path:
            path.append(detours.between(path[-1][-1], lane[0]))
        path.append(lane)
        path = [np.concatenate(path)]
    return path[0]


def _order(found: list[NDArray[np.float64]], start: Point2 | None) -> list[tuple[int, bool]]:
    """Return the order in which to fly the lanes, each with whether it is flown backwards: always the nearest next, from the best
    of several first lanes.
    """
    ends = np.array([[lane[0], lane[-1]] for lane in found]).reshape(-1, 2)  # 2n and 2n + 1: the ends of lane n
    gaps = np.hypot(*(ends[:, None] - ends[None]).transpose(2, 0, 1))
    approach = np.zeros(len(ends)) if start is None else np.hypot(*(ends - start).T)
    outer = {0, 1, len(ends) - 2, len(ends) - 1}  # the ends of the first and of the last lane
    beginnings = sorted(outer | {int(end) for end in np.argsort(approach, kind="stable")[:4]})
    tours = [_nearest_next(gaps, beginning) for beginning in beginnings]
    costs = [approach[tour[0]] + sum(gaps[one ^ 1, other] for one, other in pairwise(tour)) for tour in tours]
    best = tours[int(np.argmin(np.round(costs, 3)))]
    return [(end // 2, bool(end % 2)) for end in best]


def _nearest_next(gaps: NDArray[np.float64], beginning: int) -> list[int]:
    """Return the ends at which the lanes are entered, beginning with ``beginning``, and always the nearest next. A lane entered
    at one end is left at the other one (^ 1). ``gaps``: distances between all ends.
    """
    free = gaps.copy()
    tour = [beginning]
    while True:
        free[:, [tour[-1], tour[-1] ^ 1]] = np.inf
        if len(tour) == len(gaps) // 2:
            return tour
        tour.append(int(np.argmin(free[tour[-1] ^ 1])))
