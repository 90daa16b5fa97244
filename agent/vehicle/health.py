"""Whether the autopilot is ready to arm, and in its own words why not."""

from __future__ import annotations

from collections import deque

from agent.vehicle.messages import StatusText, SystemStatus

# MAV_SYS_STATUS_SENSOR; without a prearm bit these are what counts.
_SENSORS = {
    0x01: "gyroscope",
    0x02: "accelerometer",
    0x04: "magnetometer",
    0x08: "barometer",
    0x20: "GPS",
    0x0020_0000: "attitude and position estimate",
    0x0200_0000: "battery",
}
_ESSENTIAL = 0x01 | 0x02 | 0x04
_GPS = 0x20
_PREARM = 0x1000_0000
_WARNING = 4  # MAV_SEVERITY; smaller is worse
_CHUNK = 50
TEXT_AGE_S = 15.0
MOST_TEXTS = 3


def not_ready(status: SystemStatus, gnss: bool = True) -> str | None:
    """What keeps the autopilot from being armed, or None. Its own prearm check decides where it reports one.

    ``gnss``: it flies by satellites.
    """
    present = status.onboard_control_sensors_present & status.onboard_control_sensors_enabled
    failing = present & ~status.onboard_control_sensors_health
    essential = _ESSENTIAL | _GPS if gnss else _ESSENTIAL
    if not failing & (_PREARM if present & _PREARM else essential):
        return None
    return ", ".join(name for bit, name in _SENSORS.items() if failing & bit) or "prearm check"


class StatusTexts:
    """The autopilot's warnings and errors of the last seconds; long ones come in chunks of 50 characters."""

    def __init__(self) -> None:
        self._texts: deque[tuple[float, str]] = deque(maxlen=16)
        self._chunks: dict[int, dict[int, str]] = {}

    def receive(self, message: StatusText, now_s: float) -> None:
        """Take a STATUSTEXT."""
        if message.severity > _WARNING:
            return
        text: str | None = message.text
        if message.id:
            text = self._join(message)
        if text:
            self._texts.append((now_s, text.strip()))

    def recent(self, now_s: float) -> tuple[str, ...]:
        """The newest different ones, newest first."""
        fresh = (text for at_s, text in reversed(self._texts) if now_s - at_s < TEXT_AGE_S)
        return tuple(dict.fromkeys(fresh))[:MOST_TEXTS]

    def _join(self, message: StatusText) -> str | None:
        """The whole text when its last chunk has come: the one that is not full. A chunk that was lost is missing from it."""
        if message.chunk_seq == 0:
            self._chunks.clear()  # PX4 sends the chunks of a text in one go
        parts = self._chunks.setdefault(message.id, {})
        parts[message.chunk_seq] = message.text
        if len(message.text) >= _CHUNK:
            return None
        del self._chunks[message.id]
        return "".join(parts[number] for number in sorted(parts))
