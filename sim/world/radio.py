"""The simulated radio network between the drones: delay, jitter and loss of messages."""

from __future__ import annotations

import heapq
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

Delay = Annotated[float, Meta(ge=0.0, le=60.0)]
LOG_KINDS = ("credential", "cone", "exposure", "sighting", "fix", "coverage", "retraction")


class RadioTruth(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """True behaviour of the radio links between the drones: delay, jitter and loss, with one hop from each drone to each other.

    Lost messages stay lost, except log entries, which are repeated until they arrive, as Zenoh does.
    """

    delay_s: Delay = 0.02
    jitter_s: Delay = 0.01  # uniform, up to this
    loss: Annotated[float, Meta(ge=0.0, le=0.9)] = 0.01
    recovery_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 0.5  # until a lost log entry is sent again


def is_entry(key: str) -> bool:
    """Return whether a message key belongs to log entries (measurements, which are repeated until they arrive)."""
    return key.rsplit("/", 1)[-1] in LOG_KINDS


class Radio:
    """Simulates the radio network between the drones.

    Messages go from each drone to all other drones, and are delivered in order of arrival.
    """

    def __init__(self, truth: RadioTruth, count: int, rng: np.random.Generator) -> None:
        self._truth = truth
        self._rng = rng
        self._sent = 0
        self._drawn: list[float] = []
        self._inboxes: list[list[tuple[int, int, str, bytes]]] = [[] for _ in range(count)]

    @property
    def waiting(self) -> list[int]:
        """Number of messages on their way to each drone."""
        return [len(inbox) for inbox in self._inboxes]

    def send(self, sender: int, key: str, payload: bytes, now_ns: int, to: int | None = None) -> None:
        """Send a message to all other drones, or to one drone ``to``.

        A message to the sender itself is possible, as a thief of its key sends one.
        """
        truth = self._truth
        repeated = is_entry(key)
        for receiver in range(len(self._inboxes)) if to is None else (to,):
            if receiver == sender and to is None:
                continue
            delay = truth.delay_s + truth.jitter_s * self._random()
            lost = self._random() < truth.loss
            if lost and not repeated:
                continue
            while lost:
                delay += truth.recovery_s
                lost = self._random() < truth.loss
            self._carry(sender, receiver, key, payload, delay, now_ns)

    def _carry(self, sender: int, receiver: int, key: str, payload: bytes, delay_s: float, now_ns: int) -> None:
        """Put a payload on its way over one link; overridden by ``radron.sim.faults.network`` with the link's faults."""
        self._sent += 1
        heapq.heappush(self._inboxes[receiver], (now_ns + int(delay_s * 1e9), self._sent, key, payload))

    def _random(self) -> float:
        """Return the next uniform number; drawn in blocks, which takes a tenth of the time."""
        if not self._drawn:
            self._drawn = self._rng.random(1024).tolist()
        return self._drawn.pop()

    def receive(self, receiver: int, now_ns: int) -> list[tuple[str, bytes]]:
        """Remove and return the messages that have arrived at a drone by now."""
        inbox = self._inboxes[receiver]
        arrived = []
        while inbox and inbox[0][0] <= now_ns:
            _, _, key, payload = heapq.heappop(inbox)
            arrived.append((key, payload))
        return arrived
