"""The two directions of a socket, with a common end."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from station.outbox import LET_GO


async def talk(socket: WebSocket, *directions: Coroutine[Any, Any, object], code: Callable[[], int] = lambda: LET_GO) -> None:
    """Run all directions until a direction or the server ends; then end the others and close the socket with a code."""
    tasks = [asyncio.create_task(one) for one in directions]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):  # the socket is closed already
            await socket.close(code())
