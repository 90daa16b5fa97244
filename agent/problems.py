"""What is wrong with a drone, in words: what stands against a start, and what the operator has to know besides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from agent.vehicle.interface import VehicleState
from protocol.messages import Status

TELEMETRY_AGE_NS = 1_000_000_000  # telemetry further from now cannot be flown by
TWIN_NS = 10_000_000_000  # another agent with the same id is forgotten after so long
MOST_PROBLEMS = 32  # of a status message, as is the length
LONGEST_PROBLEM = 256


class Problems:
    """The problems of one drone. A flying drone reports them but flies on.

    ``blocked``, ``warned``: what the shell has found, with and without power to stand against a start. ``noticed``, ``seen``:
    what the pilot has found, without that power, of the camera and its spectrum and of clocks, places and frames.
    ``unplaced``: there is nothing yet that its heading could be derived from.
    """

    def __init__(self, drone: str, mission_id: str) -> None:
        self._drone = drone
        self._mission_id = mission_id
        self._twin_ns: int | None = None  # when another agent with this id was last heard
        self.unplaced = False
        self.blocked: tuple[str, ...] = ()
        self.warned: tuple[str, ...] = ()
        self.noticed: tuple[str, ...] = ()
        self.seen: tuple[str, ...] = ()

    def hear_twin(self, now_ns: int) -> None:
        """Another agent speaks under this drone's id."""
        self._twin_ns = now_ns

    def against_start(self, now_ns: int, vehicle: VehicleState | None, statuses: Mapping[str, Status]) -> tuple[str, ...]:
        """What stands against a start. ``statuses``: of the others, by id."""
        problems = []
        if vehicle is None:
            problems.append("no telemetry from the vehicle yet")
        elif abs(now_ns - vehicle.stamp_ns) > TELEMETRY_AGE_NS:
            problems.append("no new telemetry from the vehicle")
        elif not vehicle.healthy:
            problems.append("the vehicle is not healthy")
        if self._twin_ns is not None and now_ns - self._twin_ns < TWIN_NS:
            problems.append(f"another agent is running as {self._drone}")
        if self.unplaced:
            problems.append("its heading is not known, and it has neither seen another drone nor been seen yet")
        problems += [
            f"{name} has another mission file ({status.mission}, here {self._mission_id})"
            for name, status in statuses.items()
            if status.mission != self._mission_id
        ]
        return _sendable((*problems, *self.blocked))

    def all(self, now_ns: int, vehicle: VehicleState | None, statuses: Mapping[str, Status]) -> tuple[str, ...]:
        """Everything, what stands against a start first."""
        return _sendable((*self.against_start(now_ns, vehicle, statuses), *self.warned, *self.seen, *self.noticed))


def _sendable(problems: Iterable[str]) -> tuple[str, ...]:
    """Each once, and no more than a status message carries."""
    return tuple(dict.fromkeys(problem[:LONGEST_PROBLEM] for problem in problems))[:MOST_PROBLEMS]
