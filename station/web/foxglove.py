"""WebSocket for Foxglove on the web page's server, with the page's access checks."""

from __future__ import annotations

import contextlib

import msgspec
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from radron.station.outbox import LET_GO
from radron.station.viewers.live import PROTOCOLS, Client, LiveFoxglove, is_foxglove
from radron.station.web.flood import Credit
from radron.station.web.guard import Guard
from radron.station.web.talk import talk

MAX_CLIENTS = 8


def door(live: LiveFoxglove, guard: Guard) -> WebSocketRoute:
    """Return the WebSocket route ``/foxglove``, through which Foxglove programs receive the state of the swarm."""

    async def serve(socket: WebSocket) -> None:
        refusal = guard.refusal(socket.headers, socket.query_params, is_foxglove)
        protocol = next((one for one in PROTOCOLS if one in socket.scope["subprotocols"]), None)
        if refusal is not None or protocol is None or len(live.clients) >= MAX_CLIENTS:
            await socket.close(LET_GO)
            return
        await socket.accept(protocol)
        with live.joined() as client:
            await talk(socket, _send(socket, client), _listen(socket, client, live))

    return WebSocketRoute("/foxglove", serve)


async def _send(socket: WebSocket, client: Client) -> None:
    while not client.gone:
        data = await client.next()
        if data.startswith(b"{"):
            await socket.send_text(data.decode())
        else:
            await socket.send_bytes(data)


async def _listen(socket: WebSocket, client: Client, live: LiveFoxglove) -> None:
    """Carry out a client's requests until it closes, floods, or breaks the protocol."""
    credit = Credit()
    with contextlib.suppress(WebSocketDisconnect, msgspec.MsgspecError, KeyError):
        while credit.spend():
            live.ask(client, await socket.receive_text())
