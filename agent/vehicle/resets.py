"""Jumps of the autopilot's local frame, detected by its count of resets and by the effect of the reset.

PX4 counts in ODOMETRY every reset of its estimator: of position, velocity, height or heading. Many do not matter here (the
velocity at takeoff). The frame changes with a reset in which the position jumps. It also changes if satellites are lost or found
with the reset, because the autopilot then uses another position source. A frame guided by vision also changes with a reset of the
heading. The axes of a frame guided by satellites do not change. A reset of the heading without one of the position corrects the
attitude alone (PX4 v1.16.1: in every takeoff).

Positions come in another message (LOCAL_POSITION_NED), so the count may arrive a little before or after the position that jumped.
This position is held back until the count explains it; without an explanation it is passed on unchanged.
"""

from __future__ import annotations

from math import dist, remainder, tau

from radron.agent.geometry import Vector3

JUMP_M = 0.5  # more than three times the noise of the estimate
JUMP_RAD = 0.05
SETTLE_S = 0.05  # after this time the attitude also belongs to the new frame: two messages at 30 Hz
SWITCH_S = 10.0  # largest delay of the reset after a loss of satellites: PX4 waits for them for 5 s
LATE_S = 0.2  # largest delay between count and position: the count comes at 10 Hz
COUNTED_S = 1.0  # after this time without a count the autopilot reports none any more
HARDEST_MPS2 = 8.0  # largest acceleration, linear and angular, that may explain a difference after a gap
HARDEST_RPS2 = 6.0
_NEVER_S = float("-inf")
_COUNTS = 256


class Resets:
    """Detector of jumps of an autopilot's local frame, after which positions and plans in the old frame are wrong.

    All times are by the autopilot's clock. ``count``: the newest count of resets of its position filter; None: not reported.
    ``moved``: whether the position itself jumped at the last change of the frame.
    """

    def __init__(self, count: int | None = None, *, axes_fixed: bool = False) -> None:
        """Start without positions.

        ``count``: count of resets before a restart of the agent; if it has changed since, the frame counts as new.
        ``axes_fixed``: the frame does not turn with the heading.
        """
        self._axes_fixed = axes_fixed
        self.count: int | None = None
        self._before, self._unseen = count, False
        self._waited_from_s: float | None = None  # for the first count
        self._reset_s = self._jump_s = _NEVER_S
        self._held = False
        self.moved = self._moves = False
        self._last: tuple[float, Vector3, Vector3, float, float] | None = None  # as the arguments of ``judge``
        self._satellites: bool | None = None
        self._satellites_of_frame: bool | None = None

    def take_count(self, count: int, stamp_s: float) -> None:
        """Take the autopilot's count of resets of its position filter from an ODOMETRY message."""
        if self.count is not None and (count - self.count) % _COUNTS:
            self._reset_s = stamp_s
        if self.count is None and self._before is not None:
            self._unseen = (count - self._before) % _COUNTS != 0
        self.count = count

    def take_satellites(self, found: bool) -> None:
        """Take whether the satellite receiver has a position."""
        self._satellites = found
        if self._satellites_of_frame is None:
            self._satellites_of_frame = found

    @property
    def in_doubt(self) -> bool:
        """Whether the autopilot's newest position is held back, because it is not decided yet to which local frame it belongs."""
        return self._held

    def judge(self, stamp_s: float, position: Vector3, velocity: Vector3, yaw: float, turning: float) -> bool | None:
        """Return whether the autopilot's frame has changed since the position before.

        Args:
            stamp_s: time of the position.
            position, velocity: m, m/s; NED.
            yaw, turning: heading, rad, and its rate, rad/s.

        Returns:
            None: undecided yet; this position must not be used.
        """
        if self._awaits_count(stamp_s):
            self._held = True
            return None
        # After a reset, a filter's position moves faster than its velocity for a moment: that is no second jump.
        moves, turns = self._jumps(stamp_s, position, velocity, yaw, turning)
        if (moves or (turns and not self._axes_fixed)) and stamp_s - self._jump_s >= LATE_S:
            self._jump_s, self._moves = stamp_s, moves
        self._last = (stamp_s, position, velocity, yaw, turning)
        jumped, reset = stamp_s - self._jump_s < LATE_S, stamp_s - self._reset_s < LATE_S
        settled = stamp_s - self._jump_s >= SETTLE_S
        self._held = jumped and self.count is not None and not (reset and settled)
        if self._held:
            return None
        switched = self._satellites is not self._satellites_of_frame and stamp_s - self._reset_s < SWITCH_S
        unseen, self._unseen = self._unseen, False
        if not (jumped and reset) and not switched:
            self.moved = self.moved and not unseen
            return unseen
        self.moved = jumped and reset and self._moves
        self._satellites_of_frame = self._satellites
        self._jump_s = self._reset_s = _NEVER_S
        return True

    def _awaits_count(self, stamp_s: float) -> bool:
        """Whether the first count is needed to know if the frame has survived a restart of the agent."""
        if self.count is not None or self._before is None:
            return False
        self._waited_from_s = stamp_s if self._waited_from_s is None else self._waited_from_s
        return abs(stamp_s - self._waited_from_s) < COUNTED_S

    def _jumps(self, stamp_s: float, position: Vector3, velocity: Vector3, yaw: float, turning: float) -> tuple[bool, bool]:
        """Whether the step from the last position, and from the last heading, to this one is more than motion explains."""
        if self._last is None or stamp_s <= self._last[0]:
            return False, False
        last_s, last_position, last_velocity, last_yaw, last_turning = self._last
        elapsed_s = stamp_s - last_s
        moved = [0.5 * elapsed_s * (before + now) for before, now in zip(last_velocity, velocity, strict=True)]
        expected = [before + way for before, way in zip(last_position, moved, strict=True)]
        turned = abs(remainder(yaw - last_yaw - 0.5 * elapsed_s * (turning + last_turning), tau))
        gap = 0.5 * elapsed_s**2
        return dist(position, expected) > JUMP_M + HARDEST_MPS2 * gap, turned > JUMP_RAD + HARDEST_RPS2 * gap
