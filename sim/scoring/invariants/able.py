"""Which drones must be able to finish a mission after the faults have ended.

It is decided by their faults and by their flight at that time, never by the outcome.
"""

from __future__ import annotations

from radron.sim.faults.agents import Disk, Equivocating, Forged, Freeze, Kill, Lie, Poisoned, Revoked, SlowCpu
from radron.sim.faults.base import Family, Fault
from radron.sim.faults.machines import Takeover
from radron.sim.faults.process import RESTART_NS, SILENCE_NS
from radron.sim.scoring.invariants.base import Setting
from radron.sim.scoring.moment import Scene

_DISABLING: tuple[Family, ...] = ("vehicle", "thrust", "pose", "camera", "network")
_OF_THE_LOG = ("cone", "counts", "sighting")
_STATE_LOST = ("full", "state-torn", "state-flipped")


class Able:
    """Determines which drones must finish the mission: the ones that are able to, by their faults and their flight.

    They are known from the time when the network heals (its faults end), none before. ``without_state``: drones that need not
    finish, as their autopilots may be on hold without agents, and their stored states may be lost. A restarted agent leaves such
    a vehicle there until an operator's command, and no operator is simulated.
    """

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        faults = setting.scenario.fault
        unfit = {name for fault in faults if _disables(fault, setting.heal_s) for name in setting.strikes(fault)}
        names = enumerate(setting.names) if setting.mission.safety.agent_lost == "hold" else ()
        self.without_state = frozenset(drone for drone, name in names if _loses_state(setting, name))
        self._fit = [k for k, name in enumerate(setting.names) if name not in unfit and k not in self.without_state]
        self.drones: tuple[int, ...] | None = None

    def see(self, moment: Scene) -> tuple[int, ...]:
        """Return the indices of the drones that must finish the mission, as far as is known at this time."""
        if self.drones is None:
            if moment.time_s < self._setting.heal_s:
                return ()
            self.drones = tuple(drone for drone in self._fit if moment.airborne(drone))
        return self.drones


def _disables(fault: Fault, heal_s: float) -> bool:
    """Return whether a fault leaves a drone unable: a permanent fault of vehicle, own position, camera or link, or a dead
    agent.

    Some faults have effects beyond their end. A drone whose entries arrived falsified or poisoned at the others has a
    different log for ever. After a manual override a drone holds until the operator resumes its mission, which nobody plays.
    The entries of an equivocator do not count any more, not even its position, and a revoked drone has no links.
    """
    if isinstance(fault, Equivocating | Poisoned | Revoked):
        return True
    if isinstance(fault, Takeover) and fault.at_s < heal_s:
        return True
    if isinstance(fault, Lie) and (fault.what in _OF_THE_LOG or fault.end_s > heal_s):
        return True
    if isinstance(fault, Forged) and fault.what == "two-versions":
        return True
    lasts = fault.end_s > heal_s + 1e-9
    return lasts and (fault.family in _DISABLING or isinstance(fault, Kill))


def _loses_state(setting: Setting, name: str) -> bool:
    """Return whether a drone's agent ends, or restarts, while its disk keeps no state, or spoils it."""
    faults = [fault for fault in setting.scenario.fault if name in setting.strikes(fault)]
    spoilt = [fault for fault in faults if isinstance(fault, Disk) and fault.how in _STATE_LOST]
    gone = [span for fault in faults if (span := _gone_s(fault)) is not None]
    return any(disk.at_s <= last_s and disk.end_s >= first_s for disk in spoilt for first_s, last_s in gone)


def _gone_s(fault: Fault) -> tuple[float, float] | None:
    """Return the time in which a fault, or a watchdog, may keep the agent down, from and to, s; None: never."""
    silence_s, restart_s = SILENCE_NS * 1e-9, RESTART_NS * 1e-9
    if isinstance(fault, SlowCpu):
        return (fault.at_s, fault.end_s + silence_s + restart_s) if fault.late_s > silence_s else None
    ends = isinstance(fault, Kill) or (isinstance(fault, Freeze) and fault.end_s - fault.at_s > silence_s)
    return (fault.at_s, fault.end_s) if ends else None
