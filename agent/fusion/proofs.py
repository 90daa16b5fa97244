"""Proofs of log entries and statuses: this drone's own are signed; other drones' are verified before they count."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterator, Sequence

from radron.protocol.codec import as_bytes
from radron.protocol.codes import Code
from radron.protocol.entries import Credential, Entry
from radron.protocol.messages import Status
from radron.protocol.signing import Trust, Verifier, sign_entries, sign_status
from radron.protocol.texts import CodedText

MAX_UNPROVEN = 500  # entries of a drone that wait for its certificate; more are left to the log query
FORGERY_REPORTED_NS = 10_000_000_000  # duration of the report on forgeries

Received = tuple[Entry, bytes]
Own = tuple[str, str, str]


class Proofs:
    """Signs the log entries and statuses of this drone, and verifies the signatures of other drones before their messages count.

    ``forged``: number of messages dropped without their publisher's signature, by publisher and kind.
    """

    def __init__(
        self,
        drones: Sequence[str],
        own: Own,
        trust: Trust | None,
        verifier: Verifier | None,
        leaves_out: Callable[[Entry], bool] = lambda _: False,
    ) -> None:
        """Set up signing and verification.

        ``drones``: of the mission; only their entries are verified. ``own``: drone, mission and boot (start of the agent) of this
        drone's entries. ``trust`` None: no signatures, all entries are accepted. ``leaves_out``: whether a signed entry does not
        count.
        """
        self._leaves_out = leaves_out
        self._own, self._trust, self._verifier = own, trust, verifier
        self._introduced = False
        self._waiting = {name: deque[Received](maxlen=MAX_UNPROVEN) for name in drones}
        self.forged: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self._forged_ns: dict[str, int] = {}

    def signed(self, entries: Sequence[Entry], now_ns: int) -> Sequence[Entry]:
        """Return entries of this drone that are published together, with their signatures; before the first ones, the drone's
        certificate.
        """
        if self._trust is None or not entries:
            return entries
        if self._introduced:
            return tuple(sign_entries(entries, self._trust.sign))
        self._introduced = True
        drone, mission, boot = self._own
        introduction = Credential(
            stamp_ns=now_ns, drone=drone, mission=mission, boot=boot, sequence=0, certificate=self._trust.certificate
        )
        signed = tuple(sign_entries((introduction, *entries), self._trust.sign))
        if self._verifier is not None:  # so that entries of its own name held by peers are verified here too
            self._verifier.accepts_entry(signed[0], as_bytes(signed[0]))
        return signed

    def signed_status(self, status: Status) -> Status:
        """Return a status message of this drone with its signature."""
        return status if self._trust is None else sign_status(status, self._trust)

    def is_signed(self, status: Status, now_ns: int) -> bool:
        """Return whether a status message is signed by the drone that it names."""
        if self._verifier is None or self._verifier.accepts_status(status):
            return True
        self._note(status.drone if status.drone in self._waiting else "others", status, now_ns)
        return False

    def proven(self, entry: Entry, payload: bytes, now_ns: int) -> Iterator[Received]:
        """Yield the entries, with their bytes, that may be logged after this one: the entry itself and entries that have waited
        for it.

        Entries wait for the certificate of their publisher. Yield nothing if the entry is not signed, or must wait.
        """
        if self._verifier is None:
            yield entry, payload
        elif entry.drone not in self._waiting:
            self._note("others", entry, now_ns)
        elif self._leaves_out(entry):
            return
        elif not self._verifier.knows(entry):
            self._waiting[entry.drone].append((entry, payload))
        elif not self._verifier.accepts_entry(entry, payload):
            self._note(entry.drone, entry, now_ns)
        else:
            yield entry, payload
            if isinstance(entry, Credential):
                yield from self._released(entry, now_ns)

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return one line for each drone in whose name forged or altered messages arrived recently."""
        told = []
        for name in sorted(self._forged_ns):
            if abs(now_ns - self._forged_ns[name]) < FORGERY_REPORTED_NS:
                kinds = ", ".join(f"{number} x {kind}" for kind, number in sorted(self.forged[name].items()))
                text = f"messages of {name} that it has not signed were dropped: {kinds}"
                told.append(CodedText(Code.MESSAGES_UNSIGNED, text, name if name in self._waiting else None))
        return tuple(told)

    def _released(self, credential: Credential, now_ns: int) -> Iterator[Received]:
        waiting = self._waiting[credential.drone]
        ready = [one for one in waiting if one[0].boot == credential.boot]
        if ready:
            others = [one for one in waiting if one[0].boot != credential.boot]
            waiting.clear()
            waiting.extend(others)
        for entry, payload in ready:
            yield from self.proven(entry, payload, now_ns)

    def _note(self, publisher: str, message: Entry | Status, now_ns: int) -> None:
        self.forged[publisher][type(message).__name__.lower()] += 1
        self._forged_ns[publisher] = now_ns
