"""Simulated sensors with which drones measure direction and range of each other.

A camera that identifies blinking lamps gives directions, a radio gives ranges.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta, Struct
from scipy.spatial.transform import Rotation

from radron.agent.vehicle.interface import SeenDrone
from radron.sim.geometry import Array, Quaternion
from radron.sim.world.walls import Walls

Share = Annotated[float, Meta(ge=0.0, lt=1.0)]


class SightingTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True errors of the sensors with which drones see each other.

    Defaults: UVDAR, ultraviolet lamps and cameras all around (Walter et al., RA-L 2019: bearings to a few degrees, tens of
    metres), with ultra-wideband ranging (0.1-0.3 m). sigmas: 1 sigma of both angles, and of the range. missed: share of the
    visible drones that are not reported. false_share: share of the reports; half of these are of nothing, half of another drone
    than the one named. Occlusions occur by pair; walls hide drones too.
    """

    sensor: Literal["both", "direction", "range"] = "both"
    rate_hz: Annotated[float, Meta(gt=0.0, le=20.0)] = 5.0
    range_m: Annotated[float, Meta(gt=0.0, le=1e4)] = 40.0
    field_of_view_deg: Annotated[float, Meta(gt=0.0, le=360.0)] = 360.0  # about the body's forward axis
    direction_sigma_deg: Annotated[float, Meta(gt=0.0, le=45.0)] = 2.0
    range_sigma_m: Annotated[float, Meta(gt=0.0, le=100.0)] = 0.3
    missed: Share = 0.1
    false_share: Share = 0.1
    visible_s: Annotated[float, Meta(gt=0.0, le=1e6)] | None = 20.0  # mean time between occlusions; None: no occlusions
    occluded_s: Annotated[float, Meta(gt=0.0, le=1e6)] = 3.0  # mean duration
    delay_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.1  # from the exposure to the agent


class Sightings:
    """Simulates how N drones see each other, in fixed time steps; every time stamp is the time of exposure."""

    def __init__(
        self, truth: SightingTruth, drones: Sequence[str], walls: Walls | None, step_s: float, rng: np.random.Generator
    ) -> None:
        self._truth, self._drones, self._walls, self._rng = truth, tuple(drones), walls, rng
        self._every = max(1, round(1.0 / (truth.rate_hz * step_s)))
        self._period_s = self._every * step_s
        self._delay_ns = round(truth.delay_s * 1e9)
        self._direction_sigma = float(np.radians(truth.direction_sigma_deg))
        self._least_cos = float(np.cos(np.radians(0.5 * truth.field_of_view_deg)))
        self._occluded = np.zeros((len(drones), len(drones)), dtype=bool)
        self._waiting: list[tuple[int, int, list[SeenDrone]]] = []  # delivery time, observer, observations

    def due(self, step: int) -> bool:
        """Return whether the sensors are exposed in this time step."""
        return step % self._every == 0

    def look(self, stamp_ns: int, position_m: Array, attitudes: Sequence[Quaternion]) -> None:
        """Expose all sensors at the true positions (N, 3) and attitudes of the drones.

        Attitudes rotate from the body to the world frame (w, x, y, z).
        """
        self._occlude()
        turns = Rotation.from_quat(np.array(attitudes)[:, [1, 2, 3, 0]]).as_matrix()
        for observer in range(len(self._drones)):
            ways = (position_m - position_m[observer]) @ turns[observer]  # body FLU
            seen = [
                self._report(stamp_ns, observer, target, ways)
                for target in range(len(self._drones))
                if target != observer and self._sees(observer, target, ways[target], position_m)
            ]
            if seen:
                self._waiting.append((stamp_ns + self._delay_ns, observer, seen))

    def take(self, now_ns: int) -> list[tuple[int, list[SeenDrone]]]:
        """Return the observations that have been delivered by now, with the index of the observing drone."""
        ready = [(observer, seen) for due_ns, observer, seen in self._waiting if due_ns <= now_ns]
        self._waiting = [one for one in self._waiting if one[0] > now_ns]
        return ready

    def _occlude(self) -> None:
        truth = self._truth
        if truth.visible_s is None:
            return
        mean_s = np.where(self._occluded, truth.occluded_s, truth.visible_s)
        self._occluded ^= self._rng.random(self._occluded.shape) < self._period_s / mean_s

    def _sees(self, observer: int, target: int, way: Array, position_m: Array) -> bool:
        distance = float(np.linalg.norm(way))
        if self._occluded[observer, target] or not 0.0 < distance <= self._truth.range_m:
            return False
        if self._truth.sensor != "range" and way[0] < self._least_cos * distance:
            return False
        if self._walls is not None and self._walls.concrete_m(position_m[observer], position_m[target]) > 0.0:
            return False
        return bool(self._rng.random() >= self._truth.missed)

    def _report(self, stamp_ns: int, observer: int, target: int, ways: Array) -> SeenDrone:
        """Return a report of the drone ``target``, or of a false target; ways (N, 3): to each drone, in the observer's body
        frame.
        """
        truth, rng = self._truth, self._rng
        way = ways[target]
        if rng.random() < truth.false_share:
            others = [k for k in range(len(ways)) if k not in (observer, target)]
            mistaken = others and rng.random() < 0.5
            way = ways[rng.choice(others)] if mistaken else self._anywhere()
        distance = max(float(np.linalg.norm(way)), 1e-3)
        # along the line of sight the noise has no effect
        direction = way / distance + self._direction_sigma * rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        range_m = abs(distance + truth.range_sigma_m * float(rng.standard_normal()))
        return SeenDrone(
            stamp_ns=stamp_ns,
            target=self._drones[target],
            direction=None if truth.sensor == "range" else (float(direction[0]), float(direction[1]), float(direction[2])),
            direction_sigma_rad=None if truth.sensor == "range" else self._direction_sigma,
            range_m=None if truth.sensor == "direction" else range_m,
            range_sigma_m=None if truth.sensor == "direction" else truth.range_sigma_m,
        )

    def _anywhere(self) -> Array:
        """A random position (3,) in the field of view, within the range."""
        half = 0.5 * np.radians(self._truth.field_of_view_deg)
        off = self._rng.uniform(-half, half)
        way: Array = np.array([np.cos(off), np.sin(off), self._rng.uniform(-0.2, 0.2)])
        return way * self._rng.uniform(0.05, 1.0) * self._truth.range_m
