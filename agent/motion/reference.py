"""Reference path of a drone, the input of its tracker, and the state of a drone.

All of ``radron.agent.motion`` works in one planning frame, the drone's own local ENU frame: metres, seconds, radians.
"""

from __future__ import annotations

from msgspec import Struct

from radron.agent.geometry import Array, Vector3


class PeerState(Struct, frozen=True):
    """Position (m) and velocity (m/s) of a drone. ``age_s``: age of these data, over which users extrapolate them."""

    position: Vector3
    velocity: Vector3 = (0.0, 0.0, 0.0)
    age_s: float = 0.0


class Reference(Struct, frozen=True):
    """Wanted path of a drone: positions (m) and velocities (m/s), (K + 1, 3) each, at the times 0, step_s, 2 step_s, ... from
    now. The vehicle need not be able to fly it; the tracker makes a plan from it.
    """

    positions: Array
    velocities: Array
    step_s: float
