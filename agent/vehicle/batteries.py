"""The level of the vehicle's batteries, as the autopilot tells it."""

from __future__ import annotations

STALE_S = 10.0  # PX4 tells it once a second or twice; a smart battery's bus may fail in flight
ALL = -1  # number of what SYS_STATUS tells: of all batteries together


class Batteries:
    """The newest level of each battery."""

    def __init__(self) -> None:
        self._told: dict[int, tuple[float, float]] = {}  # level, and when it was told (s), by number

    def take(self, number: int, percent: int, now_s: float) -> None:
        """Take what is told of one battery, or of ``ALL``; negative: it does not know."""
        if percent >= 0:
            self._told[number] = percent / 100.0, now_s
        else:
            self._told.pop(number, None)

    def level(self, now_s: float) -> float | None:
        """The lowest level, 0 .. 1, that is not stale; None: nobody tells."""
        return min((level for level, told_s in self._told.values() if now_s - told_s <= STALE_S), default=None)

    def problem(self, now_s: float) -> str | None:
        """What is told to the operator: a level that was known is not told any more, and no return follows from it."""
        if not self._told or self.level(now_s) is not None:
            return None
        return f"the autopilot has not told the battery's level for {STALE_S:.0f} s"
