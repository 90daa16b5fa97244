"""The problems of a drone as texts: obstacles to a start, and other notices for the operator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.messages import Status
from radron.protocol.texts import MAX_PROBLEMS, CodedText, sendable

TELEMETRY_AGE_NS = 1_000_000_000  # telemetry further from now is not flown by
TWIN_NS = 10_000_000_000  # another agent with the same id is forgotten after this long
FAILSAFE = CodedText(Code.FAILSAFE, "the autopilot is in a failsafe")
NOT_READY = CodedText(Code.NOT_READY_TO_ARM, "the vehicle is not ready to be armed")
LOW_BATTERY = CodedText(Code.BATTERY_LOW, "its battery is below the mission's reserve")


class Problems:
    """The problems of one drone. A flying drone reports them but flies on.

    ``blocked``, ``warned``: found by the shell; the former prevent a start. ``revoked``: that this drone has been, which prevents
    one too.
    """

    def __init__(self, drone: str, mission_id: str, battery_reserve: float) -> None:
        """``battery_reserve``: share of the battery below which the drone would return at once."""
        self._drone = drone
        self._mission_id = mission_id
        self._battery_reserve = battery_reserve
        self._twin_ns: int | None = None  # time of the last message of another agent with this id
        self.revoked: tuple[CodedText, ...] = ()
        self.blocked: tuple[CodedText, ...] = ()
        self.warned: tuple[CodedText, ...] = ()

    def hear_twin(self, now_ns: int) -> None:
        """Another agent sends under this drone's id."""
        self._twin_ns = now_ns

    def has_twin(self, now_ns: int) -> bool:
        """Whether another agent has lately sent under this drone's id."""
        return self._twin_ns is not None and now_ns - self._twin_ns < TWIN_NS

    def against_start(
        self, now_ns: int, vehicle: VehicleState | None, statuses: Mapping[str, Status], obstacles: Iterable[CodedText] = ()
    ) -> tuple[CodedText, ...]:
        """Return what prevents a start. ``statuses``: of the other drones, by id; ``obstacles``: found elsewhere on board."""
        problems = []
        if vehicle is None:
            problems.append(CodedText(Code.TELEMETRY_MISSING, "no telemetry from the vehicle yet"))
        elif now_ns - vehicle.stamp_ns > TELEMETRY_AGE_NS:
            problems.append(CodedText(Code.TELEMETRY_MISSING, "no new telemetry from the vehicle"))
        elif not vehicle.healthy:
            problems.append(FAILSAFE if vehicle.armed or vehicle.in_air else NOT_READY)
        if vehicle is not None and not vehicle.in_air and vehicle.battery is not None and vehicle.battery < self._battery_reserve:
            problems.append(LOW_BATTERY)
        if self.has_twin(now_ns):
            problems.append(CodedText(Code.OWN_ID_IN_USE, f"another agent is running as {self._drone}"))
        problems += obstacles
        problems += [
            CodedText(Code.MISSION_DIFFERS, f"{name} has another mission ({status.mission}, here {self._mission_id})", name)
            for name, status in statuses.items()
            if status.mission != self._mission_id
        ]
        return sendable((*self.revoked, *problems, *self.blocked), MAX_PROBLEMS)

    def all(
        self, flown: Iterable[CodedText], against_start: Iterable[CodedText], seen: Iterable[CodedText]
    ) -> tuple[CodedText, ...]:
        """Return all problems: of the flight, against a start, the shell's warnings, and what else the pilot has seen."""
        return sendable((*flown, *against_start, *self.warned, *seen), MAX_PROBLEMS)
