"""What the planners of a drone's motion hand to its tracker, and what they know of the other drones.

All of ``agent.motion`` works in one planning frame, the drone's own local ENU: metres, seconds, radians.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]


class PeerState(Struct, frozen=True):
    """Where a drone is and how it moves. ``age_s``: how long ago that was true; consumers extrapolate by it."""

    position: Vector3
    velocity: Vector3 = (0.0, 0.0, 0.0)
    age_s: float = 0.0


class Reference(Struct, frozen=True):
    """Where a drone should be at the times 0, step_s, 2 step_s, ... from now; it need not be feasible.

    positions: (K + 1, 3) m; velocities: (K + 1, 3) m/s.
    """

    positions: Array
    velocities: Array
    step_s: float
