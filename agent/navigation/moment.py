"""Inputs of one step of the navigator, and the centre of the circle around the source."""

from __future__ import annotations

from msgspec import Struct

from radron.agent.fusion.estimator import Hypothesis
from radron.agent.geometry import Point2, Vector3
from radron.agent.motion.reference import PeerState
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.messages import Stage

STEP_S = 0.2  # time step of plans
HORIZON = 20  # number of steps of a plan
_OLDEST_S = 1.0  # telemetry is extrapolated for at most this long


class Moment(Struct, frozen=True):
    """Inputs of one step of the navigator.

    now_ns: own time. stage: present stage, begun at ``since_ns``. vehicle: newest telemetry, local frame.
    hypothesis: source estimate, mission frame, stamped in own time; None without one.
    took_part_ns: begin of the present, unbroken time in which this drone takes off, searches or tracks; else without meaning.
    """

    now_ns: int
    stage: Stage
    since_ns: int
    vehicle: VehicleState
    hypothesis: Hypothesis | None
    took_part_ns: int = 0

    @property
    def stage_s(self) -> float:
        """Time (s) since the begin of the present stage."""
        return (self.now_ns - self.since_ns) * 1e-9

    @property
    def here(self) -> PeerState:
        """Position and velocity of the vehicle now, local frame: the newest telemetry, extrapolated for at most a second.

        Planning goes on without new telemetry, because the vehicle flies on, and other drones come nearer.
        """
        (x, y, z), (u, v, w) = self.vehicle.position_m, self.vehicle.velocity_mps
        age_s = min(1e-9 * (self.now_ns - self.vehicle.stamp_ns), _OLDEST_S)
        return PeerState((x + age_s * u, y + age_s * v, z + age_s * w), (u, v, w))


class Centre(Struct, frozen=True):
    """Position (m) and velocity (m/s) of the circle's centre, the source as this drone's localisation sees it; local frame.

    ``in_mission``: the same in the mission frame, horizontal.
    """

    position: Vector3
    velocity: Vector3
    in_mission: tuple[Point2, Point2]
