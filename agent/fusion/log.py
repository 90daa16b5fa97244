"""The observation log: the grow-only set of what anybody measured in this mission (DESIGN, "Messages and keys").

Whatever way and order the entries come in, two logs with the same entries have the same digest.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import TypeVar, cast

from msgspec import Struct

from agent.fusion.sequences import Range, SequenceSet
from protocol.messages import Entry, EntryId

E = TypeVar("E", bound=Entry)
_DIGEST_BYTES = 16
_MODULUS = 1 << (8 * _DIGEST_BYTES)

Publisher = tuple[str, str]  # drone, boot
Summary = Mapping[Publisher, tuple[Range, ...]]  # ranges of the sequence numbers held of each publisher


class Outcome(Enum):
    """What became of an entry that was offered to the log. The first two changed the log."""

    ADDED = "added"
    REPLACED = "replaced"  # took the place of an entry of the same identity and other bytes
    DUPLICATE = "duplicate"
    CONFLICT = "conflict"  # same identity and other bytes; the entry held stays
    FOREIGN = "foreign"  # of another mission, or of a drone that is not in it
    LATE = "late"  # behind the horizon, and not known from before


class Record(Struct, frozen=True):
    """An entry with its bytes as they crossed the link, and their hash as a number."""

    entry: Entry
    payload: bytes
    hash: int


class ObservationLog:
    """Entries of one mission by identity.

    Digest: the sum, modulo 2^128, of the BLAKE2b-128 hashes of the entries' bytes. A sum does not depend on the order,
    takes one addition per entry, and unlike XOR does not cancel equal terms. It tells accidents apart, not forgers: those are for
    the publisher's signature.

    One identity with two payloads (a publisher's fault) resolves to the payload with the smaller hash, whichever came first.

    Memory: it grows. Nothing calls ``compact`` in flight, on purpose: a restarted agent begins with an empty log and must
    be able to get all of it, and any entry may come late and have everything after it folded again. Three drones at 3 GBq give
    5 exposures and 2.5 cones a second (scenario ``demo``, tracking): 4.2 kB/s of payloads, 15 MB per hour, and some 100 MB per
    hour with entries, observations and indices.
    """

    def __init__(self, mission_id: str, drones: Iterable[str]) -> None:
        """``drones``: ids of those whose entries are taken in, the mission's."""
        self.mission_id = mission_id
        self._drones = frozenset(drones)
        self.horizon_ns = 0  # entries stamped before it are compacted
        self.counters: dict[str, int] = {outcome.value: 0 for outcome in Outcome}
        self._records: dict[EntryId, Record] = {}
        self._by_kind: defaultdict[type[Entry], dict[EntryId, Entry]] = defaultdict(dict)
        self._revisions: Counter[type[Entry]] = Counter()
        self._held: dict[Publisher, SequenceSet] = {}
        self._numbered: defaultdict[Publisher, dict[int, tuple[EntryId, ...]]] = defaultdict(dict)  # one each, but for faults
        self._sum = 0

    def __len__(self) -> int:
        """Number of entries held, without the compacted ones."""
        return len(self._records)

    def __iter__(self) -> Iterator[Record]:
        """The records held, in the order of their identities."""
        return (self._records[identity] for identity in sorted(self._records))

    def __contains__(self, identity: EntryId) -> bool:
        return identity in self._records

    def entries(self, kind: type[E]) -> list[E]:
        """The entries of one kind (without compacted ones) in the order of their identities: a function of the log's content."""
        held = self._by_kind[kind]
        return [cast(E, held[identity]) for identity in sorted(held)]

    def revision(self, kind: type[Entry]) -> int:
        """Grows whenever ``entries(kind)`` changes, so that whoever works from them can notice cheaply."""
        return self._revisions[kind]

    @property
    def digest(self) -> str:
        """32 hex digits over everything that was ever taken in, compacted entries included."""
        return f"{self._sum:032x}"

    def add(self, entry: Entry, payload: bytes) -> Outcome:
        """Offer an entry; ``payload`` are the bytes that it was decoded from."""
        outcome = self._add(entry, payload)
        self.counters[outcome.value] += 1
        return outcome

    def _add(self, entry: Entry, payload: bytes) -> Outcome:
        if entry.mission != self.mission_id or entry.drone not in self._drones:
            return Outcome.FOREIGN
        held = self._held.setdefault((entry.drone, entry.boot), SequenceSet())
        if entry.stamp_ns < self.horizon_ns:
            return Outcome.DUPLICATE if entry.sequence in held else Outcome.LATE
        record = Record(entry, payload, int.from_bytes(hashlib.blake2b(payload, digest_size=_DIGEST_BYTES).digest()))
        identity = entry.entry_id
        present = self._records.get(identity)
        if present is not None:
            if record.hash == present.hash:
                return Outcome.DUPLICATE
            if record.hash > present.hash:
                return Outcome.CONFLICT
        self._records[identity] = record
        if present is not None:  # possibly of another kind
            self._forget(identity, type(present.entry))
        else:
            numbered = self._numbered[entry.drone, entry.boot]
            numbered[entry.sequence] = (*numbered.get(entry.sequence, ()), identity)
        self._by_kind[type(entry)][identity] = entry
        self._revisions[type(entry)] += 1
        self._sum = (self._sum + record.hash - (present.hash if present else 0)) % _MODULUS
        held.add(entry.sequence)
        return Outcome.REPLACED if present else Outcome.ADDED

    def _forget(self, identity: EntryId, kind: type[Entry]) -> None:
        del self._by_kind[kind][identity]
        self._revisions[kind] += 1

    def summary(self) -> dict[Publisher, tuple[Range, ...]]:
        """What this log holds or has compacted: a peer that gets it can tell what is lacking."""
        return {publisher: tuple(held) for publisher, held in self._held.items() if any(held)}

    def missing_from(self, summary: Summary) -> list[Record]:
        """The records held here that a log of this summary lacks, in the order of their identities.

        The work goes with what is lacking, which is mostly nothing or little: every peer asks every few seconds.
        """
        missing: list[EntryId] = []
        for publisher, held in self._held.items():
            numbered = self._numbered[publisher]
            for first, last in held.without(SequenceSet(summary.get(publisher, ()))):
                for sequence in range(first, last + 1):
                    missing += numbered.get(sequence, ())  # none: compacted
        return [self._records[identity] for identity in sorted(missing)]

    def agreed_until_ns(self, peers: Iterable[Summary]) -> int:
        """Stamp before which neither this log nor any of the peers' lacks an entry that one of them has.

        While a peer holds something that is lacking here, its stamp is not known: then nothing beyond the horizon is agreed.
        """
        agreed = max((identity.stamp_ns + 1 for identity in self._records), default=self.horizon_ns)
        for summary in peers:
            for publisher, ranges in summary.items():
                held = self._held.get(publisher)
                if held is None or not held.covers(SequenceSet(ranges)):
                    return self.horizon_ns
            missing = self.missing_from(summary)
            if missing:
                agreed = min(agreed, missing[0].entry.stamp_ns)
        return agreed

    def compact(self, before_ns: int) -> None:
        """Forget the bytes of entries stamped before ``before_ns``. Digest and summary go on covering them.

        Only to be done where nobody lacks such an entry (``agreed_until_ns``): from then on an unknown one is refused, and the
        digests of the swarm would differ for good.
        """
        self.horizon_ns = max(self.horizon_ns, before_ns)
        for identity in [identity for identity in self._records if identity.stamp_ns < self.horizon_ns]:
            self._forget(identity, type(self._records.pop(identity).entry))
            numbered = self._numbered[identity.drone, identity.boot]
            numbered[identity.sequence] = tuple(other for other in numbered[identity.sequence] if other != identity)
