"""Audit of a flight's record: the commands and revocations in it, their senders, and their outcomes.

A command is in the record as it arrived, with its certificate, and the pilot's decision follows it. Nothing is judged anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import msgspec

from radron.agent.errors import FlightRecordError
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedCall, RecordedFlight
from radron.agent.mission.commanding import Verdict
from radron.protocol.codec import decode_from
from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Authority, Peer, utc
from radron.protocol.keys import Key, parse_key
from radron.protocol.messages import STATION_KINDS, Action, AnyMessage, AnyOrder, Command, Order, Upload
from radron.protocol.revocations import Revocation, Revoked
from radron.protocol.signing import Member

UNTOLD = "the record does not say what became of it (it lists a bounded number of refused commands a second)"
_TAKEN = "taken over"  # an upload, unless the agent could not keep it
_SERIAL_DIGITS = 16  # as `radron-deploy pki show` prints them
_WORDS = {
    "of_another_mission": "it is for another mission",
    "with_revoked_certificate": "its certificate has been revoked",
    "forged": "its signature is not valid: it was altered, or forged",
    "with_expired_certificate": "its certificate was not valid at that time",
    "already_obeyed": "replayed: it has been carried out before, or a later one has",
    "without_the_right": "its certificate does not carry the right to revoke others",
    "void": "it was valid until an earlier time only",
}


@dataclass(slots=True)
class Audited:
    """A command found in a flight's record, with its copies and its outcome.

    ``first_ns``, ``last_ns``: when the copies arrived, by the drone's clock, UTC; ``station``: the name of the sender that the
    message states; ``signer``: its certificate as text. ``signer``, ``action`` and ``drones`` are empty if the message could not
    be read, or was one of a flood.
    """

    first_ns: int
    last_ns: int
    station: str
    signer: str
    action: str
    drones: tuple[str, ...]
    result: str
    copies: int = 1


def mission_of(flight: RecordedFlight) -> str:
    """Return a line of text that names the mission of a flight, and the operator who uploaded it."""
    header = flight.header
    text, origin = f"mission {header.mission.mission_id} ({header.mission.name})", header.origin
    if origin is None:
        return f"{text}, from its mission file"
    at = f"{utc(origin.taken_ns):%Y-%m-%d %H:%M:%S} UTC"
    return f"{text}, uploaded {at} by {origin.station}, {told(_Reader(flight).signer(origin.certificate))}"


def audit(flight: RecordedFlight, progress: Callable[[float], None] | None = None) -> list[Audited]:
    """Return the commands in a flight's record in the order of their arrival. Copies with equal outcome are one entry.

    Args:
        flight: its record; see there for possible gaps.
        progress: called regularly with the share done, 0 to 1.

    Raises:
        FlightRecordError: its content cannot be read.
    """
    reader = _Reader(flight)
    found: dict[tuple[object, ...], Audited] = {}
    taken: Audited | None = None  # the upload that the agent is taking over
    for count, call in enumerate(flight.calls()):
        if call.record.topic == topics.DECLINE and taken is not None:
            taken.result, taken = f"not taken over: {reader.reason(call.record.data)}", None
        for key, audited in reader.read(call) if call.record.topic == topics.MESSAGE else ():
            known = found.setdefault(key, audited)
            taken = known if audited.result == _TAKEN else taken
            if known is not audited:
                known.last_ns, known.copies = audited.last_ns, known.copies + 1
        if progress is not None and count % 500 == 0:
            progress(flight.read_bytes / max(1, flight.size_bytes))
    return list(found.values())


class _Reader:
    """From the record of a message to the command or the revocations in it."""

    def __init__(self, flight: RecordedFlight) -> None:
        self._file, header = flight.files[0], flight.header
        self._drone, self._mission, self._swarm = header.drone.id, header.mission.mission_id, header.mission.swarm
        try:
            self._authority = Authority.read(header.authority.encode()) if header.authority else None
        except ProtocolError as error:
            raise FlightRecordError(f"{self._file}: the certificate of the authority in the record {error}") from None

    def read(self, call: RecordedCall) -> Iterator[tuple[tuple[object, ...], Audited]]:
        """The command to this drone, or revocations that it did not know; and what each has in common with its copies."""
        key, payload = self._message(call.record.data)
        if key is not None and key.kind in ("revocation", "revoked"):
            yield from self._revocations(key, payload, call)
        elif key is not None and key.kind in STATION_KINDS:
            found = self._order(key, payload, call)
            if found is not None:
                yield found

    def _revocations(self, key: Key, payload: bytes, call: RecordedCall) -> Iterator[tuple[tuple[object, ...], Audited]]:
        verdict, at_ns = self._verdict(call.results), call.record.log_ns
        message = _decoded(key, payload)
        if verdict is None or not isinstance(message, Revocation | Revoked):
            return
        for one in message.held if isinstance(message, Revoked) else (message,):
            signer = self.signer(one.certificate)
            result = _result(verdict, one, signer)
            audited = Audited(at_ns, at_ns, one.station, told(signer), "revoke", (one.member,), result)
            yield (one.signature, one.station, one.member, result), audited

    def _order(self, key: Key, payload: bytes, call: RecordedCall) -> tuple[tuple[object, ...], Audited] | None:
        at_ns = call.record.log_ns
        command = _decoded(key, payload)
        if not isinstance(command, Order):
            result = "refused: it cannot be read, or is not of the station under whose name it came"
            return (key, result), Audited(at_ns, at_ns, key.sender, "", "", (), result)
        verdict = self._verdict(call.results)
        is_ours = self._drone in command.to or (isinstance(command, Command) and command.mission != self._mission)
        if verdict is None and key.swarm == self._swarm and not is_ours:
            return None
        if verdict is None and key.swarm == self._swarm:
            result = _without_verdict(call)
            return (key, result), Audited(at_ns, at_ns, key.sender, "", "", (), result)  # of a flood, one line for all of a name
        signer, drones = self.signer(command.certificate), tuple(sorted(command.to))
        result = "refused: it is for another swarm" if verdict is None else _result(verdict, command, signer)
        action = _action(command)
        audited = Audited(at_ns, at_ns, command.station, told(signer), action, drones, result)
        return (key, command.certificate, command.stamp_ns, action, drones, result), audited

    def _message(self, data: bytes) -> tuple[Key | None, bytes]:
        """Key and payload of a message; no key for a foreign one."""
        try:
            text, payload = topics.decode_message(data)
            if not isinstance(text, str) or not isinstance(payload, bytes):
                raise TypeError("not a key with a payload")
        except (ValueError, TypeError) as error:
            raise FlightRecordError(f"{self._file}: a record of {topics.MESSAGE} cannot be read: {error}") from None
        try:
            return parse_key(text), payload
        except ProtocolError:
            return None, payload

    def reason(self, data: bytes) -> str:
        """Why an upload was declined."""
        try:
            return msgspec.json.decode(data, type=str)
        except (msgspec.MsgspecError, ValueError) as error:  # ValueError: text that is not UTF-8
            raise FlightRecordError(f"{self._file}: a record of {topics.DECLINE} cannot be read: {error}") from None

    def _verdict(self, results: Iterable[tuple[str, bytes]]) -> Verdict | None:
        """The recorded verdict among the results of a call."""
        for topic, data in results:
            if topic == topics.VERDICT:
                try:
                    return msgspec.json.decode(data, type=Verdict)
                except (msgspec.MsgspecError, ValueError) as error:
                    raise FlightRecordError(f"{self._file}: a record of {topics.VERDICT} cannot be read: {error}") from None
        return None

    def signer(self, certificate: bytes) -> Peer | str:
        """Return the holder of a certificate, or the reason without one."""
        if not certificate:
            return "unsigned"
        if self._authority is None:
            return "not verified"  # the swarm has no certificates
        try:
            return self._authority.verify(certificate)
        except ProtocolError as error:
            return f"certificate {error}"


def _without_verdict(call: RecordedCall) -> str:
    """Why the record has no verdict on a command to this drone."""
    if any(topic == topics.ERROR for topic, _ in call.results):
        return "the agent failed over it"
    return "the record ends here" if call.is_last else UNTOLD


def _result(verdict: Verdict, command: AnyOrder | Revocation, signer: Peer | str) -> str:
    if not verdict.refused:
        return _TAKEN if isinstance(command, Upload) else "obeyed"
    is_start = isinstance(command, Command) and command.action is Action.START
    return f"refused: {verdict.because or in_words(verdict.refused, signer, is_start)}"


def in_words(refused: str, signer: Member | str, is_start: bool = False) -> str:
    """Return the reason why a command was refused in words for people.

    ``refused``: code of the reason, as of a ``Verdict`` or a ``Verifier``. ``signer``: its certificate. ``is_start``: a start
    command.
    """
    if refused == "without_valid_certificate":
        if not isinstance(signer, str):
            return f"its certificate is that of {signer.name}"
        return "it is not signed" if signer == "unsigned" else f"its {signer}"
    if refused == "too_old":
        return f"replayed or delayed: its {'nonce or its stamp' if is_start else 'nonce'} is not valid any more"
    if refused.startswith("by_a_"):
        return f"its certificate is not an operator's, but of the role {refused.removeprefix('by_a_')}"
    return _WORDS.get(refused, refused.replace("_", " "))


def told(signer: Member | str) -> str:
    """Return a certificate in a few words: role, name, serial number and end."""
    if isinstance(signer, str):
        return signer
    serial = f"{signer.serial:x}"[:_SERIAL_DIGITS]
    return f"{signer.role} {signer.name}, serial {serial}, until {utc(signer.not_after_ns):%Y-%m-%d %H:%M}"


def _action(order: AnyOrder) -> str:
    return order.action if isinstance(order, Command) else f"upload {order.mission}"


def _decoded(key: Key, payload: bytes) -> AnyMessage | None:
    try:
        return decode_from(key, payload)
    except ProtocolError:
        return None
