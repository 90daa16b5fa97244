"""Revocation of members in a simulated flight, as an operator does by ``radron-agent revoke``.

The operator reads the logs, signs, and sends the revocation to one drone.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from radron.agent.pilot import Pilot
from radron.protocol.revocations import Revocation
from radron.sim.faults.agents import Revoked
from radron.sim.faults.schedule import Schedule
from radron.sim.lockstep.members import SimulatedOperator

LINKS_END_NS = 1_000_000_000  # the others open their sessions anew one after the other; this is for the second drone


class Revoker:
    """Plays the faults ``revoked``: the operator withdraws a drone's rights.

    The drones forward the revocation, also to the revoked member; then its links end.
    """

    def __init__(
        self,
        schedule: Schedule,
        drones: Sequence[str],
        operator: SimulatedOperator,
        exclude: Callable[[int], None],
        own_ns: Callable[[int, int], int],
    ) -> None:
        """``drones``: ids of the mission's drones. ``operator``: signs the revocations. ``exclude``: ends the links of a drone.
        ``own_ns``: returns the own time of a drone's agent at a time.
        """
        self._schedule, self._drones, self._operator = schedule, drones, operator
        self._due: deque[int] = deque()
        self._gone: set[int] = set()
        self._linked: deque[tuple[int, int]] = deque()  # end of the links, drone
        self._exclude, self._own_ns = exclude, own_ns

    def advance(self, now_ns: int, running: dict[int, Pilot]) -> None:
        """Send the revocations that are due, as soon as a drone can receive them. ``running``: the pilots of live agents."""
        for one in self._schedule.begun:
            if isinstance(one.fault, Revoked):
                self._due += sorted(one.drones)
                self._gone |= one.drones
        hearing = [drone for drone in running if drone not in self._gone]
        while self._linked and now_ns >= self._linked[0][0]:
            self._exclude(self._linked.popleft()[1])
        while self._due and hearing:
            self._linked.append((now_ns + LINKS_END_NS, self._due[0]))
            member, last = self._drones[self._due.popleft()], dict[str, int]()
            for drone in hearing:
                for (name, boot), held in running[drone].fusion.log.summary().items():
                    if name == member and held.ranges:
                        last[boot] = max(last.get(boot, -1), held.ranges[-1][1])
            key, payload = self._operator.revoked(now_ns, member, last)
            running[hearing[0]].receive(key, payload, self._own_ns(hearing[0], now_ns))

    def remind(self, drone: int, pilot: Pilot, held: tuple[Revocation, ...], now_ns: int) -> None:
        """Give a restarted agent the revocations saved on its disk."""
        own_ns = self._own_ns(drone, now_ns)
        pilot.receive(*self._operator.kept(self._drones[drone], held, own_ns), own_ns)
