"""What an operator's station sees of a live swarm: what each agent says of itself, and what it believes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agent.config import MissionConfig
from protocol.codec import decode_from
from protocol.errors import ProtocolError
from protocol.messages import AnyDroneMessage, Cone, DroneMessage, Estimate, Stage, Status
from sim.vehicle.px4.fleet import VehicleReport

SILENT_S = 3.0  # a status comes each second: whoever says nothing for so long is not heard
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Belief:
    """A hypothesis as it was published. position: (3,) mission frame, metres; covariance: (3, 3)."""

    position: Array
    covariance: Array
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    evidence: float | None = None

    def sight_of(self, drone: str) -> Belief:
        """An estimate does not tell what each drone sees."""
        return self


class ObservedAgent:
    """One agent, as it is heard."""

    def __init__(self, drone: str) -> None:
        self.drone = drone
        self.status: Status | None = None
        self.estimate: Estimate | None = None
        self.cones = 0  # that it published
        self.heard_s = -np.inf  # when it last said anything
        self.alive = False  # by its liveliness token
        self._belief: Belief | None = None
        self._believed_s = -np.inf
        self._flew = self._down = False
        self._failsafe = False
        self.failsafes = 0  # how often the autopilot took over from it

    @property
    def stage(self) -> Stage:
        """What it says that it is doing; where it has died, what the autopilot does: bring the vehicle home, and down."""
        if not self.alive and self._down:
            return Stage.LANDED
        if not self.alive and self._failsafe:
            return Stage.RETURN
        return self.status.stage if self.status is not None else Stage.PREFLIGHT

    @property
    def hypothesis(self) -> Belief | None:
        """Its newest estimate."""
        return self._belief

    @property
    def outlook(self) -> None:
        """What it knows without a hypothesis is not published."""
        return None

    @property
    def finding(self) -> str:
        """What its search has ended with, where it has found nothing; else empty."""
        return self.status.finding if self.status is not None else ""

    @property
    def believed_s(self) -> float:
        """When the newest estimate came."""
        return self._believed_s

    @property
    def problems(self) -> tuple[str, ...]:
        """What it reports."""
        return self.status.problems if self.status is not None else ()

    def hear(self, message: DroneMessage, now_s: float) -> None:
        """Take a message of this agent."""
        self.heard_s = now_s
        if isinstance(message, Status):
            self.status = message
        elif isinstance(message, Cone):
            self.cones += 1
        elif isinstance(message, Estimate):
            xx, xy, xz, yy, yz, zz = message.covariance_m2
            covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            self.estimate = message
            self._belief = Belief(
                np.array(message.position_m), covariance, message.activity_bq, message.activity_sigma_bq, message.evidence
            )
            self._believed_s = now_s

    def look(self, vehicle: VehicleReport, now_s: float, alive: bool) -> None:
        """See the vehicle itself. An agent without an estimate for a while has died, or has taken its hypothesis back."""
        self.alive = alive
        self._flew = self._flew or vehicle.armed
        self._down = self._flew and not vehicle.armed
        if vehicle.failsafe and not self._failsafe:
            self.failsafes += 1
        self._failsafe = vehicle.failsafe
        if self._belief is not None and now_s - self._believed_s > SILENT_S:
            self._belief = None

    def obstacle(self, mission_id: str, now_s: float) -> str | None:
        """Why it cannot be started, or None."""
        if not self.alive:
            return "not in the mesh yet"
        if self.status is None or now_s - self.heard_s > SILENT_S:
            return "says nothing yet"
        if self.status.mission != mission_id:
            return f"another mission file ({self.status.mission}, here {mission_id})"
        if self.status.stage is not Stage.PREFLIGHT:
            return f"in {self.status.stage} already"
        return self.status.problems[0] if self.status.problems else None


class Observer:
    """All agents of a mission.

    Args:
        mission: theirs.
        clock_s: monotonic.
    """

    def __init__(self, mission: MissionConfig, clock_s: Callable[[], float]) -> None:
        self._mission_id = mission.mission_id
        self._clock_s = clock_s
        self.agents = [ObservedAgent(drone.id) for drone in mission.drones]
        self._places = {drone.id: place for place, drone in enumerate(mission.drones)}
        self.entry: Callable[[int, AnyDroneMessage], None] | None = None  # told of each message, with the drone's place
        self.refused = 0  # messages that are none

    def receive(self, key: str, payload: bytes) -> None:
        """Take a message from the mesh."""
        try:
            message = decode_from(key, payload)
        except ProtocolError:
            self.refused += 1
            return
        if not isinstance(message, AnyDroneMessage):
            return
        place = self._places.get(message.drone)
        if place is None:
            return
        self.agents[place].hear(message, self._clock_s())
        if self.entry is not None:
            self.entry(place, message)

    def look(self, vehicles: Sequence[VehicleReport], alive: frozenset[str]) -> None:
        """See the vehicles, and whose liveliness token is there."""
        now_s = self._clock_s()
        for agent, vehicle in zip(self.agents, vehicles, strict=True):
            agent.look(vehicle, now_s, agent.drone in alive)

    def obstacles(self) -> list[str]:
        """What stands against a start, a line for each drone that has something."""
        now_s = self._clock_s()
        found = [(agent.drone, agent.obstacle(self._mission_id, now_s)) for agent in self.agents]
        return [f"{drone}: {text}" for drone, text in found if text is not None]

    def agreed(self) -> bool:
        """Whether all agents that live have told the same digest, and with it the same position, bit for bit."""
        told = [agent.estimate for agent in self.agents if agent.alive]
        estimates = [estimate for estimate in told if estimate is not None]
        return len(estimates) == len(told) > 0 and len({(each.digest, each.position_m) for each in estimates}) == 1
