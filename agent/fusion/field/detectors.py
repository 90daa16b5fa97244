"""Detectors whose counts the map of contaminated ground explains, by the mission: cameras, ordinary detectors, or both."""

from __future__ import annotations

from functools import cache

from radron.agent.config.mission import MissionConfig
from radron.agent.config.responses import ResponseTable
from radron.agent.errors import ConfigError
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.field.kernel import AnyDetector, Detector, MiniPix, Mixed
from radron.agent.fusion.ordinary import OrdinaryCounts


def detector_of(mission: MissionConfig) -> AnyDetector:
    """Return the detectors of a mission's drones.

    Raises:
        ConfigError: ordinary detectors are not over soil, the tables of counts lack the nuclide, or the mission names several.
    """
    nuclide, ground = mission.named(), mission.fusion.ground
    tables = {drone.id: mission.table(drone.id) for drone in mission.drones}
    if ground != "soil" and any(tables.values()):
        raise ConfigError("fusion.ground: ordinary detectors need 'soil', whose scattered photons their expected counts include")

    @cache
    def made(table: ResponseTable | None) -> Detector:
        return MiniPix(response_of(nuclide, ground)) if table is None else OrdinaryCounts(table, nuclide)

    each = tuple(made(table) for table in tables.values())
    return each[0] if len(set(map(id, each))) == 1 else Mixed(tuple(tables), each)
