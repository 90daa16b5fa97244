"""Conditions on the swarm's precautions: battery reserves, suspicion of members with wrong positions, and memory."""

from __future__ import annotations

import gc
import sys
import types
from collections import defaultdict
from collections.abc import Iterator
from itertools import chain
from math import dist, hypot, inf

import numpy as np

from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codes import Code
from radron.sim.faults.agents import CopiedKey, Corrupt, Cut, Equivocating, Lie, Partition, RadioRange
from radron.sim.faults.base import Family, Fault
from radron.sim.faults.machines import Battery, CameraDead, CameraStuck, Drag, PositionJump
from radron.sim.scoring.invariants.base import LOOK_TICKS, RECOVERY_S, Breach, Invariant, Setting
from radron.sim.scoring.invariants.place import excluded
from radron.sim.scoring.moment import Moment, Shared

MIN_BATTERY = 0.03  # of the battery: below it a real one may fail at any time
LIAR_NAMED_S = 10.0
IMPERSONATED_S = 2.0
REPORT_WITHIN_S = 25.0
_USELESS = (Code.CAMERA_SILENT, Code.CAMERA_BLIND, Code.CAMERA_REPEATS)  # noisy pixels or shifted energies are not
PLAINLY_MISPLACED_M = 5.0  # plainly visible to others: sightings are good to a metre or two
SEEN_M = 30.0  # nearer vehicles are not overlooked
FIXED_BYTES, ENTRY_BYTES = 8_000_000, 2_000  # a and b; a: the estimator's bounded checkpoints, and all planners
_SHARED = (type, types.ModuleType, types.FunctionType, types.BuiltinFunctionType, types.MethodType, Shared)
_MISPLACING: tuple[Family, ...] = ("pose",)  # a faulted thrust makes no own position wrong
_CLOCK: tuple[Family, ...] = ("clock",)
_ELSEWHERE: tuple[Family, ...] = ("liar", "pose")  # faults with two published places


class Reserve(Invariant[Moment]):
    """Requires that no vehicle is in the air with less than 3 % left in its battery. Exempt are:

    - a vehicle with a false battery report;
    - a hover without an agent by the mission's choice (``safety.agent_lost``), until its autopilot acts;
    - a vehicle under manual override, until its agent flies it by setpoints again: after release it hovers until an operator's
      command, and no operator is simulated.
    """

    name = "reserve"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        lying = [fault for fault in setting.scenario.fault if isinstance(fault, Battery) and fault.lies]
        self._honest = [name not in {one for fault in lying for one in setting.strikes(fault)} for name in setting.names]
        self._hovers = setting.mission.safety.agent_lost == "hold"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the vehicles that are in the air with empty batteries."""
        for drone, level in enumerate(moment.batteries):
            if level < MIN_BATTERY and self._honest[drone] and moment.airborne(drone) and not self._is_exempt(moment, drone):
                yield Breach((drone,), f"{100.0 * level:.1f} % left in the air")

    def _is_exempt(self, moment: Moment, drone: int) -> bool:
        mode = moment.autopilots[drone].mode
        hovers = self._hovers and moment.pilots[drone] is None and mode is FlightMode.HOLD
        return hovers or (mode is not FlightMode.OFFBOARD and self.setting.taken_over(drone, moment.time_s))


class Named(Invariant[Moment]):
    """Requires that a drone whose own position is more than 5 m wrong is suspected by another drone within 10 s.

    This holds in swarms with sightings (drones that measure direction or range of each other). The error comes from an
    unannounced jump or drag of the position. The 10 s count with at least two witnesses: other drones within 30 m, linked to it,
    with correct own positions, and without any earlier equivocation or lie about poses or sightings. With all satellites spoofed
    no drone can tell which position is wrong. A sighting informs only drones that know both tracks, by clocks that agree: the 10
    s do not count while its agent is down or its clock is wrong, nor after its revocation.

    Nor do they count for a drone with SLAM while the sightings by other drones correct its frame, which drifts anyway: its
    position in the mission frame is right, and none of its measurements contradicts that. A drone with satellites must be
    suspected then, too: its fixes contradict the sightings.

    An unknown frame, as of a restarted agent, is no suspicion; the 10 s begin again for a new agent. Suspicions of a revoked
    drone do not count.
    """

    name = "named"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        seen = setting.scenario.sightings is not None
        self._spans = [
            (setting.names.index(name), *span)
            for fault in setting.scenario.fault
            if seen and (span := _misplaced_s(fault)) is not None
            for name in setting.strikes(fault)
        ]
        misplacing = [fault for fault in setting.scenario.fault if _misplaces(fault)]
        self._lied_s = [
            min((one.at_s for one in misplacing if name in setting.strikes(one)), default=inf) for name in setting.names
        ]
        self._by_slam = [drone.localization == "slam" for drone in setting.mission.drones]
        self._unnamed_s = [0.0] * len(self._spans)
        self._agents: list[Pilot | None] = [None] * len(self._spans)
        self._found: list[Breach] = []
        self._ticks = 0

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that are wrong about their position without being suspected; checked twice a second."""
        self._ticks += 1
        if self._spans and self._ticks % LOOK_TICKS == 0:
            self._found = list(self._unnamed(moment))
        yield from self._found

    def _unnamed(self, moment: Moment) -> Iterator[Breach]:
        for place, (drone, begin_s, end_s) in enumerate(self._spans):
            if not begin_s <= moment.time_s < end_s or not self._is_seen(moment, drone) or self._is_kept_right(moment, drone):
                continue
            pilot = moment.pilots[drone]
            if self._agents[place] is not pilot:  # a new agent, not yet suspected
                self._agents[place], self._unnamed_s[place] = pilot, min(0.0, self._unnamed_s[place])
            if self._is_named(moment, drone):
                self._unnamed_s[place] = -inf
            self._unnamed_s[place] += 0.05 * LOOK_TICKS
            if self._unnamed_s[place] > LIAR_NAMED_S:
                yield Breach((drone,), f"its position is wrong since {begin_s:.1f} s, and nobody suspects it")

    def _is_named(self, moment: Moment, drone: int) -> bool:
        name = self.setting.names[drone]
        others = ((other, pilot) for other, pilot in enumerate(moment.pilots) if other != drone and pilot is not None)
        heard = (pilot for other, pilot in others if moment.time_s < self.setting.unheard_s(other))
        return any(name in pilot.frames.contradicted() for pilot in heard)

    def _is_kept_right(self, moment: Moment, drone: int) -> bool:
        """Return whether sightings correct all errors of a drone's own position, as for any drift."""
        pilot = moment.pilots[drone]
        return self._by_slam[drone] and pilot is not None and pilot.whereabouts is not None and not excluded(moment, drone)

    def _tells(self, moment: Moment, drone: int) -> bool:
        """Return whether its agent publishes meaningful messages."""
        has_wrong_clock = self.setting.struck(_CLOCK, drone, moment.time_s)
        return moment.pilots[drone] is not None and moment.time_s < self.setting.unheard_s(drone) and not has_wrong_clock

    def _are_linked(self, moment: Moment, drone: int, other: int) -> bool:
        """Return whether two drones have a link, by cuts and range."""
        pair, apart_m = self.setting.named(drone, other), dist(*moment.position_m[[drone, other]])
        for fault in self.setting.scenario.fault:
            if not fault.at_s <= moment.time_s < fault.end_s:
                continue
            if isinstance(fault, Cut) and set(pair) & set(self.setting.strikes(fault)):
                return False
            if isinstance(fault, Partition) and not any(set(pair) <= set(group) for group in fault.groups):
                return False
            if isinstance(fault, RadioRange) and apart_m > fault.range_m:
                return False
        return True

    def _is_seen(self, moment: Moment, drone: int) -> bool:
        x, y, _ = moment.position_m[drone].tolist()
        others = [k for k in range(len(moment.pilots)) if k != drone and self._tells(moment, k) and moment.airborne(k)]
        near = [k for k in others if hypot(moment.position_m[k, 0] - x, moment.position_m[k, 1] - y) < SEEN_M]
        honest = [k for k in near if moment.time_s < self._lied_s[k]]
        right = [k for k in honest if not self.setting.struck_unannounced(k, moment.time_s, _MISPLACING)]
        linked = [k for k in right if self._are_linked(moment, drone, k)]
        return len(linked) >= 2 and moment.airborne(drone) and self._tells(moment, drone)


class Accused(Invariant[Moment]):
    """Requires that no honest drone is reported as two senders under one name: forgeries in its name are not taken for its own.

    Exempt are drones with a copied key, a lie, or a fault of their own position, until ``RECOVERY_S`` after it; and all drones
    with corrupted bytes: one changed byte may move a pose.
    """

    name = "accused"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the reporting drone together with the wrongly reported drone."""
        if any(isinstance(fault, Corrupt) and fault.at_s <= moment.time_s for fault in self.setting.scenario.fault):
            return
        for drone, pilot in enumerate(moment.pilots):
            for text in pilot.problems if pilot is not None else ():
                if text.code != Code.TWO_SOURCES or text.about is None:
                    continue
                named = self.setting.names.index(text.about)
                if not self.setting.struck(_ELSEWHERE, named, moment.time_s, RECOVERY_S):
                    yield Breach((drone, named), str(text))


class Impersonated(Invariant[Moment]):
    """Requires that a drone whose id is used by a thief is reported within 2 s by each agent that uses both versions.

    The 2 s count while the drone's own agent lives, and not for an agent started after the thief began.
    """

    name = "impersonated"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        copied = [fault for fault in setting.scenario.fault if isinstance(fault, CopiedKey)]
        self._spans = [
            (setting.names.index(name), fault.at_s, fault.end_s) for fault in copied for name in setting.strikes(fault)
        ]
        self._named: set[tuple[int, int]] = set()  # by naming drone and named drone
        self._unnamed_s: defaultdict[tuple[int, int], float] = defaultdict(float)

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the agents that have not reported the drone with the stolen id."""
        for drone, begin_s, end_s in self._spans:
            if not begin_s <= moment.time_s < end_s or moment.pilots[drone] is None:
                continue
            copied = Code.TWO_SOURCES, self.setting.names[drone]
            for other, pilot in enumerate(moment.pilots):
                if other == drone or pilot is None or (other, drone) in self._named:
                    continue
                self._unnamed_s[other, drone] += 0.05
                if any((text.code, text.about) == copied for text in pilot.problems):
                    self._named.add((other, drone))
                elif self._unnamed_s[other, drone] > IMPERSONATED_S:
                    yield Breach((other, drone), f"its key is copied since {begin_s:.1f} s, and it is not named")


def _misplaces(fault: Fault) -> bool:
    """Return whether the drone publishes wrong places, its own or of others, or its messages do not count any more."""
    return isinstance(fault, Equivocating) or (isinstance(fault, Lie) and fault.what in ("pose", "sighting"))


def _misplaced_s(fault: Fault) -> tuple[float, float] | None:
    """Return the span of a large, unannounced error of a drone's own position, s; None: never."""
    if isinstance(fault, PositionJump) and not fault.announced and fault.jump_m > PLAINLY_MISPLACED_M:
        return fault.at_s, fault.end_s
    if isinstance(fault, Drag) and fault.most_m > PLAINLY_MISPLACED_M:
        return fault.at_s + PLAINLY_MISPLACED_M / fault.speed_mps, fault.end_s
    return None


class Told(Invariant[Moment]):
    """Requires that a drone reports within 25 s that its camera is useless, as no search may rely on it.

    The camera delivers nothing, sees nothing (not even background), or repeats itself. A camera without any delivery since the
    agent's start is for its driver to report, and simulated flights in lockstep have no drivers.
    """

    name = "told"

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        useless = [fault for fault in setting.scenario.fault if isinstance(fault, CameraDead | CameraStuck)]
        self._spans = [(setting.names.index(name), fault) for fault in useless for name in setting.strikes(fault)]
        self._born: dict[int, tuple[Pilot, float]] = {}

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield the drones that have not reported their useless camera for too long.

        The time counts from the begin of the fault and from the start of the agent.
        """
        for drone, fault in self._spans:
            pilot = moment.pilots[drone]
            if pilot is None:
                continue
            if drone not in self._born or self._born[drone][0] is not pilot:
                self._born[drone] = pilot, moment.time_s
            since_s = max(fault.at_s, self._born[drone][1])
            if since_s > fault.at_s and isinstance(fault, CameraDead) and not fault.blind:
                continue
            if fault.end_s > moment.time_s > since_s + REPORT_WITHIN_S and not any(
                text.code in _USELESS for text in pilot.problems
            ):
                yield Breach((drone,), f"its camera sees nothing new since {fault.at_s:.1f} s, and it does not say so")


class Memory(Invariant[Moment]):
    """Requires that an agent holds at most 8 MB plus 2 kB for each log entry at the end of the flight: only the log may grow."""

    name = "memory"

    def breaches(self, moment: Moment) -> Iterator[Breach]:
        """Yield nothing in flight, as a measurement takes half a second."""
        yield from ()

    def at_end(self, moment: Moment) -> Iterator[Breach]:
        """Yield the first live agent, if it holds too much memory."""
        for drone, pilot in enumerate(moment.pilots):
            if pilot is not None:
                entries, held = len(pilot.fusion.log), bytes_of(pilot)
                if held > FIXED_BYTES + ENTRY_BYTES * entries:
                    yield Breach((drone,), f"{held / 1e6:.1f} MB for {entries} entries")
                return


def bytes_of(root: object) -> int:
    """Return the memory of an object with all objects that it refers to, in bytes.

    Classes, functions, modules and objects that agents share are left out.
    """
    seen: set[int] = set()
    found, size = {id(root): root}, 0
    while found:  # all objects that are a step farther away
        seen |= found.keys()
        size += sum(map(sys.getsizeof, found.values()))
        views = [one.base for one in found.values() if isinstance(one, np.ndarray) and one.base is not None]
        held = gc.get_referents(*(one for one in found.values() if not isinstance(one, np.ndarray)))
        found = {id(one): one for one in chain(views, held) if id(one) not in seen and not isinstance(one, _SHARED)}
    return size
