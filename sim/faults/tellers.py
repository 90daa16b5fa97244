"""Messages as the drones send them: true, false (from liars), or different by receiver (from equivocators)."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Entry
from radron.protocol.errors import ProtocolError
from radron.protocol.signing import Sign, sign_entries
from radron.protocol.summary import decode_summary, encode_summary
from radron.sim.faults.agents import Equivocating, Lie, Poisoned
from radron.sim.faults.base import Fault
from radron.sim.faults.liars import KIND_OF, Liars, falsified
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.world.radio import LOG_KINDS, is_entry

_OTHERWISE = Lie(at_s=0.0, what="cone")  # for the numbers of the changed version


class Tellers:
    """Changes the outgoing messages of lying and equivocating drones of a simulated flight."""

    def __init__(
        self, faults: Sequence[Fault], schedule: Schedule, drones: Sequence[str], signs: Sequence[Sign], poisoners: Poisoners
    ) -> None:
        """``faults``: of the scenario. ``drones``: ids of the mission's drones. ``signs``: signing function of each drone."""
        self._liars = Liars(faults, schedule, signs, poisoners)
        self._schedule, self._drones, self._signs = schedule, list(drones), signs
        self._sly = {drones.index(name) for fault in faults if _lies_to_logs(fault) for name in fault.strikes(drones)}
        self._otherwise: dict[tuple[int, bytes], tuple[frozenset[int], bytes]] = {}  # receivers, changed version
        self._angles: dict[Active, float] = {}  # turn of the measured directions, rad

    def tell(self, drone: int, key: str, payload: bytes) -> list[tuple[int | None, bytes]]:
        """Return the bytes that a drone publishes instead of this message, each with its receiver; None: all drones."""
        told = self._liars.tell(drone, key, payload)
        active = self._schedule.active(Equivocating, drone) if is_entry(key) else []
        if not active:
            return [(None, told)]
        (fault, one), message = active[0], decode_from(key, told)
        if one not in self._angles:
            self._angles[one] = float(one.rng.uniform(0.5 * pi, 1.5 * pi))
        changed = falsified(message, _OTHERWISE, self._angles[one])
        if changed is message or not isinstance(changed, Entry):
            return [(None, told)]
        others = [receiver for receiver in range(len(self._drones)) if receiver != drone]
        peers = frozenset(others[1::2] if fault.peers is None else self._named(fault) & set(others))
        version = encode(next(sign_entries([changed], self._signs[drone])))
        self._otherwise[drone, payload] = peers, version
        return [(receiver, version if receiver in peers else told) for receiver in others]

    def answer(self, drone: int, to: int, key: str, payload: bytes) -> bytes:
        """Return the log entry that a drone sends to an asking peer: the version that this peer has got before."""
        peers, version = self._otherwise.get((drone, payload), (frozenset(), b""))
        return version if to in peers else self._liars.told(drone, key, payload)

    def discreet(self, drone: int, summary: bytes) -> bytes:
        """Return a log summary as a liar uses it: without the hashes of its own log, which would reveal the lie."""
        if drone not in self._sly:
            return summary
        try:
            mission, held = decode_summary(summary)
        except ProtocolError:
            return summary
        own = self._drones[drone]
        return encode_summary(mission, {one: told._replace(blocks=()) if one[0] == own else told for one, told in held.items()})

    def _named(self, fault: Equivocating) -> set[int]:
        names = (fault.peers,) if isinstance(fault.peers, str) else fault.peers or ()
        return {self._drones.index(name) for name in names}


def _lies_to_logs(fault: Fault) -> bool:
    """Return whether the fault puts different entries into the drone's own log and the others'."""
    return isinstance(fault, Equivocating | Poisoned) or (isinstance(fault, Lie) and KIND_OF[fault.what] in LOG_KINDS)
