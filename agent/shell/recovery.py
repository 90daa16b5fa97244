"""Recovery of missing log entries: the agent asks one peer after another for what it lacks."""

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
    """Ask one peer after another, until cancelled.

    Args:
        alive: ids of the reachable peers.
        summary: summary of the own log.
        ask: sends it to a peer; returns the number of entries received.
        phase: 0 .. 1 of the period, so that agents do not all ask at the same time.
    """
    turn = 0
    first = True
    while True:
        peers = sorted(alive())
        if not peers:
            await asyncio.sleep(HURRY_S)
            continue
        turn += 1
        got = await ask(peers[turn % len(peers)], summary())
        await asyncio.sleep(HURRY_S if got else PERIOD_S * (phase if first else 1.0))
        first = False
