"""Faults of the links between the agents, played by the simulated radio.

Whether a message is lost or changed is drawn from the random numbers of each fault: without an active fault the radio is
unchanged, bit for bit. Lost log entries wait in their publisher's cache, as in Zenoh's advanced publishers, and are sent again
until they arrive. The logs' own exchange of missing entries is in ``recovery``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import product

import msgpack
import numpy as np

from radron.sim.faults.agents import Corrupt, Cut, Duplicate, Flood, Lag, LinkFault, Loss, Partition, RadioRange, Reorder
from radron.sim.faults.base import Fault
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.geometry import Array
from radron.sim.world.radio import Radio, RadioTruth, is_entry

CACHE_ENTRIES = 500  # of each kind, kept by a publisher for a link that is down (radron.protocol.mesh.session)
MAX_FLOODING = 300  # messages on a link in one tick: the excess is dropped, as by Zenoh
_PAD = 1000  # bytes of a piece of padding; the decoder refuses strings of more than 1024

Link = tuple[int, int]  # sender, receiver
Arrival = tuple[float, bytes]  # delay (s), payload


class FaultyRadio(Radio):
    """The simulated radio network with the faults of its links that the scenario prescribes."""

    def __init__(
        self, truth: RadioTruth, names: Sequence[str], rng: np.random.Generator, faults: Schedule, tick_s: float
    ) -> None:
        """``names``: ids of the mission's drones. ``faults``: times of the faults. ``tick_s``: interval at which :meth:`advance`
        is called.
        """
        super().__init__(truth, len(names), rng)
        self._names = list(names)
        self._faults = faults
        self._tick_s = tick_s
        self._calm, self._broken = True, False
        self._excluded: set[int] = set()
        self._cut: set[Link] = set()
        self._far: set[Link] = set()
        self._struck: dict[Link, list[tuple[LinkFault, Active]]] = {}
        self._waiting: dict[tuple[int, int, str], deque[tuple[int, bytes]]] = {}  # entries, each with its next attempt
        self._poses: dict[int, tuple[str, bytes]] = {}  # the newest of each drone, while somebody floods

    def advance(self, now_ns: int, position: Array) -> None:
        """Update the links for a new time: links break or heal, and waiting entries are sent again.

        position: (N, 3), true positions of the N drones.
        """
        if self._faults.begun or self._faults.ended:
            self._look()
        self._calm = not self._broken and not self._waiting
        if self._calm:
            return
        self._far = self._out_of_range(position)
        self._send_again(now_ns)
        for flood, active in self._faults.active(Flood):
            for sender in sorted(active.drones):
                self._flood(sender, flood, now_ns)

    def hears(self, sender: int, receiver: int) -> bool:
        """Return whether the link from one drone to another is up at present."""
        return (sender, receiver) not in self._cut and (sender, receiver) not in self._far

    def exclude(self, drone: int) -> None:
        """End the links of a revoked drone, as the other drones have opened their network sessions anew without it."""
        self._excluded.add(drone)
        self._look()

    def silence(self, drone: int) -> None:
        """Delete the waiting messages and the cache of a drone whose agent has died."""
        self._inboxes[drone].clear()
        self._poses.pop(drone, None)
        for sender, receiver, key in list(self._waiting):
            if drone in (sender, receiver):
                del self._waiting[sender, receiver, key]

    def _look(self) -> None:
        """Note the active faults of each link."""
        everyone = range(len(self._names))
        active = self._faults.active
        self._cut, self._struck = set(), {}
        for partition, _ in active(Partition):
            side = {name: number for number, group in enumerate(partition.groups) for name in group}
            sides = [side.get(name, -1 - place) for place, name in enumerate(self._names)]
            self._cut.update((one, other) for one, other in product(everyone, everyone) if sides[one] != sides[other])
        self._cut.update(link for link in product(everyone, everyone) if not self._excluded.isdisjoint(link))
        for fault, one in active(LinkFault):
            links = self._links(fault, one)
            if isinstance(fault, Cut):
                self._cut.update(links)
            else:
                for link in links:
                    self._struck.setdefault(link, []).append((fault, one))
        self._broken = bool(self._cut or self._struck or active(RadioRange) or active(Flood))

    def _links(self, fault: LinkFault, active: Active) -> list[Link]:
        named = fault.names_of_peers()
        peers = [place for place, name in enumerate(self._names) if fault.peers is None or name in named]
        pairs = [(target, peer) for target, peer in product(active.drones, peers) if target != peer]
        sent = pairs if fault.direction != "receive" else []
        received = [(peer, target) for target, peer in pairs] if fault.direction != "send" else []
        return sorted({*sent, *received})

    def _out_of_range(self, position: Array) -> set[Link]:
        far: set[Link] = set()
        for fault, active in self._faults.active(RadioRange):
            between = np.linalg.norm(position[:, None] - position[None], axis=2)
            for sender, receiver in np.argwhere(between > fault.range_m).tolist():
                if sender in active.drones or receiver in active.drones:
                    far.add((sender, receiver))
        return far

    def _carry(self, sender: int, receiver: int, key: str, payload: bytes, delay_s: float, now_ns: int) -> None:
        if self._calm:
            super()._carry(sender, receiver, key, payload, delay_s, now_ns)
            return
        if key.endswith("/pose"):
            self._poses[sender] = key, payload
        arrivals: list[Arrival] = [(delay_s, payload)] if self.hears(sender, receiver) else []
        resent = True
        for fault, active in self._struck.get((sender, receiver), ()):
            if isinstance(fault, Loss) and fault.news is not None and not key.endswith(f"/{fault.news}"):
                continue
            arrivals = [arrival for one in arrivals for arrival in played(fault, active.rng, one)]
            resent = resent and not (isinstance(fault, Loss) and not fault.resent)
        for late_s, content in arrivals:
            super()._carry(sender, receiver, key, content, late_s, now_ns)
        if not arrivals and resent and is_entry(key):
            queue = self._waiting.setdefault((sender, receiver, key), deque(maxlen=CACHE_ENTRIES))
            queue.append((now_ns + int(self._truth.recovery_s * 1e9), payload))

    def _send_again(self, now_ns: int) -> None:
        for (sender, receiver, key), queue in list(self._waiting.items()):
            if not self.hears(sender, receiver):
                continue
            while queue and queue[0][0] <= now_ns:
                self._carry(sender, receiver, key, queue.popleft()[1], self._truth.delay_s, now_ns)
            if not queue:
                del self._waiting[sender, receiver, key]

    def _flood(self, sender: int, flood: Flood, now_ns: int) -> None:
        """Send the newest pose of a drone again and again, padded by a field that no receiver knows."""
        if sender not in self._poses:
            return
        key, payload = self._poses[sender]
        copy = padded(payload, flood.message_bytes)
        number = min(MAX_FLOODING, round(flood.rate_mbps * 1e6 * self._tick_s / len(copy)))
        for receiver in range(len(self._names)):
            if receiver != sender:
                for _ in range(number):
                    self._carry(sender, receiver, key, copy, self._truth.delay_s, now_ns)
        self._poses[sender] = key, payload


def played(fault: Fault, rng: np.random.Generator, arrival: Arrival) -> list[Arrival]:
    """Return how a message arrives after one fault of its link: no, one or several arrivals, each with delay and bytes."""
    late_s, payload = arrival
    match fault:
        case Loss():
            return [] if rng.random() < fault.probability else [arrival]
        case Lag():
            return [(late_s + fault.delay_s + fault.jitter_s * rng.random(), payload)]
        case Reorder():
            return [(late_s + fault.held_s, payload) if rng.random() < fault.probability else arrival]
        case Duplicate():
            copies = [(late_s + fault.within_s * rng.random(), payload)] if rng.random() < fault.probability else []
            return [arrival, *copies]
        case Corrupt():
            return [(late_s, _corrupted(payload, rng)) if rng.random() < fault.probability else arrival]
        case _:
            return [arrival]


def _corrupted(payload: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes with one changed, with the last ones missing, or with some more."""
    place, what = int(rng.integers(len(payload))), rng.integers(3)
    if what == 0:
        return payload[:place] + bytes([payload[place] ^ int(rng.integers(1, 256))]) + payload[place + 1 :]
    return payload[:place] if what == 1 else payload + rng.bytes(1 + place % 16)


def padded(payload: bytes, size: int) -> bytes:
    """Pad a message to about ``size`` bytes, never fewer than before, by a field that receivers ignore."""
    if size < len(payload) + 12:
        return payload
    whole, rest = divmod(size - len(payload) - 12, _PAD + 3)  # each piece has a header of 3 bytes
    fields = msgpack.unpackb(payload) | {"padding": [*([bytes(_PAD)] * whole), bytes(max(0, rest - 3))]}
    return bytes(msgpack.packb(fields))
