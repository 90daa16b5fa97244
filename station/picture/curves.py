"""Compton cones as curves on the ground."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from shapely import get_coordinates, linestrings, simplify

from radron.agent.fusion.observation import ConeObservation
from radron.agent.terrain.ground import Ground
from radron.station.picture.frame import Point

REACH_M = 150.0  # curves farther away are of no use to an operator
DETAIL_M = 0.1  # largest deviation of a drawn curve from the computed curve
_RAYS = 72
_ANGLES = np.linspace(0.0, 2.0 * np.pi, _RAYS + 1)
_TURN = np.column_stack((np.cos(_ANGLES), np.sin(_ANGLES)))


def ground_curves(cone: ConeObservation, ground: Ground, reach_m: float = REACH_M) -> tuple[tuple[Point, ...], ...]:
    """Return the curves on the ground from which the photon of a Compton cone may have come, for the map.

    Of the cone's two possible readings, the more probable one is intersected with the ground, up to the horizontal distance
    ``reach_m``. Each curve has at least two points. The ground is taken as level at its height below the camera, which is
    sufficient for a line on a map.
    """
    reading = cone.probable
    x, y, z = reading.apex
    drop = ground.height_m(x, y) - z
    rays = _rays(reading.axis, reading.theta_rad)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = drop / rays[:, 2]
    reached = np.isfinite(along) & (along > 0.0)
    hits = rays[:, :2] * np.where(reached, along, 0.0)[:, None]
    reached &= np.hypot(hits[:, 0], hits[:, 1]) <= reach_m
    return tuple(_pieces(hits + np.array((x, y)), reached))


def _rays(axis: tuple[float, float, float], theta_rad: float) -> NDArray[np.float64]:
    """Directions (R, 3) on the cone's surface, once around and back to the first."""
    length = math.hypot(*axis)
    x, y, z = (part / length for part in axis)
    # Two unit vectors normal to the axis, by the cross product with x or y, whichever is farther from the axis.
    u, v, w = (0.0, z, -y) if abs(x) < 0.9 else (-z, 0.0, x)
    far = math.hypot(u, v, w)
    u, v, w = u / far, v / far, w / far
    frame = np.array(((u, v, w), (y * w - z * v, z * u - x * w, x * v - y * u)))
    rays: NDArray[np.float64] = math.sin(theta_rad) * (_TURN @ frame)
    rays += np.array((x, y, z)) * math.cos(theta_rad)
    return rays


def _pieces(places: NDArray[np.float64], reached: NDArray[np.bool_]) -> Iterator[tuple[Point, ...]]:
    """Yield runs of at least two reached places, simplified to ``DETAIL_M``."""
    edges = np.flatnonzero(np.diff(reached, prepend=False, append=False)).tolist()
    for first, behind in zip(edges[::2], edges[1::2], strict=True):
        if behind - first > 1:
            needed = get_coordinates(simplify(linestrings(places[first:behind]), DETAIL_M, preserve_topology=False))
            yield tuple((x, y) for x, y in np.round(needed, 2).tolist())
