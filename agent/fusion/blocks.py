"""Hashes of the blocks of each publisher's entries: by these, logs find out that they hold different entries of one number."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from hashlib import blake2b
from itertools import cycle, islice

from protocol.summary import BLOCK, HASH_BYTES, MOST_BLOCKS

Publisher = tuple[str, str]  # drone, boot
Payloads = Callable[[Publisher, range], Iterable[tuple[int, bytes]]]  # of the entries with these numbers, in order, with them


class Blocks:
    """The blocks of which a log holds anything, with their hashes, computed when they are asked for: of one that has grown at its
    end, only what is new.

    A hash over the bytes in their order, and no sum as the log's digest: of sums a publisher could find two that are equal.
    """

    def __init__(self, payloads: Payloads) -> None:
        self._payloads = payloads
        self._hashes: dict[Publisher, dict[int, _Hash]] = {}

    def change(self, publisher: Publisher, number: int, *, empty: bool = False) -> None:
        """What is held under a number has changed; ``empty``: nothing of its block is held any more."""
        blocks = self._hashes.setdefault(publisher, {})
        block = number // BLOCK
        if empty:
            del blocks[block]
        elif block not in blocks or number < blocks[block].end:
            blocks[block] = _Hash(block)
        else:
            blocks[block].digest = None

    def held(self, publisher: Publisher, block: int) -> bool:
        """Whether anything of a block is held."""
        return block in self._hashes.get(publisher, ())

    def chosen(self, publishers: Sequence[Publisher], turn: int) -> list[tuple[Publisher, int]]:
        """As many blocks as a summary carries: each turn others, until all have been told."""
        every = [(publisher, block) for publisher in publishers for block in self._hashes.get(publisher, ())]
        if len(every) <= MOST_BLOCKS:
            return every
        start = turn * (MOST_BLOCKS - 1) % len(every)  # no multiple of the peers: each of them gets all blocks in time
        return list(islice(cycle(every), start, start + MOST_BLOCKS))

    def hash(self, publisher: Publisher, block: int) -> bytes:
        """The hash of a block held."""
        found = self._hashes[publisher][block]
        if found.digest is not None:
            return found.digest
        return found.extended(self._payloads(publisher, found.missing))


class _Hash:
    """The hash of a block: of the entries before ``end``. ``digest``: None where there may be more."""

    __slots__ = ("_last", "_whole", "digest", "end")

    def __init__(self, block: int) -> None:
        numbers = numbers_of(block)
        self._whole = blake2b(digest_size=HASH_BYTES)
        self.end, self._last = numbers.start, numbers.stop
        self.digest: bytes | None = None

    @property
    def missing(self) -> range:
        """The numbers of the entries that are not in it yet, as far as there are any."""
        return range(self.end, self._last)

    def extended(self, payloads: Iterable[tuple[int, bytes]]) -> bytes:
        """The hash of all entries of the block: with those that were ``missing``."""
        for number, payload in payloads:
            _add(self._whole, payload)
            self.end = number + 1
        self.digest = self._whole.digest()
        return self.digest


def numbers_of(block: int) -> range:
    """The sequence numbers of a block."""
    return range(block * BLOCK, (block + 1) * BLOCK)


def hash_of(payloads: Iterable[bytes]) -> bytes:
    """The hash of entries, from their bytes."""
    whole = blake2b(digest_size=HASH_BYTES)
    for payload in payloads:
        _add(whole, payload)
    return whole.digest()


def _add(whole: blake2b, payload: bytes) -> None:
    whole.update(len(payload).to_bytes(4))  # else two entries could be cut elsewhere
    whole.update(payload)
