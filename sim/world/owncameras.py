"""A camera of a single drone that differs from the other drones' cameras: dead pixels, mounting, and calibration."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from radron.agent.config.drone import DroneConfig
from radron.agent.errors import ConfigError
from radron.sim.geometry import Vector3
from radron.sim.radiation.truth import CameraTruth

_Degrees = Annotated[float, Meta(ge=-180.0, le=180.0)]


class OwnCamera(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the camera of one drone differs from the other drones' cameras.

    dead_block: share of dead pixels. turned_deg: rotation vector about the camera's axes, relative to the usual mounting.
    calibrated: folder of a calibration by ``radron-agent calibrate``, whose two lines are in the drone file; None: no entry in
    the drone file.
    """

    dead_block: Annotated[float, Meta(ge=0.0, lt=1.0)] = 0.0
    turned_deg: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    calibrated: str | None = None

    def of(self, truth: CameraTruth) -> CameraTruth:
        """Return the true parameters of this camera. ``truth``: parameters of the other drones' cameras."""
        return replace(truth, dead_block=self.dead_block) if self.dead_block > 0.0 else truth

    def mounting(self, rpy_deg: Vector3) -> Vector3:
        """Return the true roll, pitch and yaw (degrees) of this camera. ``rpy_deg``: angles of the other drones' cameras."""
        if not any(self.turned_deg):
            return rpy_deg
        turned = Rotation.from_euler("xyz", rpy_deg, degrees=True) * Rotation.from_rotvec(self.turned_deg, degrees=True)
        roll, pitch, yaw = turned.as_euler("xyz", degrees=True).tolist()
        return roll, pitch, yaw


class _Oriented(Struct, frozen=True):
    camera_rpy_deg: Vector3


class _Result(Struct, frozen=True):
    orientation: _Oriented | None


class _Report(Struct, frozen=True):
    result: _Result


def drone_file(drone: DroneConfig, cameras: Mapping[str, OwnCamera]) -> DroneConfig:
    """Return a drone's configuration with the two lines of its camera's calibration.

    Raises:
        ConfigError: the calibration cannot be read.
    """
    own = cameras.get(drone.id)
    if own is None or own.calibrated is None:
        return drone
    folder = Path(own.calibrated).resolve()
    report = folder / "result.json"
    where = f"cameras.{drone.id}.calibrated: {report}"
    try:
        oriented = msgspec.json.decode(report.read_bytes(), type=_Report).result.orientation
    except OSError as error:
        raise ConfigError(f"{where}: cannot be read: {error.strerror}; give a folder by radron-agent calibrate") from None
    except msgspec.DecodeError as error:
        raise ConfigError(f"{where}: is not the result of radron-agent calibrate: {error}") from None
    if oriented is None:
        raise ConfigError(f"{where}: has no orientation; measure longer")
    return replace(drone, calibration=str(folder), camera_rpy_deg=oriented.camera_rpy_deg)
