"""Orientation of a camera's sensor face to a source: f, the cosine of the angle to the face's normal.

Assumption: the camera looks along the drone's x axis, either way, as entries do not state its mounting. With psi its heading,
only the means C of cos 2 psi and S of sin 2 psi in an exposure are known (``CountObservation.facing``). f is the root mean square
of a level camera.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from radron.agent.geometry import Array

MEAN_FACING = 0.565  # mean of f over all headings, the source 5 to 45 degrees below the horizon
MEAN_STEEPNESS = 0.41  # mean of the sine of that angle


class Facing(NamedTuple):
    """How far a camera's sensor faces a source: f, the cosine of the angle between the sensor's normal and the direction to the
    source.

    square: f^2. ahead, aside: derivatives of d^2 f^2 by x and y of the vector from the camera to the source, d the distance.
    """

    square: Array
    ahead: Array
    aside: Array

    def cosine(self, least: float = 0.0) -> Array:
        """Return the cosine f between the sensor's normal and the direction to the source, with a lower limit: (f^2 +
        least^2)^(1/2).
        """
        result: Array = np.sqrt(np.maximum(self.square, 0.0) + least * least)
        return result

    @staticmethod
    def of(x: Array, y: Array, distance: Array, twice_cos: Array | float, twice_sin: Array | float) -> Facing:
        """Return f^2 and its derivatives for a source at the horizontal vector (x, y) from the camera, and at the distance d:

            f^2 = (x^2 + y^2 + C (x^2 - y^2) + 2 S x y) / 2 d^2.

        twice_cos, twice_sin: C and S, means of cos 2 psi and sin 2 psi over the exposure, psi the camera's heading. Metres,
        mission frame; arrays of any shapes.
        """
        ahead, aside = x + twice_cos * x + twice_sin * y, y - twice_cos * y + twice_sin * x
        return Facing(0.5 / distance**2 * (x * ahead + y * aside), ahead, aside)
