"""Motion of a landed vehicle: either it is carried away, or its localisation is wrong."""

from __future__ import annotations

from math import dist

from msgspec.structs import replace

from radron.agent.geometry import Vector3
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

# A standing receiver's position wanders by a metre or two (multipath, the constellation). With spoofing, or a diverging filter,
# it moves on and on. This limit and the stated errors avoid false alarms.
MOVED_M = 3.0
_SIGMAS = 3.0


class Resting:
    """Takes the telemetry of one vehicle; on the ground after a flight its position is trusted as long as it stays the same.

    The camera continues measuring there, and in flight nothing on board could distinguish a slow slide of the position from
    motion.
    """

    def __init__(self) -> None:
        self._has_flown = False
        self._place: tuple[int, Vector3, float] | None = None  # of the landing: epoch, position, 1 sigma
        self.moved_m = 0.0  # since then, if more than errors explain

    def take(self, state: VehicleState, *, reports_down: bool) -> VehicleState:
        """Return the telemetry; its position is untrusted after a motion on the ground.

        ``reports_down``: the autopilot reports a landing; ``state`` shows it only once it is confirmed.
        """
        if not reports_down:
            self._has_flown = self._has_flown or state.in_air
            self._place, self.moved_m = None, 0.0
        elif self._has_flown and state.position_trusted:
            self._compare(state)
        if not self.moved_m or state.armed or state.in_air:
            return state
        return replace(state, position_trusted=False, position_sigma_m=max(state.position_sigma_m, self.moved_m))

    def problem(self) -> CodedText | None:
        """Return the message to the operator on a vehicle that seems to have moved."""
        if not self.moved_m:
            return None
        text = f"has moved by {self.moved_m:.0f} m since it landed, if its localisation is right: what it measures is not used"
        return CodedText(Code.MOVED_AFTER_LANDING, text)

    def _compare(self, state: VehicleState) -> None:
        if self._place is None or (self._place[0] != state.epoch and not self.moved_m):
            self._place = state.epoch, state.position_m, state.position_sigma_m
        epoch, place, sigma_m = self._place
        if epoch != state.epoch:  # it has jumped as well
            return
        moved_m = dist(place[:2], state.position_m[:2])
        self.moved_m = moved_m if moved_m > MOVED_M + _SIGMAS * max(sigma_m, state.position_sigma_m) else 0.0
