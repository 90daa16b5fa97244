"""Correction of autopilot parameters that are wrong for a mission, for ``radron-agent doctor --write``."""

from __future__ import annotations

import asyncio
import time

from msgspec import Struct

from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.parameters import float32
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.agent.vehicle.rules import correction

AGAIN_S = 0.5
MOST_ATTEMPTS = 4
_ANSWER_S = 2.0  # until the autopilot has reported the new value


class Change(Struct, frozen=True):
    """A parameter of the autopilot that was set. ``after``: last value reported by the autopilot; None: not reported."""

    name: str
    before: float
    after: float | None
    wanted: float

    @property
    def taken(self) -> bool:
        """Whether the autopilot has the wanted value of the parameter now."""
        return self.after == float32(self.wanted)


class Corrections:
    """Sets the autopilot's parameters that are wrong for the mission, each a few times, and remembers their old values."""

    def __init__(self, demands: Demands) -> None:
        """Set up the corrections. ``demands``: values that the mission requires of this drone's autopilot."""
        self._demands = demands
        self._before: dict[str, tuple[float, float]] = {}  # value before, and the wanted one
        self._attempts: dict[str, int] = {}
        self._set_s: dict[str, float] = {}  # when each was set last
        self._values: dict[str, float | None] = {}

    @property
    def changes(self) -> list[Change]:
        """All autopilot parameters that were set, with their present values."""
        return [Change(name, before, self._values.get(name), wanted) for name, (before, wanted) in self._before.items()]

    def tries(self, name: str) -> bool:
        """Return whether a wrong parameter will still be set, or its new value may still be reported."""
        if correction(name, 0.0, self._demands) is None:
            return False
        answers = time.monotonic() - self._set_s.get(name, float("-inf")) < _ANSWER_S
        return answers or self._attempts.get(name, 0) < MOST_ATTEMPTS

    async def run(self, vehicle: Px4Vehicle) -> None:
        """Set the autopilot's wrong parameters, again and again, until cancelled."""
        asked_s = float("-inf")
        while True:
            self._values = {name: vehicle.parameters.value(name) for name in self._before}
            if time.monotonic() - asked_s >= AGAIN_S:
                asked_s = time.monotonic()
                self._set(vehicle)
            await asyncio.sleep(0.1)

    def _set(self, vehicle: Px4Vehicle) -> None:
        for name, value in vehicle.parameters.wrong().items():
            wanted = correction(name, value, self._demands)
            if wanted is None or self._attempts.get(name, 0) >= MOST_ATTEMPTS:
                continue
            if vehicle.set_parameter(name, wanted):
                self._attempts[name] = self._attempts.get(name, 0) + 1
                self._set_s[name] = time.monotonic()
                self._before.setdefault(name, (value, wanted))
