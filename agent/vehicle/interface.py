"""The interface between the pilot and a vehicle: PX4 through MAVSDK, or the simulation. Local frame ENU, body FLU."""

from __future__ import annotations

from enum import StrEnum
from math import hypot
from typing import Literal

from msgspec import Struct

from radron.agent.geometry import Vector3

Origin = tuple[float, float, float]  # latitude and longitude in degrees, height above the ellipsoid in metres


class FlightMode(StrEnum):
    """The autopilot's flight mode, as its heartbeat message reports it."""

    MANUAL = "manual"
    HOLD = "hold"
    TAKEOFF = "takeoff"
    OFFBOARD = "offboard"
    RETURN = "return"
    LAND = "land"


class VehicleState(Struct, frozen=True, kw_only=True):
    """Telemetry of one vehicle at one time: position, attitude, mode and health.

    Position, velocity and attitude are in the vehicle's local frame (ENU), by its own localisation, with the 1-sigma errors that
    the localisation states. ``epoch``: number of the local frame, which changes with each jump of the localisation.
    """

    stamp_ns: int
    epoch: int
    position_m: Vector3
    velocity_mps: Vector3
    quaternion: tuple[float, float, float, float]  # w, x, y, z; local from body
    height_m: float  # above ground
    position_sigma_m: float
    yaw_sigma_rad: float
    mode: FlightMode
    armed: bool
    in_air: bool
    healthy: bool  # ready to arm, or flying without a failsafe
    battery: float | None = None  # 0 .. 1
    clock_sigma_m: float = 0.0  # error by a wrong clock, for others, which know the time by the stamp alone
    position_trusted: bool = True  # False: satellites lost or estimate inconsistent; the drone holds
    aided: bool = True  # False: it flies by its inertial sensors alone, as no satellites are received
    axes_fixed: bool = False  # by satellites: a heading that jumps corrects the attitude, and does not turn the frame

    @property
    def stamped_sigma_m(self) -> float:
        """1 sigma of the position (m) for other drones, which know the time by the stamp alone: with the error by a
        wrong clock.
        """
        return hypot(self.position_sigma_m, self.clock_sigma_m)


class GnssFix(Struct, frozen=True, kw_only=True):
    """A position from a satellite receiver: WGS84, height above the ellipsoid, with 1-sigma errors (m) of horizontal and vertical
    distance.
    """

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    horizontal_sigma_m: float
    vertical_sigma_m: float


class SeenDrone(Struct, frozen=True, kw_only=True):
    """A relative observation of another drone by a sensor of this drone: direction, range, or both.

    ``direction``: unit vector in this drone's body frame (FLU: forward, left, up). Sigmas are 1-sigma errors.
    """

    stamp_ns: int
    target: str
    direction: Vector3 | None = None
    direction_sigma_rad: float | None = None
    range_m: float | None = None
    range_sigma_m: float | None = None


class Setpoint(Struct, frozen=True):
    """The present target values for the autopilot in the local frame (ENU): position, velocity, acceleration and heading."""

    position_m: Vector3
    velocity_mps: Vector3
    acceleration_mps2: Vector3
    yaw_rad: float  # 0 = east, counter-clockwise
    yaw_rate_rps: float


class Request(StrEnum):
    """A state or mode into which the pilot program wants the autopilot; the PX4 driver sends the commands, possibly for some
    time.
    """

    STAY = "stay"  # on the ground, disarmed
    TAKEOFF = "takeoff"  # arm and climb to takeoff_height_m
    OFFBOARD = "offboard"  # follow the setpoint
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    DISARM = "disarm"  # on the ground; an autopilot in the air refuses
    RELEASE = "release"  # released to a pilot, a ground station or a failsafe: send no commands


class VehicleCommand(Struct, frozen=True):
    """The command of one step to the vehicle: the requested mode, with the setpoint for ``OFFBOARD``."""

    request: Request
    setpoint: Setpoint | None = None
    takeoff_height_m: float = 3.0


class LaunchPlace(Struct, frozen=True, kw_only=True):
    """The place of the launch in the autopilot's local NED frame, which is the origin of the drone's local frame.

    A restarted agent recognises the autopilot's frame by its geodetic origin. Without satellites the frame has no such origin,
    and the boot time of the autopilot is used. ``epoch``: present epoch (number) of the frame, which changes with each jump;
    ``resets``:
    the autopilot's count of resets of its position filter by then (None: not reported); ``flown``: whether the vehicle has been
    in the air since; ``mission``: id of the mission for which it was launched.
    """

    north_m: float
    east_m: float
    down_m: float
    origin_latitude_deg: float | None = None
    origin_longitude_deg: float | None = None
    origin_altitude_m: float | None = None
    booted_ns: int | None = None
    epoch: int = 0
    resets: int | None = None
    flown: bool = False
    mission: str = ""

    @property
    def origin(self) -> Origin | None:
        """The geodetic origin of the autopilot's local frame: latitude and longitude (degrees), height (m); None if the frame has
        none.
        """
        latitude_deg, longitude_deg, altitude_m = self.origin_latitude_deg, self.origin_longitude_deg, self.origin_altitude_m
        if latitude_deg is None or longitude_deg is None or altitude_m is None:
            return None
        return latitude_deg, longitude_deg, altitude_m


class Finding(Struct, frozen=True):
    """One line of the report of a preflight check.

    ``verdict``: ``not yet`` may resolve by itself; ``failed`` needs action of a person.
    """

    name: str
    verdict: Literal["ok", "not yet", "failed"]
    text: str
