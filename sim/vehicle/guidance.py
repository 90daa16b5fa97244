"""The way that an autopilot flies by itself: climbing, going home, descending.

The target moves and the vehicle follows it. Positions are the vehicle's own, estimated, in its local frame (ENU).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, sin
from typing import NamedTuple

from agent.vehicle.interface import Vector3

ARRIVED_M = 0.3
BELOW_GROUND_M = 0.5  # where the target of a descent ends, so that the vehicle surely comes down


class Reframing(NamedTuple):
    """``new from old`` of a local frame that jumped: yaw about up, then translation, metres."""

    yaw_rad: float
    translation_m: Vector3

    def point(self, place: Vector3) -> Vector3:
        """A place of the old frame, in the new one."""
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
    """What the vehicle's controllers follow: position and velocity in the local frame, heading."""

    position: Vector3
    velocity: Vector3
    yaw: float


class Guidance:
    """A target that moves in fixed steps. ``home``: where the vehicle took off."""

    def __init__(self, home: Vector3, yaw: float, step_s: float) -> None:
        self.home = home
        self.target = Target(home, (0.0, 0.0, 0.0), yaw)
        self._step_s = step_s

    def stay(self, position: Vector3) -> None:
        """Rest at ``position``, with the heading as it is."""
        self.target = Target(position, (0.0, 0.0, 0.0), self.target.yaw)

    def reframe(self, frame: Reframing) -> None:
        """The local frame has jumped: what was meant stays where it is in the world."""
        target = self.target
        self.home = frame.point(self.home)
        self.target = Target(frame.point(target.position), frame.direction(target.velocity), target.yaw + frame.yaw_rad)

    def climb(self, height_m: float, speed_mps: float) -> None:
        """Go up, to ``height_m`` above home at most."""
        x, y, z = self.target.position
        self._go((x, y, min(self.home[2] + height_m, z + speed_mps * self._step_s)))

    def go_home(self, height_m: float, climb_mps: float, speed_mps: float) -> bool:
        """Go home at ``height_m`` above it or higher, first up and then across; True once the target is there."""
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
        """Go down, to ``height_m`` above home at least."""
        x, y, z = self.target.position
        self._go((x, y, max(self.home[2] + height_m, z - speed_mps * self._step_s)))

    def _go(self, position: Vector3) -> None:
        old = self.target.position
        velocity = tuple((new - was) / self._step_s for new, was in zip(position, old, strict=True))
        self.target = Target(position, (velocity[0], velocity[1], velocity[2]), self.target.yaw)
