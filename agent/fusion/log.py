"""The observation log: the grow-only set of all measurements made in this mission.

Two logs with the same entries have the same digest, whatever the order in which the entries arrived.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from itertools import chain, islice, zip_longest
from typing import TypeVar, cast

from msgspec import Struct

from agent.fusion.sequences import Range, SequenceSet
from protocol.codec import decode
from protocol.entries import Entry, EntryId
from protocol.summary import MOST_PUBLISHERS

E = TypeVar("E", bound=Entry)
_DIGEST_BYTES = 16
_TURN = 50  # entries of one publisher in an answer before it is the next one's turn
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
    """An entry as its bytes that crossed the link. Decoded it would take four times the memory."""

    kind: type[Entry]
    payload: bytes

    @property
    def entry(self) -> Entry:
        """The entry, decoded anew."""
        return cast(Entry, decode(self.payload))


class ObservationLog:
    """Entries of one mission by identity.

    Digest: the sum, modulo 2^128, of the BLAKE2b-128 hashes of the entries' bytes. A sum is independent of the order, takes one
    addition per entry, and unlike XOR does not cancel equal terms. It detects accidental differences, not forgeries: the
    publisher's signature is for those.

    One identity with two payloads (a publisher's fault) resolves to the payload with the smaller hash, whichever came first.

    The log is never compacted: a restarted agent begins with an empty log and must be able to get all of it, and an entry may
    arrive late, after which all later grid steps are computed again. Memory: three drones at 3 GBq publish 5 exposures and 11
    cones a second (scenario ``demo``, tracking), 8 kB/s or 30 MB per hour of payloads, and about 100 MB per hour with
    observations and indices: 1.6 kB for each entry. A single entry is bounded by ``protocol.codec.MAX_ENTRY_BYTES``;
    ``agent.shell.memory`` warns the operator before memory runs out.
    """

    def __init__(self, mission_id: str, drones: Iterable[str]) -> None:
        """``drones``: ids of the mission's drones; only their entries are accepted."""
        self.mission_id = mission_id
        self._drones = frozenset(drones)
        self.counters: dict[str, int] = {outcome.value: 0 for outcome in Outcome}
        self._payloads: defaultdict[type[Entry], dict[EntryId, bytes]] = defaultdict(dict)
        self._revisions: Counter[type[Entry]] = Counter()
        self._held: dict[Publisher, SequenceSet] = {}
        self._boots: defaultdict[str, list[str]] = defaultdict(list)  # by drone, in the order of their first entries
        self._numbered: defaultdict[Publisher, dict[int, EntryId]] = defaultdict(dict)
        self._twins: defaultdict[tuple[Publisher, int], dict[EntryId, EntryId]] = defaultdict(dict)  # others of a number: faults
        self._sum = 0

    def __len__(self) -> int:
        """Number of entries held."""
        return sum(map(len, self._payloads.values()))

    def __iter__(self) -> Iterator[Record]:
        """The records held, in the order of their identities."""
        return (self._record(identity) for identity in sorted(chain.from_iterable(self._payloads.values())))

    def entries(self, kind: type[E]) -> list[E]:
        """The entries of one kind in the order of their identities: a function of the log's content."""
        return [cast(E, decode(payload)) for _, payload in sorted(self._payloads[kind].items())]

    def entry(self, identity: EntryId) -> Entry:
        """The entry held of this identity. Raises KeyError without one."""
        return self._record(identity).entry

    def identity_of(self, entry: Entry) -> EntryId:
        """The identity of an entry held, as the log holds it: whoever keeps that one needs no memory for another."""
        own = entry.entry_id
        publisher = entry.drone, entry.boot
        first = self._numbered[publisher][entry.sequence]
        return first if first == own else self._twins[publisher, entry.sequence][own]

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
        kind, identity, hashed = type(entry), entry.entry_id, _hash(payload)
        present = self._kind_of(identity)
        present_hash = 0
        if present is not None:
            present_hash = _hash(self._payloads[present][identity])
            if hashed == present_hash:
                return Outcome.DUPLICATE
            if hashed > present_hash:
                return Outcome.CONFLICT
            del self._payloads[present][identity]
            self._revisions[present] += 1
        else:
            self._number(identity)
        self._payloads[kind][identity] = payload
        self._revisions[kind] += 1
        self._sum = (self._sum + hashed - present_hash) % _MODULUS
        return Outcome.ADDED if present is None else Outcome.REPLACED

    def _number(self, identity: EntryId) -> None:
        """Enter a new identity under its publisher and sequence number."""
        publisher, sequence = (identity.drone, identity.boot), identity.sequence
        if publisher not in self._held:
            self._held[publisher] = SequenceSet()
            self._boots[identity.drone].append(identity.boot)
        self._held[publisher].add(sequence)
        if self._numbered[publisher].setdefault(sequence, identity) is not identity:
            self._twins[publisher, sequence][identity] = identity

    def _kind_of(self, identity: EntryId) -> type[Entry] | None:
        return next((kind for kind, held in self._payloads.items() if identity in held), None)

    def _record(self, identity: EntryId) -> Record:
        """The record of this identity. Raises KeyError without one."""
        kind = self._kind_of(identity)
        if kind is None:
            raise KeyError(identity)
        return Record(kind, self._payloads[kind][identity])

    def summary(self) -> dict[Publisher, tuple[Range, ...]]:
        """The sequence numbers held of each publisher: a peer that gets this can tell which entries are missing here.

        As many publishers as a summary carries, those of each drone in turn: one that goes through many boots does not keep the
        others out.
        """
        turns = zip_longest(
            *([(drone, boot) for boot in boots[:MOST_PUBLISHERS]] for drone, boots in sorted(self._boots.items()))
        )
        chosen = islice((publisher for turn in turns for publisher in turn if publisher is not None), MOST_PUBLISHERS)
        return {publisher: tuple(self._held[publisher]) for publisher in chosen}

    def missing_from(self, summary: Summary, most: int) -> list[tuple[EntryId, Record]]:
        """Up to ``most`` records held here that are missing from a log with this summary, some of every drone in turn.

        In the order of the sequence numbers, so that the cost follows from what is returned and from the summary, however much
        is missing; and nobody's entries wait for those of a drone that has many.
        """
        waiting = deque(self._lacked(drone, summary) for drone in sorted(self._boots))
        missing: list[tuple[EntryId, Record]] = []
        while waiting and len(missing) < most:
            records = waiting.popleft()
            found = list(islice(records, _TURN))
            missing += found
            if len(found) == _TURN:
                waiting.append(records)
        return missing[:most]

    def _lacked(self, drone: str, summary: Summary) -> Iterator[tuple[EntryId, Record]]:
        """The records of a drone that are missing."""
        for boot in self._boots[drone]:
            publisher = drone, boot
            numbered = self._numbered[publisher]
            for first, last in self._held[publisher].without(SequenceSet(summary.get(publisher, ()))):
                for sequence in range(first, last + 1):
                    for identity in (numbered[sequence], *self._twins.get((publisher, sequence), ())):
                        yield identity, self._record(identity)


def _hash(payload: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(payload, digest_size=_DIGEST_BYTES).digest())
