"""Messages of version 1 of the protocol, in old records, for reading a record without a replay."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from protocol.codec import decode_from
from protocol.errors import ProtocolError
from protocol.keys import ROOT, parse_key
from protocol.message import Message
from protocol.messages import Action, AnyMessage, Source
from protocol.units import DroneId, Identifier, MissionId

FORMER = 1  # version of the protocol
_FORMER_ROOT = f"radron/{FORMER}/"


class FormerCommand(Message, frozen=True, kw_only=True, tag="command"):
    """An operator's command, unsigned; an empty ``drones`` addresses the whole swarm."""

    station: Identifier
    mission: MissionId
    action: Action
    drones: Annotated[tuple[DroneId, ...], Meta(max_length=64)] = ()


def read_message(key: str, payload: bytes) -> AnyMessage | FormerCommand:
    """A message in a record, of this version of the protocol or the former one, as it would be today.

    Raises:
        ProtocolError: no valid message.
    """
    if key.startswith(_FORMER_ROOT) and parse_key(_todays(key)).kind == "command":
        try:
            return msgspec.msgpack.decode(payload, type=FormerCommand)
        except (msgspec.DecodeError, ValueError) as error:
            raise _refusal(error) from None
    return decode_from(*as_today(key, payload))


def as_today(key: str, payload: bytes) -> tuple[str, bytes]:
    """Key and payload as of this version of the protocol. The bytes of log entries and digests are unchanged; commands, which had
    neither nonce nor signature, have no counterpart in this version.

    Raises:
        ProtocolError: no valid message.
    """
    if not key.startswith(_FORMER_ROOT):
        return key, payload
    try:
        return _todays(key), _with_sources(payload) if key.endswith("/estimate") else payload
    except (msgspec.DecodeError, ValueError, TypeError) as error:
        raise _refusal(error) from None


def _todays(key: str) -> str:
    return f"{ROOT}/{key.removeprefix(_FORMER_ROOT)}"


def _refusal(error: Exception) -> ProtocolError:
    return ProtocolError(f"not a message of version {FORMER} of the protocol: {str(error)[:120]}")


def _with_sources(payload: bytes) -> bytes:
    """An estimate, which had one source among its own fields."""
    fields = msgspec.msgpack.decode(payload, type=dict[str, object])
    source = {name: fields.pop(name) for name in Source.__struct_fields__ if name in fields}
    return msgspec.msgpack.encode(fields | {"sources": [source]})
