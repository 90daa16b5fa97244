"""Detection of motion after the landing: either the vehicle is carried away, or its localisation is wrong."""

from __future__ import annotations

from math import dist

from msgspec.structs import replace

from radron.agent.geometry import Vector3
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

# The position of a satellite receiver at rest wanders by a metre or two (multipath, the constellation). With spoofing, or a
# diverging filter, it moves on and on. This limit, together with the stated errors, avoids false alarms.
MOVED_M = 3.0
_SIGMAS = 3.0


class Resting:
    """Check of the position of one vehicle on the ground after a flight: it is trusted only as long as it stays the same.

    This matters because the camera goes on measuring there. In flight, a slow slide of the position cannot be distinguished from
    motion. ``moved_m``: horizontal distance since the landing, if it is more than errors explain; else 0.
    """

    def __init__(self) -> None:
        self._has_flown = False
        self._place: tuple[int, Vector3, float] | None = None  # of the landing: epoch, position, 1 sigma
        self.moved_m = 0.0

    def take(self, state: VehicleState, *, reports_down: bool) -> VehicleState:
        """Process telemetry, and return it; its position is marked as not trusted if it has moved on the ground.

        ``reports_down``: the autopilot reports that the vehicle is down; ``state`` shows that only once it is confirmed.
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
        """Return the problem for the operator that a landed vehicle seems to have moved; None without that."""
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
