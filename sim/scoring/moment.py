"""State of the simulated world at one time of a flight, for observers and scores: truth, agents and autopilots."""

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
    """An agent's source estimate: position in the mission frame and its covariance."""

    @property
    def position(self) -> Array:
        """(3,) position in metres."""

    @property
    def covariance(self) -> Array:
        """(3, 3) covariance in m2."""


class Member(Protocol):
    """An agent as an observer sees it: in a simulation its own state, in a live flight its messages."""

    @property
    def stage(self) -> Stage:
        """Stage of the agent's mission."""

    @property
    def digest(self) -> str:
        """Hash of the log from which the agent's source estimate was computed."""

    @property
    def hypothesis(self) -> Hypothesis | None:
        """The agent's source estimate; None without one."""


class Flown(Protocol):
    """A vehicle's autopilot, as an observer sees it."""

    @property
    def mode(self) -> FlightMode:
        """Flight mode of the autopilot."""

    @property
    def armed(self) -> bool:
        """Whether the rotors run."""

    @property
    def setpoint_age_s(self) -> float | None:
        """Age of the setpoint that the vehicle follows, seconds; None if it follows none."""


class Shared:
    """Base of objects that all agents of a simulated flight share in one process; they do not count as an agent's memory."""


@dataclass(frozen=True, slots=True)
class Scene:
    """State of the world at one time of a flight, simulated in one process (lockstep) or live.

    Arrays and lists have one row or item for each of the N drones, in the order of the mission. time_s: since the start of the
    simulation; live: since the start command. position_m: (N, 3) true x, y in the mission frame, and height above ground. source:
    true x, y of the first source; None without any. pilots: None for a dead agent.
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
    """State of the world after one tick (time step) of a flight simulated in one process (lockstep).

    velocity_mps: (N, 3) true, mission frame. heading_rad: (N,) true, from east. commands: to the autopilots in this tick; None
    without a step of the agent. sent: number of each agent's messages in this tick. inboxes: messages on their way to each agent.
    batteries: true levels, 0 to 1. told_s: time of each vehicle's last telemetry at its agent.
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
