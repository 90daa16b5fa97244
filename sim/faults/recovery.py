"""Exchange of missing log entries between the simulated agents, as ``radron.protocol.mesh.recovery`` does it over Zenoh.

Each agent asks one reachable peer after another every two seconds, and at once again while entries arrive. Requests and answers
use the same radio as all messages.
"""

from __future__ import annotations

from collections.abc import Sequence

from radron.agent.pilot import Pilot
from radron.protocol.keys import drone_key
from radron.sim.faults.network import FaultyRadio
from radron.sim.faults.tellers import Tellers
from radron.sim.world.radio import is_entry

PERIOD_NS = 2_000_000_000
HURRY_NS = 300_000_000  # 0.2 s after an answer, which takes about 0.1 s
TOKEN_NS = 1_000_000_000  # a peer's liveliness token goes this long after its last message (lease of a Zenoh link)


class Recovery:
    """Plays the requests of all agents of a swarm for missing log entries, and the answers."""

    def __init__(self, swarm: str, names: Sequence[str], radio: FaultyRadio, tellers: Tellers) -> None:
        self._keys = [drone_key(swarm, name, "log") for name in names]
        self._places = {name: place for place, name in enumerate(names)}
        self._radio = radio
        self._tellers = tellers
        self._due_ns: dict[int, int] = {}
        self._turns = [0] * len(names)
        self._heard_ns: dict[tuple[int, int], int] = {}  # by receiver and sender

    def hear(self, drone: int, key: str, payload: bytes, pilot: Pilot, now_ns: int) -> bool:
        """Record a received message, and answer a request for log entries. Return True if the message is such a request."""
        sender = self._places.get(key.split("/")[3])
        if sender is None:
            return False
        if is_entry(key):  # the key names the measuring drone, not the sender of an answer
            return False
        self._heard_ns[drone, sender] = now_ns
        if not key.endswith("/log"):
            return False
        missing = pilot.log_answer(self._tellers.discreet(drone, payload))
        for place, entry in missing:
            self._radio.send(drone, place, self._tellers.answer(drone, sender, place, entry), now_ns, to=sender)
        if missing:
            self._due_ns[sender] = now_ns + HURRY_NS
        return True

    def ask(self, drone: int, pilot: Pilot, now_ns: int) -> None:
        """Let a drone ask one of its reachable peers for missing log entries, if a request is due."""
        phase_ns = PERIOD_NS * drone // len(self._keys)  # not all at the same time
        if now_ns < self._due_ns.setdefault(drone, now_ns + phase_ns):
            return
        since_ns = now_ns - TOKEN_NS
        peers = [peer for peer in self._places.values() if self._heard_ns.get((drone, peer), 0) > since_ns]
        if peers:
            self._turns[drone] += 1
            self._due_ns[drone] = now_ns + PERIOD_NS
            peer = peers[self._turns[drone] % len(peers)]
            summary = self._tellers.discreet(drone, pilot.log_summary())
            self._radio.send(drone, self._keys[drone], summary, now_ns, to=peer)

    def begin_anew(self, drone: int) -> None:
        """Reset the exchange of a restarted agent: no peer has been heard so far, and the first contact causes a request."""
        self._due_ns[drone] = 0
        for receiver, sender in list(self._heard_ns):
            if drone in (receiver, sender):
                del self._heard_ns[receiver, sender]
