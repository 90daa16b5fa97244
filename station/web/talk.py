"""Sending and receiving on one WebSocket at the same time, with a common end."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from radron.station.outbox import LET_GO


async def talk(socket: WebSocket, *directions: Coroutine[Any, Any, object], code: Callable[[], int] = lambda: LET_GO) -> None:
    """Run several coroutines on one WebSocket (such as sending and receiving) until one of them or the server ends.

    The rest is then cancelled, and the socket is closed with a close ``code``.
    """
    tasks = [asyncio.create_task(one) for one in directions]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the socket is closed already
            await socket.close(code())
