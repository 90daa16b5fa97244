"""Presence of the drones by the mesh's liveliness tokens, and drones with another version of the protocol."""

from __future__ import annotations

from collections import Counter

from protocol.keys import VERSION, read_token

MOST_ALIVE = 256  # kept names with a liveliness token


class Presence:
    """The drones' liveliness tokens. ``alive``: drones with a token of this version."""

    def __init__(self, counters: Counter[str]) -> None:
        """``counters``: ``overflow`` counts the tokens beyond ``MOST_ALIVE``."""
        self._counters = counters
        self.alive: set[str] = set()
        self._differing: dict[str, str] = {}  # by drone: a protocol version other than this one

    def take(self, key: str, appears: bool) -> None:
        """Take the appearance or the end of a token."""
        drone, version = read_token(key)
        if version != str(VERSION):
            self._differ(drone, version, appears)
        elif not appears:
            self.alive.discard(drone)
        elif len(self.alive) < MOST_ALIVE or drone in self.alive:
            self.alive.add(drone)
        else:
            self._counters["overflow"] += 1

    @property
    def differing(self) -> tuple[str, ...]:
        """Drones with another protocol version, one line each."""
        return tuple(
            f"{drone} speaks version {version or 'unknown'} of the protocol, here {VERSION}: give all the same version of radron"
            for drone, version in sorted(self._differing.items())
        )

    def clear(self) -> None:
        """Forget all drones: the session has ended."""
        self.alive.clear()
        self._differing.clear()

    def _differ(self, drone: str, version: str, appears: bool) -> None:
        if not appears:
            self._differing.pop(drone, None)
        elif len(self._differing) < MOST_ALIVE:
            self._differing[drone] = version
