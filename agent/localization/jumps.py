"""Detection of jumps of the localisation that the vehicle does not announce: each position is compared with the motion before."""

from __future__ import annotations

from collections import deque
from math import degrees, dist, remainder, tau

from msgspec.structs import replace

from radron.agent.geometry import yaw_of
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

JUMP_M, JUMP_RAD = 1.0, 0.15  # ordinary corrections of a localisation filter in one step are smaller
HARDEST_RPS2 = 6.0  # greatest change of a vehicle's turn rate in a second
_LONGEST_S = 0.5  # telemetry further apart in time than this shows no turn rate
_SHORT = 0.5  # a time step shorter than this share of the step before shows no turn rate
_SIGMAS = 3.0
_TOLD_NS = 60_000_000_000  # a jump is reported to the operator for this long
# After so many jumps within SPAN_NS the position is not trusted until it has not jumped for CONFIRM_NS.
OFTEN = 3
SPAN_NS = 10_000_000_000
CONFIRM_NS = 3_000_000_000


class JumpDetector:
    """Detector of unannounced jumps in the telemetry of one vehicle. Each such jump begins an epoch, in addition to those that
    the vehicle counts.

    ``offset``: number of epochs added to the vehicle's count; a restarted agent continues with it. ``jumps``: detected so far.
    """

    def __init__(self, speed_mps: float, offset: int = 0, *, from_launch: bool = False) -> None:
        """``speed_mps``: greatest speed of the vehicles of this swarm. ``offset``: as of the former agent. ``from_launch``: the
        local frame is set at the launch, so jumps before it do not matter.
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
        """Return the telemetry with the epoch to which its position belongs; epochs never decrease. After frequent jumps its
        position is marked as not trusted.
        """
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
        """Return the problem for the operator that the localisation jumped in the last minute; None without that."""
        if not self.jumps or now_ns - self._jump_ns >= _TOLD_NS:
            return None
        return CodedText(Code.LOCALISATION_JUMP, f"its localisation {self._jump} without announcing it")

    def _compare(self, last: VehicleState, state: VehicleState) -> None:
        """Compare two successive telemetry messages of one epoch, and begin a new epoch if the localisation has jumped.

        It has jumped if the position differs from the integrated velocity by more than a flight at full speed and 3 sigma
        explain. If the axes of the local frame may turn, also if the heading has changed by more than a turn and 3 sigma explain.
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
        """Return the change of heading (rad) that a turn of the vehicle does not explain; 0 if a turn explains it.

        ``step_s``: time between both messages. Stamps of telemetry are uneven, so the true time may be that of the step before. A
        turn may slow down or end at once, however fast it was. (A vehicle out of control spins until it hits the ground.)
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
    """Return by how much (rad) a turn lies outside of the range from no turn to a turn on at the former rate, ``onward_rad``."""
    return max(0.0, min(0.0, onward_rad) - turned_rad, turned_rad - max(0.0, onward_rad))
