"""Recovery of missing log entries: the agent asks one peer after another for what it lacks, and who appears at once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection

PERIOD_S = 2.0
HURRY_S = 0.2  # while entries arrive: after a restart the whole log is missing, and each answer brings a bounded part


async def recover(
    alive: Callable[[], Collection[str]],
    summary: Callable[[], bytes],
    ask: Callable[[str, bytes], Awaitable[int]],
    phase: float,
) -> None:
    """Ask one peer after another, until cancelled; those that have appeared first, until they have nothing new.

    Args:
        alive: ids of the reachable peers.
        summary: summary of the own log.
        ask: sends it to a peer; returns the number of entries received.
        phase: 0 .. 1 of the period and of the peers, so that agents do not all ask at the same time, or the same peer first.
    """
    now_s = asyncio.get_running_loop().time
    due_s, turn = now_s() + PERIOD_S * phase, 0
    known: set[str] = set()
    fresh: list[str] = []
    while True:
        peers = sorted(alive())
        fresh = [peer for peer in peers if peer in fresh or peer not in known]
        known = set(peers)
        if not peers or (not fresh and now_s() < due_s):
            await asyncio.sleep(HURRY_S)
            continue
        peer = fresh[int(phase * len(fresh))] if fresh else peers[turn % len(peers)]
        got = await ask(peer, summary())
        if fresh and not got:
            fresh.remove(peer)
        elif not fresh:
            turn += 1
            due_s = now_s() + (0.0 if got else PERIOD_S)
        if got:
            await asyncio.sleep(HURRY_S)
