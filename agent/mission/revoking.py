"""Revocation in flight: messages and commands of a revoked member are ignored. Log entries of a drone that has been revoked, or
has contradicted itself, are left out from a number on.

What follows depends on the set of revocations and entries alone, not on their order. Of several numbers for the same drone the
lowest counts, for each boot. So all drones leave the same entries out of log, digest and hypothesis.
"""

from __future__ import annotations

from collections import Counter
from typing import cast

from radron.agent.fusion.blocks import Publisher
from radron.agent.fusion.records import Contradiction
from radron.agent.fusion.revocations import Revocations
from radron.agent.mission.commanding import Verdict
from radron.agent.mission.executive import Executive
from radron.agent.mission.problems import Problems
from radron.agent.mission.worldmodel import WorldModel
from radron.agent.navigation.covered import MOST_ENTRIES, MOST_WINDOWS, WINDOW_NS
from radron.agent.navigation.peers.newest import Peers
from radron.agent.owntime import Utc
from radron.protocol.codes import Code
from radron.protocol.entries import Coverage, Entry
from radron.protocol.revocations import MAX_HELD_REVOCATIONS, Obeying, Revocation, Revoked
from radron.protocol.signing import Trust, Verifier, sign_obeying
from radron.protocol.texts import CodedText

_MOST_READ = 4 * MOST_ENTRIES  # in a window: more than count, because some may be implausible
PERIOD_NS = 1_000_000_000  # of passing them on: also to drones that join, or whose link returns


class Revoking:
    """The revocations that one drone knows, and their effect on its mission."""

    def __init__(
        self,
        publisher: Publisher,
        trust: Trust | None,
        verifier: Verifier | None,
        world: WorldModel,
        executive: Executive,
        peers: Peers,
        problems: Problems,
        counters: Counter[str],
        utc: Utc,
    ) -> None:
        """``publisher``: of the own entries. ``trust``, ``verifier``: None without certificates; then without revocation."""
        self._publisher, self._drone = publisher, publisher[0]
        self._trust, self._revocations, self._utc = trust, Revocations(verifier, counters), utc
        self._world, self._executive, self._peers, self._problems = world, executive, peers, problems
        self._contradictions: dict[Publisher, Contradiction] = {}
        self._obeying: dict[str, Obeying] = {}  # the words of the others that are revoked; after a restart others pass them on
        self._due_ns = 0

    @property
    def held(self) -> tuple[Revocation, ...]:
        """The revocations in force; the same object while they do not change."""
        return self._revocations.held

    @property
    def names(self) -> frozenset[str]:
        """The names of the revoked members."""
        return self._revocations.names

    def hear(self, message: Revocation | Revoked, now_ns: int) -> Verdict | None:
        """Put revocations into effect. Returns the outcome of the last that was not known."""
        verdict = None
        by = message.drone if isinstance(message, Revoked) else None
        for one in message.held if isinstance(message, Revoked) else (message,):
            refused = self._revocations.take(one, self._utc.of(now_ns), by)
            if refused is None:
                self._carry_out(one, now_ns)
            if refused not in ("known", "flood"):
                verdict = Verdict(refused or "")
        if isinstance(message, Revoked):
            self._note_obeying(message, now_ns)
        return verdict

    def _note_obeying(self, message: Revoked, now_ns: int) -> None:
        """Note which revoked drones obey. This is the only report of a revoked drone that counts: signed, and with no copy of its
        key known; otherwise the drone may circle on.
        """
        for word in message.obeying:
            known = word.drone in self._obeying or word.drone in self._executive.remembering.copied or word.drone == self._drone
            if not known and self._revocations.confirms(word, self._utc.of(now_ns), message.drone):
                self._obeying[word.drone] = word
                self._executive.obeys(word.drone, now_ns)

    def leaves_out(self, entry: Entry) -> bool:
        """Whether a revocation leaves an entry out."""
        return self._revocations.leaves_out(entry)

    def recount(self, entry: Entry) -> None:
        """Handle an entry that was not taken: if it contradicts another one, no entry from that number on counts."""
        publisher = entry.drone, entry.boot
        log = self._world.fusion.log
        found = log.contradictions.get(publisher)
        if found is not self._contradictions.get(publisher) and found is not None:
            self._contradictions[publisher] = found
            held = log.identities(Coverage, entry.drone)
            if any(one.boot == entry.boot and one.sequence >= found.number for one in held):
                self._recount(entry.drone)
            if publisher == self._publisher:
                self._executive.left_out()

    def due(self, now_ns: int) -> tuple[Revoked, ...]:
        """Return the revocations to be passed on now."""
        if not self.held or now_ns < self._due_ns:
            return ()
        self._due_ns = now_ns + PERIOD_NS
        own = (self._word(),) if self._drone in self.names and self._executive.flies_home(now_ns) else ()
        obeying = tuple(word for _, word in sorted(self._obeying.items()))[: MAX_HELD_REVOCATIONS - len(own)]
        return (Revoked(stamp_ns=now_ns, drone=self._drone, held=self.held, obeying=(*own, *obeying)),)

    def _word(self) -> Obeying:
        """Return the signed statement that this drone obeys its last revocation."""
        assert self._trust is not None  # without certificates nothing is revoked
        return sign_obeying([one for one in self.held if one.member == self._drone][-1], self._trust)

    @property
    def notices(self) -> tuple[CodedText, ...]:
        """One line for each revoked member, and for each drone that has contradicted itself."""
        by = {one.member: one.station for one in reversed(self.held)}
        contradicting = {name: found.number for (name, _), found in self._contradictions.items()}
        told = "{} has published two different log entries with the number {}: nothing from it on counts"
        return (
            *(CodedText(Code.MEMBER_REVOKED, f"{name} has been revoked by {by[name]}", name) for name in sorted(by)),
            *(CodedText(Code.ENTRIES_CONTRADICT, told.format(name, contradicting[name]), name) for name in sorted(contradicting)),
        )

    def _carry_out(self, revocation: Revocation, now_ns: int) -> None:
        """Carry out a revocation. The known motion of a revoked drone stays: the others keep clear of it as of a silent drone.

        If it is this drone, it returns: its measurements do not count, and its position is not known to the others. Its
        hypothesis ends as well: the others would ignore it, and its only camera flies away.
        """
        name, log = revocation.member, self._world.fusion.log
        self._due_ns = now_ns
        if name == self._drone:
            self._executive.revoke()
            self._world.end_estimates()
            text = f"{name} has been revoked by {revocation.station}: no other drone hears it any more"
            self._problems.revoked = (CodedText(Code.SELF_REVOKED, text, name),)
            return
        if name in self._obeying and not self._revocations.counts(self._obeying[name]):
            del self._obeying[name]  # another revocation counts now: to others its word would be a forged one
        if self._peers.are_two(name, now_ns):
            self._executive.remembering.copied.add(name)  # the statement may be by the copy
        self._executive.exclude(name)
        self._world.forget(log.beyond(name, revocation.counts))
        self._recount(name)

    def _recount(self, name: str) -> None:
        """Count the coverage of a drone anew. No more of it is read than can count: it may have published a minute's flood."""
        log, read = self._world.fusion.log, Counter[int]()
        counted = []
        for identity in log.identities(Coverage, name):
            window = identity.stamp_ns // WINDOW_NS
            if self._revocations.leaves_out(identity) or identity.sequence > log.last_counted(name, identity.boot):
                continue
            read[window] += 1
            if read[window] <= _MOST_READ and len(read) <= MOST_WINDOWS:
                counted.append(cast(Coverage, log.entry(identity)))
        self._executive.recount_coverage(name, counted)
