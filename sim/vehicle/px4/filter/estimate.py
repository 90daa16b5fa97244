"""The vehicles' estimates of their own motion in PX4's frames, made from the truth and the filters' errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pymap3d

from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors
from radron.sim.vehicle.px4.config import Datum
from radron.sim.vehicle.px4.filter.deadreckoning import FilterErrors
from radron.sim.world.frame import LocalFrames
from radron.sim.world.terrain import Terrain


class Geodetic(NamedTuple):
    """A geographic position (WGS 84)."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class Estimate(NamedTuple):
    """A vehicle's estimate of its own motion in its local frame; NED and FRD axes except ``position_enu_m``."""

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
        """Position in the local NED frame, metres."""
        east, north, up = self.position_enu_m
        return (north, east, -up)


class Estimator:
    """Makes the estimates of N vehicles from their true motion and the filters' errors.

    It is called after motion and errors have been simulated for a time step.
    """

    def __init__(
        self, motion: Multirotors, error: FilterErrors, frames: LocalFrames, datum: Datum, step_s: float, terrain: Terrain
    ) -> None:
        self._motion, self._error, self._frames, self._terrain = motion, error, frames, terrain
        self._step_s, self._datum = step_s, datum
        self._angles: Array | None = None
        self.origins = geodetic(frames.origin, datum)
        self._origins = np.array(self.origins)
        self._scale = _units_per_metre(self._origins)

    def step(self) -> list[Estimate]:
        """Return the present estimate of each vehicle."""
        motion, error, frames = self._motion, self._error, self._frames
        world = motion.position_m + error.position_error_m
        positions = frames.local(world)
        velocities = frames.turn(motion.velocity_mps + error.velocity_error_mps)
        thrust_mps2 = np.array(frames.turn(motion.thrust_mps2 + GRAVITY_MPS2 * error.tilt_error))
        angles, thrust = _attitudes(thrust_mps2, motion.yaw_rad + error.yaw_error_rad - frames.yaw_rad)
        rates = self._rates(np.column_stack([angles[:, :2], _from_north(motion.yaw_rad)]))
        heights = (self._terrain.above_ground(motion.position_m)[:, 2] + error.height_error_m).tolist()
        places = self._origins + (world - frames.origin)[:, [1, 0, 2]] * self._scale
        return [
            Estimate(position, (north, east, -up), roll, pitch, yaw, (p, q, r), force, height, Geodetic(*place))
            for position, (east, north, up), (roll, pitch, yaw), (p, q, r), force, height, place in zip(
                positions, velocities, angles.tolist(), rates, thrust.tolist(), heights, places.tolist(), strict=True
            )
        ]

    def truth(self, drone: int) -> Estimate:
        """Return the true motion of one vehicle in the form of an estimate, in the world frame."""
        motion = self._motion
        angles, thrust = _attitudes(motion.thrust_mps2[[drone]], motion.yaw_rad[[drone]])
        east, north, up = motion.velocity_mps[drone].tolist()
        x, y, z = motion.position_m[drone].tolist()
        roll, pitch, yaw = angles[0].tolist()
        place = geodetic(motion.position_m[[drone]], self._datum)[0]
        return Estimate((x, y, z), (north, east, -up), roll, pitch, yaw, (0.0, 0.0, 0.0), float(thrust[0]), z, place)

    def world_from(self, drone: int, place: Geodetic) -> Array:
        """Convert a geographic position to the world (3,), by a vehicle's local frame; without an altitude, at its own height."""
        offset = (np.array(place) - self._origins[drone]) / self._scale[drone]
        world: Array = self._frames.origin[drone] + offset[[1, 0, 2]]
        own = self._motion.position_m[drone] + self._error.position_error_m[drone]
        return np.where(np.isfinite(world), world, own)

    def move_origin(self, drone: int, origin: Geodetic) -> Array:
        """Move the origin of a vehicle's local frame to a geographic position; return the displacement (3,) in world axes."""
        moved: Array = ((np.array(origin) - self._origins[drone]) / self._scale[drone])[[1, 0, 2]]
        self._origins[drone] = origin
        return moved

    def _rates(self, angles: Array) -> list[list[float]]:
        """Return differences of the angles (N, 3): close to body rates, as a multirotor tilts little. The heading is the true
        one: gyroscopes do not measure a filter's reset.
        """
        before = angles if self._angles is None else self._angles
        self._angles = angles
        turned: list[list[float]] = ((np.remainder(angles - before + np.pi, 2.0 * np.pi) - np.pi) / self._step_s).tolist()
        return turned


def geodetic(world: Array, datum: Datum) -> list[Geodetic]:
    """Convert positions (N, 3) in the world (ENU about the datum) to geographic positions."""
    places = pymap3d.enu2geodetic(*world.T, datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    return [Geodetic(*map(float, place)) for place in zip(*places, strict=True)]


def _units_per_metre(origins: Array) -> Array:
    """(N, 3): degrees north, degrees east and metres up per metre. PX4's map, too, is a plane about the local origin; within 500
    m it deviates by less than 3 cm from the ellipsoid.
    """
    latitude, _, altitude = origins.T
    north_m = pymap3d.rcurve.meridian(latitude) + altitude
    east_m = (pymap3d.rcurve.transverse(latitude) + altitude) * np.cos(np.radians(latitude))
    return np.column_stack([np.degrees(1.0 / north_m), np.degrees(1.0 / east_m), np.ones(len(origins))])


def _attitudes(thrust_mps2: Array, yaw: Array) -> tuple[Array, Array]:
    """Roll, pitch and yaw (N, 3), FRD in NED, of multirotors with these thrust accelerations beyond gravity's (N, 3) and headings
    (N,), both ENU; and their thrust per mass (N,). The same geometry as ``multirotor.attitude``.
    """
    ax, ay = thrust_mps2[:, 0], thrust_mps2[:, 1]
    up = GRAVITY_MPS2 + thrust_mps2[:, 2]
    forward = ax * np.cos(yaw) + ay * np.sin(yaw)
    left = -ax * np.sin(yaw) + ay * np.cos(yaw)
    roll = -np.arctan2(left, np.hypot(forward, up))
    pitch = -np.arctan2(forward, up)  # FRD: nose up is positive
    return np.column_stack([roll, pitch, _from_north(yaw)]), np.sqrt(ax**2 + ay**2 + up**2)


def _from_north(yaw: Array) -> Array:
    """Headings (N,) from north, clockwise, of headings from east, counter-clockwise; rad."""
    north: Array = np.remainder(1.5 * np.pi - yaw, 2.0 * np.pi) - np.pi
    return north
