"""Presence of a ground station and a companion on a vehicle's links."""

from __future__ import annotations

from collections.abc import Callable

from radron.sim.vehicle.px4 import events
from radron.sim.vehicle.px4.events import Announcement
from radron.sim.vehicle.px4.parameters import Parameters

STATION_NOTICED_S = 2.1  # delay beyond COM_DL_LOSS_T
COMPANION_LOST_S = 7.08


class _Contact:
    def __init__(self, lost: tuple[Announcement, ...], regained: Announcement) -> None:
        self.heard_s: float | None = None
        self.lost = False
        self._announcements = (lost, regained)

    def step(self, now_s: float, after_s: float, announce: Callable[[Announcement], None]) -> None:
        lost = self.heard_s is not None and now_s - self.heard_s > after_s
        if lost != self.lost:
            self.lost = lost
            for announcement in self._announcements[0] if lost else (self._announcements[1],):
                announce(announcement)


class Contacts:
    """Tracks whether a ground station and a companion computer are present on a vehicle's links; times by the vehicle's clock."""

    def __init__(self, parameters: Parameters, announce: Callable[[Announcement], None]) -> None:
        self._parameters, self._announce = parameters, announce
        self._station = _Contact((events.GROUND_STATION_LOST, events.NO_GROUND_STATION), events.GROUND_STATION_REGAINED)
        self._companion = _Contact((events.COMPANION_LOST,), events.COMPANION_REGAINED)

    @property
    def station_lost(self) -> bool:
        """Whether a ground station was present and has been silent for too long."""
        return self._station.lost

    @property
    def station_missing(self) -> bool:
        """Whether there is no ground station now."""
        return self._station.lost or self._station.heard_s is None

    def hear_station(self, now_s: float) -> None:
        """Record a ground station's heartbeat."""
        self._station.heard_s = now_s

    def hear_companion(self, now_s: float) -> None:
        """Record a companion computer's heartbeat."""
        self._companion.heard_s = now_s

    def step(self, now_s: float) -> None:
        """Update which contacts are lost or regained, and announce changes."""
        self._station.step(now_s, self._parameters["COM_DL_LOSS_T"] + STATION_NOTICED_S, self._announce)
        self._companion.step(now_s, COMPANION_LOST_S, self._announce)
