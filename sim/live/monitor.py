"""The agents of a live swarm as an operator sees them: status and source estimate, as published."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.protocol.codec import decode_from
from radron.protocol.codes import Code
from radron.protocol.entries import Cone
from radron.protocol.errors import ProtocolError
from radron.protocol.message import DroneMessage
from radron.protocol.messages import AnyDroneMessage, Estimate, Stage, Status, Ticket
from radron.protocol.signing import Verifier
from radron.protocol.stages import ON_GROUND
from radron.protocol.texts import CodedText
from radron.sim.geometry import Array
from radron.sim.vehicle.px4.fleet import VehicleReport

LINK_LOST_S = 3.0  # a status comes each second: after so long without a message an agent's link counts as lost


@dataclass(frozen=True, slots=True)
class Belief:
    """A source estimate that an agent has published. position: (3,) mission frame, metres; covariance: (3, 3)."""

    position: Array
    covariance: Array
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    evidence: float | None = None

    def sight_of(self, drone: str) -> Belief:
        """Return the estimate itself, as the source's position in a drone's own view is not published."""
        return self


class ObservedAgent:
    """One agent of a live swarm, as its messages show it."""

    def __init__(self, drone: str) -> None:
        self.drone = drone
        self.status: Status | None = None
        self.estimate: Estimate | None = None
        self.cones = 0  # published so far
        self.heard_s = -np.inf  # time of its last message
        self.alive = False  # by its liveliness token
        self._belief: Belief | None = None
        self._believed_s = -np.inf
        self._flew = self._down = self._met = self._died = False
        self._failsafe = False
        self.failsafes = 0  # number of takeovers by its autopilot's failsafe

    @property
    def stage(self) -> Stage:
        """Mission stage that the agent reports; after its death, what the autopilot does: return, then landed.

        An agent that died on the ground, or was restarted there after its flight, counts as landed.
        """
        if self._died or (not self.alive and self._down):
            return Stage.LANDED
        if not self.alive and self._failsafe:
            return Stage.RETURN
        stage = self.status.stage if self.status is not None else Stage.PREFLIGHT
        return Stage.LANDED if stage is Stage.PREFLIGHT and self._down else stage

    @property
    def hypothesis(self) -> Belief | None:
        """The latest source estimate of the agent; None without one."""
        return self._belief

    @property
    def outlook(self) -> None:
        """None, as the state of an agent's search is not published."""
        return None

    @property
    def ticket(self) -> Ticket | None:
        """The ticket (proof of freshness) that a command to the drone needs; None before its first status."""
        return self.status.ticket if self.status is not None else None

    @property
    def finding(self) -> CodedText | None:
        """Result of a search that has found nothing; empty otherwise."""
        return self.status.texts.finding if self.status is not None else None

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Problems that the agent reports."""
        return self.status.texts.problems if self.status is not None else ()

    def hear(self, message: DroneMessage, now_s: float) -> None:
        """Process a message of this agent."""
        self.heard_s = now_s
        if isinstance(message, Status):
            self.status = message
        elif isinstance(message, Cone):
            self.cones += 1
        elif isinstance(message, Estimate):
            self.estimate = message
            if not message.sources:
                return
            source = message.sources[0]
            xx, xy, xz, yy, yz, zz = source.covariance_m2
            covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            self._belief = Belief(
                np.array(source.position_m), covariance, source.activity_bq, source.activity_sigma_bq, source.evidence
            )
            self._believed_s = now_s

    def look(self, vehicle: VehicleReport, now_s: float, alive: bool) -> None:
        """Update the state from the vehicle itself.

        An agent without an estimate for a while has died, or has withdrawn its estimate.
        """
        self.alive, self._met = alive, self._met or alive
        self._flew = self._flew or vehicle.armed
        self._down = self._flew and not vehicle.armed
        self._died = self._met and not alive and not self._flew
        if vehicle.failsafe and not self._failsafe:
            self.failsafes += 1
        self._failsafe = vehicle.failsafe
        if self._belief is not None and now_s - self._believed_s > LINK_LOST_S:
            self._belief = None

    def obstacle(self, mission_id: str, now_s: float, without: Collection[str] = ()) -> str | None:
        """Return why the drone cannot be started yet, or None. ``without``: drones that it does not wait for."""
        if not self.alive:
            return "not in the mesh yet"
        if self.status is None or now_s - self.heard_s > LINK_LOST_S:
            return "no status yet"
        if self.status.mission != mission_id:
            return f"another mission file ({self.status.mission}, here {mission_id})"
        if self.status.stage not in ON_GROUND:
            return f"in {self.status.stage} already"
        problems = self.status.texts.problems
        return next((one for one in problems if one.code != Code.NO_CONTACT or one.about not in without), None)


class Observer:
    """Collects the messages of all agents of a live mission.

    Args:
        mission: the agents' mission.
        clock_s: monotonic clock.

    ``verifier``: checks the signatures of the statuses; None: in a swarm without certificates.
    """

    def __init__(self, mission: MissionConfig, clock_s: Callable[[], float]) -> None:
        self.verifier: Verifier | None = None
        self._mission_id = mission.mission_id
        self._clock_s = clock_s
        self.agents = [ObservedAgent(drone.id) for drone in mission.drones]
        self._places = {drone.id: place for place, drone in enumerate(mission.drones)}
        self.listeners: list[Callable[[int, AnyDroneMessage], None]] = []  # called with each message and the drone's index
        self.refused = 0  # invalid messages, and statuses without their drones' signatures

    def receive(self, key: str, payload: bytes) -> None:
        """Process a message from the network."""
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
        if isinstance(message, Status) and self.verifier is not None and not self.verifier.accepts_status(message):
            self.refused += 1
            return
        self.agents[place].hear(message, self._clock_s())
        for listen in self.listeners:
            listen(place, message)

    def look(self, vehicles: Sequence[VehicleReport], alive: frozenset[str]) -> None:
        """Update the agents' states from their vehicles and from the liveliness tokens (signs of connected programs)."""
        now_s = self._clock_s()
        for agent, vehicle in zip(self.agents, vehicles, strict=True):
            agent.look(vehicle, now_s, agent.drone in alive)

    def obstacles(self, without: Collection[str] = ()) -> list[str]:
        """Return why the swarm cannot be started yet, at most one line for each drone.

        ``without``: drones that are not waited for.
        """
        now_s = self._clock_s()
        waiting = [agent for agent in self.agents if agent.drone not in without]
        found = [(agent.drone, agent.obstacle(self._mission_id, now_s, without)) for agent in waiting]
        return [f"{drone}: {text}" for drone, text in found if text is not None]

    def has_problems(self) -> bool:
        """Return whether a live agent reports a problem."""
        return any(agent.alive and agent.problems for agent in self.agents)

    def agreed(self) -> bool:
        """Return whether all live agents have reported equal hashes of their logs and bitwise equal source positions."""
        told = [agent.estimate for agent in self.agents if agent.alive]
        estimates = [estimate for estimate in told if estimate is not None]
        return len(estimates) == len(told) > 0 and len({(each.digest, _first_m(each)) for each in estimates}) == 1


def _first_m(estimate: Estimate) -> tuple[float, float, float] | None:
    """Return the first source's place; None if the estimate is a map without sources."""
    return estimate.sources[0].position_m if estimate.sources else None
