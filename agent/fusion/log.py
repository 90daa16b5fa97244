"""The observation log: the grow-only set of all measurements made in this mission.

Two logs with the same entries have the same digest, whatever the order in which the entries arrived.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from typing import TypeVar, cast

from msgspec import Struct

from agent.fusion.sequences import Range, SequenceSet
from protocol.entries import Entry, EntryId

E = TypeVar("E", bound=Entry)
_DIGEST_BYTES = 16
_MODULUS = 1 << (8 * _DIGEST_BYTES)

Publisher = tuple[str, str]  # drone, boot
Summary = Mapping[Publisher, tuple[Range, ...]]  # ranges of the sequence numbers held of each publisher


class Outcome(Enum):
    """Result of offering an entry to the log. The first two changed the log."""

    ADDED = "added"
    REPLACED = "replaced"  # took the place of an entry of the same identity and other bytes
    DUPLICATE = "duplicate"
    CONFLICT = "conflict"  # same identity and other bytes; the entry held stays
    FOREIGN = "foreign"  # of another mission, or of a drone that is not in it


class Record(Struct, frozen=True):
    """An entry with its bytes as they crossed the link, and their hash as a number."""

    entry: Entry
    payload: bytes
    hash: int


class ObservationLog:
    """Entries of one mission by identity.

    Digest: the sum, modulo 2^128, of the BLAKE2b-128 hashes of the entries' bytes. A sum is independent of the order, takes one
    addition per entry, and unlike XOR does not cancel equal terms. It detects accidental differences, not forgeries: the
    publisher's signature is for those.

    One identity with two payloads (a publisher's fault) resolves to the payload with the smaller hash, whichever came first.

    The log is never compacted: a restarted agent begins with an empty log and must be able to get all of it, and an entry may
    arrive late, after which all later grid steps are computed again. Memory: three drones at 3 GBq publish 5 exposures and 2.5
    cones a second (scenario ``demo``, tracking), 4.2 kB/s or 15 MB per hour of payloads, and about 100 MB per hour with decoded
    entries, observations and indices. A single entry is bounded by ``protocol.codec.MAX_ENTRY_BYTES``;
    ``agent.shell.memory`` warns the operator before memory runs out.
    """

    def __init__(self, mission_id: str, drones: Iterable[str]) -> None:
        """``drones``: ids of the mission's drones; only their entries are accepted."""
        self.mission_id = mission_id
        self._drones = frozenset(drones)
        self.counters: dict[str, int] = {outcome.value: 0 for outcome in Outcome}
        self._records: dict[EntryId, Record] = {}
        self._by_kind: defaultdict[type[Entry], dict[EntryId, Entry]] = defaultdict(dict)
        self._revisions: Counter[type[Entry]] = Counter()
        self._held: dict[Publisher, SequenceSet] = {}
        self._numbered: defaultdict[Publisher, dict[int, tuple[EntryId, ...]]] = defaultdict(dict)  # one each, but for faults
        self._sum = 0

    def __len__(self) -> int:
        """Number of entries held."""
        return len(self._records)

    def __iter__(self) -> Iterator[Record]:
        """The records held, in the order of their identities."""
        return (self._records[identity] for identity in sorted(self._records))

    def entries(self, kind: type[E]) -> list[E]:
        """The entries of one kind in the order of their identities: a function of the log's content."""
        held = self._by_kind[kind]
        return [cast(E, held[identity]) for identity in sorted(held)]

    def revision(self, kind: type[Entry]) -> int:
        """A counter that grows whenever ``entries(kind)`` changes: a cheap test for changes."""
        return self._revisions[kind]

    @property
    def digest(self) -> str:
        """32 hex digits over all entries held."""
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
        """The sequence numbers held of each publisher: a peer that gets this can tell which entries are missing here."""
        return {publisher: tuple(held) for publisher, held in self._held.items() if any(held)}

    def missing_from(self, summary: Summary) -> list[Record]:
        """The records held here that are missing from a log with this summary, in the order of their identities.

        The cost is proportional to what is missing, usually little or nothing: every peer asks every few seconds.
        """
        missing: list[EntryId] = []
        for publisher, held in self._held.items():
            numbered = self._numbered[publisher]
            for first, last in held.without(SequenceSet(summary.get(publisher, ()))):
                for sequence in range(first, last + 1):
                    missing += numbered[sequence]
        return [self._records[identity] for identity in sorted(missing)]
