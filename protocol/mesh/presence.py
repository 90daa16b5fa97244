"""Which drones are connected, and with which version of the protocol, by their liveliness tokens.

A liveliness token is Zenoh's sign that a program is connected.
"""

from __future__ import annotations

from collections import Counter

from radron.protocol.codes import Code
from radron.protocol.keys import read_token
from radron.protocol.texts import CodedText
from radron.protocol.versions import PROTOCOL

MAX_ALIVE = 256  # kept names with a liveliness token


class Presence:
    """Keeps the set of connected drones up to date, from Zenoh's liveliness tokens (signs that a program is connected).

    ``alive``: connected drones with this version of the protocol.
    """

    def __init__(self, counters: Counter[str]) -> None:
        """``counters``: the count ``overflow`` is raised for each token beyond ``MAX_ALIVE``."""
        self._counters = counters
        self.alive: set[str] = set()
        self._differing: dict[str, str] = {}  # by drone: a protocol version other than this one

    def take(self, key: str, appears: bool) -> None:
        """Record that a drone's liveliness token has appeared or, with ``appears`` false, has vanished."""
        drone, version = read_token(key)
        if version != str(PROTOCOL):
            self._differ(drone, version, appears)
        elif not appears:
            self.alive.discard(drone)
        elif len(self.alive) < MAX_ALIVE or drone in self.alive:
            self.alive.add(drone)
        else:
            self._counters["overflow"] += 1

    @property
    def differing(self) -> tuple[CodedText, ...]:
        """Connected drones with another version of the protocol, one line of text each."""
        text = f"{{}} speaks version {{}} of the protocol, here {PROTOCOL}: give all the same version of radron"
        return tuple(
            CodedText(Code.PROTOCOL_DIFFERS, text.format(drone, version or "unknown"), drone)
            for drone, version in sorted(self._differing.items())
        )

    def clear(self) -> None:
        """Remove all drones, as the own network session has ended."""
        self.alive.clear()
        self._differing.clear()

    def _differ(self, drone: str, version: str, appears: bool) -> None:
        if not appears:
            self._differing.pop(drone, None)
        elif len(self._differing) < MAX_ALIVE:
            self._differing[drone] = version
