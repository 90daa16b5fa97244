"""Scores of the drones' local frames as an agent estimates them: errors against the true frames, and recovery after a jump."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from math import cos, inf, sin
from typing import Protocol

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.sim.geometry import Array, Vector3
from radron.sim.world.movingframes import MovingFrames

RECOVERED_M = 3.0
MAX_RECOVERY_S = 60.0  # longest measured recovery


class Placed(Protocol):
    """Transform from a drone's local frame to the mission frame: rotation by yaw about the vertical axis, then translation."""

    @property
    def yaw_rad(self) -> float:
        """Heading of the local frame in the mission frame, radians."""

    @property
    def translation(self) -> Vector3:
        """Origin of the local frame in the mission frame, metres."""


class Graph(Protocol):
    """The drones' local frames as far as an agent knows them."""

    def mission_from_local(self, drone: str, epoch: int, stamp_ns: int | None = None, /) -> Placed | None:
        """Return the transform from a drone's local frame of this epoch to the mission frame; None while unknown."""


class Frames(Protocol):
    """An agent's knowledge of the drones' local frames."""

    @property
    def graph(self) -> Graph:
        """The local frames known to the agent."""

    def suspects(self) -> Mapping[str, str]:
        """Drones whose local frame the agent distrusts or lacks, with the reasons."""


class FrameScore:
    """Scores one agent's estimates of the drones' local frames, by the position errors that they cause, horizontally."""

    def __init__(self, mission: MissionConfig, frames: Frames, truth: MovingFrames, event_s: float | None) -> None:
        """``frames``: the agent's knowledge of the local frames. ``truth``: the true frames. ``event_s``: time of a jump of a
        frame, from which the recovery is measured; None: no jump.
        """
        self._names = [drone.id for drone in mission.drones]
        self._estimated = [not drone.is_exact for drone in mission.drones]
        self._frames, self._truth = frames, truth
        self._told = [0] * len(self._names)
        self._errors_m: list[float] = []
        self._own_m: list[list[float]] = []
        self._suspected: Counter[str] = Counter()
        self._samples = 0
        self._event_s = event_s
        self._before_m: list[float] = []
        self._after: list[tuple[float, float]] = []
        self.known_s: float | None = None

    def hear(self, drone: int, epoch: int) -> None:
        """Record the epoch of a drone's pose, as an agent also counts jumps that its vehicle has not announced."""
        self._told[drone] = epoch

    def sample(self, time_s: float, tracking: bool, position: Array, position_error: Array) -> Array:
        """Add the frames' errors at one time. N drones.

        Args:
            time_s: since the start of the simulation.
            tracking: whether the agent tracks a source.
            position: (N, 3), true.
            position_error: (N, 3), the small errors of the localisations within their frames.

        Returns:
            (N, 3): position error of each drone in the mission frame, by the agent's frames, or if unknown by its own.
        """
        own = position_error + self._truth.own_error_m(position)
        local = self._truth.local(position + position_error)
        epochs = map(max, self._told, self._truth.epoch)  # a vehicle that has just jumped has not sent a pose yet
        placed = [self._frames.graph.mission_from_local(name, epoch) for name, epoch in zip(self._names, epochs, strict=True)]
        if self.known_s is None and None not in placed:
            self.known_s = time_s
        errors = own.copy()
        for k, transform in enumerate(placed):
            if transform is not None:
                errors[k] = _applied(transform, local[k]) - position[k]
        if tracking:
            level = np.hypot(errors[:, 0], errors[:, 1]).tolist()
            self._errors_m += [level[k] for k, found in enumerate(placed) if found is not None and self._estimated[k]]
            self._own_m.append(np.hypot(own[:, 0], own[:, 1]).tolist())
            self._suspected.update(list(self._frames.suspects()))
            self._samples += 1
        return errors

    def follow(self, time_s: float, error_m: float | None) -> None:
        """Add the error of the source estimate at one time; None: there is no estimate."""
        if self._event_s is None:
            return
        if time_s < self._event_s:
            if error_m is not None:
                self._before_m.append(error_m)
        elif time_s <= self._event_s + MAX_RECOVERY_S:
            self._after.append((time_s, inf if error_m is None else error_m))

    @property
    def error_median_m(self) -> float | None:
        """Median position error of all drones with estimated frames, while tracking, metres."""
        return float(np.median(self._errors_m)) if self._errors_m else None

    @property
    def best_position_error_m(self) -> float | None:
        """Median position error, while tracking, of the drone with the best localisation, metres."""
        return float(np.median(self._own_m, axis=0).min()) if self._own_m else None

    @property
    def suspects(self) -> str:
        """Drones that the agent has suspected for more than half of the tracking, separated by commas."""
        return ",".join(name for name in self._names if 2 * self._suspected[name] > self._samples)

    @property
    def recovery_s(self) -> float | None:
        """Time from a jump of a local frame until the error of the source estimate was last above a limit, seconds.

        The limit is 3 m, or twice the median before the jump if that is more. ``MAX_RECOVERY_S`` if the error is above it at the
        end."""
        if self._event_s is None or not self._before_m or not self._after:
            return None
        limit_m = max(RECOVERED_M, 2.0 * float(np.median(self._before_m)))
        above_s = [time_s for time_s, error_m in self._after if error_m > limit_m]
        if not above_s:
            return 0.0
        return MAX_RECOVERY_S if above_s[-1] == self._after[-1][0] else above_s[-1] - self._event_s


def _applied(transform: Placed, point: Vector3) -> Array:
    c, s = cos(transform.yaw_rad), sin(transform.yaw_rad)
    x, y, z = point
    u, v, w = transform.translation
    return np.array([c * x - s * y + u, s * x + c * y + v, z + w])
