"""The drone's own signatures in a replay: its private key is in no record, but its signed messages are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msgspec import UNSET

from radron.agent.flight import topics
from radron.protocol.codec import decode_from
from radron.protocol.entries import SIGNATURE_BYTES, Entry
from radron.protocol.errors import ProtocolError
from radron.protocol.message import Message
from radron.protocol.messages import Status
from radron.protocol.revocations import Revoked
from radron.protocol.signing import Authority, Member, Trust

_NONE = bytes(SIGNATURE_BYTES)


class RecordedSignatures:
    """Gives this drone's signatures in a replay: its private key is in no record, but the recorded messages contain the
    signatures.
    """

    def __init__(self, certificate: bytes, authority: Authority) -> None:
        """Set up the signatures of a drone. Raises ProtocolError if the authority has not issued the certificate."""
        self._member: Member = authority.verify(certificate)
        self._results: Sequence[tuple[str, bytes]] = ()
        self.trust = Trust(self._member.name, self._sign, certificate, authority)

    def offer(self, results: Sequence[tuple[str, bytes]]) -> None:
        """Take topics and contents of the recorded results of the next call, in which its signatures are found."""
        self._results = results

    def _sign(self, data: bytes) -> bytes:
        """The recorded signature of these bytes; zeros where there is none, so that the results differ."""
        for topic, content in self._results:
            if topic != topics.PUBLICATION:
                continue
            try:
                message = decode_from(*topics.decode_message(content))
            except (ProtocolError, ValueError):
                continue
            for signature in _signatures(message):
                if self._member.verified(signature, data):
                    return signature
        return _NONE


def _signatures(message: Message) -> Iterator[bytes]:
    if isinstance(message, Entry):
        yield message.proof[:SIGNATURE_BYTES]
    if isinstance(message, Status):
        yield message.signature
        if message.obeyed is not UNSET:
            yield message.obeyed.signature
    if isinstance(message, Revoked):
        yield from (word.signature for word in message.obeying)
