"""The world at one time of a flight, as its observers see it: truth, agents and autopilots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode, VehicleCommand
from radron.protocol.messages import Stage
from radron.sim.geometry import Array
from radron.sim.vehicle.autopilot import Autopilot

EPOCH_NS = 1_767_225_600_000_000_000  # 2026-01-01 UTC: missions in lockstep begin here
OFF_GROUND_M = 0.5  # height above the ground of an airborne drone


class Hypothesis(Protocol):
    """A source estimate: position (3,) m, mission frame, and its covariance (3, 3)."""

    @property
    def position(self) -> Array:
        """(3,)."""

    @property
    def covariance(self) -> Array:
        """(3, 3)."""


class Member(Protocol):
    """An agent: on board, or as observed in the mesh."""

    @property
    def stage(self) -> Stage:
        """Stage of its mission."""

    @property
    def digest(self) -> str:
        """Digest of the log behind its hypothesis."""

    @property
    def hypothesis(self) -> Hypothesis | None:
        """Its source estimate."""


class Flown(Protocol):
    """An autopilot, as an observer sees it."""

    @property
    def mode(self) -> FlightMode:
        """Its mode."""

    @property
    def armed(self) -> bool:
        """Whether its rotors run."""

    @property
    def setpoint_age_s(self) -> float | None:
        """Age of the setpoint that the vehicle follows, s; None without a setpoint."""


class Shared:
    """Objects shared by the agents of a flight in one process, which are no part of any agent's memory."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Observations of any flight, in lockstep or live. One drone per row and item, in the order of the mission.

    time_s: since the start of the simulation; live: since the start command. position_m: (N, 3) true x, y in the mission
    frame, and height above ground. source: true x, y of the first source; None without any. pilots: None for a dead agent.
    """

    time_s: float
    position_m: Array
    source: tuple[float, float] | None
    pilots: Sequence[Member | None]
    autopilots: Sequence[Flown]

    def airborne(self, drone: int) -> bool:
        """Return whether a drone is off the ground."""
        return bool(self.position_m[drone, 2] > OFF_GROUND_M)


@dataclass(frozen=True, slots=True)
class Moment(Scene):
    """The world after one tick of a flight in lockstep.

    velocity_mps: (N, 3) true, mission frame. heading_rad: (N,) true, from east. commands: of this tick; None without a step.
    sent: number of each agent's messages in this tick. inboxes: messages on their way to each agent. batteries: true levels,
    0 .. 1. told_s: time of each vehicle's last telemetry at its agent.
    """

    pilots: Sequence[Pilot | None]
    autopilots: Sequence[Autopilot]
    velocity_mps: Array
    heading_rad: Array
    commands: Sequence[VehicleCommand | None]
    sent: Sequence[int]
    inboxes: Sequence[int]
    batteries: Sequence[float]
    told_s: Sequence[float]


Observer = Callable[[Moment], bool]  # called after every tick; True ends the flight
