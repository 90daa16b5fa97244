"""Inputs of the tracker from the planners, and states of the other drones.

All of ``radron.agent.motion`` works in one planning frame, the drone's own local ENU frame: metres, seconds, radians.
"""

from __future__ import annotations

from msgspec import Struct

from radron.agent.geometry import Array, Vector3


class PeerState(Struct, frozen=True):
    """Position (m) and velocity (m/s) of a drone. ``age_s``: age of these data; users extrapolate by it."""

    position: Vector3
    velocity: Vector3 = (0.0, 0.0, 0.0)
    age_s: float = 0.0


class Reference(Struct, frozen=True):
    """The positions where a drone should be at the times 0, step_s, 2 step_s, ... from now, K + 1 in all; they need not be
    feasible.

    positions: (K + 1, 3) m; velocities: (K + 1, 3) m/s.
    """

    positions: Array
    velocities: Array
    step_s: float
