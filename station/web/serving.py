"""Web server of the station, which runs in the station's event loop."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path

import uvicorn
from msgspec import Struct
from starlette.routing import WebSocketRoute

from radron.agent.errors import RadronError
from radron.station.hub import Hub
from radron.station.web.app import application
from radron.station.web.connections import MAX_CONNECTIONS, BoundedHttp
from radron.station.web.guard import LOCAL, Guard
from radron.station.web.token import token_from

MAX_MESSAGE_BYTES = 65_536  # received on a socket: Foxglove subscribes to all topics of 30 drones at once
Doors = Callable[[Guard], Sequence[WebSocketRoute]]


class StationError(RadronError):
    """The station cannot serve its web page, or cannot show its mission, network or records."""


class Place(Struct, frozen=True, kw_only=True):
    """Address at which the station serves its web page.

    Other computers can only connect with TLS (``certificate`` and ``key``, PEM files). ``token_file``: file with the secret token
    of all requests, made if it is missing; None: a new token, only in the printed address.
    """

    host: str = "127.0.0.1"
    port: int = 8087
    certificate: Path | None = None
    key: Path | None = None
    token_file: Path | None = None

    @property
    def is_local(self) -> bool:
        """Whether only programs of this computer can connect."""
        return self.host in LOCAL


class Serving:
    """The web server of the operator's page.

    ``address``: address to open in a browser, with the token. ``port``: the port in use.
    """

    def __init__(self, hub: Hub, place: Place, doors: Doors | None = None) -> None:
        """Open the port. ``doors``: WebSocket routes of other programs, protected by the page's access checks.

        Raises:
            StationError: the port is in use, or the page would be open to other computers without TLS.
            TokenError: the token's file cannot be used.
        """
        if not place.is_local and (place.certificate is None or place.key is None):
            raise StationError(
                f"--host {place.host}: others could connect, so give --tls-certificate and --tls-key, or leave --host out"
            )
        token = token_from(place.token_file)
        hosts = LOCAL if place.is_local else (*LOCAL, place.host.lower())
        self._socket = _bound(place)
        self.port = int(self._socket.getsockname()[1])
        scheme = "http" if place.certificate is None else "https"
        name = f"[{place.host}]" if ":" in place.host else place.host
        self.address, self._token_file = f"{scheme}://{name}:{self.port}/?token={token}", place.token_file
        guard = Guard(token, scheme, self.port, hosts)
        self._server = uvicorn.Server(
            uvicorn.Config(
                application(hub, guard, doors(guard) if doors is not None else ()),
                http=BoundedHttp,
                backlog=MAX_CONNECTIONS,  # taken at once
                ws_max_size=MAX_MESSAGE_BYTES,
                log_level="warning",
                access_log=False,
                server_header=False,
                ssl_certfile=place.certificate,
                ssl_keyfile=place.key,
                timeout_graceful_shutdown=1,
            )
        )

    def shown(self, socket: str = "") -> str:
        """Return the address of the page, or of a ``socket`` path, for printing.

        A token from a file is left out, because the output may be logged.
        """
        page, _, token = self.address.partition("?")
        address = f"{page.replace('http', 'ws', 1)}{socket}" if socket else page
        return f"{address}?{token}" if self._token_file is None else f"{address} (with ?token= from {self._token_file})"

    async def run(self, work: Awaitable[None]) -> None:
        """Serve the web page until interrupted, and meanwhile run ``work``, which fills the page. Errors of both are raised."""
        serving = asyncio.create_task(self._server.serve([self._socket]))
        working = asyncio.ensure_future(work)
        try:
            await asyncio.wait((serving, working), return_when=asyncio.FIRST_COMPLETED)
            if working.done():
                working.result()  # a record stays open after its end
                await serving
        finally:
            working.cancel()
            self._server.should_exit = True
            await asyncio.gather(serving, working, return_exceptions=True)


def _bound(place: Place) -> socket.socket:
    family = socket.AF_INET6 if ":" in place.host else socket.AF_INET
    bound = socket.socket(family, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind((place.host, place.port))
        bound.listen()
    except OSError as error:
        bound.close()
        raise StationError(f"{place.host}:{place.port}: {error.strerror or error}; give another --port") from None
    return bound
