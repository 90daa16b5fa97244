"""How a swarm uses Zenoh: the settings of a session, its opening, and errors that say what to do."""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import ipaddress
import json
import os
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from typing import TypeVar

import zenoh
from msgspec import Struct
from zenoh.handlers import Callback

from protocol.errors import MeshError

T = TypeVar("T")

OPEN_S = 5.0  # a session opens in 0.5 s at most, reachable peers or not
LOOKUP_S = 1.5
CLOSE_S = 2.0  # 0.8 s when a peer is dialled that is stopped; twice that on a busy machine
_ENDPOINT = re.compile(r"tcp/(?P<host>[^\s/?#]+):(?P<port>\d{1,5})\Z")
_RUNTIME = "(rx: (worker_threads: 16))"  # with Zenoh's two, vanished peers stall the reception from healthy ones for 10 s

# Each was chosen by partition tests. One-way dialling and "greater-zid" keep two peers from opening two half sessions.
_SETTINGS: dict[str, object] = {
    "mode": "peer",
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
    "transport/link/tx/lease": 1000,  # ms after which a silent peer is gone
    "transport/link/tx/keep_alive": 4,
    "transport/link/tx/queue/size/data_high": 16,  # of 64 KiB for each peer, at the priority of log entries
    "transport/unicast/open_timeout": 750,  # ms, two round trips; closing waits for it while a peer is dialled that is stopped
    "transport/unicast/accept_timeout": 750,
    "transport/shared_memory/enabled": False,  # drones share none, and a killed process leaves its segments behind
    "queries_default_timeout": 1000,
}


class MeshConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a session listens and which peers it dials, as Zenoh endpoints: ``tcp/10.7.1.11:7447``.

    Of two drones only one may dial the other (by convention the one of the higher index).
    """

    listen: str | None = None  # none: dial only (operators)
    connect: tuple[str, ...] = ()
    multicast: bool = False  # find peers by multicast, too


async def open_session(config: MeshConfig, dial_all: bool) -> zenoh.Session:
    """Open a Zenoh session. A peer that cannot be reached is no error: it is dialled again until it answers.

    Args:
        config: endpoints; names among them are looked up here, once (Zenoh would again at each try, and stand still meanwhile).
        dial_all: dial also every peer that is heard of through another: for a session that does not listen.

    Raises:
        MeshError: a malformed endpoint, an unknown name, a port in use.
    """
    settings = zenoh.Config()
    for path, value in {**_SETTINGS, **await _settings_of(config, dial_all)}.items():
        settings.insert_json5(path, json.dumps(value))
    os.environ.setdefault("ZENOH_RUNTIME", _RUNTIME)  # read when the first session opens
    opening = in_thread(lambda: _open(settings))
    try:
        return await asyncio.wait_for(asyncio.shield(opening), OPEN_S)
    except asyncio.CancelledError:
        with contextlib.suppress(zenoh.ZError):
            await close_session(await opening)  # a thread of Zenoh that outlives the interpreter aborts the process
        raise
    except TimeoutError:
        raise MeshError(f"mesh: the Zenoh session does not open within {OPEN_S:g} s; see whether the network is up") from None
    except zenoh.ZError as error:
        raise MeshError(_explain(str(error), config)) from None


def _open(settings: zenoh.Config) -> zenoh.Session:
    session = zenoh.open(settings)
    session.info.declare_link_events_listener(Callback(_on_link, indirect=False), history=True)
    return session


def in_thread(work: Callable[[], T]) -> asyncio.Future[T]:
    """The result of a blocking call, made in a thread of its own that does not keep the process from ending."""
    outcome: concurrent.futures.Future[T] = concurrent.futures.Future()
    outcome.set_running_or_notify_cancel()

    def run() -> None:
        try:
            outcome.set_result(work())
        except Exception as error:
            outcome.set_exception(error)

    threading.Thread(target=run, name="mesh", daemon=True).start()
    return asyncio.wrap_future(outcome)


async def close_session(session: zenoh.Session) -> None:
    """Close a Zenoh session, within ``CLOSE_S`` whatever its peers do.

    What takes longer is left to a thread; a process that ends before that thread does may abort instead.
    """
    with contextlib.suppress(TimeoutError, zenoh.ZError):
        _do_not_linger(session.info.links())  # those that are younger than what the listener has seen
        await asyncio.wait_for(in_thread(session.close), CLOSE_S)


def _on_link(event: zenoh.LinkEvent) -> None:
    _do_not_linger((event.link,))


def _do_not_linger(links: Iterable[zenoh.Link]) -> None:
    """Let the kernel deliver in the background what is still to be sent when a link is closed.

    Zenoh gives its sockets a linger time of 10 s: for so long a link to a peer that stopped reading would hold up close(), and,
    when such a peer is given up, a receive thread with whatever waits there for its turn.
    """
    ends = {(link.src.partition("/")[2], link.dst.partition("/")[2]) for link in links}
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # no socket, not connected, closed meanwhile
            link = socket.socket(fileno=int(name))
            try:
                if link.family in (socket.AF_INET, socket.AF_INET6) and _ends(link) in ends:
                    link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))
            finally:
                link.detach()


def _ends(link: socket.socket) -> tuple[str, str]:
    return _host_port(link.getsockname()), _host_port(link.getpeername())


def _host_port(address: tuple[str, int]) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


async def _settings_of(config: MeshConfig, dial_all: bool) -> dict[str, object]:
    names = [("mesh.listen", config.listen)] if config.listen is not None else []
    numbers = await asyncio.gather(*(_numeric(*item) for item in [*names, *(("mesh.connect", peer) for peer in config.connect)]))
    listen = list(numbers[: len(names)])
    return {
        "listen/endpoints": listen,
        "connect/endpoints": list(numbers[len(names) :]),
        "scouting/multicast/enabled": config.multicast,
        "scouting/gossip/autoconnect_strategy": "always" if dial_all else "greater-zid",
    }


async def _numeric(where: str, endpoint: str) -> str:
    """The endpoint with its host as a number."""
    match = _ENDPOINT.match(endpoint)
    if match is None or int(match["port"]) > 65535:
        raise MeshError(f"{where}: {endpoint!r} is no endpoint; expected tcp/HOST:PORT, such as tcp/10.7.1.11:7447")
    host, port = match["host"].strip("[]"), int(match["port"])
    try:
        found = await asyncio.wait_for(in_thread(lambda: socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)), LOOKUP_S)
    except TimeoutError:
        raise MeshError(f"{where}: {endpoint!r}: looking up {host!r} takes too long; give its address as a number") from None
    except (OSError, UnicodeError):
        raise MeshError(f"{where}: {endpoint!r}: the host {host!r} is unknown; give its address as a number") from None
    address = ipaddress.ip_address(str(found[0][4][0]).partition("%")[0])
    if address.is_unspecified:
        raise MeshError(f"{where}: {endpoint!r} is no address of one interface; peers must be able to dial it: name one")
    return f"tcp/{_host_port((str(address), port))}"


def _explain(text: str, config: MeshConfig) -> str:
    """One line of Zenoh's error."""
    reason = re.search(r"([A-Z][a-z ]+) \(os error \d+\)", text)
    if reason is not None and config.listen is not None:
        return f"mesh.listen: {config.listen!r} cannot be listened at: {reason[1].lower()}; is another agent running there?"
    return f"mesh: {text.partition(' at /')[0].splitlines()[0][:160]}"
