"""A warning before the computer's memory runs out: the observation log grows until the agent ends."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from msgspec import Struct

from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

LEAST_MB = 300.0  # available memory: three hours of the log's growth, and the need of the autopilot's link and the camera
LEAST_SHARE = 0.15  # of the total
_OVER = 1.1  # hysteresis: the warning ends above this multiple of its threshold


class Memory(Struct, frozen=True):
    """Main memory of the computer in MB: total, and available to programs without swapping."""

    total_mb: float
    available_mb: float


def read_memory(source: Path = Path("/proc/meminfo")) -> Memory | None:
    """Return the computer's memory by the kernel's MemTotal and MemAvailable; None if they are missing (not Linux)."""
    found: dict[str, float] = {}
    with suppress(OSError, UnicodeDecodeError):
        for name, kilobytes in re.findall(r"^(MemTotal|MemAvailable):\s*(\d+) kB", source.read_text("ascii"), re.MULTILINE):
            found[name] = float(kilobytes) * 1024.0 / 1e6
    if len(found) < 2:
        return None
    return Memory(found["MemTotal"], found["MemAvailable"])


class MemoryWatch:
    """Warns the operator while the available memory is below the larger of ``LEAST_MB`` and ``LEAST_SHARE`` of the total."""

    def __init__(self, read: Callable[[], Memory | None] = read_memory) -> None:
        self._read = read
        self._low = False

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator if memory is low now, else empty; the text does not change while the warning lasts."""
        memory = self._read()
        if memory is None:
            return ()
        least_mb = max(LEAST_MB, LEAST_SHARE * memory.total_mb)
        self._low = memory.available_mb < least_mb * (_OVER if self._low else 1.0)
        if not self._low:
            return ()
        text = (
            f"memory runs low: less than {least_mb:.0f} of {memory.total_mb:.0f} MB available, and the log grows by about "
            "100 MB per hour; end other programs or land soon, and restart the agent before the next flight"
        )
        return (CodedText(Code.MEMORY_LOW, text),)
