"""Cameras turned against their drone's heading: a wrong ``camera_rpy_deg``, a bent mount, a wrong compass.

The heading's bias of a track follows the cones of the last ten seconds or so, within the localisation's stated error. A turn of
the mount stays, and is larger. Let g be the derivative of a cone's log likelihood by the heading's bias, at the track. The sums U
of g and J of g^2 over a vehicle's cones give the score test [Rao 1948]: without a turn U / sqrt(J) ~ N(0, 1). U / J estimates the
turn, to first order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

_MIN_SIGMAS = 5.0
_MIN_TURN_DEG = 4.0  # above the errors of compasses and SLAM
_MEMORY_CONES = 500.0

Turns = Mapping[int, tuple[float, float]]  # by vehicle: U and J, faded


def with_score(turns: Turns, vehicle: int, score: float) -> Turns:
    """Add one more cone of a vehicle to the test for a camera that is turned on its vehicle, and return the sums by vehicle.

    score: derivative of the cone's log likelihood by the vehicle's heading error, per radian.
    """
    total, information = turns.get(vehicle, (0.0, 0.0))
    keep = 1.0 - 1.0 / _MEMORY_CONES
    return {**turns, vehicle: (keep * total + score, keep * information + score * score)}


def turned_deg(turns: Turns, vehicle: int) -> float | None:
    """Return the angle (degrees) by which a vehicle's cones are turned to the left of its heading; None if it is not certain."""
    total, information = turns.get(vehicle, (0.0, 0.0))
    if total * total < _MIN_SIGMAS**2 * information or information == 0.0:
        return None
    turn_deg = math.degrees(total / information)
    return turn_deg if abs(turn_deg) >= _MIN_TURN_DEG else None
