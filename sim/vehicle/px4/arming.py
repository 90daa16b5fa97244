"""Checks that an emulated PX4 makes before it starts the rotors (arming)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from radron.sim.vehicle.px4 import events
from radron.sim.vehicle.px4.battery import Warning
from radron.sim.vehicle.px4.events import Announcement
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters

STABLE_S = (3.7, 3.95)  # time after the start at which the heading is trusted
HEADING = "heading estimate not stable"
CHECKED_S = 2.5  # time after the start of the first checks


class Readiness(NamedTuple):
    """State of a vehicle that the arming checks need.

    mode: present mode. stream: whether offboard targets arrive. at_the_sticks: a pilot uses the remote control.
    """

    armed: bool
    mode: Mode
    stream: bool
    at_the_sticks: bool
    knows_position: bool
    station_missing: bool
    beyond_fence: bool
    battery: Warning


class ArmingChecks:
    """Emulates PX4's checks before arming (start of the rotors) of one vehicle. ``unhealthy``: a check that never passes."""

    def __init__(
        self,
        parameters: Parameters,
        rng: np.random.Generator,
        announce: Callable[[Announcement], None],
        unhealthy: str | None,
    ) -> None:
        self._parameters, self._announce, self._unhealthy = parameters, announce, unhealthy
        self._stable_s = float(rng.uniform(*STABLE_S))
        self._time_s = 0.0
        self._fixless = False

    @property
    def running(self) -> bool:
        """Whether the checks have begun; they do so some seconds after the start."""
        return self._time_s >= CHECKED_S

    def step(self, time_s: float, fixless: bool) -> None:
        """Update the checks at ``time_s`` after the start. ``fixless``: the vehicle is disarmed without satellites."""
        before, self._time_s = self._time_s, time_s
        if before < CHECKED_S <= time_s:
            self._announce(events.HEADING_UNSTABLE)
            self._announce(events.NO_GROUND_STATION)
            if self._unhealthy is not None:
                self._announce(events.unhealthy(self._unhealthy))
        if self.running and fixless and not self._fixless:
            self._announce(events.FIX_TOO_LOW)
        self._fixless = fixless

    def failure(self, now: Readiness) -> str | None:
        """Return why arming is denied, in PX4's words; None if it is allowed."""
        found = (
            (self._time_s < self._stable_s, HEADING),
            (self._unhealthy is not None, self._unhealthy),
            (not now.knows_position and now.mode is not Mode.DESCEND, "position estimate error"),
            (now.mode is Mode.OFFBOARD and not now.stream, "No offboard signal"),
            (now.mode.by_hand and not now.at_the_sticks, "No manual control input"),
            (now.mode.prevents_arming and not now.armed, "Mode not suitable for arming"),
            (self._parameters["NAV_DLL_ACT"] > 0 and now.station_missing, "No connection to the GCS"),
            (now.beyond_fence, "Geofence violation"),
            (now.battery >= Warning.CRITICAL, "Battery critical"),
        )
        return next((reason for failing, reason in found if failing), None)
