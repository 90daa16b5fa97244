"""The launch places of a mission, apart from each other."""

from __future__ import annotations

from itertools import combinations
from math import hypot

from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.agent.errors import ConfigError


def check_launch_places(mission: MissionConfig, where: str) -> None:
    """Check that all drones are launched at a safe distance from each other, as far as the mission knows their places.

    Raises:
        ConfigError: two drones are launched closer than they may fly; ``where`` (the file's name) begins the text.
    """
    for one, other in combinations(mission.drones, 2):
        apart_m = hypot(one.origin_m[0] - other.origin_m[0], one.origin_m[1] - other.origin_m[1])
        known = _sigma_m(one) + _sigma_m(other) < mission.limits.separation_m
        if known and apart_m < mission.limits.separation_m:
            raise ConfigError(
                f"{where}: drones: {one.id} and {other.id} are launched {apart_m:.1f} m apart, which is less than "
                f"limits.separation_m = {mission.limits.separation_m:g}; correct their origin_m"
            )


def _sigma_m(drone: DroneInMission) -> float:
    return 0.0 if drone.is_exact else drone.origin_sigma_m
