"""How an agent comes by the log entries that never reached it: it asks the others in turn what it lacks."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection

PERIOD_S = 2.0
HURRY_S = 0.2  # while entries come: after a restart there is a whole log to be had, a bounded piece with each answer


async def recover(
    alive: Callable[[], Collection[str]],
    summary: Callable[[], bytes],
    ask: Callable[[str, bytes], Awaitable[int]],
    phase: float,
) -> None:
    """Ask one peer after another, until cancelled.

    Args:
        alive: ids of the peers that can be asked.
        summary: of the own log.
        ask: sends it to a peer; the number of entries that came back.
        phase: 0 .. 1 of the period, so that not all agents ask at the same time.
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
