"""What the vehicles' own filters say of their motion: estimates in PX4's frames, from the truth and its errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pymap3d
from numpy.typing import NDArray

from agent.vehicle.interface import Vector3
from sim.frame import LocalFrames
from sim.localization import Localization
from sim.terrain import Terrain
from sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors
from sim.vehicle.px4.config import Datum

Array = NDArray[np.float64]


class Geodetic(NamedTuple):
    """WGS 84."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Estimate(NamedTuple):
    """One vehicle, as its filter sees it. Local frame; NED and FRD but for ``position_enu_m``."""

    position_enu_m: Vector3
    velocity_ned_mps: Vector3
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    rates_rps: Vector3  # roll, pitch, yaw
    thrust_mps2: float  # specific force along the body's up axis
    height_m: float  # above ground, along the vertical
    place: Geodetic

    @property
    def position_ned_m(self) -> Vector3:
        """Local NED."""
        east, north, up = self.position_enu_m
        return (north, east, -up)


class Estimator:
    """The estimates of N vehicles; ``step`` after the motion and its errors have moved on."""

    def __init__(
        self, motion: Multirotors, error: Localization, frames: LocalFrames, datum: Datum, step_s: float, terrain: Terrain
    ) -> None:
        self._motion, self._error, self._frames, self._terrain = motion, error, frames, terrain
        self._step_s = step_s
        self._angles: Array | None = None
        self.origins = geodetic(frames.origin, datum)
        self._origins = np.array(self.origins)
        self._scale = _units_per_metre(self._origins)

    def step(self) -> list[Estimate]:
        """One for each vehicle."""
        motion, error, frames = self._motion, self._error, self._frames
        world = motion.position_m + error.position_error_m
        positions = frames.local(world)
        velocities = frames.turn(motion.velocity_mps + error.velocity_error_mps)
        acceleration = np.array(frames.turn(motion.acceleration_mps2 + GRAVITY_MPS2 * error.tilt_error))
        angles, thrust = _attitudes(acceleration, motion.yaw_rad + error.yaw_error_rad - frames.yaw_rad)
        rates = self._rates(angles)
        heights = (self._terrain.above_ground(motion.position_m)[:, 2] + error.height_error_m).tolist()
        places = self._origins + (world - frames.origin)[:, [1, 0, 2]] * self._scale
        return [
            Estimate(position, (north, east, -up), roll, pitch, yaw, (p, q, r), force, height, Geodetic(*place))
            for position, (east, north, up), (roll, pitch, yaw), (p, q, r), force, height, place in zip(
                positions, velocities, angles.tolist(), rates, thrust.tolist(), heights, places.tolist(), strict=True
            )
        ]

    def _rates(self, angles: Array) -> list[list[float]]:
        """Differences of the angles: close to body rates, as a multirotor leans little."""
        before = angles if self._angles is None else self._angles
        self._angles = angles
        turned: list[list[float]] = ((np.remainder(angles - before + np.pi, 2.0 * np.pi) - np.pi) / self._step_s).tolist()
        return turned


def geodetic(world: Array, datum: Datum) -> list[Geodetic]:
    """World positions (N, 3), ENU about the datum, on the globe."""
    places = pymap3d.enu2geodetic(*world.T, datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    return [Geodetic(*map(float, place)) for place in zip(*places, strict=True)]


def _units_per_metre(origins: Array) -> Array:
    """(N, 3): degrees north, degrees east and metres up per metre. PX4's map, too, is a plane about the local origin; within
    500 m it is less than 3 cm off the ellipsoid.
    """
    latitude, _, altitude = origins.T
    north_m = pymap3d.rcurve.meridian(latitude) + altitude
    east_m = (pymap3d.rcurve.transverse(latitude) + altitude) * np.cos(np.radians(latitude))
    return np.column_stack([np.degrees(1.0 / north_m), np.degrees(1.0 / east_m), np.ones(len(origins))])


def _attitudes(acceleration: Array, yaw: Array) -> tuple[Array, Array]:
    """Roll, pitch and yaw (N, 3), FRD in NED, of multirotors that accelerate so (N, 3) with these headings (N,), both ENU; and
    their thrust by mass (N,). The same geometry as ``multirotor.attitude``.
    """
    ax, ay = acceleration[:, 0], acceleration[:, 1]
    up = GRAVITY_MPS2 + acceleration[:, 2]
    forward = ax * np.cos(yaw) + ay * np.sin(yaw)
    left = -ax * np.sin(yaw) + ay * np.cos(yaw)
    roll = -np.arctan2(left, np.hypot(forward, up))
    pitch = -np.arctan2(forward, up)  # FRD: nose up is positive
    north_yaw = np.remainder(1.5 * np.pi - yaw, 2.0 * np.pi) - np.pi
    return np.column_stack([roll, pitch, north_yaw]), np.sqrt(ax**2 + ay**2 + up**2)
