"""Which drones are able to finish a mission after the heal: by the faults and who is in the air then, never by the outcome."""

from __future__ import annotations

from sim.faults.agents import Equivocating, Forged, Kill, Lie, Revoked
from sim.faults.base import Family, Fault
from sim.faults.machines import Takeover
from sim.scoring.invariants.base import Setting
from sim.scoring.moment import Scene

_DISABLING: tuple[Family, ...] = ("vehicle", "thrust", "pose", "camera", "network")
_OF_THE_LOG = ("cone", "counts", "sighting")


class Able:
    """The drones that are able, known from the heal on; before, none is."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        faults = setting.scenario.fault
        unfit = {name for fault in faults if _disables(fault, setting.heal_s) for name in setting.strikes(fault)}
        self._fit = [drone for drone, name in enumerate(setting.names) if name not in unfit]
        self.drones: tuple[int, ...] | None = None

    def see(self, moment: Scene) -> tuple[int, ...]:
        """The able drones so far."""
        if self.drones is None:
            if moment.time_s < self._setting.heal_s:
                return ()
            self.drones = tuple(drone for drone in self._fit if moment.airborne(drone))
        return self.drones


def _disables(fault: Fault, heal_s: float) -> bool:
    """Whether it leaves a drone unable: vehicle, own position, camera or link are faulted for good, or its agent is dead.

    Some faults last although they are over: a drone whose entries arrived falsified at the others has another log than they for
    ever, and one that a human pilot has given back holds until the operator resumes its mission, whom nobody plays. Of one that
    has contradicted itself nothing counts any more, not even where it is, and one that is revoked hears nobody.
    """
    if isinstance(fault, Equivocating | Revoked):
        return True
    if isinstance(fault, Takeover) and fault.at_s < heal_s:
        return True
    if isinstance(fault, Lie) and (fault.what in _OF_THE_LOG or fault.end_s > heal_s):
        return True
    if isinstance(fault, Forged) and fault.what == "two-versions":
        return True
    lasts = fault.end_s > heal_s + 1e-9
    return lasts and (fault.family in _DISABLING or isinstance(fault, Kill))
