"""Readiness of the autopilot to arm, and its own messages on the obstacles."""

from __future__ import annotations

from collections import deque

from radron.agent.vehicle.events import FAILSAFE, REPORT_BEGINS, REPORT_ENDS, FailedCheck, failed_check, severity, text_of
from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.mavlink.messages import AutopilotVersion, Event, StatusText, SystemStatus

# MAV_SYS_STATUS_SENSOR: names of missing parts.
_SENSORS = {
    0x01: "gyroscope",
    0x02: "accelerometer",
    0x04: "magnetometer",
    0x08: "barometer",
    0x20: "GPS",
    0x0020_0000: "attitude and position estimate",
    0x0200_0000: "battery",
}
_PREARM = 0x1000_0000  # PX4 sets it only in the health bits, and only while it can be armed in its present mode
_WARNING = 4  # MAV_SEVERITY; smaller is worse
_CHUNK = 50
_AT_ONCE_S = 0.05
TEXT_AGE_S = 15.0
MOST_TEXTS = 3


def not_ready(status: SystemStatus) -> str | None:
    """Return the reason why the autopilot cannot arm, by its own prearm check; None if it can."""
    health = status.onboard_control_sensors_health
    if health & _PREARM:
        return None
    failing = status.onboard_control_sensors_present & status.onboard_control_sensors_enabled & ~health
    return ", ".join(name for bit, name in _SENSORS.items() if failing & bit) or "prearm check"


class StatusMessages:
    """The autopilot's warnings and errors of the last seconds, and the checks that prevent arming by its last report.

    The messages come as events (numbers) and as texts; long texts come in chunks of 50 characters. ``failsafe``: the message at
    the beginning of the last failsafe; else empty. ``version``: of the autopilot's firmware.
    """

    def __init__(self) -> None:
        self._texts: deque[tuple[float, str]] = deque(maxlen=16)
        self._chunks: dict[int, dict[int, str]] = {}
        self._unfinished = ("", float("-inf"))  # a full chunk without a number, and when it came
        self._sequence: int | None = None  # of the newest event: PX4 repeats events on request
        self.failsafe = ""
        self.version: AutopilotVersion | None = None
        self._reporting: list[FailedCheck] | None = None
        self._failed: tuple[FailedCheck, ...] = ()

    def receive(self, message: StatusText | Event | AutopilotVersion, now_s: float) -> None:
        """Take one message of the autopilot: a STATUSTEXT, an EVENT, or an AUTOPILOT_VERSION."""
        if isinstance(message, AutopilotVersion):
            self.version = message
            return
        if isinstance(message, Event):
            self._take_event(message, now_s)
            return
        if message.severity > _WARNING:
            return
        text = self._join(message) if message.id else self._append(message.text, now_s)
        is_event_too = text is not None and text.endswith("\t")  # PX4's convention
        if text and not (is_event_too and self._sequence is not None):
            self._texts.append((now_s, text.strip()))

    def recent(self, now_s: float) -> tuple[str, ...]:
        """Return the newest different texts of the autopilot, newest first."""
        fresh = (text for at_s, text in reversed(self._texts) if now_s - at_s < TEXT_AGE_S)
        return tuple(dict.fromkeys(fresh))[:MOST_TEXTS]

    def failed_checks(self, mode: FlightMode) -> tuple[str, ...]:
        """Return the failed checks that prevent arming in this mode, by the autopilot's last report."""
        return tuple(check.text for check in self._failed if check.bars(mode))

    def _take_event(self, event: Event, now_s: float) -> None:
        if event.sequence == self._sequence:
            return
        self._sequence = event.sequence
        if event.id == REPORT_BEGINS:
            self._reporting = []
        elif event.id == REPORT_ENDS:
            if self._reporting is not None:
                self._failed, self._reporting = tuple(self._reporting), None
        elif severity(event) <= _WARNING:
            self._note(event, now_s)

    def _note(self, event: Event, now_s: float) -> None:
        if self._reporting is not None:
            check = failed_check(event)
            if check is not None:
                self._reporting.append(check)
            return
        text = text_of(event)
        if text is None:
            return
        self._texts.append((now_s, text))
        if text.startswith(FAILSAFE):
            self.failsafe = text

    def _append(self, text: str, now_s: float) -> str | None:
        """PX4 splits its first long texts without numbering the parts, which follow each other at once."""
        begun, at_s = self._unfinished
        whole = begun + text if now_s - at_s < _AT_ONCE_S else text
        if len(text) >= _CHUNK:
            self._unfinished = whole, now_s
            return None
        self._unfinished = "", float("-inf")
        return whole

    def _join(self, message: StatusText) -> str | None:
        """The whole text once its last chunk, which is not full, has come. Lost chunks are missing from it."""
        if message.chunk_seq == 0:
            self._chunks.clear()  # PX4 sends the chunks of a text one after another
        parts = self._chunks.setdefault(message.id, {})
        parts[message.chunk_seq] = message.text
        if len(message.text) >= _CHUNK:
            return None
        del self._chunks[message.id]
        return "".join(parts[number] for number in sorted(parts))
