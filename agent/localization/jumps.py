"""Jumps of the localisation that the vehicle does not announce, found by holding each position against the motion before it."""

from __future__ import annotations

from collections import deque
from math import dist

from msgspec.structs import replace

from agent.vehicle.interface import VehicleState

JUMP_M = 1.0  # corrections of a filter within one step stay below this
_SIGMAS = 3.0
_TOLD_NS = 60_000_000_000  # a jump is reported for this long
OFTEN = 3  # jumps within SPAN_NS: such a position is not flown by until it has not jumped for CONFIRM_NS
SPAN_NS = 10_000_000_000
CONFIRM_NS = 3_000_000_000


class JumpDetector:
    """Tells jumps from flown steps, and counts epochs of its own on top of the vehicle's.

    ``offset``: the number of epochs added; a restarted agent continues from it.
    """

    def __init__(self, speed_mps: float, offset: int = 0, *, from_launch: bool = False) -> None:
        """``speed_mps``: no vehicle of this swarm flies faster. ``from_launch``: the frame is that of the launch place, so that a
        jump before it does not matter.
        """
        self._speed_mps = speed_mps
        self.offset = offset
        self._counts = not from_launch
        self._recent: deque[tuple[int, float]] = deque(maxlen=OFTEN)  # stamps and sizes of the last jumps
        self._last: VehicleState | None = None  # with the vehicle's own epoch
        self._jump_m, self._jump_ns = 0.0, 0
        self.jumps = 0

    def take(self, state: VehicleState) -> VehicleState:
        """The telemetry with the epoch that its position belongs to; epochs only ever grow."""
        last, self._last = self._last, state
        self._counts = self._counts or state.armed or state.in_air
        if last is not None and self._counts:
            if state.epoch < last.epoch:  # a restarted autopilot counts from the beginning
                self.offset += last.epoch - state.epoch + 1
            elif state.epoch == last.epoch:
                self._compare(last, state)
        if self._jumps_often(state.stamp_ns):
            sigma_m = max(state.position_sigma_m, *(jump_m for _, jump_m in self._recent))
            state = replace(state, position_trusted=False, position_sigma_m=sigma_m)
        return replace(state, epoch=state.epoch + self.offset) if self.offset else state

    def problem(self, now_ns: int) -> str | None:
        """The last jump in words; None where there was none in the last minute."""
        if not self.jumps or not 0 <= now_ns - self._jump_ns < _TOLD_NS:
            return None
        return f"its localisation jumped by {self._jump_m:.0f} m without announcing it"

    def _compare(self, last: VehicleState, state: VehicleState) -> None:
        """A jump is a step that differs from the integrated velocity by more than maximum speed and 3 sigma explain."""
        step_s = (state.stamp_ns - last.stamp_ns) * 1e-9
        if step_s <= 0.0:  # the clock was set back: how long it took is not known
            return
        expected = [
            place + 0.5 * step_s * (before + after)
            for place, before, after in zip(last.position_m, last.velocity_mps, state.velocity_mps, strict=True)
        ]
        jump_m = dist(expected, state.position_m)
        sigma_m = max(last.position_sigma_m, state.position_sigma_m)
        if jump_m > self._speed_mps * step_s + _SIGMAS * sigma_m + JUMP_M:
            self.offset += 1
            self.jumps += 1
            self._jump_m, self._jump_ns = jump_m, state.stamp_ns
            self._recent.append((state.stamp_ns, jump_m))

    def _jumps_often(self, stamp_ns: int) -> bool:
        if len(self._recent) < OFTEN or abs(stamp_ns - self._jump_ns) >= CONFIRM_NS:
            return False
        return self._recent[-1][0] - self._recent[0][0] < SPAN_NS
