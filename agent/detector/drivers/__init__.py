"""Detector drivers: the simulation's feed, a recording, the camera, or a driver of another package.

Another package adds a driver by an entry point of the group ``radron.detectors``. Its name is the driver's, its object a callable
that takes a ``DetectorConfig`` and returns a ``Detector``.
"""

from __future__ import annotations

from pathlib import Path

from radron.agent.config.drone import DetectorConfig
from radron.agent.detector.drivers.feed import FeedDetector
from radron.agent.detector.drivers.inutc import DetectorInUtc
from radron.agent.detector.drivers.t3pa import RecordedDetector
from radron.agent.detector.readout import Detector
from radron.agent.errors import ConfigError
from radron.agent.ownclock import OwnClock
from radron.agent.plugins import entry_point, made

DRIVERS = ("none", "feed", "t3pa", "pypixet")  # of this package
_MEMBERS = ("readouts", "problems", "close")


def open_detector(config: DetectorConfig, clock: OwnClock | None = None) -> Detector | None:
    """Return the driver of the camera that the drone file names; None if it names none.

    Links and devices are not opened here, but by ``readouts``. ``clock``: of the agent; None: its own time begins now.

    Raises:
        ConfigError: no such driver, a setting of this driver is missing or wrong, or the installed object is no detector.
        DetectorError: the file cannot be read, or the vendor's module is missing.
    """
    clock = clock or OwnClock()
    match config.driver:
        case "feed":
            return FeedDetector(_needed(config.address, "feed", "address"), clock.now_ns, clock)
        case "t3pa":
            return RecordedDetector(Path(_needed(config.file, "t3pa", "file")), clock.now_ns)
        case "pypixet":
            from radron.agent.detector.drivers.pypixet import PixetDetector, load_pypixet  # noqa: PLC0415

            folder = None if config.pixet_folder is None else Path(config.pixet_folder)
            return PixetDetector(load_pypixet(folder), config.bias_v, clock.now_ns)
        case "none":
            return None
        case name:
            detector: Detector = made("detector", entry_point("detector", name, "detector.driver", DRIVERS), config, _MEMBERS)
            return DetectorInUtc(detector, clock)


def _needed(value: str | None, driver: str, key: str) -> str:
    if not value:
        raise ConfigError(f"detector.{key} is missing; detector.driver = {driver!r} needs it")
    return value
