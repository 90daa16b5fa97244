"""The level of the vehicle's batteries, as the autopilot reports it."""

from __future__ import annotations

from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

STALE_S = 10.0  # PX4 reports once a second or twice; a smart battery's bus may fail in flight
ALL = -1  # number of the level in SYS_STATUS: of all batteries together


class Batteries:
    """Store of the newest reported level of each battery of the vehicle."""

    def __init__(self) -> None:
        self._told: dict[int, tuple[float | None, float]] = {}  # level, and time of the report (s), by number, once known

    def take(self, number: int, percent: int, now_s: float) -> None:
        """Take the reported level (percent) of one battery, or of all together (``ALL``); negative: not known."""
        if percent >= 0 or number in self._told:
            self._told[number] = percent / 100.0 if percent >= 0 else None, now_s

    def level(self, now_s: float) -> float | None:
        """Return the lowest level of all batteries, 0 .. 1, from reports that are not too old; None without one."""
        fresh = (level for level, told_s in self._told.values() if now_s - told_s <= STALE_S)
        return min((level for level in fresh if level is not None), default=None)

    def problem(self, now_s: float) -> CodedText | None:
        """Return the message to the operator if a battery's level is not reported any more; None without a problem.

        The drone would not return when such a battery is nearly empty. SYS_STATUS may repeat the level from before the loss of a
        battery.
        """
        single = [one for number, one in self._told.items() if number != ALL] or list(self._told.values())
        if all(level is not None and now_s - told_s <= STALE_S for level, told_s in single):
            return None
        return CodedText(Code.BATTERY_UNKNOWN, "the autopilot does not tell a battery's level any more")
