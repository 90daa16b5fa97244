"""How well the agents know whose coordinates are whose: their frames against the true ones, and how they get over a jump."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from math import cos, inf, sin
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from agent.config import MissionConfig
from sim.movingframes import MovingFrames

RECOVERED_M = 3.0
RECOVERY_S = 60.0  # longer is not waited for
Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]


class Placed(Protocol):
    """Mission frame from a local frame: yaw about up, then translation."""

    @property
    def yaw_rad(self) -> float:
        """Heading of the local frame."""

    @property
    def translation(self) -> Vector3:
        """Its origin, metres."""


class Graph(Protocol):
    """The frames that an agent knows."""

    def mission_from_local(self, drone: str, epoch: int, stamp_ns: int | None = None, /) -> Placed | None:
        """Where a drone's frame of this epoch lies now; None while nobody knows."""


class Frames(Protocol):
    """What an agent knows of the frames."""

    @property
    def graph(self) -> Graph:
        """The frames that it knows."""

    def suspects(self) -> Mapping[str, str]:
        """By drone: why its frame is not believed, or not known."""


class FrameScore:
    """One agent's frames against the truth. Places are compared where the drones are, level."""

    def __init__(self, mission: MissionConfig, frames: Frames, truth: MovingFrames, event_s: float | None) -> None:
        """``event_s``: when something happens to a frame that the swarm has to get over."""
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
        """A drone has told a pose of that epoch: an agent counts jumps that its vehicle said nothing of, too."""
        self._told[drone] = epoch

    def sample(self, time_s: float, tracking: bool, position: Array, position_error: Array) -> Array:
        """Look once.

        Args:
            time_s: since the start of the simulation.
            tracking: whether the agent tracks.
            position: (N, 3), true.
            position_error: (N, 3), the small errors of the localisations within their frames.

        Returns:
            (N, 3): by how much each drone's place in the mission frame is wrong, by the frames that the agent knows;
            where it knows none, by the drone's own.
        """
        own = position_error + self._truth.own_error_m(position)
        local = self._truth.local(position + position_error)
        epochs = map(max, self._told, self._truth.epoch)  # of a vehicle that jumped just now nothing was told yet
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
        """Take the error of the hypothesis down, one sample after the other; None: there is no hypothesis."""
        if self._event_s is None:
            return
        if time_s < self._event_s:
            if error_m is not None:
                self._before_m.append(error_m)
        elif time_s <= self._event_s + RECOVERY_S:
            self._after.append((time_s, inf if error_m is None else error_m))

    @property
    def error_median_m(self) -> float | None:
        """Of the places of all drones whose frames are estimated, while tracking."""
        return float(np.median(self._errors_m)) if self._errors_m else None

    @property
    def best_position_error_m(self) -> float | None:
        """Of the drone whose own localisation is the best; median while tracking."""
        return float(np.median(self._own_m, axis=0).min()) if self._own_m else None

    @property
    def suspects(self) -> str:
        """Those that the agent suspected for more than half of the tracking, separated by commas."""
        return ",".join(name for name in self._names if 2 * self._suspected[name] > self._samples)

    @property
    def recovery_s(self) -> float | None:
        """How long after the event the error was above the limit for the last time; ``RECOVERY_S`` where it is so in the end.

        The limit is 3 m, or twice the median before the event where that is more.
        """
        if self._event_s is None or not self._before_m or not self._after:
            return None
        limit_m = max(RECOVERED_M, 2.0 * float(np.median(self._before_m)))
        above_s = [time_s for time_s, error_m in self._after if error_m > limit_m]
        if not above_s:
            return 0.0
        return RECOVERY_S if above_s[-1] == self._after[-1][0] else above_s[-1] - self._event_s


def _applied(transform: Placed, point: Vector3) -> Array:
    c, s = cos(transform.yaw_rad), sin(transform.yaw_rad)
    x, y, z = point
    u, v, w = transform.translation
    return np.array([c * x - s * y + u, s * x + c * y + v, z + w])
