"""Base class of all conditions that a simulated flight must fulfil, and what they know of the flight in advance."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from math import inf
from typing import ClassVar, Generic, NamedTuple, TypeVar

from msgspec import Struct

from radron.sim.faults.agents import Revoked
from radron.sim.faults.base import Family, Fault
from radron.sim.faults.machines import HeadingReset, MavlinkImpaired, MavlinkLoss, PositionJump, SatellitesLost, Takeover
from radron.sim.scenario import Scenario
from radron.sim.scoring.moment import Scene

S_contra = TypeVar("S_contra", bound=Scene, contravariant=True)  # observations needed by an invariant
AT_HOME_M = 10.0  # of the place of the launch: frames are good to a metre or two, and others may stand in the way
ANNOUNCED_S = 5.0  # after an announced jump of a vehicle its agent knows its new frame
RECOVERY_S = 15.0  # until a vehicle is back on course after a fault of its own position or thrust
EXCLUDED_SIGMAS, EXCLUDED_S = 6.0, 5.0  # the truth may be farther from a stated value for this long
LOOK_TICKS = 10  # between two looks of an invariant that need not judge each tick
_LINKED_S = 1.0  # after a revocation the links are down
FRAME_FAULTS: tuple[Family, ...] = ("pose", "liar", "clock")  # put wrong observations into every log
OWN_FAULTS: tuple[Family, ...] = ("pose", "thrust")


class Violation(Struct, frozen=True, kw_only=True):
    """Report of a violated condition: its name, the begin (s), the drones, and a text with numbers."""

    invariant: str
    time_s: float
    drones: tuple[str, ...]
    text: str


class Breach(NamedTuple):
    """Drones (indices) that violate a condition at one time, with a text that gives the numbers."""

    drones: tuple[int, ...]
    text: str


class Setting:
    """What the judges of a simulated flight know in advance: its scenario, and the times and targets of its faults."""

    def __init__(self, scenario: Scenario, heal_s: float = inf, end_s: float = inf) -> None:
        """``heal_s``: time at which the network heals; faults active after it are permanent. ``end_s``: latest landing of the
        drones that are able to finish the mission.
        """
        self.heal_s, self.end_s = heal_s, end_s
        self.mission = scenario.mission
        self.scenario = scenario
        self.names = tuple(drone.id for drone in scenario.mission.drones)
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
        """Return the ids of the drones that a fault affects.

        A vehicle that localises by SLAM is not affected by lost satellites or by a heading reset.
        """
        by_slam = {drone.id for drone in self.mission.drones if drone.localization == "slam"}
        spared = by_slam if isinstance(fault, SatellitesLost | HeadingReset) else frozenset[str]()
        return [name for name in fault.strikes(self.names) if name not in spared]

    def struck(self, families: Collection[Family], drone: int, time_s: float, after_s: float = 0.0) -> bool:
        """Return whether a fault of one of these families affects a drone now, or did so less than ``after_s`` ago."""
        return any(
            drone in drones and family in families and at_s <= time_s <= end_s + after_s
            for family, drones, at_s, end_s in self._spans
        )

    def unheard_s(self, *drones: int) -> float:
        """Return the time (s) from which one of these drones has no links because it is revoked (its rights are withdrawn).

        The time is infinite if none of them is revoked.
        """
        return min((self.revoked_s.get(drone, inf) for drone in drones), default=inf) + _LINKED_S

    def began_s(self, families: Collection[Family]) -> float:
        """Return when the first fault of these families begins, on any drone; infinite without one."""
        return min((at_s for family, _, at_s, _ in self._spans if family in families), default=inf)

    def misled_s(self, families: Collection[Family] = FRAME_FAULTS) -> float:
        """Return when the first fault of these families begins that puts wrong observations into every log; infinite without one.

        Faults that the affected vehicle announces are left out.
        """
        striking = (fault for fault in self.scenario.fault if fault.family in families and self.strikes(fault))
        return min((fault.at_s for fault in striking if not _is_announced(fault)), default=inf)

    def struck_unannounced(self, drone: int, time_s: float, families: Collection[Family] = OWN_FAULTS) -> bool:
        """Return whether a fault affects a drone's own position or thrust, or did so until ``RECOVERY_S`` ago.

        An announced jump counts for ``ANNOUNCED_S`` only, after the jump and after the jump back. ``families``: the kinds of
        faults.
        """
        name = self.names[drone]
        return any(
            begin_s <= time_s <= end_s and family in families and name in struck
            for family, struck, begin_s, end_s in self._unannounced
        )

    def taken_over(self, drone: int, time_s: float) -> bool:
        """Return whether a safety pilot has overridden a vehicle by this time.

        After its release the vehicle holds until an operator's command.
        """
        takeovers = (fault for fault in self.scenario.fault if isinstance(fault, Takeover) and fault.at_s <= time_s)
        return any(self.names[drone] in self.strikes(fault) for fault in takeovers)

    def lost_itself(self, drone: int, time_s: float) -> bool:
        """Return whether a vehicle's own position or thrust is faulted, or was until ``RECOVERY_S`` ago."""
        return self.struck(OWN_FAULTS, drone, time_s, RECOVERY_S)

    def may_land_elsewhere(self, drone: int, time_s: float) -> bool:
        """Return whether a drone is allowed to land away from home.

        After a fault of its own position, thrust or battery it may have landed where it was. With estimated frames, this also
        holds after a wrong clock of its own, and after any lie or unannounced fault of a drone's own position in the swarm.
        """
        if all(one.is_exact for one in self.mission.drones):
            return self.struck(OWN_FAULTS, drone, time_s, inf)
        return self.struck((*OWN_FAULTS, "clock"), drone, time_s, inf) or self.misled_s(("pose", "liar")) <= time_s

    def was_set_down(self, drone: int, time_s: float) -> bool:
        """Return whether the autopilot of a drone may have landed it where it was, because setpoints were missing.

        Conditions: ``safety.agent_lost`` is "land", or "return" for a vehicle without satellites, which has no home; and its
        agent or its link to the autopilot was faulted.
        """
        without_agent, by_slam = self.mission.safety.agent_lost, self.mission.drones[drone].localization == "slam"
        if without_agent != "land" and not (by_slam and without_agent == "return"):
            return False
        begun = (fault for fault in self.scenario.fault if fault.at_s <= time_s)
        stopping = (fault for fault in begun if fault.family == "process" or isinstance(fault, MavlinkLoss | MavlinkImpaired))
        return any(self.names[drone] in self.strikes(fault) for fault in stopping)

    def named(self, *drones: int) -> tuple[str, ...]:
        """Return the ids of drones, given by indices."""
        return tuple(self.names[drone] for drone in drones)


class Invariant(ABC, Generic[S_contra]):
    """A condition that must hold in every simulated flight, judged at each time step.

    A violation is reported when it begins, and again only after its end.
    """

    name: ClassVar[str]

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        self._broken: set[tuple[int, ...]] = set()

    @abstractmethod
    def breaches(self, moment: S_contra) -> Iterator[Breach]:
        """Yield the violations at this time. Called once after each tick (time step)."""

    def at_end(self, moment: S_contra) -> Iterator[Breach]:
        """Yield the violations that exist at the end of the flight, or that are judged only then. ``moment``: the last state."""
        yield from ()

    def look(self, moment: S_contra) -> list[Violation]:
        """Return the violations that begin at this time, as reports."""
        found = list(self.breaches(moment))
        if not found and not self._broken:
            return []
        new = [breach for breach in found if breach.drones not in self._broken]
        self._broken = {breach.drones for breach in found}
        return [self._told(breach, moment.time_s) for breach in new]

    def finish(self, moment: S_contra) -> list[Violation]:
        """Return the violations at the end of the flight, as reports."""
        return [self._told(breach, moment.time_s) for breach in self.at_end(moment)]

    def _told(self, breach: Breach, time_s: float) -> Violation:
        drones = self.setting.named(*breach.drones)
        return Violation(invariant=self.name, time_s=round(time_s, 3), drones=drones, text=breach.text)


def _is_announced(fault: Fault) -> bool:
    """Return whether a drone knows of a fault of its own position, and begins a new epoch."""
    return isinstance(fault, PositionJump) and fault.announced


def _unannounced_s(fault: Fault) -> tuple[tuple[float, float], ...]:
    """Return the spans in which a fault unknown to its drone counts (``Setting.struck_unannounced``)."""
    if _is_announced(fault):
        return (fault.at_s, fault.at_s + ANNOUNCED_S), (fault.end_s, fault.end_s + ANNOUNCED_S)
    return ((fault.at_s, fault.end_s + RECOVERY_S),)
