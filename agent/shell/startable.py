"""Checks of the files alone before a flight, shared by ``run`` and the preflight check, so that both always agree."""

from __future__ import annotations

from radron.agent.config.drone import DroneConfig
from radron.agent.config.launchplaces import check_launch_places
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.fusion.registry import check_estimator
from radron.agent.terrain.ground import Ground
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText


def check_for_drone(mission: MissionConfig, drone: str, where: str) -> None:
    """Check by its files that a mission can be flown, and names this drone.

    Raises:
        ConfigError: an unknown estimator, unusable launch places or ground model, or a mission
            without this drone; ``where`` (the file's name) begins the text.
    """
    check_estimator(mission.fusion.estimator, f"{where}: fusion.estimator")
    check_launch_places(mission, where)
    Ground.from_config(mission)  # an unusable elevation grid is an error now, not when the pilot needs it
    ids = [member.id for member in mission.drones]
    if drone not in ids:
        raise ConfigError(f"drone {drone!r} is not in {where}; its drones are {', '.join(ids)}")


def camera_missing(drone: DroneConfig, mission: MissionConfig) -> CodedText | None:
    """Return the reason why this drone cannot search, if the mission needs a camera and none is configured; else None."""
    if drone.detector.driver != "none" or mission.fusion.estimator == "given":
        return None
    text = 'no camera (detector.driver = "none"): this drone measures nothing and cannot search'
    return CodedText(Code.CAMERA_MISSING, text)
