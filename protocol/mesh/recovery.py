"""Recovery of missing log entries: the agent asks one peer after another for what it lacks, and who appears at once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection

PERIOD_S = 2.0
MAX_PUT_OFF = 0.5  # share of an answer
HURRY_S = 0.2  # while entries arrive: after a restart the whole log is missing, and each answer brings a bounded part


async def recover(
    alive: Callable[[], Collection[str]],
    summary: Callable[[], bytes],
    ask: Callable[[str, bytes], Awaitable[int]],
    phase: float,
    put_off: Callable[[], int] = lambda: 0,
) -> None:
    """Ask one peer after another, until cancelled; those that have appeared first, in turn, until they have nothing new.

    Whoever always has an answer, of what is known already, must not keep the others out: while some have appeared, one of all
    peers is asked for every second period.

    Args:
        alive: ids of the reachable peers.
        summary: summary of the own log.
        ask: sends it to a peer; returns the number of entries received.
        phase: 0 .. 1 of the period and of the peers, so that agents do not all ask at the same time, or the same peer first.
        put_off: the number of entries put off so far: where most of an answer is, there is no hurry to ask again.
    """
    now_s = asyncio.get_running_loop().time
    due_s, turn = now_s() + PERIOD_S * phase, 0
    known: set[str] = set()
    fresh: list[str] = []
    while True:
        peers = sorted(alive())
        new = [peer for peer in peers if peer not in known]
        first = int(phase * len(new))
        fresh = [peer for peer in fresh if peer in peers] + new[first:] + new[:first]
        known = set(peers)
        if not peers or (not fresh and now_s() < due_s):
            await asyncio.sleep(HURRY_S)
            continue
        regular = not fresh or now_s() >= due_s + PERIOD_S
        peer = peers[turn % len(peers)] if regular else fresh[0]
        before = put_off()
        received = await ask(peer, summary())
        got = received > 0 and put_off() - before <= MAX_PUT_OFF * received
        if peer in fresh:
            fresh.remove(peer)
            fresh += [peer] if got else []
        if regular:
            turn += 1
            due_s = now_s() + (0.0 if got else PERIOD_S)
        if got:
            await asyncio.sleep(HURRY_S)
