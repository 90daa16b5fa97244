"""Shapes of detectors: upright or lying cylinders and boxes, centred on the origin; lengths in cm.

A shape is an array (4,): kind (``BOX`` or ``CYLINDER``) and half sizes. Of a box: x, y, z. Of a cylinder: radius, unused, half
length along z.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation._jit import jit

FloatArray = NDArray[np.float64]

BOX, CYLINDER = 0.0, 1.0
_NEVER = 1e9


def box(x_cm: float, y_cm: float, z_cm: float) -> FloatArray:
    """Return the shape of a box with these full sizes, cm."""
    return np.array([BOX, 0.5 * x_cm, 0.5 * y_cm, 0.5 * z_cm])


def cylinder(diameter_cm: float, length_cm: float) -> FloatArray:
    """Return the shape of a cylinder, cm."""
    return np.array([CYLINDER, 0.5 * diameter_cm, 0.5 * diameter_cm, 0.5 * length_cm])


@jit
def crossing(position: FloatArray, direction: FloatArray, shape: FloatArray) -> tuple[float, float]:
    """Return the distances at which a line enters and leaves a shape, cm; the second is not above the first if it misses.

    position, direction: (3,) a point of the line and its unit vector.
    """
    enter, leave = -_NEVER, _NEVER
    first = 0
    if shape[0] == CYLINDER:
        first = 2
        a = direction[0] ** 2 + direction[1] ** 2
        b = position[0] * direction[0] + position[1] * direction[1]
        c = position[0] ** 2 + position[1] ** 2 - shape[1] ** 2
        if a < 1e-14:
            if c > 0.0:
                return 0.0, 0.0
        else:
            root = b * b - a * c
            if root <= 0.0:
                return 0.0, 0.0
            enter, leave = (-b - math.sqrt(root)) / a, (-b + math.sqrt(root)) / a
    for axis in range(first, 3):
        half, speed = shape[1 + axis], direction[axis]
        if abs(speed) < 1e-12:
            if abs(position[axis]) > half:
                return 0.0, 0.0
            continue
        one, other = (-half - position[axis]) / speed, (half - position[axis]) / speed
        enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
    return enter, leave


@jit
def beam(cosine: float, radius: float, rng: np.random.Generator, position: FloatArray, direction: FloatArray) -> None:
    """Draw a ray of a parallel beam over a disc of this radius (cm) about the origin, perpendicular to it.

    cosine: of the angle between the way to the source and straight down; the azimuth is random. position, direction: (3,) get a
    point on the disc and the direction of flight.
    """
    sine, azimuth = math.sqrt(max(0.0, 1.0 - cosine * cosine)), 2.0 * math.pi * rng.random()
    ca, sa = math.cos(azimuth), math.sin(azimuth)
    direction[0], direction[1], direction[2] = -sine * ca, -sine * sa, cosine  # from a source below: upward
    r, turn = radius * math.sqrt(rng.random()), 2.0 * math.pi * rng.random()
    p, q = r * math.cos(turn), r * math.sin(turn)
    position[0] = p * cosine * ca - q * sa
    position[1] = p * cosine * sa + q * ca
    position[2] = p * sine


def bounding_radius(shape: FloatArray) -> float:
    """Return the radius of a sphere about the origin that encloses the shape, cm."""
    if shape[0] == CYLINDER:
        return math.hypot(shape[1], shape[3])
    return math.sqrt(float(shape[1] ** 2 + shape[2] ** 2 + shape[3] ** 2))
