"""From WGS84 geodetic coordinates to the mission frame: east, north, up (metres) at the mission's datum.

The conversions are pymap3d's closed formulas on Earth-centred coordinates, exact to 1e-8 m in double precision
(``tests/agent/frames/test_geodesy.py``: the whole globe, with the poles and the date line).
"""

from __future__ import annotations

import math

import numpy as np
import pymap3d
from scipy.spatial.transform import Rotation

from radron.agent.config.mission import DatumConfig
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Array, Vector3


def mission_from_geodetic(datum: DatumConfig, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector3:
    """Convert a place on Earth (degrees; height above the ellipsoid, m) to the frame of a datum: east, north, up, metres."""
    x, y, z = mission_from_geodetics(datum, np.array([latitude_deg, longitude_deg, altitude_m])).tolist()
    return x, y, z


def mission_from_geodetics(datum: DatumConfig, places: Array) -> Array:
    """Convert places on Earth (..., 3) to the frame of a datum (..., 3): east, north, up, metres.

    places: latitude and longitude in degrees, and height above the ellipsoid in metres.
    """
    east, north, up = pymap3d.geodetic2enu(places[..., 0], places[..., 1], places[..., 2], *_place(datum))
    return np.stack((east, north, up), axis=-1)


def geodetic_from_mission(datum: DatumConfig, place_m: Vector3) -> Vector3:
    """Convert a place in the frame of a datum (east, north, up, metres) to latitude and longitude (degrees) and height (m).

    The height is above the ellipsoid.
    """
    latitude_deg, longitude_deg, altitude_m = pymap3d.enu2geodetic(*place_m, *_place(datum))
    return float(latitude_deg), float(longitude_deg), float(altitude_m)


def mission_from_launch(mission: DatumConfig, origin: DatumConfig, launch_m: Vector3) -> tuple[Transform, float]:
    """Return the transform from a vehicle's local frame into the mission frame, for an autopilot with a geodetic origin of its
    own.

    The two frames have different verticals (1 mrad in 6.4 km) and, by the meridians' convergence, different norths.

    Args:
        mission: datum of the mission frame.
        origin: geodetic origin of the vehicle, at the place of its autopilot's start.
        launch_m: launch place (east, north, up; metres) in the frame at ``origin``; the local frame begins there.

    Returns:
        The transform of yaw and translation that is nearest, and the tilt (rad) that it leaves out: a point p of the local frame
        is wrong by 2 sin(tilt / 2) |p| at most.
    """
    rotation = _ecef_from_enu(mission).T @ _ecef_from_enu(origin)
    start = mission_from_geodetic(mission, origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
    x, y, z = (rotation @ launch_m + start).tolist()
    yaw_rad = math.atan2(rotation[1, 0] - rotation[0, 1], rotation[0, 0] + rotation[1, 1])
    tilt_rad = float((Rotation.from_matrix(rotation) * Rotation.from_euler("z", -yaw_rad)).magnitude())
    return Transform(yaw_rad, (x, y, z)), tilt_rad


def _place(datum: DatumConfig) -> Vector3:
    return datum.latitude_deg, datum.longitude_deg, datum.altitude_m


def _ecef_from_enu(datum: DatumConfig) -> Array:
    """(3, 3): east, north and up at the datum, as columns, along Earth-centred axes."""
    axes = pymap3d.enu2uvw(*np.eye(3), datum.latitude_deg, datum.longitude_deg)
    return np.array(axes)
