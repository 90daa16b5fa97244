"""Obstacles before a flight, such as a cable that is not plugged in: the agent ends, or waits and reports the obstacle."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable

from radron.agent.errors import RadronError
from radron.agent.shell.heartbeat import Heartbeat
from radron.protocol.errors import ProtocolError

RETRY_S = 2.0
LIVE_S = 10.0  # between two signs of life during an attempt


class Patience:
    """Waits for obstacles before a flight to go away, such as a cable that is not plugged in, and reports them.

    An obstacle is reported once on the error stream, and in the status line of the service manager's unit.
    """

    def __init__(self, heartbeat: Heartbeat, waits: bool = False, retry_s: float = RETRY_S) -> None:
        """Set up the waiting. ``waits``: False ends the agent at the first obstacle. ``retry_s``: between two attempts."""
        self.waits = waits
        self.retry_s = retry_s
        self._heartbeat = heartbeat
        self._told = ""

    def tell(self, obstacle: Exception) -> None:
        """Print the obstacle if its text has changed. The supervisor gets every call, as a sign of life."""
        text = f"waiting: {obstacle}"
        if text != self._told:
            self._told = text
            print(f"radron-agent: {text}", file=sys.stderr, flush=True)
        self._heartbeat.tell(f"STATUS={text}")

    async def until(self, attempt: Callable[[], Awaitable[None]]) -> None:
        """Repeat an attempt, such as to connect to the autopilot, until it succeeds.

        Raises:
            RadronError, ProtocolError: the first failure, if ``waits`` is False.
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
