"""The demands of a mission on the autopilot of one drone."""

from __future__ import annotations

from math import hypot

from msgspec import Struct

from radron.agent.config.drone import DroneConfig, VehicleConfig
from radron.agent.config.mission import MissionConfig


class Demands(Struct, frozen=True):
    """The values that a mission requires of the autopilot of one drone; without a mission only the ceiling.

    vehicle: connection of the autopilot. agent_lost: the autopilot's reaction to a lost agent, as the other drones expect it
    (return, land, hold; None: any reaction). return_height_m: height of the autopilot's return, above the launch place (None: as
    set in the autopilot); sets: the agent sets this height. farthest_m: distance from the launch place to the farthest point of
    the mission.
    """

    vehicle: VehicleConfig
    ceiling_m: float
    agent_lost: str | None = None
    return_height_m: float | None = None
    sets: bool = False
    farthest_m: float = 0.0
    speed_mps: float = 0.0
    climb_mps: float = 0.0
    acceleration_mps2: float = 0.0


def demands_of(mission: MissionConfig, drone: DroneConfig, *, sets: bool) -> Demands:
    """Return the values that a mission requires of the autopilot of one of its drones.

    sets: whether the agent sets the height of the return.
    """
    area, limits, vehicle = mission.area, mission.limits, drone.vehicle
    x0, y0, *_ = mission.member(drone.id).origin_m
    return Demands(
        vehicle,
        area.ceiling_m,
        agent_lost=mission.safety.agent_lost,
        return_height_m=mission.return_height_m(drone.id),
        sets=sets,
        farthest_m=max(hypot(x - x0, y - y0) for x, y in area.polygon_m) + area.fence_margin_m,
        speed_mps=limits.speed_mps,
        climb_mps=limits.climb_mps,
        acceleration_mps2=limits.acceleration_mps2,
    )
