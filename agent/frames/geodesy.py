"""Between places on Earth and the mission frame: WGS84 geodetic coordinates, and east, north, up at the mission's datum.

All of it is pymap3d's closed formulas on Earth-centred coordinates. In double precision those have a grain of 1e-9 m; there
and back is the same within 1e-8 m (``tests/agent/frames/test_geodesy.py``: the whole globe, poles and date line too).
"""

from __future__ import annotations

import numpy as np
import pymap3d
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from agent.config import DatumConfig
from agent.frames.rigid import Rigid
from agent.frames.transform import Transform, Vector3

Array = NDArray[np.float64]


def mission_from_geodetic(datum: DatumConfig, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Vector3:
    """One place on Earth (height above the ellipsoid) in the frame of a datum: east, north, up, metres."""
    x, y, z = mission_from_geodetics(datum, np.array([latitude_deg, longitude_deg, altitude_m])).tolist()
    return x, y, z


def mission_from_geodetics(datum: DatumConfig, places: Array) -> Array:
    """Places (..., 3) of latitude and longitude in degrees and height above the ellipsoid in metres, in the datum's frame."""
    east, north, up = pymap3d.geodetic2enu(places[..., 0], places[..., 1], places[..., 2], *_place(datum))
    return np.stack((east, north, up), axis=-1)


def geodetic_from_mission(datum: DatumConfig, point: Vector3) -> Vector3:
    """A point of the datum's frame as latitude and longitude in degrees (-180 .. 180) and height above the ellipsoid."""
    latitude_deg, longitude_deg, altitude_m = geodetics_from_mission(datum, np.array(point)).tolist()
    return latitude_deg, longitude_deg, altitude_m


def geodetics_from_mission(datum: DatumConfig, points: Array) -> Array:
    """The same for points (..., 3)."""
    latitude, longitude, altitude = pymap3d.enu2geodetic(points[..., 0], points[..., 1], points[..., 2], *_place(datum))
    return np.stack((latitude, longitude, altitude), axis=-1)


def enu_from_enu(to: DatumConfig, of: DatumConfig) -> Rigid:
    """The frame of one datum in the frame of another: they lie apart, and their ups and norths differ too.

    Up differs by the angle between the two verticals; north by the meridians' convergence, the difference in longitude times
    the sine of the latitude: near the poles that is everything.
    """
    turn = _ecef_from_enu(to).T @ _ecef_from_enu(of)
    origin = mission_from_geodetic(to, of.latitude_deg, of.longitude_deg, of.altitude_m)
    return Rigid(Rotation.from_matrix(turn), origin)


def mission_from_launch(mission: DatumConfig, origin: DatumConfig, launch_m: Vector3) -> tuple[Transform, float]:
    """Where the frame of a vehicle lies that was launched at ``launch_m`` (east, north, up) of the frame at ``origin``.

    An autopilot has a geodetic origin of its own, wherever it was switched on. Returns the transform from the vehicle's local
    frame (east, north, up from the launch place) into the mission frame with up kept up, and the angle (rad) by which it is not.
    """
    launch = Rigid(Rotation.identity(), launch_m)
    return (enu_from_enu(mission, origin) @ launch).level()


def _place(datum: DatumConfig) -> Vector3:
    return datum.latitude_deg, datum.longitude_deg, datum.altitude_m


def _ecef_from_enu(datum: DatumConfig) -> Array:
    """(3, 3): east, north and up at the datum, as columns, along Earth-centred axes."""
    axes = pymap3d.enu2uvw(*np.eye(3), datum.latitude_deg, datum.longitude_deg)
    return np.array(axes)
