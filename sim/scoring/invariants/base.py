"""The interface of all invariants, and what they know of a flight beforehand."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from math import inf
from typing import ClassVar, Generic, NamedTuple, TypeVar

from msgspec import Struct

from sim.faults.agents import Revoked
from sim.faults.base import Family, Fault
from sim.faults.machines import HeadingReset, MavlinkImpaired, MavlinkLoss, PositionJump, SatellitesLost, Takeover
from sim.scenario import Scenario
from sim.scoring.moment import Scene

S_contra = TypeVar("S_contra", bound=Scene, contravariant=True)  # what an invariant needs to see
AT_HOME_M = 10.0  # of the place of the launch: frames are good to a metre or two, and others may stand in the way
ANNOUNCED_S = 5.0  # after a jump that a vehicle has announced its agent knows how its new frame lies
RECOVERY_S = 15.0  # until a vehicle is back where it belongs after its own position or thrust was wrong
_LINKED_S = 1.0  # after a revocation nothing passes any more
FRAME_FAULTS: tuple[Family, ...] = ("pose", "liar", "clock")  # put wrong observations into every log
OWN_FAULTS: tuple[Family, ...] = ("pose", "thrust")


class Violation(Struct, frozen=True, kw_only=True):
    """An invariant that does not hold: since when (s), for which drones, and by what numbers."""

    invariant: str
    time_s: float
    drones: tuple[str, ...]
    text: str


class Breach(NamedTuple):
    """Drones (indices) that violate an invariant at a moment, and by what numbers."""

    drones: tuple[int, ...]
    text: str


class Setting:
    """A flight as it is known before: its scenario, and when which drones are struck by what."""

    def __init__(self, scenario: Scenario, heal_s: float = inf, end_s: float = inf) -> None:
        """``heal_s``: the network heals, and what is then active stays; ``end_s``: by then the able drones have landed."""
        self.heal_s, self.end_s = heal_s, end_s
        self.mission = scenario.mission
        self.scenario = scenario
        self.names = tuple(drone.id for drone in scenario.mission.drones)
        self.first_fault_s = min((fault.at_s for fault in scenario.fault), default=inf)
        revoked = (fault for fault in scenario.fault if isinstance(fault, Revoked))
        self.revoked_s = {self.names.index(name): fault.at_s for fault in revoked for name in fault.strikes(self.names)}
        struck = ((fault, [self.names.index(name) for name in self.strikes(fault)]) for fault in scenario.fault)
        self._spans = [(fault.family, drones, fault.at_s, fault.end_s) for fault, drones in struck if drones]
        self._unannounced = [
            (fault.family, frozenset(self.strikes(fault)), begin_s, end_s)
            for fault in scenario.fault
            for begin_s, end_s in _unannounced_s(fault)
        ]

    def strikes(self, fault: Fault) -> list[str]:
        """The drones that a fault strikes: a vehicle that flies by SLAM neither loses satellites nor has its heading reset."""
        by_slam = {drone.id for drone in self.mission.drones if drone.localization == "slam"}
        spared = by_slam if isinstance(fault, SatellitesLost | HeadingReset) else frozenset[str]()
        return [name for name in fault.strikes(self.names) if name not in spared]

    def struck(self, families: Collection[Family], drone: int, time_s: float, after_s: float = 0.0) -> bool:
        """Whether a fault of these families strikes a drone, or did so less than ``after_s`` ago."""
        return any(
            drone in drones and family in families and at_s <= time_s <= end_s + after_s
            for family, drones, at_s, end_s in self._spans
        )

    def unheard_s(self, *drones: int) -> float:
        """From when on nobody hears one of these drones, nor it anybody, as it is revoked; infinite if none is."""
        return min((self.revoked_s.get(drone, inf) for drone in drones), default=inf) + _LINKED_S

    def began_s(self, families: Collection[Family]) -> float:
        """When the first fault of these families begins, on any drone; infinite without one."""
        return min((at_s for family, _, at_s, _ in self._spans if family in families), default=inf)

    def misled_s(self, families: Collection[Family] = FRAME_FAULTS) -> float:
        """When the first fault of these families begins that puts wrong observations into every log; infinite without one."""
        striking = (fault for fault in self.scenario.fault if fault.family in families and self.strikes(fault))
        return min((fault.at_s for fault in striking if not _is_announced(fault)), default=inf)

    def struck_unannounced(self, drone: int, time_s: float, families: Collection[Family] = OWN_FAULTS) -> bool:
        """Whether the own position or thrust (``families``) of a drone is faulted, or was until ``RECOVERY_S`` ago. Of a jump
        that it knows of, only ``ANNOUNCED_S`` count, after the jump and after the one back.
        """
        name = self.names[drone]
        return any(
            begin_s <= time_s <= end_s and family in families and name in struck
            for family, struck, begin_s, end_s in self._unannounced
        )

    def taken_over(self, drone: int, time_s: float) -> bool:
        """Whether a human pilot has taken a vehicle over by then; one that is given back holds until an operator commands."""
        takeovers = (fault for fault in self.scenario.fault if isinstance(fault, Takeover) and fault.at_s <= time_s)
        return any(self.names[drone] in self.strikes(fault) for fault in takeovers)

    def lost_itself(self, drone: int, time_s: float) -> bool:
        """Whether a vehicle's own position or thrust is faulted, or was until ``RECOVERY_S`` ago."""
        return self.struck(OWN_FAULTS, drone, time_s, RECOVERY_S)

    def may_land_elsewhere(self, drone: int, time_s: float) -> bool:
        """Whether a drone need not find home: whose own position, thrust or battery was ever faulted may have had to land where
        it was. Where frames are estimated, who had a wrong clock, too, and everybody after a liar or an own position faulted
        unannounced.
        """
        if all(one.is_exact for one in self.mission.drones):
            return self.struck(OWN_FAULTS, drone, time_s, inf)
        return self.struck((*OWN_FAULTS, "clock"), drone, time_s, inf) or self.misled_s(("pose", "liar")) <= time_s

    def was_set_down(self, drone: int, time_s: float) -> bool:
        """Whether the autopilot of a drone may have landed it where it was, for want of setpoints: the mission says so, or that
        it returns, and one without satellites has no home to return to; and its agent or its link to the autopilot was faulted.
        """
        without_agent, by_slam = self.mission.safety.agent_lost, self.mission.drones[drone].localization == "slam"
        if without_agent != "land" and not (by_slam and without_agent == "return"):
            return False
        begun = (fault for fault in self.scenario.fault if fault.at_s <= time_s)
        stopping = (fault for fault in begun if fault.family == "process" or isinstance(fault, MavlinkLoss | MavlinkImpaired))
        return any(self.names[drone] in self.strikes(fault) for fault in stopping)

    def named(self, *drones: int) -> tuple[str, ...]:
        """Ids of drones."""
        return tuple(self.names[drone] for drone in drones)


class Invariant(ABC, Generic[S_contra]):
    """One thing that must hold. A violation is told when it begins, and again only after it was over."""

    name: ClassVar[str]

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        self._broken: set[tuple[int, ...]] = set()

    @abstractmethod
    def breaches(self, moment: S_contra) -> Iterator[Breach]:
        """Who violates it at this moment. Called once after each tick."""

    def at_end(self, moment: S_contra) -> Iterator[Breach]:
        """Who violates it by how the flight has ended, or would only be judged then; ``moment``: the last one."""
        yield from ()

    def look(self, moment: S_contra) -> list[Violation]:
        """The violations that begin at this moment."""
        found = list(self.breaches(moment))
        if not found and not self._broken:
            return []
        new = [breach for breach in found if breach.drones not in self._broken]
        self._broken = {breach.drones for breach in found}
        return [self._told(breach, moment.time_s) for breach in new]

    def finish(self, moment: S_contra) -> list[Violation]:
        """The violations that show at the end."""
        return [self._told(breach, moment.time_s) for breach in self.at_end(moment)]

    def _told(self, breach: Breach, time_s: float) -> Violation:
        drones = self.setting.named(*breach.drones)
        return Violation(invariant=self.name, time_s=round(time_s, 3), drones=drones, text=breach.text)


def _is_announced(fault: Fault) -> bool:
    """Whether a fault of an own position is known to its drone, which begins a new epoch then."""
    return isinstance(fault, PositionJump) and fault.announced


def _unannounced_s(fault: Fault) -> tuple[tuple[float, float], ...]:
    """When a fault counts whose drone does not know of it (``Setting.struck_unannounced``)."""
    if _is_announced(fault):
        return (fault.at_s, fault.at_s + ANNOUNCED_S), (fault.end_s, fault.end_s + ANNOUNCED_S)
    return ((fault.at_s, fault.end_s + RECOVERY_S),)
