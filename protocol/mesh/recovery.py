"""Recovery of missing log entries: the agent queries one peer after another, and an appearing peer at once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection

RECOVERY_PERIOD_S = 2.0
MAX_PUT_OFF = 0.5  # share of an answer
HURRY_S = 0.2  # while entries arrive: after a restart the whole log is missing, and each answer has a bounded part of it


async def recover(
    alive: Callable[[], Collection[str]],
    summary: Callable[[], bytes],
    ask: Callable[[str, bytes], Awaitable[int]],
    phase: float,
    put_off: Callable[[], int] = lambda: 0,
) -> None:
    """Fetch the log entries that are missing here from the other drones, one drone after another, until cancelled.

    Drones that have just appeared are queried first, in turn, until their answers are empty. A peer with endless answers of known
    entries must not exclude the other peers: while appeared peers are queried, every second period goes to one of all peers.

    Args:
        alive: ids of the reachable peers.
        summary: summary of the own log.
        ask: sends the summary to a peer; returns the number of received entries.
        phase: position in the period and in the list of peers, from 0 to 1, different for each agent, so that agents query
            neither all at the same time nor the same peer first.
        put_off: number of postponed entries so far; if most of an answer is postponed, the next query waits a period.
    """
    now_s = asyncio.get_running_loop().time
    due_s, turn = now_s() + RECOVERY_PERIOD_S * phase, 0
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
        regular = not fresh or now_s() >= due_s + RECOVERY_PERIOD_S
        peer = peers[turn % len(peers)] if regular else fresh[0]
        before = put_off()
        received = await ask(peer, summary())
        got = received > 0 and put_off() - before <= MAX_PUT_OFF * received
        if peer in fresh:
            fresh.remove(peer)
            fresh += [peer] if got else []
        if regular:
            turn += 1
            due_s = now_s() + (0.0 if got else RECOVERY_PERIOD_S)
        if got:
            await asyncio.sleep(HURRY_S)
