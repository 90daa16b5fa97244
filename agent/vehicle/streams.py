"""The message streams requested from the autopilot, and their rates; requested again while too slow."""

from __future__ import annotations

from radron.agent.vehicle.mavlink.link import Link

MOST_ASKS = 5  # a slow link or simulation may never reach the rates
REQUEST, GLOBAL_ORIGIN, HOME_POSITION = 512, 49, 242  # MAV_CMD_REQUEST_MESSAGE; message ids

_SET_INTERVAL, _VERSION = 511, 148
# Message ids and rates (Hz) that are requested; other streams are not read. (Heartbeats stay at PX4's 1 Hz.)
_WANTED_HZ = {32: 30.0, 31: 30.0, 331: 10.0, 132: 10.0, 245: 5.0, 24: 5.0, 230: 5.0, 436: 5.0, 1: 2.0}
_UNWANTED = (30, 33, 36, 74, 83, 85, 105, 141)
_FEWEST_POSITIONS_PER_S = 20  # with fewer the rates are requested again


class Streams:
    """Requests the message streams that the agent needs from the autopilot, and requests them again while they are too slow."""

    def __init__(self, link: Link) -> None:
        """Start before the first request. ``link``: to the autopilot."""
        self._link = link
        self._asks = self.positions = 0  # positions received since the last check of the rates

    def begin_anew(self) -> None:
        """Request all streams again: the autopilot may have been restarted, or replaced."""
        self._asks = 0

    def check(self, elapsed_s: float) -> None:
        """Request all streams and the firmware's version: at first, and again if too few positions came since the last check.

        elapsed_s: time since the last check.
        """
        too_few = self.positions < _FEWEST_POSITIONS_PER_S * elapsed_s
        if self._asks == 0 or (too_few and self._asks < MOST_ASKS):
            self._asks += 1
            self._ask()
        self.positions = 0

    def _ask(self) -> None:
        for message, rate_hz in _WANTED_HZ.items():
            self._link.send_command(_SET_INTERVAL, message, 1e6 / rate_hz)
        for message in _UNWANTED:
            self._link.send_command(_SET_INTERVAL, message, -1)
        self._link.send_command(REQUEST, _VERSION)
