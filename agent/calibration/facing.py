"""Facings: directions of the known source, as the vehicle stands to it."""

from __future__ import annotations

import math

from msgspec import Struct

from radron.agent.errors import ConfigError
from radron.agent.geometry import Vector3

MIN_FACINGS = 3
MIN_APART_DEG = 20.0  # facings nearer to each other leave a rotation about them undetermined


class Facing(Struct, frozen=True):
    """A direction of the source from the camera, in the vehicle's axes, degrees.

    bearing_deg: clockwise from the nose, seen from above. elevation_deg: above the horizon of the vehicle, negative below.
    """

    bearing_deg: float
    elevation_deg: float = 0.0

    @property
    def direction(self) -> Vector3:
        """Unit vector to the source in the body frame (FLU: forward, left, up)."""
        bearing, elevation = math.radians(self.bearing_deg), math.radians(self.elevation_deg)
        return (
            math.cos(elevation) * math.cos(bearing),
            -math.cos(elevation) * math.sin(bearing),
            math.sin(elevation),
        )

    def __str__(self) -> str:
        return f"bearing {self.bearing_deg:g} deg, elevation {self.elevation_deg:g} deg"


def parse_facing(text: str) -> Facing:
    """Parse a direction of the source from ``BEARING`` or ``BEARING,ELEVATION`` in degrees.

    Raises:
        ConfigError: not such numbers, or out of range.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not abs(numbers[0]) <= 360.0 or not all(abs(number) <= 90.0 for number in numbers[1:]):
        raise ConfigError(
            f"--facing {text!r}: expected BEARING or BEARING,ELEVATION of the source in degrees, clockwise from the nose and "
            "above the vehicle's horizon, such as 30,-20"
        )
    return Facing(*numbers)


def check_facings(facings: list[Facing]) -> None:
    """Raise ConfigError if the directions are too few, or too near to each other, to determine the camera's orientation."""
    if len(facings) < MIN_FACINGS:
        raise ConfigError(f"{len(facings)} facings of the source; at least {MIN_FACINGS} are needed: turn the drone in between")
    closest = min(
        math.degrees(math.acos(min(1.0, sum(a * b for a, b in zip(one.direction, other.direction, strict=True)))))
        for place, one in enumerate(facings)
        for other in facings[:place]
    )
    if closest < MIN_APART_DEG:
        raise ConfigError(
            f"two facings are {closest:.0f} deg apart; at least {MIN_APART_DEG:g} deg are needed to find the camera's orientation"
        )
