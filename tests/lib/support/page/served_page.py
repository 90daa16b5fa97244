"""A station's page on a real server, in a thread of its own, and its clients."""

from __future__ import annotations

import asyncio
import http.client
import json
import ssl
import threading
from collections.abc import Callable, Coroutine, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from socket import create_connection
from typing import Any

from websockets.sync.client import ClientConnection, connect

from radron.station.hub import Hub
from radron.station.web.serving import Doors, Place, Serving

Work = Callable[[], Coroutine[Any, Any, None]]


class Served:
    """``address``: for a browser, with the ``token``; ``port``: where it is served."""

    def __init__(self, hub: Hub, place: Place, work: Work, doors: Doors | None = None) -> None:
        self.hub, self._doors = hub, doors
        self._work = work
        self._loop = asyncio.new_event_loop()
        self._started = threading.Event()
        self._stop: asyncio.Event
        self._thread = threading.Thread(target=lambda: self._loop.run_until_complete(self._run(place)), daemon=True)
        self._thread.start()
        assert self._started.wait(10.0)

    async def _run(self, place: Place) -> None:
        self._stop = asyncio.Event()
        serving = Serving(self.hub, place, self._doors)
        self.address = serving.address
        self.token = serving.address.split("token=")[1]
        self.port = serving.port
        self._started.set()
        work = asyncio.create_task(self._stop.wait())
        serve = asyncio.create_task(serving.run(self._work()))
        await work
        serve.cancel()
        await asyncio.gather(serve, return_exceptions=True)

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call something in the server's loop."""
        return self.call_later(function, *arguments).result(10.0)

    def call_later(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The same, without waiting for it."""

        async def run() -> Any:
            return function(*arguments)

        return asyncio.run_coroutine_threadsafe(run(), self._loop)

    def get(self, path: str, tls: ssl.SSLContext | None = None, **headers: str) -> tuple[int, http.client.HTTPMessage, bytes]:
        """A file, by exactly this path: status, headers, body."""
        kind: Any = http.client.HTTPConnection if tls is None else http.client.HTTPSConnection
        client = kind("127.0.0.1", self.port, timeout=10.0, **({} if tls is None else {"context": tls}))
        try:
            client.putrequest("GET", path, skip_host=True)
            for name, value in {"Host": f"localhost:{self.port}", **headers}.items():
                client.putheader(name, value)
            client.endheaders()
            answer = client.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            client.close()

    def socket(
        self,
        origin: str | None = None,
        host: str = "localhost",
        tls: ssl.SSLContext | None = None,
        path: str = "socket",
        token: str | None = None,
        **options: Any,
    ) -> ClientConnection:
        """A page's socket, or another client's; ``host``: the server's name; ``token``: another than the page's."""
        address = f"{'ws' if tls is None else 'wss'}://{host}:{self.port}/{path}?token={self.token if token is None else token}"
        return connect(address, origin=origin, ssl=tls, sock=create_connection(("127.0.0.1", self.port)), **options)

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(10.0)
        assert not self._thread.is_alive()
        self._loop.close()


async def _forever() -> None:
    await asyncio.Event().wait()


@contextmanager
def served(hub: Hub, place: Place | None = None, work: Work = _forever, doors: Doors | None = None) -> Iterator[Served]:
    """A page that is served as long as the block lasts; ``work``: what fills it meanwhile; ``doors``: sockets of other ones."""
    found = Served(hub, place or Place(port=0), work, doors)
    try:
        yield found
    finally:
        found.close()


def first(socket: ClientConnection, kind: str) -> dict[str, Any]:
    """The next message of a kind."""
    while (message := json.loads(socket.recv(timeout=10.0)))["kind"] != kind:
        pass
    found: dict[str, Any] = message
    return found


def fresh(socket: ClientConnection) -> int:
    """The station's stamp now, as a page gets it in the answer to a heartbeat."""
    socket.send('{"beat": 1}')
    stamp: int = first(socket, "beat")["stamp"]
    return stamp
