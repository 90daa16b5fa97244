"""When the autopilot's local frame has jumped: by its count of resets, and by what the reset did.

PX4 counts in ODOMETRY every reset of its estimator: of position, velocity, height or heading. Many move nothing that matters (the
velocity at takeoff). The frame is another one after a reset with which position or heading jumped, or with which satellites were
lost or found, because the autopilot is then guided by something else.

Positions come in another message (LOCAL_POSITION_NED), so the count may arrive a little before or after the position that jumped.
A position that jumped is held back until the count says what it was; where it says nothing, it is passed on as it is.
"""

from __future__ import annotations

from math import dist, remainder, tau

from agent.vehicle.interface import Vector3

JUMP_M = 0.5  # more than three times what the estimate's noise is
JUMP_RAD = 0.05
SETTLE_S = 0.05  # after which the attitude, too, is surely that of the new frame: two messages of 30 Hz
SWITCH_S = 10.0  # by which the loss of satellites and the reset that follows may differ: PX4 waits for them for 5 s
LATE_S = 0.2  # by which count and position may differ: the count comes at 10 Hz
HARDEST_MPS2 = 8.0  # acceleration, and turning, that explain a difference after a gap
HARDEST_RPS2 = 6.0
_NEVER_S = float("-inf")
_COUNTS = 256


class Resets:
    """Watches one autopilot; all times are of its clock. ``count``: the newest count of resets; None: it tells none."""

    def __init__(self, count: int | None = None) -> None:
        """``count``: of before a restart of the agent: where it has grown since, the frame counts as another one."""
        self.count: int | None = None
        self._before = count
        self._reset_s = self._jump_s = _NEVER_S
        self._held = False
        self._last: tuple[float, Vector3, Vector3, float, float] | None = None  # as the arguments of ``judge``
        self._satellites: bool | None = None
        self._satellites_of_frame: bool | None = None

    def take_count(self, count: int, stamp_s: float) -> None:
        """Take the count of an ODOMETRY."""
        before = self._before if self.count is None else self.count
        if before is not None and (count - before) % _COUNTS:
            self._reset_s = stamp_s
            if self.count is None:
                self._jump_s = stamp_s  # whatever happened, nobody was there to see it
        self.count = count

    def take_satellites(self, found: bool) -> None:
        """Take whether the receiver has a position."""
        self._satellites = found
        if self._satellites_of_frame is None:
            self._satellites_of_frame = found

    @property
    def in_doubt(self) -> bool:
        """Whether the newest position is held back."""
        return self._held

    def judge(self, stamp_s: float, position: Vector3, velocity: Vector3, yaw: float, turning: float) -> bool | None:
        """Whether the frame is another one than at the position before.

        Args:
            stamp_s: of the position.
            position, velocity: m, m/s; NED.
            yaw, turning: rad, rad/s.

        Returns:
            None: it cannot be told yet, and nothing should be done by this position.
        """
        if self._jumps(stamp_s, position, velocity, yaw, turning):
            self._jump_s = stamp_s
        self._last = (stamp_s, position, velocity, yaw, turning)
        jumped, reset = stamp_s - self._jump_s < LATE_S, stamp_s - self._reset_s < LATE_S
        settled = stamp_s - self._jump_s >= SETTLE_S
        self._held = jumped and self.count is not None and not (reset and settled)
        if self._held:
            return None
        switched = self._satellites is not self._satellites_of_frame and stamp_s - self._reset_s < SWITCH_S
        if not (jumped and reset) and not switched:
            return False
        self._satellites_of_frame = self._satellites
        self._jump_s = self._reset_s = _NEVER_S
        return True

    def _jumps(self, stamp_s: float, position: Vector3, velocity: Vector3, yaw: float, turning: float) -> bool:
        """Whether motion does not explain the way from the last position to this one."""
        if self._last is None or stamp_s <= self._last[0]:
            return False
        last_s, last_position, last_velocity, last_yaw, last_turning = self._last
        elapsed_s = stamp_s - last_s
        moved = [0.5 * elapsed_s * (before + now) for before, now in zip(last_velocity, velocity, strict=True)]
        expected = [before + way for before, way in zip(last_position, moved, strict=True)]
        turned = abs(remainder(yaw - last_yaw - 0.5 * elapsed_s * (turning + last_turning), tau))
        gap = 0.5 * elapsed_s**2
        return dist(position, expected) > JUMP_M + HARDEST_MPS2 * gap or turned > JUMP_RAD + HARDEST_RPS2 * gap
