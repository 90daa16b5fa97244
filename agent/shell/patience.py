"""Obstacles before a flight, such as a cable that is not plugged in: the agent ends, or it waits and says for what."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable

from agent.errors import RadronError
from agent.shell.heartbeat import Heartbeat
from protocol.errors import ProtocolError

RETRY_S = 2.0
LIVE_S = 10.0  # between two signs of life during an attempt


class Patience:
    """Tells what is waited for: once on the error stream, and to the service manager, which shows it with the unit's state."""

    def __init__(self, heartbeat: Heartbeat, waits: bool = False, retry_s: float = RETRY_S) -> None:
        """``waits``: False ends the agent at the first obstacle. ``retry_s``: between two attempts."""
        self.waits = waits
        self.retry_s = retry_s
        self._heartbeat = heartbeat
        self._told = ""

    def tell(self, obstacle: Exception) -> None:
        """Say what is waited for, if that has changed. The supervisor hears it every time, as a sign of life."""
        text = f"waiting: {obstacle}"
        if text != self._told:
            self._told = text
            print(f"radron-agent: {text}", file=sys.stderr, flush=True)
        self._heartbeat.tell(f"STATUS={text}")

    async def until(self, attempt: Callable[[], Awaitable[None]]) -> None:
        """Attempt something until it succeeds.

        Raises:
            RadronError, ProtocolError: the first failure, where this agent does not wait.
        """
        living = asyncio.create_task(self._live())
        try:
            while True:
                try:
                    return await attempt()
                except (RadronError, ProtocolError) as obstacle:
                    if not self.waits:
                        raise
                    self.tell(obstacle)
                await asyncio.sleep(self.retry_s)
        finally:
            living.cancel()

    async def _live(self) -> None:
        """Show the supervisor that the event loop works, however long an attempt takes."""
        while True:
            self._heartbeat.tell(f"STATUS={self._told or 'starting'}")
            await asyncio.sleep(LIVE_S)
