"""Walls of concrete between source and cameras: how much concrete a straight line passes. They stop photons, not vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import Annotated

from msgspec import Meta, Struct

from agent.config import Point2
from agent.errors import ConfigError

Vector3 = tuple[float, float, float]


class WallTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An upright wall on the ground; ``from_m``, ``to_m``: the ends of its middle line, mission frame."""

    from_m: Point2
    to_m: Point2
    thickness_m: Annotated[float, Meta(gt=0.0, le=100.0)] = 0.2
    height_m: Annotated[float, Meta(gt=0.0, le=1000.0)] = 2.5

    def check(self, where: str) -> None:
        """Raise ConfigError where it has no length."""
        if self.from_m == self.to_m:
            raise ConfigError(f"{where}: walls: from_m and to_m are both {list(self.from_m)}; give two different ends")

    def crossed_m(self, start: Vector3, end: Vector3) -> float:
        """Length of the part of a straight line, from start to end, that lies in the wall."""
        (west, south), (east, north) = self.from_m, self.to_m
        length = hypot(east - west, north - south)
        ux, uy = (east - west) / length, (north - south) / length
        dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
        rx, ry = start[0] - 0.5 * (west + east), start[1] - 0.5 * (south + north)
        enters, leaves = 0.0, 1.0
        for place, way, low, high in (
            (rx * ux + ry * uy, dx * ux + dy * uy, -0.5 * length, 0.5 * length),
            (ry * ux - rx * uy, dy * ux - dx * uy, -0.5 * self.thickness_m, 0.5 * self.thickness_m),
            (start[2], dz, 0.0, self.height_m),
        ):
            if way == 0.0:
                if not low <= place <= high:
                    return 0.0
                continue
            one, other = (low - place) / way, (high - place) / way
            enters, leaves = max(enters, min(one, other)), min(leaves, max(one, other))
        return max(0.0, leaves - enters) * hypot(dx, dy, dz)


def concrete_m(walls: Sequence[WallTruth], start: Vector3, end: Vector3) -> float:
    """Length of concrete on a straight line; where walls overlap, it counts for each."""
    return sum(wall.crossed_m(start, end) for wall in walls)
