"""The world after one tick of a flight in lockstep, as its observers see it: truth, agents and autopilots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from agent.pilot import Pilot
from agent.vehicle.interface import VehicleCommand
from sim.geometry import Array
from sim.vehicle.autopilot import Autopilot

OFF_GROUND_M = 0.5  # above the ground: off it


@dataclass(frozen=True, slots=True)
class Moment:
    """One drone per row and item, in the order of the mission.

    time_s: since the start of the simulation. position_m: (N, 3) true x, y in the mission frame, and height above ground.
    velocity_mps: (N, 3) true, mission frame. source: true x, y; None without one. pilots: None where an agent is dead.
    commands: of this tick; None where there was no step. sent: messages that
    each agent has published in this tick. inboxes: messages on their way to each agent.
    batteries: true levels, 0 .. 1.
    """

    time_s: float
    position_m: Array
    velocity_mps: Array
    source: tuple[float, float] | None
    pilots: Sequence[Pilot | None]
    commands: Sequence[VehicleCommand | None]
    autopilots: Sequence[Autopilot]
    sent: Sequence[int]
    inboxes: Sequence[int]
    batteries: Sequence[float]

    def airborne(self, drone: int) -> bool:
        """Whether it is off the ground."""
        return bool(self.position_m[drone, 2] > OFF_GROUND_M)


Observer = Callable[[Moment], bool]  # called after every tick; True ends the flight
