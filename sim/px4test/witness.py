"""Observation of a flight test by the vehicles' true states: distances, speeds, and errors of the agents' own positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import dist, hypot
from typing import NamedTuple

import numpy as np

from radron.protocol.messages import AnyDroneMessage, Pose, Stage
from radron.sim.geometry import Array
from radron.sim.live.operator import Operator
from radron.sim.live.worldlink import Truth
from radron.sim.scoring.moment import OFF_GROUND_M
from radron.sim.world.frame import LocalFrames


class Moment(NamedTuple):
    """State of a flight test at one time.

    time_s: time of the world. position, velocity: (N, 3) true values of N vehicles. own_error_m: error of each agent's latest
    pose; NaN without one.
    """

    time_s: float
    position: Array
    velocity: Array
    stages: tuple[Stage, ...]
    modes: tuple[str, ...]
    armed: tuple[bool, ...]
    failsafe: tuple[bool, ...]
    own_error_m: tuple[float, ...]

    def flies(self, drone: int) -> bool:
        """Return whether a drone is in the air, by its true height above its mission's ground plane."""
        return bool(self.position[drone, 2] > OFF_GROUND_M)


class Witness:
    """Records the flights of a swarm from its construction on. ``moments``: recorded states, 20 a second."""

    def __init__(self, operator: Operator) -> None:
        self.moments: list[Moment] = []
        self._agents = operator.observer.agents
        drones = operator.mission.drones
        self._frames = LocalFrames([(drone.origin_m, drone.yaw_deg) for drone in drones])
        self._own: list[Array | None] = [None] * len(drones)
        operator.watchers.append(self._see)
        operator.observer.listeners.append(self._hear)

    @property
    def now(self) -> Moment:
        """The latest recorded state."""
        return self.moments[-1]

    def since(self, time_s: float) -> list[Moment]:
        """Return the states recorded since a time (s)."""
        return [moment for moment in self.moments if moment.time_s >= time_s]

    def first_s(self, since_s: float, condition: Callable[[Moment], bool]) -> float | None:
        """Return the time (s) from ``since_s`` until a condition first held; None: never."""
        return next((moment.time_s - since_s for moment in self.since(since_s) if condition(moment)), None)

    def _hear(self, place: int, message: AnyDroneMessage) -> None:
        if isinstance(message, Pose):
            self._own[place] = self._frames.matrix[place] @ message.position_m + self._frames.origin[place]

    def _see(self, truth: Truth) -> None:
        own = [
            float("nan") if believed is None else hypot(believed[0] - true[0], believed[1] - true[1])
            for believed, true in zip(self._own, truth.position_m, strict=True)
        ]
        self.moments.append(
            Moment(
                truth.time_s,
                np.array(truth.position_m),
                np.array(truth.velocity_mps),
                tuple(agent.stage for agent in self._agents),
                tuple(vehicle.mode for vehicle in truth.vehicles),
                tuple(vehicle.armed for vehicle in truth.vehicles),
                tuple(vehicle.failsafe for vehicle in truth.vehicles),
                tuple(own),
            )
        )


def least_distance_m(moments: Sequence[Moment]) -> tuple[float, float]:
    """Return the smallest distance between two airborne drones in metres, horizontally and in space.

    The values are infinite without two such drones.
    """
    flat = space = float("inf")
    for moment in moments:
        flying = [moment.position[drone].tolist() for drone in range(len(moment.position)) if moment.flies(drone)]
        for place, one in enumerate(flying):
            for other in flying[:place]:
                flat = min(flat, dist(one[:2], other[:2]))
                space = min(space, dist(one, other))
    return flat, space


def speed_mps(moment: Moment, drone: int) -> float:
    """Return the true speed of a drone, m/s."""
    return float(np.linalg.norm(moment.velocity[drone]))
