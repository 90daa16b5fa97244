"""Which faults of a simulated flight are active at a time, and which begin and end then."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from typing import TypeVar

import msgspec
import numpy as np

from radron.sim.faults.base import Fault

T = TypeVar("T", bound=Fault)
_STREAM = 1_000_004  # key of the faults' random streams, beside those of ``radron.sim.world.streams``


class Active:
    """A fault that has begun, with the affected drones (indices) and random numbers of its own."""

    __slots__ = ("drones", "fault", "rng")

    def __init__(self, fault: Fault, drones: Sequence[str], seed: int) -> None:
        """``drones``: ids of the mission's drones. The random numbers of a fault are independent of all other faults."""
        self.fault = fault
        self.drones = frozenset(drones.index(name) for name in fault.strikes(drones))
        self.rng = np.random.default_rng(
            np.random.SeedSequence(seed, spawn_key=(_STREAM, zlib.crc32(msgspec.json.encode(fault))))
        )


class Schedule:
    """Tells which faults of a simulated flight are active.

    ``faults``: all faults; ``begun``, ``ended``: faults that the last ``advance``, to ``time_s``, has begun or ended.
    """

    def __init__(self, faults: Sequence[Fault], drones: Sequence[str], seed: int) -> None:
        self.faults = tuple(faults)
        entries = [Active(fault, drones, seed) for fault in faults]
        self._waiting = sorted(entries, key=lambda one: one.fault.at_s, reverse=True)  # the next one is the last
        self._active: list[Active] = []
        self.time_s = 0.0
        self.begun: list[Active] = []
        self.ended: list[Active] = []

    def advance(self, time_s: float) -> None:
        """Begin and end the faults that are due at a time (s)."""
        self.time_s = time_s
        if not self._active and not self._waiting:
            self.begun, self.ended = [], []
            return
        self.begun = []
        while self._waiting and self._waiting[-1].fault.at_s <= time_s + 1e-9:
            self.begun.append(self._waiting.pop())
        self._active += self.begun
        self.ended = [one for one in self._active if one.fault.end_s <= time_s + 1e-9]
        if self.ended:
            self._active = [one for one in self._active if one not in self.ended]

    def dispatch(self, begin: Callable[[Active, int], None], end: Callable[[Active, int], None]) -> None:
        """Call ``begin`` for each affected drone of each fault that has begun, then ``end`` for the faults that have ended."""
        for change, faults in ((begin, self.begun), (end, self.ended)):
            for one in faults:
                for drone in sorted(one.drones):
                    change(one, drone)

    def active(self, kind: type[T], drone: int | None = None) -> list[tuple[T, Active]]:
        """Return the active faults of a kind, of one drone or of any, in order of their begin."""
        return [
            (one.fault, one) for one in self._active if isinstance(one.fault, kind) and (drone is None or drone in one.drones)
        ]
