"""Faulty clocks of the drones' computers in a simulated flight.

Such a clock gives UTC on board; an agent's own time is monotonic from its start on.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from radron.agent.detector.readout import Readout
from radron.agent.vehicle.interface import SeenDrone
from radron.sim.faults.machines import Clock
from radron.sim.faults.schedule import Schedule


class ClockFaults:
    """Plays the clock faults of all drones of a simulated flight."""

    def __init__(self, schedule: Schedule, start_ns: int) -> None:
        """``start_ns``: UTC time at the start of the simulation."""
        self._schedule, self._start_ns = schedule, start_ns
        self._frozen_ns: dict[int, int] = {}  # lead of each agent's own time over true time, since its start

    def begin(self, drone: int) -> None:
        """Start a drone's agent: its own time begins with the next reading of its clock."""
        self._frozen_ns.pop(drone, None)

    def own_ns(self, drone: int, true_ns: int) -> int:
        """Return the own time of a drone's agent at a true time."""
        if drone not in self._frozen_ns:
            self._frozen_ns[drone] = self.utc_ns(drone, true_ns) - true_ns
        return true_ns + self._frozen_ns[drone]

    def ahead_ns(self, drone: int, true_ns: int) -> int:
        """Return the lead of a drone's clock over the own time of its agent."""
        return self.utc_ns(drone, true_ns) - self.own_ns(drone, true_ns)

    def utc_ns(self, drone: int, utc_ns: int) -> int:
        """Return the reading of a drone's clock at a UTC time. The jump of an active fault also applies to times before it."""
        off_ns = 0
        for fault, _ in self._schedule.active(Clock, drone):
            since_ns = max(0, utc_ns - self._start_ns - round(fault.at_s * 1e9))
            off_ns += round(fault.jump_s * 1e9 + fault.drift_ppm * 1e-6 * since_ns)
        return utc_ns + off_ns

    def restamped_sightings(self, drone: int, seen: Sequence[SeenDrone]) -> Sequence[SeenDrone]:
        """Return relative observations of other drones with stamps in own time."""
        if self.own_ns(drone, 0) == 0:
            return seen
        return [replace(one, stamp_ns=self.own_ns(drone, one.stamp_ns)) for one in seen]

    def restamped(self, drone: int, readout: Readout) -> Readout:
        """Return a camera readout with stamps in own time.

        The camera counts its own ticks; the computer stamps the first tick.
        """
        if self.own_ns(drone, 0) == 0:
            return readout
        start_ns = self.own_ns(drone, readout.start_ns)
        clock_ns = readout.clock_ns + start_ns - readout.start_ns
        return replace(readout, start_ns=start_ns, end_ns=self.own_ns(drone, readout.end_ns), clock_ns=clock_ns)
