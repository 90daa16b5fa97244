"""Zenoh key expressions: ``radron/2/{swarm}/{drone}/{kind}``, and of operators ``radron/2/{swarm}/station/{name}/{kind}``.

The number is the version of the protocol: drones of different versions do not read each other's messages. Liveliness tokens
have the same key layout in every version, so that drones of another version can be reported.
"""

from __future__ import annotations

import re
from functools import lru_cache

from radron.protocol.errors import ProtocolError
from radron.protocol.message import DroneMessage, Message, StationMessage
from radron.protocol.messages import DRONE_KINDS, STATION_KINDS
from radron.protocol.units import IDENTIFIER, STATION
from radron.protocol.versions import PROTOCOL

ROOT = f"radron/{PROTOCOL}"
_IDENTIFIER = re.compile(IDENTIFIER)


class Key(str):
    """A valid key (Zenoh's name of a data stream) split into its parts: swarm, sender and kind of message."""

    swarm: str
    sender: str  # a drone's id or a station's name
    kind: str


def drone_key(swarm: str, drone: str, kind: str) -> str:
    """Return the key under which a drone publishes messages of one ``kind``.

    ``alive`` is the key of the drone's liveliness token (Zenoh's sign that a program is connected), and ``log`` the key at which
    its log can be queried.

    Raises:
        ProtocolError: an unknown kind, or an invalid name.
    """
    if kind not in DRONE_KINDS and kind not in ("alive", "log"):
        raise ProtocolError(f"unknown message kind {kind!r}; known: {', '.join(DRONE_KINDS)}, alive, log")
    if drone == STATION:
        raise ProtocolError(f"a drone cannot be called {STATION!r}: the name is taken for operators")
    return f"{ROOT}/{_identifier(swarm, 'swarm')}/{_identifier(drone, 'drone')}/{kind}"


def log_query_key(swarm: str, drone: str, asker: str) -> str:
    """Return the key under which ``asker`` queries a drone's log.

    The asker's certificate permits queries under this key only. ``asker`` is a drone's id, or "station" for any operator.
    """
    return f"{drone_key(swarm, drone, 'log')}/{_identifier(asker, 'asker')}"


def command_key(swarm: str, station: str) -> str:
    """Return the key under which an operator's station publishes commands."""
    return station_key(swarm, station, "command")


def station_key(swarm: str, station: str, kind: str) -> str:
    """Return the key under which an operator's station publishes messages of one ``kind``.

    ``mission`` is the key at which drones query the parts of an uploaded mission.

    Raises:
        ProtocolError: an unknown kind, or an invalid name.
    """
    if kind not in STATION_KINDS and kind != "mission":
        raise ProtocolError(f"unknown message kind {kind!r}; known: {', '.join(STATION_KINDS)}, mission")
    return f"{ROOT}/{_identifier(swarm, 'swarm')}/{STATION}/{_identifier(station, 'station')}/{kind}"


def key_of(swarm: str, message: Message) -> str:
    """Return the key under which a message must be published, from its kind and sender."""
    kind = type(message).__name__.lower()
    if isinstance(message, StationMessage):
        return station_key(swarm, message.station, kind)
    if isinstance(message, DroneMessage):
        return drone_key(swarm, message.drone, kind)
    raise ProtocolError(f"{type(message).__name__} has no key")


def token_keys(swarm: str) -> str:
    """Return the key expression that matches the liveliness tokens of all drones of a swarm.

    A token is Zenoh's sign that a program is connected. Tokens of all versions of the protocol match.
    """
    return f"radron/*/{_identifier(swarm, 'swarm')}/*/alive"


def read_token(key: str) -> tuple[str, str]:
    """Return the drone's id and the protocol version from the key of a liveliness token; "" for a version that is no number."""
    _, version, _, drone, _ = key.split("/")
    return drone, version if version.isdecimal() and len(version) < 4 else ""


def parse_key(key: str) -> Key:
    """Split the key of a message into its parts. A :class:`Key` is returned unchanged.

    Raises:
        ProtocolError: another version, another layout, an unknown kind or a name that is no identifier.
    """
    return key if isinstance(key, Key) else _parsed(key)


@lru_cache(maxsize=1024)  # a swarm has a few dozen keys; refusals are not kept
def _parsed(key: str) -> Key:
    parts = key.split("/")
    if parts[:2] != ROOT.split("/"):
        raise ProtocolError(f"key {key[:80]!r} does not start with {ROOT}/")
    if len(parts) == 6 and parts[3] == STATION and parts[5] in STATION_KINDS:
        swarm, sender, kind = parts[2], parts[4], parts[5]
    elif len(parts) == 5 and parts[3] != STATION and parts[4] in DRONE_KINDS:
        swarm, sender, kind = parts[2], parts[3], parts[4]
    else:
        raise ProtocolError(f"key {key[:80]!r} is not the key of a message")
    read = Key(key)
    read.swarm, read.sender, read.kind = _identifier(swarm, "swarm"), _identifier(sender, "sender"), kind
    return read


def _identifier(name: str, what: str) -> str:
    if not _IDENTIFIER.match(name):
        raise ProtocolError(f"{what} {name[:40]!r} is not an identifier: use up to 32 of a-z, 0-9 and '-'")
    return name
