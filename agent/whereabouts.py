"""What one drone knows of where it is: its telemetry as it is to be understood, its fixes and sights, and the swarm's frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import hypot, isfinite

from msgspec.structs import replace

from agent.clocks import Clocks
from agent.config import DroneInMission, MissionConfig
from agent.epochs import EpochWatch
from agent.frames.swarm import SwarmFrames
from agent.frames.transform import Transform
from agent.poses import PoseHistory
from agent.positioning import Positioning
from agent.vehicle.interface import VehicleState
from protocol.messages import Entry, Sighting

FARTHEST_M = 1e5  # what a message can carry
UNSURE_M = 5.0  # a drone that knows its place in the mission frame less well says so; 1 sigma
_HEADING_DEG = 90.0  # a heading known less well is not known at all


class Whereabouts:
    """Of one drone. ``vehicle``: its newest telemetry; ``clocks``: of all drones, as far as heard."""

    def __init__(
        self,
        mission: MissionConfig,
        member: DroneInMission,
        boot: str,
        frames: SwarmFrames,
        history: PoseHistory,
        numbers: Iterator[int],
        counters: Counter[str],
        epoch_offset: int,
    ) -> None:
        """``history``, ``numbers``: of its poses and entries; ``epoch_offset``: of the agent that flew it before."""
        others = [one.id for one in mission.drones if one.id != member.id]
        self._drone = member.id
        self._frames = frames
        self._history, self._counters = history, counters
        self.vehicle: VehicleState | None = None
        self.clocks = Clocks(member.id, others)
        self.positioning = Positioning(member.id, others, mission.mission_id, boot, history, numbers, counters)
        self.is_estimated = not member.is_exact
        # A drone whose heading is not known has to be seen by others, or to see them: else it would never get to know its frame.
        self.is_unplaced = self.is_estimated and member.yaw_sigma_deg > _HEADING_DEG
        self._epochs: EpochWatch | None = None  # a frame that is known exactly does not jump
        if self.is_estimated:
            self._epochs = EpochWatch(mission.limits.speed_mps, epoch_offset)

    @property
    def epoch_offset(self) -> int:
        """By how much the published epochs are ahead of the vehicle's own."""
        return self._epochs.offset if self._epochs is not None else 0

    def follow(self, state: VehicleState) -> VehicleState | None:
        """Take telemetry; returns it as it is to be understood. What is older than known, not finite or absurdly far away is
        counted and dropped."""
        if self.vehicle is not None and state.stamp_ns <= self.vehicle.stamp_ns:
            self._counters["telemetry_older_than_known"] += 1
            return None
        if not _plausible(state):
            self._counters["telemetry_implausible"] += 1
            return None
        self.vehicle = self._understood(state)
        self._history.add(self.vehicle)
        return self.vehicle

    def take(self, entry: Entry) -> None:
        """Take what is new in the log."""
        if isinstance(entry, Sighting) and self._drone in (entry.drone, entry.target):
            self.is_unplaced = False

    @property
    def frame(self) -> Transform | None:
        """The own local frame in the mission's; None while it is not known."""
        return self._frames.graph.mission_from_local(self._drone, self.vehicle.epoch) if self.vehicle is not None else None

    def problems(self, now_ns: int, flies: bool) -> tuple[str, ...]:
        """What is to be told of clock, localisation and frames. Before a flight it is no problem that a frame is not known."""
        jump = self._epochs.problem(now_ns) if self._epochs is not None else None
        told = [problem for problem in (self.clocks.problem(now_ns), jump) if problem is not None]
        if not flies:
            return tuple(told)
        frame, suspects = self.frame, self._frames.suspects()
        sigma_m = frame.sigmas_at(self.vehicle.position_m)[0] if frame is not None and self.vehicle is not None else 0.0
        if sigma_m > UNSURE_M and self._drone not in suspects:
            told.append(f"it knows its place to {sigma_m:.0f} m only")
        return (*told, *_lines(self._drone, suspects))

    def _understood(self, state: VehicleState) -> VehicleState:
        """With the epoch that it belongs to, and with the error that a wrong clock makes of a motion."""
        if self._epochs is not None:
            state = self._epochs.take(state)
        clock_m = self.clocks.sigma_m(hypot(*state.velocity_mps))
        if clock_m == 0.0:
            return state
        return replace(state, position_sigma_m=hypot(state.position_sigma_m, clock_m), clock_sigma_m=clock_m)


def _plausible(state: VehicleState) -> bool:
    """Whether telemetry can be flown by: all numbers finite, and within what a message can carry."""
    sigmas = state.position_sigma_m + state.yaw_sigma_rad
    others = sum(state.velocity_mps) + sum(state.quaternion) + sigmas + state.height_m
    return isfinite(others) and sigmas >= 0.0 and all(-FARTHEST_M < value < FARTHEST_M for value in state.position_m)


def _lines(drone: str, suspects: Mapping[str, str]) -> list[str]:
    """One for each drone that is suspected, the own first."""
    return [f"{name}: {suspects[name]}" for name in sorted(suspects, key=lambda name: (name != drone, name))]
