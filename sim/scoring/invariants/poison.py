"""Condition on members that put false measurements into the log: other drones report them."""

from __future__ import annotations

from collections.abc import Iterator

from radron.protocol.codes import Code
from radron.sim.faults.agents import Poisoned
from radron.sim.scoring.invariants.base import LOOK_TICKS, Breach, Invariant, Setting
from radron.sim.scoring.moment import Moment

POISONER_NAMED_S = 15.0


class PoisonNamed(Invariant[Moment]):
    """Requires that a drone that publishes false exposures beside its own is reported by another drone within 15 s.

    Exposures are counts of photons in an interval; the false exposures overlap the drone's own or are too long, and are published
    in flight only. False exposures in place of the drone's own are not judged, since they may look like a dead camera's.
    """

    name = "poison-named"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        self._spans = [
            (setting.names.index(name), fault.at_s, fault.end_s)
            for fault in setting.scenario.fault
            if isinstance(fault, Poisoned) and fault.beside
            for name in setting.strikes(fault)
        ]
        self._unnamed_s = [0.0] * len(self._spans)
        self._ticks = 0

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that publish false exposures without being reported; checked twice a second."""
        self._ticks += 1
        looks = self._ticks % LOOK_TICKS == 0
        for place, (drone, begin_s, end_s) in enumerate(self._spans):
            if looks and begin_s <= moment.time_s < end_s and moment.airborne(drone):
                named = self._is_named(moment, drone)
                self._unnamed_s[place] = 0.0 if named else self._unnamed_s[place] + 0.05 * LOOK_TICKS
            if self._unnamed_s[place] > POISONER_NAMED_S:
                yield Breach((drone,), f"it poisons the log since {begin_s:.1f} s, and nobody names it")

    def _is_named(self, moment: Moment, drone: int) -> bool:
        said = Code.EXPOSURES_LEFT_OUT, self.setting.names[drone]
        others = (pilot for other, pilot in enumerate(moment.pilots) if other != drone and pilot is not None)
        return any((text.code, text.about) == said for pilot in others for text in pilot.problems)
