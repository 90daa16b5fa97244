"""Lanes that cover one connected part of an area: every point is within half the lane spacing of some lane.

The part is cut into parallel slabs, as wide as the lane spacing, and each slab into cells in which each cross-section is one
interval. The lane of a cell runs along the middle of the slab, or, where the cell does not reach the middle, along its edge next
to it. So every point of a cross-section is within half a slab of the lane. Adjoining cells share one lane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

_EPS_M = 1e-6


@dataclass(slots=True)
class _OpenLane:
    """Lane that is not finished yet in the scan along a slab. ``low``, ``high``: cross-section of its cell at the right end."""

    low: float
    high: float
    points: list[tuple[float, float]] = field(default_factory=list)


def lanes(piece: Polygon, spacing_m: float) -> list[NDArray[np.float64]]:
    """Return parallel lanes that cover a polygon (holes allowed), along the direction that needs the fewest.

    Args:
        piece: connected area, metres.
        spacing_m: largest distance between lanes; they are evenly spaced.

    Returns:
        Polylines (P, 2) of P points within ``piece``, strip by strip; P = 1 if a corner needs only a visit.
    """
    along = _lane_direction(piece, spacing_m)
    rotation = np.array([along, (-along[1], along[0])])  # rows: along the lanes, across them
    turned = shapely.transform(piece, lambda points: points @ rotation.T)
    left, bottom, right, top = turned.bounds
    count = max(1, math.ceil((top - bottom) / spacing_m - 1e-6))
    edges = np.linspace(bottom, top, count + 1)
    slabs = shapely.intersection(turned, shapely.box(left - 1.0, edges[:-1], right + 1.0, edges[1:]))
    found = []
    for slab, low, high in zip(slabs, edges[:-1], edges[1:], strict=True):
        for cell in shapely.get_parts(slab):
            if cell.geom_type == "Polygon":
                found += [lane @ rotation for lane in _lanes_of_slab(cell, 0.5 * (low + high))]
    return found


def _lane_direction(piece: Polygon, spacing_m: float) -> NDArray[np.float64]:
    """Return the unit vector (2,) along the lanes: along the edge across which the part is narrowest; of equal ones, that nearest
    to the x axis.

    Edges shorter than the spacing count only if all are: short edges approximate the rounded ends of covered strips.
    """
    corners = shapely.get_coordinates(piece.exterior)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    long = lengths >= min(spacing_m, lengths.max())
    along = steps[long] / lengths[long, None]
    across = corners @ np.column_stack([-along[:, 1], along[:, 0]]).T
    widths = np.ptp(across, axis=0)
    equal = widths <= 1.001 * widths.min() + _EPS_M
    best: NDArray[np.float64] = along[np.argmax(np.where(equal, np.abs(along[:, 0]), -1.0))]
    return best if best[0] >= 0.0 else -best


def _lanes_of_slab(cell: Polygon, middle: float) -> list[NDArray[np.float64]]:
    """Return the lanes of one connected part of a slab; lanes run along x, cross-sections along y. ``middle``: y of the slab's
    middle.
    """
    segments = _edges(cell)
    stops = _distinct(segments[:, :, 0].ravel())
    done: list[_OpenLane] = []
    open_lanes: list[_OpenLane] = []
    for start, end in pairwise(stops):
        sections = _sections(segments, start, end)
        continued = [_follow(lane, sections, open_lanes) for lane in open_lanes]
        done += [lane for lane, section in zip(open_lanes, continued, strict=True) if section is None]
        lane_of = {section: lane for lane, section in zip(open_lanes, continued, strict=True) if section is not None}
        open_lanes = []
        for number, (low, high) in enumerate(sections):
            lane = lane_of.get(number) or _OpenLane(0.0, 0.0)
            lane.points += _along(start, end, low, high, middle)
            lane.low, lane.high = low[1], high[1]
            open_lanes.append(lane)
    return [_thinned(lane.points) for lane in done + open_lanes]


def _edges(cell: Polygon) -> NDArray[np.float64]:
    """Return all edges except vertical ones, (M, 2, 2), each from left to right."""
    rings = [shapely.get_coordinates(ring) for ring in (cell.exterior, *cell.interiors)]
    segments = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings])
    segments = segments[np.abs(segments[:, 1, 0] - segments[:, 0, 0]) > _EPS_M]
    backward = segments[:, 0, 0] > segments[:, 1, 0]
    segments[backward] = segments[backward][:, ::-1]
    kept: NDArray[np.float64] = segments
    return kept


def _distinct(values: NDArray[np.float64]) -> list[float]:
    ordered = np.unique(values)
    keep = np.concatenate([[True], np.diff(ordered) > _EPS_M]) if len(ordered) else np.zeros(0, dtype=bool)
    return [float(value) for value in ordered[keep]]


_Section = tuple[tuple[float, float], tuple[float, float]]  # lower edge at start and end, upper edge at start and end


def _sections(segments: NDArray[np.float64], start: float, end: float) -> list[_Section]:
    """Return the intervals of the cross-section between neighbouring corners at x = ``start`` and ``end``, in ascending order."""
    half = 0.5 * (start + end)
    spanning = segments[(segments[:, 0, 0] <= half) & (segments[:, 1, 0] > half)]
    x = np.clip(np.array([[start, half, end]]), spanning[:, 0, :1], spanning[:, 1, :1])
    slope = (spanning[:, 1, 1] - spanning[:, 0, 1]) / (spanning[:, 1, 0] - spanning[:, 0, 0])
    y = spanning[:, 0, 1:] + (x - spanning[:, 0, :1]) * slope[:, None]
    rows = y[np.argsort(y[:, 1], kind="stable")].tolist()
    return [((low[0], low[2]), (high[0], high[2])) for low, high in zip(rows[::2], rows[1::2], strict=False)]


def _follow(lane: _OpenLane, sections: list[_Section], open_lanes: list[_OpenLane]) -> int | None:
    """Return the index of the section that continues a lane; None if the lane ends, splits, or merges with another one."""
    meeting = [number for number, section in enumerate(sections) if _meets(lane, section)]
    if len(meeting) != 1 or sum(_meets(other, sections[meeting[0]]) for other in open_lanes) != 1:
        return None
    return meeting[0]


def _meets(lane: _OpenLane, section: _Section) -> bool:
    return min(lane.high, section[1][0]) - max(lane.low, section[0][0]) > _EPS_M


def _along(
    start: float, end: float, low: tuple[float, float], high: tuple[float, float], middle: float
) -> list[tuple[float, float]]:
    """Return the points of a lane from x = ``start`` to ``end``: on the middle of the slab, limited to the section."""
    fractions = [0.0, 1.0]
    for first, last in (low, high):
        if (first - middle) * (last - middle) < 0.0:
            fractions.append((middle - first) / (last - first))
    return [
        (
            start + f * (end - start),
            min(max(middle, low[0] + f * (low[1] - low[0])), high[0] + f * (high[1] - high[0])),
        )
        for f in sorted(fractions)
    ]


def _thinned(points: list[tuple[float, float]]) -> NDArray[np.float64]:
    """Return the polyline without repeated and collinear points."""
    line: NDArray[np.float64] = np.array(points)
    far = np.concatenate([[True], np.abs(np.diff(line, axis=0)).max(axis=1) > _EPS_M])
    line = line[far]
    if len(line) < 3:
        return line
    before, after = np.diff(line, axis=0)[:-1], np.diff(line, axis=0)[1:]
    bend = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    turns = bend > _EPS_M * np.hypot(*before.T) * np.hypot(*after.T)
    thinned: NDArray[np.float64] = line[np.concatenate([[True], turns, [True]])]
    return thinned
