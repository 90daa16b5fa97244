"""The detector whose counts the map of contaminated ground explains, by the mission: cameras, or ordinary detectors of one table."""

from __future__ import annotations

from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.fusion.bayes.response import response_of
from radron.agent.fusion.field.kernel import Detector, MiniPix
from radron.agent.fusion.ordinary import OrdinaryCounts


def detector_of(mission: MissionConfig) -> Detector:
    """Return the detector of all drones of a mission.

    Raises:
        ConfigError: drones have different detectors, ordinary ones are not over soil, the tables of counts lack the nuclide, or the
            mission names several.
    """
    kinds = {(drone.detector, drone.response) for drone in mission.drones}
    if len(kinds) > 1:
        names = ", ".join(sorted(response or detector for detector, response in kinds))
        raise ConfigError(f"fusion.estimator = 'field' needs the same detector on every drone, not {names}")
    table = mission.table(mission.drones[0].id)
    if table is None:
        return MiniPix(response_of(mission.named(), mission.fusion.ground))
    if mission.fusion.ground != "soil":
        raise ConfigError("fusion.ground: ordinary detectors need 'soil', whose scattered photons their expected counts include")
    return OrdinaryCounts(table, mission.named())
