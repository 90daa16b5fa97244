"""Impairment of one direction of a link, and its effect on packets."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from typing import Annotated

from msgspec import Meta, Struct

_Seconds = Annotated[float, Meta(ge=0.0)]
_Probability = Annotated[float, Meta(ge=0.0, le=1.0)]
MAX_CHANGED_BYTES = 8


class LinkState(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Impairment of one direction of a link; by default all data pass at once.

    cut: no data pass. frozen: data are accepted, and passed on only after the freeze has ended. delay_s, jitter_s: all data take
    ``delay_s`` longer, plus a random time up to ``jitter_s``. rate_bytes_ps: bytes a second at most; 0: no limit. loss,
    duplicate, reorder, corrupt: probabilities for a packet. within_s: a duplicate follows within this time. held_s: hold time of
    a packet that is to be overtaken.
    """

    cut: bool = False
    frozen: bool = False
    delay_s: _Seconds = 0.0
    jitter_s: _Seconds = 0.0
    rate_bytes_ps: Annotated[float, Meta(ge=0.0)] = 0.0
    loss: _Probability = 0.0
    duplicate: _Probability = 0.0
    within_s: _Seconds = 0.0
    reorder: _Probability = 0.0
    held_s: _Seconds = 0.0
    corrupt: _Probability = 0.0


PASSING = LinkState()


def combined(states: Iterable[LinkState]) -> LinkState:
    """Return the impairment that results from several impairments together."""
    told = list(states) or [PASSING]
    rates = [state.rate_bytes_ps for state in told if state.rate_bytes_ps > 0.0]
    return LinkState(
        cut=any(state.cut for state in told),
        frozen=any(state.frozen for state in told),
        delay_s=sum(state.delay_s for state in told),
        jitter_s=sum(state.jitter_s for state in told),
        rate_bytes_ps=min(rates, default=0.0),
        loss=_either(state.loss for state in told),
        duplicate=_either(state.duplicate for state in told),
        within_s=max(state.within_s for state in told),
        reorder=_either(state.reorder for state in told),
        held_s=max(state.held_s for state in told),
        corrupt=_either(state.corrupt for state in told),
    )


def _either(probabilities: Iterable[float]) -> float:
    """Return the probability that at least one of some independent events happens."""
    neither = 1.0
    for probability in probabilities:
        neither *= 1.0 - probability
    return 1.0 - neither


class Packets:
    """Impairs one direction of a link that carries packets.

    ``state`` may be changed at any time; it holds for the packets from then on. ``frozen`` and ``rate_bytes_ps`` concern streams
    only, and have no effect here.
    """

    def __init__(self, random: Random) -> None:
        self.state = PASSING
        self._random = random

    def carry(self, packet: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Return the arrivals of a packet that is sent at ``now_s``: (time of arrival, bytes) of each copy."""
        state, random = self.state, self._random
        if state.cut or self._happens(state.loss):
            return []
        if self._happens(state.corrupt):
            packet = corrupted(packet, random)
        due_s = now_s + state.delay_s + state.jitter_s * random.random()
        if self._happens(state.reorder):
            due_s += state.held_s
        arrivals = [(due_s, packet)]
        if self._happens(state.duplicate):
            arrivals.append((due_s + state.within_s * random.random(), packet))
        return arrivals

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._random.random() < probability


def corrupted(packet: bytes, random: Random) -> bytes:
    """Return a packet with some bytes changed, missing at the end, or added there."""
    damage = random.randrange(3)
    if damage == 1:
        return packet[: random.randrange(max(1, len(packet)))]
    if damage == 2 or not packet:
        return packet + random.randbytes(random.randint(1, MAX_CHANGED_BYTES))
    changed = bytearray(packet)
    for _ in range(random.randint(1, MAX_CHANGED_BYTES)):
        changed[random.randrange(len(changed))] ^= random.randint(1, 255)
    return bytes(changed)
