"""Jumps of the localisation that the vehicle does not announce, found by comparing each position with the motion before it."""

from __future__ import annotations

from collections import deque
from math import degrees, dist, remainder, tau

from msgspec.structs import replace

from radron.agent.geometry import yaw_of
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

JUMP_M, JUMP_RAD = 1.0, 0.15  # corrections of a filter within one step stay below these
HARDEST_RPS2 = 6.0  # no vehicle turns faster or slower more suddenly
_LONGEST_S = 0.5  # telemetry further apart than this shows no turn rate
_SHORT = 0.5  # of the step before: a shorter step shows no turn rate
_SIGMAS = 3.0
_TOLD_NS = 60_000_000_000  # a jump is reported for this long
OFTEN = 3  # jumps within SPAN_NS: such a position is not flown by until it has not jumped for CONFIRM_NS
SPAN_NS = 10_000_000_000
CONFIRM_NS = 3_000_000_000


class JumpDetector:
    """Distinguishes jumps from flown steps, and counts epochs of its own on top of the vehicle's.

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
        self._turning: tuple[float, float] | None = None  # rate of its heading (rad/s), and the time (s) that it is of
        self._jump, self._jump_ns = "", 0
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
            else:
                self._turning = None
        if self._jumps_often(state.stamp_ns):
            sigma_m = max(state.position_sigma_m, *(jump_m for _, jump_m in self._recent))
            state = replace(state, position_trusted=False, position_sigma_m=sigma_m)
        return replace(state, epoch=state.epoch + self.offset) if self.offset else state

    def problem(self, now_ns: int) -> CodedText | None:
        """The last jump in words; None where there was none in the last minute."""
        if not self.jumps or now_ns - self._jump_ns >= _TOLD_NS:
            return None
        return CodedText(Code.LOCALISATION_JUMP, f"its localisation {self._jump} without announcing it")

    def _compare(self, last: VehicleState, state: VehicleState) -> None:
        """Compare successive telemetry. A jump is a step that differs from the integrated velocity by more than maximum speed and
        3 sigma. In a frame with free axes it is also a turn that differs from the one before by more than vehicle and 3 sigma
        allow.
        """
        step_s = (state.stamp_ns - last.stamp_ns) * 1e-9
        expected = [
            place + 0.5 * step_s * (before + after)
            for place, before, after in zip(last.position_m, last.velocity_mps, state.velocity_mps, strict=True)
        ]
        jump_m = dist(expected, state.position_m)
        turn_rad = 0.0 if state.axes_fixed else self._turned_rad(last, state, step_s)
        sigma_m = max(last.position_sigma_m, state.position_sigma_m)
        moved = jump_m > self._speed_mps * step_s + _SIGMAS * sigma_m + JUMP_M
        if moved or turn_rad:
            self.offset += 1
            self.jumps += 1
            self._jump = f"jumped by {jump_m:.0f} m" if moved else f"turned by {degrees(turn_rad):.0f} degrees"
            self._jump_ns, self._turning = state.stamp_ns, None
            self._recent.append((state.stamp_ns, jump_m))

    def _turned_rad(self, last: VehicleState, state: VehicleState, step_s: float) -> float:
        """Return the jump of a heading, rad; 0 if the vehicle may have turned so.

        Stamps of telemetry are uneven: the duration may be that of the step before. A turn may end at once, or become slower,
        however fast it was. A vehicle without control spins until it hits the ground.
        """
        turned_rad = remainder(yaw_of(state.quaternion) - yaw_of(last.quaternion), tau)
        before, self._turning = self._turning, (turned_rad / step_s, step_s) if step_s < _LONGEST_S else None
        if before is None or self._turning is None:
            return 0.0
        rate_rps, over_s = before
        if step_s < _SHORT * over_s:  # no measure of the rate: it may have taken longer
            self._turning = rate_rps, step_s
        jump_rad = min(_beyond(turned_rad, rate_rps * took_s) for took_s in (step_s, over_s))
        sigma_rad = max(last.yaw_sigma_rad, state.yaw_sigma_rad)
        most_rad = JUMP_RAD + _SIGMAS * sigma_rad + 0.5 * HARDEST_RPS2 * step_s * (step_s + over_s)
        return jump_rad if jump_rad > most_rad else 0.0

    def _jumps_often(self, stamp_ns: int) -> bool:
        if len(self._recent) < OFTEN or stamp_ns - self._jump_ns >= CONFIRM_NS:
            return False
        return self._recent[-1][0] - self._recent[0][0] < SPAN_NS


def _beyond(turned_rad: float, onward_rad: float) -> float:
    """Return how far a turn is outside of the range from none to the unchanged rate, rad."""
    return max(0.0, min(0.0, onward_rad) - turned_rad, turned_rad - max(0.0, onward_rad))
