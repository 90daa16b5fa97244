"""Settings, opening and closing of a Zenoh session, with errors that name the remedy."""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import errno
import ipaddress
import json
import os
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

import zenoh
from msgspec import Struct
from zenoh.handlers import Callback

from radron.protocol.errors import MeshError
from radron.protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, Identity

T = TypeVar("T")

OPEN_S = 5.0  # a session opens in 0.5 s at most, reachable peers or not
LOOKUP_S = 1.5
MAX_PORT = 65535
LINK_CLOSE_S = 2.0  # closing takes 0.8 s while a stopped peer is dialled; twice as long on a busy machine
_ENDPOINT = re.compile(r"(?P<protocol>tcp|tls)/(?P<host>[^\s/?#]+):(?P<port>\d{1,5})\Z")
_RUNTIME = "(rx: (worker_threads: 16))"  # the default is two: vanished peers then stall the reception from others for 10 s

# Each value was chosen by partition tests. One-way dialling and "greater-zid" keep two peers from opening two half sessions.
# "open/return_conditions/connect_scouted" stays on: without it a session opens 0.5 s sooner, but 15 of 80 peers that had stopped
# for one or two seconds came back with a link and without declarations: they neither receive nor reach others any more.
_SETTINGS: dict[str, object] = {
    "mode": "peer",
    "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
    "transport/link/tx/lease": 1000,  # ms after which a silent peer is gone
    "transport/link/tx/keep_alive": 4,
    "transport/link/tx/queue/size/data_high": 16,  # batches of 64 KiB for each peer, at the priority of log entries
    "transport/unicast/open_timeout": 750,  # ms, two round trips; closing waits for it while a stopped peer is dialled
    "transport/unicast/accept_timeout": 750,
    "transport/link/rx/max_message_size": 1 << 20,  # bytes; ours are smaller, and a peer chooses the memory for its message
    "transport/shared_memory/enabled": False,  # drones share no memory, and a killed process leaves its segments behind
    "queries_default_timeout": 1000,
}


class MeshConfig(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Addresses and members with which a network session (Zenoh) is opened.

    Addresses are in Zenoh's notation, such as ``tls/10.7.1.11:7447``: ``listen`` for incoming links, ``connect`` for peers to be
    dialled. Of two drones only one may dial the other (by convention the drone with the higher index). ``drones``: the drones of
    the swarm; with an identity, each of them can publish under its own name only. ``others``: names of further members that may
    join.
    """

    listen: str | None = None  # None: dial only (operators)
    connect: tuple[str, ...] = ()
    multicast: bool = False  # also find peers by multicast
    gossip: bool = True  # also dial peers that another peer announces; False: only the endpoints above
    identity: Identity | None = None  # None: plain TCP, open to everybody (endpoints ``tcp/...``)
    drones: tuple[str, ...] | None = None  # None: not known
    others: tuple[str, ...] | None = None  # None: every holder of a certificate of the swarm
    revoked: frozenset[str] = frozenset()  # members revoked in flight, besides the identity's own list


async def open_session(
    config: MeshConfig,
    dial_all: bool,
    access: dict[str, object] | None = None,
    limits: list[dict[str, object]] | None = None,
    refused: frozenset[str] = frozenset(),
) -> zenoh.Session:
    """Open a Zenoh session. An unreachable peer is no error: Zenoh dials it until it answers.

    Args:
        config: endpoints; host names are resolved here, once (Zenoh would resolve them at each attempt, and block meanwhile).
        dial_all: also dial every peer announced by another peer: for a session that does not listen.
        access: Zenoh's access control, by the name in a peer's certificate; None: peers may send everything.
        limits: Zenoh's limits of the peers' message rates; None: no limits.
        refused: names in certificates; a link to such a member is closed at once. (Zenoh knows no revocation lists.)

    Raises:
        MeshError: a malformed endpoint, an unknown name, a port in use, no session within ``OPEN_S``.
    """
    settings = zenoh.Config()
    plain: dict[str, object] = {"transport/link/protocols": ["tcp"]}
    secured = plain if config.identity is None else _secured(config.identity)
    if access is not None:
        secured["access_control"] = access
    if limits is not None:
        secured["downsampling"] = limits
    for path, value in {**_SETTINGS, **secured, **await _settings_of(config, dial_all)}.items():
        settings.insert_json5(path, json.dumps(value))
    os.environ.setdefault("ZENOH_RUNTIME", _RUNTIME)  # read when the first session opens
    opening = in_thread(lambda: _open(settings, refused))
    try:
        async with asyncio.timeout(OPEN_S):  # wait_for of Python 3.11 can swallow a cancellation
            return await asyncio.shield(opening)
    except asyncio.CancelledError:
        with contextlib.suppress(zenoh.ZError):
            await close_session(await opening)  # a Zenoh thread that outlives the interpreter aborts the process
        raise
    except TimeoutError:
        raise MeshError(f"mesh: the Zenoh session does not open within {OPEN_S:g} s; check that the network is up") from None
    except zenoh.ZError as error:
        raise MeshError(_explain(str(error), config)) from None


def _secured(identity: Identity) -> dict[str, object]:
    """Return the settings for TLS in both directions.

    A peer's rights follow from the name in its certificate, so the certificate names no address, and none is compared. A link
    outlives its certificates: an expiry closes no link in flight.
    """
    certificate, key = str(identity.folder / CERTIFICATE_FILE), str(identity.folder / KEY_FILE)
    tls = {
        "root_ca_certificate": str(identity.folder / AUTHORITY_FILE),
        "enable_mtls": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
        "verify_name_on_connect": False,
        "close_link_on_expiration": False,
    }
    return {"transport/link/protocols": ["tls"], "transport/link/tls": tls}


def _open(settings: zenoh.Config, refused: frozenset[str]) -> zenoh.Session:
    def take(event: zenoh.LinkEvent) -> None:
        for link in _sockets((event.link,)):
            if event.link.auth_identifier in refused:
                with contextlib.suppress(OSError):  # closed by the peer meanwhile
                    link.shutdown(socket.SHUT_RDWR)
            _do_not_linger(link)

    session = zenoh.open(settings)
    session.info.declare_link_events_listener(Callback(take, indirect=False), history=True)
    return session


def in_thread(work: Callable[[], T]) -> asyncio.Future[T]:
    """Run a blocking call in a separate daemon thread, and return a future for its result."""
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
    """Close a Zenoh session in at most ``LINK_CLOSE_S`` seconds, whether or not its peers respond.

    A slower closing continues in its thread; a process that ends before this thread may abort.
    """
    with contextlib.suppress(TimeoutError, zenoh.ZError):
        for link in _sockets(session.info.links()):  # also links newer than the listener's last event
            _do_not_linger(link)
        async with asyncio.timeout(LINK_CLOSE_S):
            await in_thread(session.close)


def _do_not_linger(link: socket.socket) -> None:
    """Let the kernel send remaining data in the background when a link is closed.

    Zenoh gives its sockets a linger time of 10 s. For this time a link to a peer that has stopped reading would block close().
    When Zenoh gives such a peer up, the link would also block a receive thread with all its queued messages.
    """
    with contextlib.suppress(OSError):  # closed meanwhile
        link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 0, 0))


def _sockets(links: Iterable[zenoh.Link]) -> Iterator[socket.socket]:
    """Yield the sockets of this process's links; Zenoh remains their owner."""
    ends = {(link.src.partition("/")[2], link.dst.partition("/")[2]) for link in links}
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):  # not a socket, not connected, or closed meanwhile
            link = socket.socket(fileno=int(name))
            try:
                if link.family in (socket.AF_INET, socket.AF_INET6) and _ends(link) in ends:
                    yield link
            finally:
                link.detach()


def _ends(link: socket.socket) -> tuple[str, str]:
    return _host_port(link.getsockname()), _host_port(link.getpeername())


def _host_port(address: tuple[str, int]) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


async def _settings_of(config: MeshConfig, dial_all: bool) -> dict[str, object]:
    names = [("mesh.listen", config.listen)] if config.listen is not None else []
    protocol = "tcp" if config.identity is None else "tls"
    given = [*names, *(("mesh.connect", peer) for peer in config.connect)]
    numbers = await asyncio.gather(*(_numeric(*item, protocol) for item in given))
    listen = list(numbers[: len(names)])
    return {
        "listen/endpoints": listen,
        "connect/endpoints": list(numbers[len(names) :]),
        "scouting/multicast/enabled": config.multicast,
        "scouting/gossip/enabled": config.gossip,
        "scouting/gossip/autoconnect_strategy": "always" if dial_all else "greater-zid",
    }


async def _numeric(where: str, endpoint: str, protocol: str) -> str:
    """Return the endpoint with a numeric host. Raises MeshError."""
    match = _ENDPOINT.match(endpoint)
    if match is None or not 0 < int(match["port"]) <= MAX_PORT:
        expected = f"expected {protocol}/HOST:PORT, such as {protocol}/10.7.1.11:7447"
        raise MeshError(f"{where}: {endpoint!r} is not an endpoint; {expected}")
    if match["protocol"] != protocol:
        why = (
            "links are encrypted unless insecure = true"
            if protocol == "tls"
            else "without a certificate, links are not encrypted"
        )
        raise MeshError(f"{where}: {endpoint!r}: {why}; write {protocol}/{endpoint[4:]}")
    host, port = match["host"].strip("[]"), int(match["port"])
    address = await _address(f"{where}: {endpoint!r}", host, port)
    if address.is_unspecified:
        raise MeshError(f"{where}: {endpoint!r} is not the address of one interface; give one that peers can dial")
    return f"{protocol}/{_host_port((str(address), port))}"


async def _address(where: str, host: str, port: int) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Resolve a host. A numeric host needs no look-up, and so no thread, which a busy machine may start late."""
    try:
        return ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        pass
    try:
        async with asyncio.timeout(LOOKUP_S):
            found = await in_thread(lambda: socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))
    except TimeoutError:
        raise MeshError(f"{where}: resolving {host!r} takes too long; give a numeric address") from None
    except (OSError, UnicodeError):
        raise MeshError(f"{where}: the host {host!r} is unknown; give a numeric address") from None
    return ipaddress.ip_address(str(found[0][4][0]).partition("%")[0])


def _explain(text: str, config: MeshConfig) -> str:
    """Return Zenoh's error in one line."""
    reason = re.search(r"([A-Z][a-z ]+) \(os error (\d+)\)", text)
    if reason is not None and config.listen is not None and int(reason[2]) == errno.EADDRNOTAVAIL:
        return (
            f"mesh.listen: {config.listen!r} is not an address of this computer (`ip address` shows them): "
            "correct this drone's entry in mesh.endpoints, or its id"
        )
    if reason is not None and config.listen is not None:
        return f"mesh.listen: cannot listen at {config.listen!r}: {reason[1].lower()}; is another agent running on this port?"
    return f"mesh: {text.partition(' at /')[0].splitlines()[0][:160]}"
