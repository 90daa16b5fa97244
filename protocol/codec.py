"""Conversion between messages and bytes (msgpack).

A message that violates the schema, the size limits or its key raises ``ProtocolError``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn, TypeVar, cast

import msgpack
import msgspec

from radron.protocol.entries import Entry
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import parse_key
from radron.protocol.message import Message, StationMessage
from radron.protocol.messages import KINDS, AnyMessage, Status
from radron.protocol.revocations import Revoked

MAX_PAYLOAD_BYTES = 64 * 1024
MAX_ENTRY_BYTES = 2 * 1024  # of a log entry, which every agent keeps in memory until the mission ends
MAX_NEWS_BYTES = 4 * 1024  # of poses, plans, frames and estimates; a status with all its texts may have more, and ``Revoked``
MAX_COMMAND_BYTES = 8 * 1024  # of an operator's messages: tickets of 64 drones, and a certificate
_LIMITS = {
    "max_str_len": 1024,
    "max_bin_len": 1024,
    "max_array_len": 1024,
    "max_map_len": 128,
    "max_ext_len": 0,
}
M = TypeVar("M", bound=Message)
Read = Callable[[str, bytes], AnyMessage]  # as ``decode_from``
_WRITER = msgspec.msgpack.Encoder()
_READERS: dict[type[Message], msgspec.msgpack.Decoder[AnyMessage]] = {
    kind: msgspec.msgpack.Decoder(kind) for kind in KINDS.values()
}


def encode(message: Message) -> bytes:
    """Convert a message to bytes that :func:`decode` accepts.

    Raises:
        ProtocolError: the message breaks its own schema (NaN, out of range, too large, a NumPy scalar for a float).
    """
    payload, _ = written(message)
    return payload


def written(message: M) -> tuple[bytes, M]:
    """Return a message as bytes, and the message as its receivers will decode it. Raises the same errors as ``encode``."""
    reader = _READERS.get(type(message))
    if reader is None:
        raise ProtocolError(f"not a message: {type(message).__name__} is of no known kind")
    try:
        payload = _WRITER.encode(message)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ProtocolError(f"not serialisable: {str(error)[:120]}") from None
    _check_size(payload, _limit_of(type(message)))
    try:  # own messages have no duplicate field and no extension type, so that the fast reader suffices
        read = reader.decode(payload)
    except (msgspec.DecodeError, RecursionError, OverflowError) as error:
        raise ProtocolError(f"not a message: {str(error)[:200]}") from None
    _refuse_flaw(read)
    return payload, cast(M, read)


def as_bytes(message: Message) -> bytes:
    """Return the bytes of a message that has been received and decoded.

    The bytes equal the result of :func:`encode`, without its checks.
    """
    return _WRITER.encode(message)


def decode(payload: bytes) -> AnyMessage:
    """Convert received bytes of any kind of message to the message, with all checks of the schema.

    Unknown fields are ignored; missing required fields and duplicate fields are refused. Every number of the schema has bounds,
    which NaN and infinity violate, too.

    Raises:
        ProtocolError: for any error in the bytes.
    """
    _check_size(payload)
    try:
        document = msgpack.unpackb(payload, use_list=False, object_pairs_hook=_object, ext_hook=_refuse_extension, **_LIMITS)
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise ProtocolError(f"not msgpack within the limits: {type(error).__name__}: {str(error)[:120]}") from None
    message = _read(document)
    _check_size(payload, _limit_of(type(message)))
    return message


def decode_as(kind: type[M], payload: bytes) -> M:
    """Decode bytes that have been accepted as a message of this ``kind`` before, in a quarter of the time of :func:`decode`.

    The gain in time is lost if the sender has written the bytes differently from :func:`encode`, such as binary data as text.

    Raises:
        ProtocolError: the bytes are a message of another kind.
    """
    message = _fast(kind, payload) or decode(payload)
    if not isinstance(message, kind):
        raise ProtocolError(f"a {type(message).__name__.lower()} as a {kind.__name__.lower()}")
    return message


def decode_from(key: str, payload: bytes) -> AnyMessage:
    """Decode a received message, and check that its kind and its sender agree with the key under which it was published.

    Raises:
        ProtocolError: for any error in the key or the bytes, or if they contradict each other.
    """
    address = parse_key(key)
    message = _as_written(address.kind, payload) or decode(payload)
    kind = type(message).__name__.lower()
    if kind != address.kind:
        raise ProtocolError(f"a {kind} under the key of a {address.kind}")
    sender = message.station if isinstance(message, StationMessage) else message.drone
    if sender != address.sender:
        raise ProtocolError(f"a {kind} of {sender!r} under the key of {address.sender!r}")
    return message


def _as_written(kind: str, payload: bytes) -> AnyMessage | None:
    """Decode a message written by :func:`encode`, in a third of the time; None if :func:`decode` is needed.

    Bytes that :func:`encode` reproduces have no duplicate or unknown field, and no size beyond the schema's.
    """
    _check_size(payload, _limit_of(KINDS[kind]))
    message = _fast(KINDS[kind], payload)
    if message is None or _WRITER.encode(message) != payload:
        return None
    _refuse_flaw(message)
    return message


def _fast(kind: type[Message], payload: bytes) -> AnyMessage | None:
    """Decode by the fast reader; None if it fails. Its accepted bytes and refusals differ from :func:`decode`'s."""
    try:
        return _READERS[kind].decode(payload)
    except (msgspec.DecodeError, ValueError, RecursionError, OverflowError):  # ValueError: text that is not UTF-8
        return None


def _object(pairs: list[tuple[object, object]]) -> dict[object, object]:
    """Return a map with unique keys: two readers could take different values of a duplicate field."""
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a field is given twice")
    return fields


def _refuse_extension(code: int, data: bytes) -> NoReturn:
    raise ValueError(f"extension type {code}")


def size_limit(kind: str) -> int:
    """Return the maximum size of an encoded message of this kind, in bytes."""
    return _limit_of(KINDS[kind])


def _limit_of(kind: type[Message]) -> int:
    if issubclass(kind, Entry):
        return MAX_ENTRY_BYTES
    if issubclass(kind, StationMessage):
        return MAX_COMMAND_BYTES
    return MAX_PAYLOAD_BYTES if issubclass(kind, Status | Revoked) else MAX_NEWS_BYTES


def _check_size(payload: bytes, limit: int = MAX_PAYLOAD_BYTES) -> None:
    if len(payload) > limit:
        raise ProtocolError(f"payload of {len(payload)} bytes is over the limit of {limit}")


def _read(document: object) -> AnyMessage:
    kind = document.get("kind") if isinstance(document, dict) else None
    message_type = KINDS.get(kind) if isinstance(kind, str) else None
    if message_type is None:
        raise ProtocolError("not a message: no map with a known kind")
    try:  # converting to one type takes a tenth of the time of a union of all
        message: AnyMessage = msgspec.convert(document, message_type)
    except (msgspec.ValidationError, RecursionError, OverflowError) as error:
        raise ProtocolError(f"not a message: {str(error)[:200]}") from None
    _refuse_flaw(message)
    return message


def _refuse_flaw(message: AnyMessage) -> None:
    flaw = message.flaw()
    if flaw is not None:
        raise ProtocolError(f"not a message: {type(message).__name__.lower()}: {flaw}")
