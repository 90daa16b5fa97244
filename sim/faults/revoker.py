"""The operator revokes members in flight, as ``radron-agent revoke`` does: asks the logs, signs, and tells one drone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from agent.pilot import Pilot
from sim.faults.agents import Revoked
from sim.faults.schedule import Schedule
from sim.members import SimulatedOperator


class Revoker:
    """Carries out the faults ``revoked``. The other drones hear it of each other."""

    def __init__(self, schedule: Schedule, drones: Sequence[str], operator: SimulatedOperator) -> None:
        """``drones``: of the mission."""
        self._schedule, self._drones, self._operator = schedule, drones, operator
        self._due: deque[int] = deque()
        self._gone: set[int] = set()

    def advance(self, now_ns: int, running: dict[int, Pilot], own_ns: Callable[[int], int]) -> None:
        """Revoke whose turn it is, as soon as there is a drone to tell it to. ``running``: the pilots whose agents live;
        ``own_ns``: the time by a drone's own clock.
        """
        for one in self._schedule.begun:
            if isinstance(one.fault, Revoked):
                self._due += sorted(one.drones)
                self._gone |= one.drones
        hearing = [drone for drone in running if drone not in self._gone]
        while self._due and hearing:
            member, last = self._drones[self._due.popleft()], dict[str, int]()
            for drone in hearing:
                for (name, boot), held in running[drone].fusion.log.summary().items():
                    if name == member and held.ranges:
                        last[boot] = max(last.get(boot, -1), held.ranges[-1][1])
            key, payload = self._operator.revoked(now_ns, member, last)
            running[hearing[0]].receive(key, payload, own_ns(hearing[0]))
