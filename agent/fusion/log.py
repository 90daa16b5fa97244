"""The observation log: the set of all measurements made in this mission.

Two logs with the same entries have the same digest, in any order of arrival.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from enum import Enum
from itertools import chain, islice, zip_longest
from operator import attrgetter
from typing import TypeVar

from radron.agent.fusion.blocks import Blocks, Publisher, hash_of, numbers_of
from radron.agent.fusion.counting import Counting
from radron.agent.fusion.records import Contradiction, Record
from radron.agent.fusion.sequences import Range, SequenceSet
from radron.protocol.codec import decode_as
from radron.protocol.entries import MAX_LOGGED_EXPOSURE_NS, Entry, EntryId, Exposure
from radron.protocol.summary import BLOCK_ENTRIES, MAX_SUMMARY_PUBLISHERS, Held, Summary

E = TypeVar("E", bound=Entry)
_DIGEST_BYTES = 16
_TURN = 50  # entries of one publisher in an answer before the next publisher's turn
_MODULUS = 1 << (8 * _DIGEST_BYTES)
_EVERYTHING = 1 << 64  # above all sequence numbers


class Outcome(Enum):
    """Result of offering an entry to the log. Only an ``ADDED`` entry is in the log."""

    ADDED = "added"
    DUPLICATE = "duplicate"
    CONTRADICTION = "contradiction"  # other bytes than those held under its number: neither counts, nor any later entry
    LEFT_OUT = "left_out"  # of a publisher that has contradicted itself, at this number or before
    FOREIGN = "foreign"  # of another mission, or of a drone that is not in it
    TOO_LONG = "too_long"  # an exposure of more than ``MAX_LOGGED_EXPOSURE_NS``


class ObservationLog:
    """The observation log: all measurements of the swarm in one mission, as signed entries by identity (drone, restart and
    number).

    Digest: the sum, modulo 2^128, of the BLAKE2b-128 hashes of the entries' bytes. A sum is independent of the order, takes one
    addition per entry, and unlike XOR does not cancel equal terms. The digest detects accidental differences, not forgeries; the
    publishers' signatures detect those.

    A publisher that contradicts itself counts up to the first contradiction. Neither of the two entries counts, nor any greater
    number in that boot. The first proven contradiction decides, so that all agents with the same entries leave out the same, in
    any order of arrival. The log's owner removes the held entries beyond it (``beyond``, ``last_counted``).

    Entries retracted by their own drone (``Retraction``) stay in the log, so that all logs have one content. They do not count
    (``counts``). Nor do overlapping exposures of one drone (``overlaps``).

    The log only grows, but for entries left out after a contradiction or a revocation. It is never compacted: a restarted agent
    begins with an empty log and must be able to get all of it. After a late entry all later grid steps are recomputed. Memory:
    three drones at 3 GBq publish 5 exposures and 11 cones a second (scenario ``demo``, tracking). The payloads are 8 kB/s or 30
    MB per hour, with all indices about 65 MB per hour: 1.1 kB for each entry. An estimator computed elsewhere (``sources``) holds
    a kilobyte more. A single entry is bounded by ``radron.protocol.codec.MAX_ENTRY_BYTES``; ``radron.agent.shell.memory`` warns
    the operator before memory runs out.
    """

    def __init__(self, mission_id: str, drones: Iterable[str], *, judges_exposures: bool = True) -> None:
        """Start an empty log.

        ``drones``: ids of the mission's drones; only their entries are accepted. ``judges_exposures``: whether exposures may
        neither overlap nor be longer than ``MAX_LOGGED_EXPOSURE_NS``; False: for the replay of an older record."""
        self.mission_id = mission_id
        self._drones = frozenset(drones)
        self.counters: dict[str, int] = {outcome.value: 0 for outcome in Outcome}
        self._payloads: defaultdict[type[Entry], dict[EntryId, bytes]] = defaultdict(dict)
        self._revisions: Counter[type[Entry]] = Counter()
        self._held: defaultdict[Publisher, SequenceSet] = defaultdict(SequenceSet)
        self._boots: defaultdict[str, dict[str, None]] = defaultdict(dict)  # by drone, in the order of their first entries
        self._numbered: defaultdict[Publisher, dict[int, EntryId]] = defaultdict(dict)
        self._contradictions: dict[Publisher, Contradiction] = {}  # the first of each publisher
        self._newest_ns: dict[str, int] = {}
        self._blocks = Blocks(self._payloads_of)
        self._counting = Counting(self._held_with, self._end_ns, judges_exposures=judges_exposures)
        self._judges_exposures = judges_exposures
        self._too_long_ns: dict[str, int] = {}  # by drone, end of the newest exposure that was too long
        self._sum = 0

    def __len__(self) -> int:
        """Return the number of entries in the log."""
        return sum(map(len, self._payloads.values()))

    def __iter__(self) -> Iterator[Record]:
        """Iterate over the entries in the log, as bytes with their kind, in the order of their identities."""
        return (self.record(identity) for identity in sorted(chain.from_iterable(self._payloads.values())))

    def payloads(self) -> Iterator[bytes]:
        """Iterate over the bytes of all entries in the log, in no particular order."""
        return chain.from_iterable(held.values() for held in self._payloads.values())

    def numbers(self, publisher: Publisher) -> Collection[int]:
        """Return the sequence numbers of a publisher's entries in the log. publisher: drone, and its boot (start of the
        agent).
        """
        return self._numbered.get(publisher, {}).keys()

    def entries(self, kind: type[E], drone: str | None = None) -> list[E]:
        """Return the log's entries of one kind, of one drone or of all, in the order of their identities.

        The result depends on the log's content alone, not on the order of arrival.
        """
        held = (item for item in self._payloads[kind].items() if drone is None or item[0].drone == drone)
        return [decode_as(kind, payload) for _, payload in sorted(held)]

    def entry(self, identity: EntryId) -> Entry:
        """Return the log's entry with this identity. Raises KeyError if it is not in the log."""
        return self.record(identity).entry

    def identity_of(self, entry: Entry) -> EntryId:
        """Return the log's own identity object of an entry, so that users need no memory for another one."""
        return self._numbered[entry.drone, entry.boot][entry.sequence]

    def counts(self, identity: EntryId) -> bool:
        """Return whether an entry is in the log, is not retracted by its drone, and is not an overlapping exposure."""
        kind = self._kind_of(identity)
        return kind is not None and not self._counting.leaves_out(kind, identity)

    def leaves_out(self, entry: Entry) -> bool:
        """Return whether an entry in the log does not count: the opposite of ``counts``, in a third of the time."""
        return self._counting.leaves_out(type(entry), self.identity_of(entry))

    def misexposed(self, since_ns: int) -> list[tuple[str, str]]:
        """Return the drones with exposures since a time (ns) that do not count, each with the reason (they overlap, or are too
        long).
        """
        longer = [drone for drone, end_ns in sorted(self._too_long_ns.items()) if end_ns >= since_ns]
        return [(drone, "overlap") for drone in self._counting.overlapping(since_ns)] + [
            (drone, "are too long") for drone in longer
        ]

    @property
    def recounted(self) -> Sequence[tuple[EntryId, bool]]:
        """The entries that have ceased to count (False), or begun to count again (True), in the order of these events.

        The sequence only grows: owners of derived results continue reading at their last position.
        """
        return self._counting.recounted

    @property
    def contradictions(self) -> Mapping[Publisher, Contradiction]:
        """The first contradiction of each publisher that has published different entries under one number."""
        return self._contradictions

    @property
    def publishers(self) -> Mapping[str, int]:
        """The drones with entries in the log, with the latest time stamp (ns) of each."""
        return self._newest_ns

    def last_counted(self, drone: str, boot: str) -> int:
        """Return the last sequence number of a drone's boot (start of its agent) that counts: the last before a contradiction.

        Without a contradiction the result is greater than any number.
        """
        found = self._contradictions.get((drone, boot))
        return _EVERYTHING if found is None else found.number - 1

    def revision(self, kind: type[Entry]) -> int:
        """Return a counter that grows whenever the log's entries of this kind change: a cheap test for changes."""
        return self._revisions[kind]

    @property
    def digest(self) -> str:
        """Hash over all entries in the log, 32 hex digits; logs with equal entries have equal hashes."""
        return f"{self._sum:032x}"

    def add(self, entry: Entry, payload: bytes) -> Outcome:
        """Offer an entry to the log, and return whether it was added, or why not. ``payload``: the received bytes of the
        entry.
        """
        outcome = self._add(entry, payload)
        self.counters[outcome.value] += 1
        return outcome

    def _add(self, entry: Entry, payload: bytes) -> Outcome:
        if entry.mission != self.mission_id or entry.drone not in self._drones:
            return Outcome.FOREIGN
        publisher = entry.drone, entry.boot
        if entry.sequence > self.last_counted(*publisher):
            return Outcome.LEFT_OUT
        held = self._numbered[publisher].get(entry.sequence)
        if held is not None:
            present = self.record(held)
            if present.payload == payload:
                return Outcome.DUPLICATE
            self._contradictions[publisher] = Contradiction(entry.sequence, (present, Record(type(entry), payload)))
            return Outcome.CONTRADICTION
        if self._judges_exposures and isinstance(entry, Exposure) and entry.end_ns - entry.stamp_ns > MAX_LOGGED_EXPOSURE_NS:
            self._too_long_ns[entry.drone] = max(entry.end_ns, self._too_long_ns.get(entry.drone, entry.end_ns))
            return Outcome.TOO_LONG
        self._counting.settle()  # a new entry counts from the beginning, or does not
        identity = entry.entry_id
        self._put(publisher, identity, type(entry), payload)
        self._counting.added(entry, identity)
        return Outcome.ADDED

    def _put(self, publisher: Publisher, identity: EntryId, kind: type[Entry], payload: bytes) -> None:
        self._boots[identity.drone].setdefault(identity.boot)
        self._newest_ns[identity.drone] = max(identity.stamp_ns, self._newest_ns.get(identity.drone, identity.stamp_ns))
        self._held[publisher].add(identity.sequence)
        self._numbered[publisher][identity.sequence] = identity
        self._blocks.change(publisher, identity.sequence)
        self._payloads[kind][identity] = payload
        self._revisions[kind] += 1
        self._sum = (self._sum + _hash(payload)) % _MODULUS

    def _held_with(self, publisher: Publisher, ranges: Iterable[Range]) -> Iterator[EntryId]:
        """Return the held identities with these numbers."""
        numbered, held = self._numbered.get(publisher, {}), self._held.get(publisher, SequenceSet())
        return (numbered[number] for first, last in ranges for number in held.within(first, last))

    def _end_ns(self, identity: EntryId) -> int | None:
        payload = self._payloads[Exposure].get(identity)
        return None if payload is None else decode_as(Exposure, payload).end_ns

    def _kind_of(self, identity: EntryId) -> type[Entry] | None:
        for kind, held in self._payloads.items():
            if identity in held:
                return kind
        return None

    def record(self, identity: EntryId) -> Record:
        """Return the log's entry with this identity as its bytes. Raises KeyError if it is not in the log."""
        for kind, held in self._payloads.items():
            payload = held.get(identity)
            if payload is not None:
                return Record(kind, payload)
        raise KeyError(identity)

    def identities(self, kind: type[Entry], drone: str) -> list[EntryId]:
        """Return the identities of a drone's log entries of one kind, ascending."""
        return sorted(identity for identity in self._payloads[kind] if identity.drone == drone)

    def beyond(self, drone: str, last: Callable[[str], int], boot: str | None = None) -> list[EntryId]:
        """Return a drone's entries with numbers greater than ``last`` of their boot (start of the agent), in the order of their
        identities.

        ``boot``: limits the result to that boot.
        """
        return sorted(
            identity
            for boot in (self._boots.get(drone, ()) if boot is None else (boot,))
            for sequence, identity in self._numbered[drone, boot].items()
            if sequence > last(boot)
        )

    def newest_ns(self, kind: type[Entry]) -> int:
        """Return the latest time stamp (ns) of the log's entries of a kind that count; 0 without any."""
        held, leaves_out = self._payloads[kind], self._counting.leaves_out
        newest = max(held, key=attrgetter("stamp_ns"), default=None)
        if newest is None or not leaves_out(kind, newest):
            return 0 if newest is None else newest.stamp_ns
        return max((one.stamp_ns for one in held if not leaves_out(kind, one)), default=0)

    def forget(self, identity: EntryId) -> bool:
        """Remove an entry that does not count any more; return whether it was in the log."""
        kind = self._kind_of(identity)
        if kind is None:
            return False
        self._sum = (self._sum - _hash(self._payloads[kind].pop(identity))) % _MODULUS
        self._revisions[kind] += 1
        publisher = identity.drone, identity.boot
        numbered = self._numbered[publisher]
        del numbered[identity.sequence]
        self._held[publisher].discard(identity.sequence)
        block = numbers_of(identity.sequence // BLOCK_ENTRIES)
        self._blocks.change(publisher, identity.sequence, empty=not any(number in numbered for number in block))
        self._counting.removed(identity)
        if not numbered:
            del self._numbered[publisher], self._held[publisher]
            if publisher not in self._contradictions:
                del self._boots[identity.drone][identity.boot]
        return True

    def summary(self, turn: int = 0) -> dict[Publisher, Held]:
        """Return a short description of the log's entries by publisher, from which another agent finds the entries that are
        missing here.

        A summary carries a limited number of publishers, each drone's in turn, so that a drone with many boots (starts of its
        agent) does not keep out the other drones. ``turn``: number of the summary; the next one has hashes of other blocks of
        entries.
        """
        turns = zip_longest(
            *([(drone, boot) for boot in islice(boots, MAX_SUMMARY_PUBLISHERS)] for drone, boots in sorted(self._boots.items()))
        )
        chosen = list(
            islice((publisher for turn in turns for publisher in turn if publisher is not None), MAX_SUMMARY_PUBLISHERS)
        )
        told: dict[Publisher, list[tuple[int, bytes]]] = {publisher: [] for publisher in chosen}
        for publisher, block in self._blocks.chosen(chosen, turn):
            told[publisher].append((block, self._blocks.hash(publisher, block)))
        return {publisher: self._told(publisher, tuple(blocks)) for publisher, blocks in told.items()}

    def _told(self, publisher: Publisher, blocks: tuple[tuple[int, bytes], ...]) -> Held:
        ranges = tuple(self._held.get(publisher, ()))
        found = self._contradictions.get(publisher)
        return Held(ranges, None if found is None else found.number, blocks)

    def missing_from(self, summary: Summary, most: int) -> list[tuple[EntryId, Record]]:
        """Return up to ``most`` entries of this log, as bytes, that are missing in a log with the given summary.

        First come entries that prove or show a contradiction, then some of every drone in turn, so that no drone's entries wait
        behind a drone with many. They come in the order of the sequence numbers, so that the cost follows from the result and the
        summary alone.
        """
        missing = list(islice(self._contradicting(summary), most))
        waiting = deque(self._lacked(drone, summary) for drone in sorted(self._boots))
        while waiting and len(missing) < most:
            records = waiting.popleft()
            found = list(islice(records, _TURN))
            missing += found
            if len(found) == _TURN:
                waiting.append(records)
        return missing[:most]

    def _lacked(self, drone: str, summary: Summary) -> Iterator[tuple[EntryId, Record]]:
        """Yield the missing records of a drone."""
        for boot in self._boots[drone]:
            publisher = drone, boot
            numbered, told = self._numbered[publisher], summary.get(publisher, Held())
            unwanted = () if told.cut is None else ((told.cut, _EVERYTHING),)
            for first, last in self._held.get(publisher, SequenceSet()).without(SequenceSet((*told.ranges, *unwanted))):
                for sequence in range(first, last + 1):
                    yield numbered[sequence], self.record(numbered[sequence])

    def _contradicting(self, summary: Summary) -> Iterator[tuple[EntryId, Record]]:
        """Yield the proofs missing at a peer; and entries held there in another version, with the rest of their block."""
        for publisher, told in summary.items():
            found = self._contradictions.get(publisher)
            if found is not None and told.ranges and told.ranges[-1][1] >= found.number:
                yield from ((record.entry.entry_id, record) for record in found.proof)
            held = SequenceSet(told.ranges)
            for block, hashed in told.blocks:
                if not self._blocks.held(publisher, block) or hashed == self._blocks.hash(publisher, block):
                    continue
                numbered, numbers = self._numbered[publisher], [number for number in numbers_of(block) if number in held]
                if all(number in numbered for number in numbers) and hashed != hash_of(
                    self.record(numbered[number]).payload for number in numbers
                ):
                    yield from ((numbered[number], self.record(numbered[number])) for number in numbers)

    def _payloads_of(self, publisher: Publisher, numbers: range) -> Iterator[tuple[int, bytes]]:
        """Return the numbers of the held entries among these, with their bytes."""
        numbered = self._numbered[publisher]
        return ((number, self.record(numbered[number]).payload) for number in numbers if number in numbered)


def _hash(payload: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(payload, digest_size=_DIGEST_BYTES).digest())
