"""From the autopilot's time since boot to own time."""

from __future__ import annotations

from collections import deque

WINDOW_NS = 2_000_000_000
REBOOTED = 10  # stamps that show a reboot
REBOOT_NS = 1_000_000_000  # a stamp this much older than the last one is not a reordered packet


class BootClock:
    """Maps the time stamps of an autopilot, which count from its boot, to own time by the least delayed message of the last
    two seconds.

    Messages arrive late, never early, so the smallest difference between arrival and boot time is the closest to the true offset
    of the clocks. The window is short, so that the mapping follows a pause, or a simulation out of real time. Real clocks drift
    by less than 0.1 ms within it.
    """

    def __init__(self) -> None:
        self._offsets: deque[tuple[int, int]] = deque()  # (arrival, offset), offsets ascending: the first is the smallest
        self._boot_ns = 0
        self._before_ns, self._lower = 0, 0  # boot time before it went back, and how many have come since that are lower
        self.has_rebooted = False  # the autopilot, since its first message

    def observe(self, boot_ms: int, arrival_ns: int) -> int:
        """Take a message's stamp (ms since the autopilot's boot) and its arrival (own time); return the stamp in own time, never
        later than the arrival.
        """
        boot_ns = boot_ms * 1_000_000
        self._watch_boots(boot_ns)
        if boot_ns < self._boot_ns - REBOOT_NS:
            self._offsets.clear()
        self._boot_ns = boot_ns
        offset = arrival_ns - boot_ns
        while self._offsets and self._offsets[-1][1] >= offset:
            self._offsets.pop()
        self._offsets.append((arrival_ns, offset))
        while self._offsets[0][0] < arrival_ns - WINDOW_NS:
            self._offsets.popleft()
        return boot_ns + self._offsets[0][1]

    def _watch_boots(self, boot_ns: int) -> None:
        """A single packet may be late by more than ``REBOOT_NS``; after a reboot all have lower stamps for a while."""
        if boot_ns < self._boot_ns - REBOOT_NS:
            self._before_ns, self._lower = self._boot_ns, 0
        self._lower = self._lower + 1 if boot_ns < self._before_ns else 0
        self.has_rebooted = self.has_rebooted or self._lower >= REBOOTED

    def own_ns(self, boot_ns: int) -> int | None:
        """Convert a stamp of the autopilot (ns since boot) to own time, without updating the offset; None before the first
        message.
        """
        return boot_ns + self._offsets[0][1] if self._offsets else None

    @property
    def booted_ns(self) -> int | None:
        """Own time (ns) at which the autopilot was booted; None before the first message."""
        return self._offsets[0][1] if self._offsets else None
