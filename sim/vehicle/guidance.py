"""Autonomous flight of an autopilot: climbing, returning home, descending.

The target moves and the vehicle follows it. Positions are the vehicle's own estimates in its local frame (ENU).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin
from typing import NamedTuple

from sim.geometry import Vector3

ARRIVED_M = 0.3
BELOW_GROUND_M = 0.5  # end of a descent's target, so that the vehicle is sure to touch the ground
BRAKING_S, BRAKING_S2PM, BRAKING_MOST_S = 0.4, 0.32, 2.0  # time for which it continues at its speed: 10 m at 5 m/s


class Reframing(NamedTuple):
    """``new from old`` of a local frame that jumped: yaw about up, then translation, metres."""

    yaw_rad: float
    translation_m: Vector3

    def point(self, place: Vector3) -> Vector3:
        """A point of the old frame, in the new one."""
        x, y, z = self.direction(place)
        u, v, w = self.translation_m
        return x + u, y + v, z + w

    def direction(self, vector: Vector3) -> Vector3:
        """A velocity of the old frame, in the new one."""
        c, s = cos(self.yaw_rad), sin(self.yaw_rad)
        x, y, z = vector
        return c * x - s * y, s * x + c * y, z


@dataclass(slots=True)
class Target:
    """The setpoint of the vehicle's controllers, local frame; velocity, acceleration and yaw rate are fed forward."""

    position: Vector3
    velocity: Vector3
    yaw: float
    acceleration: Vector3 = (0.0, 0.0, 0.0)
    yaw_rate: float = 0.0


def rest_place(position: Vector3, velocity: Vector3) -> Vector3:
    """Position at which a vehicle that begins to hold or to land comes to rest: a PX4 brakes, and does not fly back."""
    (x, y, z), (vx, vy, _) = position, velocity
    time_s = min(BRAKING_S + BRAKING_S2PM * hypot(vx, vy), BRAKING_MOST_S)
    return x + vx * time_s, y + vy * time_s, z


class Guidance:
    """A target that moves in fixed steps. ``home``: takeoff place."""

    def __init__(self, home: Vector3, yaw: float, step_s: float) -> None:
        self.home = home
        self.target = Target(home, (0.0, 0.0, 0.0), yaw)
        self._step_s = step_s

    def stay(self, position: Vector3) -> None:
        """Stay at ``position`` with the present heading."""
        self.target = Target(position, (0.0, 0.0, 0.0), self.target.yaw)

    def reframe(self, frame: Reframing) -> None:
        """The local frame has jumped: the target keeps its place in the world."""
        target = self.target
        self.home = frame.point(self.home)
        self.target = Target(
            frame.point(target.position),
            frame.direction(target.velocity),
            target.yaw + frame.yaw_rad,
            frame.direction(target.acceleration),
            target.yaw_rate,
        )

    def climb(self, height_m: float, speed_mps: float) -> None:
        """Climb, up to ``height_m`` above home."""
        x, y, z = self.target.position
        self._go((x, y, min(self.home[2] + height_m, z + speed_mps * self._step_s)))

    def go_home(self, height_m: float, climb_mps: float, speed_mps: float) -> bool:
        """Return home at ``height_m`` above it or higher, first up and then across; True once the target has arrived."""
        x, y, z = self.target.position
        height = self.home[2] + height_m
        if z < height - 1e-6 and hypot(x - self.home[0], y - self.home[1]) > ARRIVED_M:
            self._go((x, y, min(height, z + climb_mps * self._step_s)))
            return False
        dx, dy = self.home[0] - x, self.home[1] - y
        distance = hypot(dx, dy)
        step = min(distance, speed_mps * self._step_s)
        if distance <= ARRIVED_M:
            return True
        self._go((x + dx / distance * step, y + dy / distance * step, z))
        return False

    def descend(self, speed_mps: float, height_m: float = -BELOW_GROUND_M) -> None:
        """Descend, down to ``height_m`` above home."""
        x, y, z = self.target.position
        self._go((x, y, max(self.home[2] + height_m, z - speed_mps * self._step_s)))

    def _go(self, position: Vector3) -> None:
        old = self.target.position
        velocity = tuple((new - was) / self._step_s for new, was in zip(position, old, strict=True))
        self.target = Target(position, (velocity[0], velocity[1], velocity[2]), self.target.yaw)
