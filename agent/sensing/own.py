"""The own detector by its kind: a Compton camera, or an ordinary detector."""

from __future__ import annotations

from collections import Counter

from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.sensing.camera import Camera
from radron.agent.sensing.observer import Observer
from radron.agent.sensing.spectrometer import Spectrometer

OwnDetector = Camera | Spectrometer


def own_detector(mission: MissionConfig, drone: DroneConfig, observer: Observer, counters: Counter[str]) -> OwnDetector:
    """Return the processing of this drone's detector, of the kind that mission and drone file name.

    Raises:
        ConfigError: mission and drone file name different kinds.
        DetectorError: a camera's calibration cannot be read.
    """
    wanted, kind = mission.member(drone.id).detector, drone.detector.kind
    if wanted != kind:
        raise ConfigError(
            f"detector.kind = {kind!r} in the drone file of {drone.id}, but {wanted!r} in the mission; correct one of them"
        )
    table = mission.table(drone.id)
    if table is None:
        return Camera(mission, drone.calibration, observer, counters)
    return Spectrometer(drone.detector, table, observer, counters)
