"""Hashes of the blocks of each publisher's entries: they reveal logs with different entries of one number."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from hashlib import blake2b
from itertools import cycle, islice

from radron.protocol.summary import BLOCK_ENTRIES, HASH_BYTES, MAX_BLOCKS

Publisher = tuple[str, str]  # drone, boot
Payloads = Callable[[Publisher, range], Iterable[tuple[int, bytes]]]  # number and bytes of each entry in a range, in order


class Blocks:
    """Hashes of the log's entries in blocks of consecutive numbers, by publisher, which reveal that two logs differ.

    The hashes are computed when asked for. After growth at a block's end, only the new part is hashed. A hash covers the bytes in
    their order, unlike the log's digest, a sum. For sums a publisher could find two equal ones.
    """

    def __init__(self, payloads: Payloads) -> None:
        self._payloads = payloads
        self._hashes: dict[Publisher, dict[int, _Hash]] = {}

    def change(self, publisher: Publisher, number: int, *, empty: bool = False) -> None:
        """Note that a log entry (signed measurement) has been added, changed or removed; ``empty``: its block (range of numbers)
        has no entry any more.
        """
        blocks = self._hashes.setdefault(publisher, {})
        block = number // BLOCK_ENTRIES
        if empty:
            del blocks[block]
        elif block not in blocks or number < blocks[block].end:
            blocks[block] = _Hash(block)
        else:
            blocks[block].digest = None

    def held(self, publisher: Publisher, block: int) -> bool:
        """Return whether the log has any entry in a block (range of numbers) of a publisher."""
        return block in self._hashes.get(publisher, ())

    def chosen(self, publishers: Sequence[Publisher], turn: int) -> list[tuple[Publisher, int]]:
        """Return the blocks of log entries whose hashes go into a summary, as many as it can carry: others each turn, until all
        have gone.
        """
        every = [(publisher, block) for publisher in publishers for block in self._hashes.get(publisher, ())]
        if len(every) <= MAX_BLOCKS:
            return every
        start = turn * (MAX_BLOCKS - 1) % len(every)  # no multiple of the peers: each of them gets all blocks in time
        return list(islice(cycle(every), start, start + MAX_BLOCKS))

    def hash(self, publisher: Publisher, block: int) -> bytes:
        """Return the hash of the log's entries in a block (range of numbers) of a publisher; there must be one."""
        found = self._hashes[publisher][block]
        if found.digest is not None:
            return found.digest
        return found.extended(self._payloads(publisher, found.missing))


class _Hash:
    """The hash of a block: of the entries before ``end``. ``digest``: None if there may be more."""

    __slots__ = ("_last", "_whole", "digest", "end")

    def __init__(self, block: int) -> None:
        numbers = numbers_of(block)
        self._whole = blake2b(digest_size=HASH_BYTES)
        self.end, self._last = numbers.start, numbers.stop
        self.digest: bytes | None = None

    @property
    def missing(self) -> range:
        """The numbers of entries that may not be in the hash yet."""
        return range(self.end, self._last)

    def extended(self, payloads: Iterable[tuple[int, bytes]]) -> bytes:
        """Return the hash of all entries of the block, extended by ``missing`` entries."""
        for number, payload in payloads:
            _add(self._whole, payload)
            self.end = number + 1
        self.digest = self._whole.digest()
        return self.digest


def numbers_of(block: int) -> range:
    """Return the sequence numbers of the log entries that belong to a block."""
    return range(block * BLOCK_ENTRIES, (block + 1) * BLOCK_ENTRIES)


def hash_of(payloads: Iterable[bytes]) -> bytes:
    """Return one hash over several log entries, from their bytes in order."""
    whole = blake2b(digest_size=HASH_BYTES)
    for payload in payloads:
        _add(whole, payload)
    return whole.digest()


def _add(whole: blake2b, payload: bytes) -> None:
    whole.update(len(payload).to_bytes(4))  # otherwise two entries could be cut elsewhere
    whole.update(payload)
