"""Limits of a mission's sizes by vehicles and positions, and of its heights by floor and ceiling."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from radron.agent.errors import ConfigError

if TYPE_CHECKING:
    from radron.agent.config.mission import MissionConfig

MIN_SEPARATION_M, MAX_SEPARATION_M = 1.0, 100.0  # below it, the vehicles' own size and the errors of their positions decide
MIN_RADIUS_M, MAX_RADIUS_M = 1.0, 1000.0  # of a circle around a source
MIN_SPEED_MPS, MAX_SPEED_MPS = 0.1, 50.0
MAX_FENCE_MARGIN_M = 1000.0
MAX_NAME = 200  # letters
_LIMITS = {
    ("limits", "separation_m"): (MIN_SEPARATION_M, MAX_SEPARATION_M),
    ("limits", "speed_mps"): (MIN_SPEED_MPS, MAX_SPEED_MPS),
    ("encirclement", "radius_m"): (MIN_RADIUS_M, MAX_RADIUS_M),
    ("encirclement", "nearest_m"): (MIN_RADIUS_M, MAX_RADIUS_M),
    ("area", "fence_margin_m"): (0.0, MAX_FENCE_MARGIN_M),
}


def check_sizes(mission: MissionConfig, where: str) -> None:
    """Raise ConfigError if a distance, speed or height of the mission is outside its limits; ``where`` (the file's name) begins
    the text.

    These limits apply to flights only; the wider limits of the keys' types also hold for flight records of any age.
    """
    for (section, key), (least, most) in _LIMITS.items():
        value = getattr(getattr(mission, section), key)
        if not least <= value <= most:
            raise ConfigError(f"{where}: {section}.{key} = {value:g} is outside {least:g} .. {most:g}")
    area = mission.area
    if area.floor_m >= area.ceiling_m:
        raise ConfigError(f"{where}: area.floor_m must be below area.ceiling_m")
    heights = {"survey.height_m": mission.survey.height_m, "encirclement.height_m": mission.encirclement.height_m}
    if mission.survey.low_height_m is not None:
        heights["survey.low_height_m"] = mission.survey.low_height_m
    for key, height in heights.items():
        if not area.floor_m <= height <= area.ceiling_m:
            raise ConfigError(
                f"{where}: {key} = {height:g} is outside area.floor_m .. area.ceiling_m ({area.floor_m:g} .. {area.ceiling_m:g})"
            )


def check_names(mission: MissionConfig, where: str) -> None:
    """Raise ConfigError for a mission name that is not one line of text, and for a file outside the mission file's folder."""
    if len(mission.name) > MAX_NAME or not mission.name.isprintable():
        raise ConfigError(f"{where}: name: give one line of at most {MAX_NAME} letters: reports, maps and terminals show it")
    responses = [(f"drones: {drone.id}: response", drone.response) for drone in mission.drones]
    for key, name in (("ground.grid", mission.ground.grid), ("buildings.file", mission.buildings.file), *responses):
        if name is not None and (Path(name).name != name or name == ".."):
            raise ConfigError(f"{where}: {key} = {name!r}: give the bare name of a file in the mission file's folder")
