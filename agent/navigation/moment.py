"""The inputs of a navigation step."""

from __future__ import annotations

from msgspec import Struct

from radron.agent.fusion.estimator import Hypothesis
from radron.agent.geometry import Point2, Vector3
from radron.agent.motion.reference import PeerState
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.messages import Stage

STEP_S = 0.2  # of the tracker's horizon
HORIZON = 20
_OLDEST_S = 1.0  # limit of the prediction from older telemetry


class Moment(Struct, frozen=True):
    """``since_ns``: begin of the stage; ``hypothesis``: mission frame, stamped in own time; ``took_part_ns``: begin of this
    drone's participation without a break; without meaning outside of it.
    """

    now_ns: int
    stage: Stage
    since_ns: int
    vehicle: VehicleState
    hypothesis: Hypothesis | None
    took_part_ns: int = 0

    @property
    def stage_s(self) -> float:
        """Duration of the stage so far."""
        return (self.now_ns - self.since_ns) * 1e-9

    @property
    def here(self) -> PeerState:
        """Position and velocity of the vehicle now, local frame. Prediction goes on without telemetry: the vehicle flies on, and
        other drones come nearer.
        """
        (x, y, z), (u, v, w) = self.vehicle.position_m, self.vehicle.velocity_mps
        age_s = min(1e-9 * (self.now_ns - self.vehicle.stamp_ns), _OLDEST_S)
        return PeerState((x + age_s * u, y + age_s * v, z + age_s * w), (u, v, w))


class Centre(Struct, frozen=True):
    """Position and velocity of the source now, in the local frame, as seen by this drone's localisation.

    ``in_mission``: the same in the mission frame, horizontal.
    """

    position: Vector3
    velocity: Vector3
    in_mission: tuple[Point2, Point2]
