"""msgpack <-> message. What does not fit the schema, the limits or the key ends in one ``ProtocolError``."""

from __future__ import annotations

from typing import NoReturn

import msgpack
import msgspec

from protocol.errors import ProtocolError
from protocol.keys import parse_key
from protocol.messages import KINDS, AnyMessage, Command, Message

MAX_PAYLOAD_BYTES = 64 * 1024
_LIMITS = {
    "max_str_len": 1024,
    "max_bin_len": 1024,
    "max_array_len": 1024,
    "max_map_len": 128,
    "max_ext_len": 0,
}
_WRITER = msgspec.msgpack.Encoder()
_READERS: dict[type[Message], msgspec.msgpack.Decoder[AnyMessage]] = {
    kind: msgspec.msgpack.Decoder(kind) for kind in KINDS.values()
}


def encode(message: Message) -> bytes:
    """Serialise a message; the result is accepted by :func:`decode`.

    Raises:
        ProtocolError: the message breaks its own schema (NaN, out of range, too large, a NumPy scalar for a float).
    """
    reader = _READERS.get(type(message))
    if reader is None:
        raise ProtocolError(f"not a message: {type(message).__name__} is of no known kind")
    try:
        payload = _WRITER.encode(message)
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ProtocolError(f"not serialisable: {str(error)[:120]}") from None
    _check_size(payload)
    try:  # what one wrote oneself has no field twice and no extension, so that the quick reader serves
        written = reader.decode(payload)
    except (msgspec.DecodeError, RecursionError, OverflowError) as error:
        raise ProtocolError(f"not a message: {str(error)[:200]}") from None
    _refuse_flaw(written)
    return payload


def decode(payload: bytes) -> AnyMessage:
    """Read any message. Unknown fields are ignored; missing required ones and fields given twice are refused.

    Every number of the schema has bounds, which NaN and infinity fail too.

    Raises:
        ProtocolError: whatever is wrong with the bytes.
    """
    _check_size(payload)
    try:
        document = msgpack.unpackb(payload, use_list=False, object_pairs_hook=_object, ext_hook=_refuse_extension, **_LIMITS)
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise ProtocolError(f"not msgpack within the limits: {type(error).__name__}: {str(error)[:120]}") from None
    return _read(document)


def decode_from(key: str, payload: bytes) -> AnyMessage:
    """Read a message that came in under a key, and hold it against what the key says (kind and sender)."""
    address = parse_key(key)
    message = _as_written(address.kind, payload) or decode(payload)
    kind = type(message).__name__.lower()
    if kind != address.kind:
        raise ProtocolError(f"a {kind} under the key of a {address.kind}")
    sender = message.station if isinstance(message, Command) else message.drone
    if sender != address.sender:
        raise ProtocolError(f"a {kind} of {sender!r} under the key of {address.sender!r}")
    return message


def _as_written(kind: str, payload: bytes) -> AnyMessage | None:
    """A message that :func:`encode` wrote, read in a third of the time; None where only :func:`decode` can tell what it is.

    Bytes that would be written again just so have no field twice, nothing unknown, and no size beyond the schema's.
    """
    _check_size(payload)
    try:
        message = _READERS[KINDS[kind]].decode(payload)
    except (msgspec.DecodeError, ValueError, RecursionError, OverflowError):  # ValueError: text that is not UTF-8
        return None
    if _WRITER.encode(message) != payload:
        return None
    _refuse_flaw(message)
    return message


def _object(pairs: list[tuple[object, object]]) -> dict[object, object]:
    """A map whose keys differ: of a field given twice, two readers could take different ones."""
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a field is given twice")
    return fields


def _refuse_extension(code: int, data: bytes) -> NoReturn:
    raise ValueError(f"extension type {code}")


def _check_size(payload: bytes) -> None:
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise ProtocolError(f"payload of {len(payload)} bytes is over the limit of {MAX_PAYLOAD_BYTES}")


def _read(document: object) -> AnyMessage:
    kind = document.get("kind") if isinstance(document, dict) else None
    message_type = KINDS.get(kind) if isinstance(kind, str) else None
    if message_type is None:
        raise ProtocolError("not a message: no map with a known kind")
    try:  # converting to one type takes a tenth of the time that a union of all would
        message: AnyMessage = msgspec.convert(document, message_type)
    except (msgspec.ValidationError, RecursionError, OverflowError) as error:
        raise ProtocolError(f"not a message: {str(error)[:200]}") from None
    _refuse_flaw(message)
    return message


def _refuse_flaw(message: AnyMessage) -> None:
    flaw = message.flaw()
    if flaw is not None:
        raise ProtocolError(f"not a message: {type(message).__name__.lower()}: {flaw}")
