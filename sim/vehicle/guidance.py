"""Autonomous flight of a simulated autopilot: climbing, returning home, descending.

A target moves, and the vehicle follows it. Positions are the vehicle's own estimates in its local frame (ENU).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, radians, sin, sqrt, tan
from typing import NamedTuple

from radron.sim.geometry import Vector3

ARRIVED_M = 0.3
REST: Vector3 = (0.0, 0.0, 0.0)
BELOW_GROUND_M = 0.5  # end of a descent's target, so that the vehicle is sure to touch the ground
# A PX4's setpoint while it brakes (MPC_ACC_HOR, MPC_JERK_AUTO): to a place ahead where it holds or lands, reckoned with the time
# in which it builds up its deceleration; or at once, and then back to where it began, at a speed by distance as recorded.
ACCELERATION_MPS2, JERK_MPS3, LATE_S = 3.0, 4.0, 0.6
BACK_PS = 0.4
APPROACH_S = 0.3  # time constant to the wanted speed
SLOWING_M = (7.0, 3.5)  # heights between which a landing slows down, as recorded
RETURN_CONE_M, RETURN_CONE_DEG, MIN_RETURN_M = 10.0, 45.0, 2.0  # a return that begins near home (PX4: RTL_MIN_DIST, RTL_CONE_ANG)


class Reframing(NamedTuple):
    """Transform from the old to the new local frame of a vehicle after a jump.

    It is a rotation about the vertical axis, followed by a translation (m).
    """

    yaw_rad: float
    translation_m: Vector3

    def point(self, place: Vector3) -> Vector3:
        """Convert a point from the old to the new frame."""
        x, y, z = self.direction(place)
        u, v, w = self.translation_m
        return x + u, y + v, z + w

    def direction(self, vector: Vector3) -> Vector3:
        """Convert a velocity from the old to the new frame."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        x, y, z = vector
        return c * x - s * y, s * x + c * y, z


@dataclass(slots=True)
class Target:
    """Setpoint of the vehicle's controllers in its local frame; velocity, acceleration and yaw rate are fed forward."""

    position: Vector3
    velocity: Vector3
    yaw: float
    acceleration: Vector3 = REST
    yaw_rate: float = 0.0


def stopping_m(speed_mps: float) -> float:
    """Return how far ahead a PX4 places its stopping point in hold or landing, m (``computeBrakingDistanceFromVelocity``)."""
    return speed_mps * (speed_mps / (2.0 * ACCELERATION_MPS2) + LATE_S)


def fastest_mps(distance_m: float) -> float:
    """Return the speed (m/s) of a PX4's setpoint at this distance before its goal (``computeMaxSpeedFromDistance``)."""
    ramp_mps = 2.0 * ACCELERATION_MPS2**2 / JERK_MPS3
    return sqrt(ramp_mps**2 + 2.0 * ACCELERATION_MPS2 * distance_m) - ramp_mps


def return_height_m(
    highest_m: float, distance_m: float, *, within_m: float = RETURN_CONE_M, angle_deg: float = RETURN_CONE_DEG
) -> float:
    """Return the height above home at which a PX4 returns from this distance, metres.

    Nearer than ``within_m`` (RTL_MIN_DIST) the height is limited by a cone about home (``angle_deg``: RTL_CONE_ANG, its
    half-angle).
    """
    if distance_m >= within_m:
        return highest_m
    return min(highest_m, max(MIN_RETURN_M, distance_m / tan(radians(angle_deg))))


def descent_mps(height_m: float, fastest_mps: float, landing_mps: float) -> float:
    """Return a PX4's descent speed (m/s) at a height: it slows down from MPC_Z_V_AUTO_DN to MPC_LAND_SPEED near the ground."""
    high_m, low_m = SLOWING_M
    share = max(0.0, min((height_m - low_m) / (high_m - low_m), 1.0))
    return landing_mps + share * (fastest_mps - landing_mps)


class Guidance:
    """Moves the target of an autonomous flight in fixed time steps. ``home``: place of the takeoff."""

    def __init__(self, home: Vector3, yaw: float, step_s: float) -> None:
        self.home = home
        self.target = Target(home, REST, yaw)
        self._step_s = step_s
        self._rest(home)

    def stay(self, position: Vector3) -> None:
        """Set the target to ``position``, at rest, with the present heading."""
        self.target = Target(position, REST, self.target.yaw)
        self._rest(position)

    def brake(self, position: Vector3, velocity: Vector3, acceleration: Vector3 = REST, *, back: bool = False) -> None:
        """Bring the target to rest at the height of ``position``, starting with this velocity and acceleration.

        ``back``: then fly back to ``position``.
        """
        self.stay(position)
        (x, y, z), (u, v, _), speed = position, velocity, hypot(velocity[0], velocity[1])
        self._velocity, self._flies_back = (u, v, 0.0), back
        self._acceleration = (*_within(ACCELERATION_MPS2, acceleration[0], acceleration[1]), 0.0)
        if speed > 0.0 and back:
            self._acceleration = -ACCELERATION_MPS2 / speed * u, -ACCELERATION_MPS2 / speed * v, 0.0
        elif speed > 0.0:
            ahead_s = stopping_m(speed) / speed
            self._place = x + ahead_s * u, y + ahead_s * v, z

    def hover(self) -> None:
        """Continue braking, or stay at rest."""
        (x, y), z = self._across(), self.target.position[2]
        self._go((x, y, z))

    def reframe(self, frame: Reframing) -> None:
        """Adapt to a jump of the local frame: the target keeps its place in the world."""
        target = self.target
        self.home = frame.point(self.home)
        self._place = frame.point(self._place)
        self._velocity, self._acceleration = frame.direction(self._velocity), frame.direction(self._acceleration)
        self.target = Target(
            frame.point(target.position),
            frame.direction(target.velocity),
            target.yaw + frame.yaw_rad,
            frame.direction(target.acceleration),
            target.yaw_rate,
        )

    def climb(self, height_m: float, speed_mps: float) -> None:
        """Move the target up for one time step, at most to ``height_m`` above home."""
        (x, y), z = self._across(), self.target.position[2]
        self._go((x, y, min(self.home[2] + height_m, z + speed_mps * self._step_s)))

    def go_home(self, height_m: float, climb_mps: float, speed_mps: float) -> bool:
        """Move the target towards home for one time step, first up to ``height_m`` above home, then across.

        Return True once the target has arrived.
        """
        x, y, z = self.target.position
        height = self.home[2] + height_m
        if z < height - 1e-6 and hypot(x - self.home[0], y - self.home[1]) > ARRIVED_M:
            self._go((*self._across(), min(height, z + climb_mps * self._step_s)))
            return False
        dx, dy = self.home[0] - x, self.home[1] - y
        distance = hypot(dx, dy)
        step = min(distance, speed_mps * self._step_s)
        if distance <= ARRIVED_M:
            return True
        self._go((x + dx / distance * step, y + dy / distance * step, z))
        self._rest(self.target.position)
        return False

    def descend(self, speed_mps: float, height_m: float = -BELOW_GROUND_M) -> None:
        """Move the target down for one time step, at most to ``height_m`` above home."""
        (x, y), z = self._across(), self.target.position[2]
        self._go((x, y, max(self.home[2] + height_m, z - speed_mps * self._step_s)))

    def _rest(self, place: Vector3) -> None:
        """End a way across at ``place``."""
        self._place, self._velocity, self._acceleration, self._flies_back = place, REST, REST, False

    def _across(self) -> tuple[float, float]:
        """Return the next horizontal position on its way: as fast as the distance allows, without a jerk."""
        (x, y, _), (u, v, _), (a, b, _) = self.target.position, self._velocity, self._acceleration
        dx, dy = self._place[0] - x, self._place[1] - y
        distance = hypot(dx, dy)
        wanted = BACK_PS if self._flies_back else fastest_mps(distance) / max(distance, 1e-9)
        a_wanted, b_wanted = _within(ACCELERATION_MPS2, (wanted * dx - u) / APPROACH_S, (wanted * dy - v) / APPROACH_S)
        a_change, b_change = _within(JERK_MPS3 * self._step_s, a_wanted - a, b_wanted - b)
        a, b = a + a_change, b + b_change
        u, v = u + a * self._step_s, v + b * self._step_s
        self._velocity, self._acceleration = (u, v, 0.0), (a, b, 0.0)
        return x + u * self._step_s, y + v * self._step_s

    def _go(self, position: Vector3) -> None:
        old = self.target.position
        velocity = tuple((new - was) / self._step_s for new, was in zip(position, old, strict=True))
        self.target = Target(position, (velocity[0], velocity[1], velocity[2]), self.target.yaw)


def _within(most: float, x: float, y: float) -> tuple[float, float]:
    """The vector, shortened to a length."""
    share = min(1.0, most / max(hypot(x, y), 1e-9))
    return share * x, share * y
