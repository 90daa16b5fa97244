"""Outlines on the map: circles, cordons, and the ellipse that contains a source with a probability of 90 %."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from radron.station.picture.dose import HEIGHT_M, rate_usvph
from radron.station.picture.frame import Point, SourceFrame

CORDON_USVPH = 10.0


def region(source: SourceFrame, points: int = 48) -> list[Point]:
    """Return the outline of the ellipse that contains the source with a probability of 90 %; closed, mission frame."""
    long_m, short_m, turn = source.region
    angles = np.linspace(0.0, 2.0 * np.pi, points + 1)
    u, v = long_m * np.cos(angles), short_m * np.sin(angles)
    x, y = source.place[0] + u * np.cos(turn) - v * np.sin(turn), source.place[1] + u * np.sin(turn) + v * np.cos(turn)
    return [(float(px), float(py)) for px, py in zip(x, y, strict=True)]


def circle(middle: Sequence[float], radius_m: float, points: int = 72) -> list[Point]:
    """Return the points of a closed circle; mission frame, metres."""
    angles: NDArray[np.float64] = np.linspace(0.0, 2.0 * np.pi, points + 1)
    return [(middle[0] + radius_m * float(np.cos(a)), middle[1] + radius_m * float(np.sin(a))) for a in angles]


def cordon_radius_m(nuclide: str, activity_bq: float | None, level_usvph: float = CORDON_USVPH) -> float | None:
    """Return the ground distance (m) from a source within which the dose rate at 1 m height exceeds a level.

    ``level_usvph``: the level in uSv/h. Return None if it is exceeded nowhere, or if the activity is unknown.
    """
    at_one = rate_usvph(nuclide, activity_bq) if activity_bq is not None else None
    if at_one is None or at_one / HEIGHT_M**2 <= level_usvph:
        return None
    return math.sqrt(at_one / level_usvph - HEIGHT_M**2)
