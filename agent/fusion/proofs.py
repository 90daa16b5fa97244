"""Proofs of the log entries, and of the statuses: this drone's own are signed, those of others verified before they count."""

from __future__ import annotations

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterator, Sequence

from protocol.codec import as_bytes
from protocol.entries import Credential, Entry
from protocol.messages import Status
from protocol.signing import Trust, Verifier, sign_entries, sign_status

MOST_UNPROVEN = 500  # entries of a drone that wait for its certificate; more are left to the log query
TOLD_NS = 10_000_000_000  # forgeries are told for this long

Received = tuple[Entry, bytes]
Own = tuple[str, str, str]


class Proofs:
    """The proofs of one drone's mission.

    ``forged``: what was dropped because its publisher has not signed it, by publisher and kind.
    """

    def __init__(
        self,
        drones: Sequence[str],
        own: Own,
        trust: Trust | None,
        verifier: Verifier | None,
        leaves_out: Callable[[Entry], bool] = lambda _: False,
    ) -> None:
        """``drones``: of the mission; only their entries are verified. ``own``: drone, mission and boot of the own entries.
        ``trust`` None: nothing is signed, everything taken. ``leaves_out``: tells what does not count, though it is signed.
        """
        self._leaves_out = leaves_out
        self._own, self._trust, self._verifier = own, trust, verifier
        self._introduced = False
        self._waiting = {name: deque[Received](maxlen=MOST_UNPROVEN) for name in drones}
        self.forged: defaultdict[str, Counter[str]] = defaultdict(Counter)
        self._forged_ns: dict[str, int] = {}

    def signed(self, entries: Sequence[Entry], now_ns: int) -> Sequence[Entry]:
        """Entries that are published together, with their proofs; the first ones of a boot after its certificate."""
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
        if self._verifier is not None:  # so that what others hold in its name is verified here too
            self._verifier.accepts_entry(signed[0], as_bytes(signed[0]))
        return signed

    def signed_status(self, status: Status) -> Status:
        """A status of this drone, as its receivers read it, with its signature."""
        return status if self._trust is None else sign_status(status, self._trust)

    def is_signed(self, status: Status, now_ns: int) -> bool:
        """Whether another drone has signed its status."""
        if self._verifier is None or self._verifier.accepts_status(status):
            return True
        self._note(status.drone if status.drone in self._waiting else "others", status, now_ns)
        return False

    def proven(self, entry: Entry, payload: bytes, now_ns: int) -> Iterator[Received]:
        """What may be logged now that this has come: the entry, those that have waited for it, or nothing."""
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

    def problems(self, now_ns: int) -> tuple[str, ...]:
        """One line for each drone in whose name something was forged or altered recently."""
        told = []
        for name in sorted(self._forged_ns):
            if abs(now_ns - self._forged_ns[name]) < TOLD_NS:
                kinds = ", ".join(f"{number} x {kind}" for kind, number in sorted(self.forged[name].items()))
                told.append(f"messages of {name} that it has not signed were dropped: {kinds}")
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
