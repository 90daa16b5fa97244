"""The revocations in effect: a set, independent of the order of arrival."""

from __future__ import annotations

from collections import Counter

from radron.protocol.entries import Entry, EntryId
from radron.protocol.revocations import MAX_HELD_REVOCATIONS, Obeying, Revocation
from radron.protocol.signing import Verifier

MAX_REFUSED_REVOCATIONS_PS = 20  # in a second, of one member; each costs a third of a millisecond


class Revocations:
    """The revocations in effect: members of the swarm whose rights were withdrawn by an operator. Their order of arrival does not
    matter.

    ``held``: the revocations in effect. ``names``: of the revoked members.
    """

    def __init__(self, verifier: Verifier | None, counters: Counter[str]) -> None:
        """Start without revocations. ``verifier``: checks signatures; None: the swarm has no certificates, and nothing can be
        revoked.
        """
        self._verifier, self._counters = verifier, counters
        self._second = 0
        self._refusals = Counter[str]()  # in that second, by sender of the refused message: no sender uses up another's share
        self.held: tuple[Revocation, ...] = ()
        self.names: frozenset[str] = frozenset()

    def take(self, revocation: Revocation, now_ns: int, passed_on_by: str | None) -> str | None:
        """Put a revocation into effect; return the reason of a refusal, or None.

        "known": it would change nothing. "flood": so many messages of the sender were refused in this second that no more of its
        signatures are verified; genuine ones come again.

        ``passed_on_by``: another drone that sent it, or this drone, if it was known before a restart; None: it comes from its
        station itself, whose certificate must be valid now. The stamp is the station's own statement, and a key that is no longer
        guarded must not revoke any member.
        """
        sender = passed_on_by or revocation.station
        if self._is_flooded(sender, now_ns):
            self._counters["dropped_revocation_flood"] += 1
            return "flood"
        refused = self._refusal(revocation, now_ns, passed_on_by is not None)
        if refused is None:
            self.held = (*self._left_beside(revocation), revocation)
            self.names |= {revocation.member}
            if self._verifier is not None:
                self._verifier.revoke(revocation.member)
        elif refused != "known":
            self._counters[f"dropped_revocation_{refused}"] += 1
            self._refusals[sender] += 1
        return refused

    def confirms(self, word: Obeying, now_ns: int, passed_on_by: str) -> bool:
        """Return whether a message proves that a revoked drone obeys its revocation; refusals count as flood, too.

        word: the message. passed_on_by: the drone that sent it.
        """
        if word.drone not in self.names or self._is_flooded(passed_on_by, now_ns):
            return False
        if self.counts(word):
            return True
        self._counters["dropped_obeying_forged"] += 1
        self._refusals[passed_on_by] += 1
        return False

    def counts(self, word: Obeying) -> bool:
        """Return whether a message confirms a revocation that is in effect, and is signed by the revoked drone."""
        verifier, held = self._verifier, (one for one in self.held if one.member == word.drone)
        return verifier is not None and any(verifier.accepts_obeying(word, one) for one in held)

    def leaves_out(self, entry: Entry | EntryId) -> bool:
        """Return whether a log entry (signed measurement) does not count, because its author was revoked and its number is beyond
        the last one that counts.
        """
        return any(one.member == entry.drone and entry.sequence > one.counts(entry.boot) for one in self.held)

    def _is_flooded(self, sender: str, now_ns: int) -> bool:
        second = now_ns // 1_000_000_000
        if second != self._second:
            self._second = second
            self._refusals.clear()
        return self._refusals[sender] >= MAX_REFUSED_REVOCATIONS_PS

    def _refusal(self, revocation: Revocation, now_ns: int, passed_on: bool) -> str | None:
        if self._verifier is None:
            return "without_certificates"
        if any(one.covers(revocation) for one in self.held):
            return "known"
        refused = self._verifier.revocation_refusal(revocation, revocation.stamp_ns if passed_on else now_ns)
        if refused is not None:
            return refused
        if now_ns > revocation.until_ns:
            return "void"
        return "one_too_many" if len(self._left_beside(revocation)) >= MAX_HELD_REVOCATIONS else None

    def _left_beside(self, revocation: Revocation) -> tuple[Revocation, ...]:
        return tuple(one for one in self.held if not revocation.covers(one))
