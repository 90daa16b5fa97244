"""A disk for QEMU (by the NBD protocol) that loses its power at a chosen write.

Like a real disk, the model has a cache: writes since the last flush are lost with the power, or not, block by block. Writes
stay in memory: any number of computers can begin from one file, and from each other's content.
Written by hand: QEMU's own block layer can neither stop at a write by its content nor lose its cache.
"""

from __future__ import annotations

import os
import random
import socket
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

BLOCK_BYTES = 4096  # written as a whole or not at all
_ZEROS = bytes(BLOCK_BYTES)
_OPTION_REPLY, _REQUEST, _REPLY = 0x3E889045565A9, 0x25609513, 0x67446698
_ABORT, _GO = 2, 7  # options
_INFO, _ACKNOWLEDGED, _UNSUPPORTED = 3, 1, 0x80000001  # their replies
_READ, _WRITE, _DISCONNECT, _FLUSH, _ZERO = 0, 1, 2, 3, 6  # commands
_FEATURES = 0b1000101  # of the export: this is a field of features; with flush, and with writing of zeros


class Moment(Enum):
    """When the power goes, at a write: before it, while it is only in the cache, once it has been flushed."""

    BEFORE = "before"
    CACHED = "cached"
    FLUSHED = "flushed"


@dataclass(frozen=True, slots=True)
class Content:
    """Blocks written over the file, by number: for good, and into the cache."""

    stored: dict[int, bytes] = field(default_factory=dict)
    cached: dict[int, bytes] = field(default_factory=dict)


class CutDisk:
    """A disk, and the socket ``at`` by which QEMU finds the disk. ``seed``: decides which blocks of the cache survive."""

    def __init__(self, file: Path, at: Path, seed: str, content: Content) -> None:
        self._at, self._random = at, random.Random(seed)
        self._base = os.open(file, os.O_RDONLY | os.O_CLOEXEC)
        self._stored, self._cached = dict(content.stored), dict(content.cached)
        self._lock = threading.Lock()
        self._place = range(0)
        self._wanted: Callable[[bytes], bool] = any
        self._moment: Moment | None = None
        self.met = threading.Event()  # the awaited write has happened, or is about to
        self.cut = threading.Event()  # the power is gone
        at.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(at))
        self._listener.listen(1)
        threading.Thread(target=self._serve, daemon=True).start()

    @property
    def drive(self) -> str:
        """For QEMU's option ``-drive``."""
        return f"nbd:unix:{self._at}"

    def watch(self, place: range, wanted: Callable[[bytes], bool], moment: Moment | None = None) -> None:
        """Set ``met`` at the first write after which the bytes at ``place`` are as wanted; lose the power there (None: no)."""
        with self._lock:
            self._place, self._wanted, self._moment = place, wanted, moment
            self.met.clear()

    def lose_power(self) -> None:
        """Lose the power now. The computer gets no answer any more."""
        with self._lock:
            self._lose_power()

    def content(self) -> Content:
        """The present content as written."""
        with self._lock:
            return Content(dict(self._stored), dict(self._cached))

    def read(self, place: range) -> bytes:
        """The content that a computer reads there."""
        with self._lock:
            return self._read(place.start, len(place))

    def close(self) -> None:
        """End; also its memory is free."""
        self._listener.close()
        os.close(self._base)
        self._stored, self._cached = {}, {}

    def _lose_power(self) -> None:
        if not self.cut.is_set():
            self._stored |= {number: data for number, data in self._cached.items() if self._random.random() < 0.5}
            self._cached = {}
            self.cut.set()

    def _read(self, start: int, length: int) -> bytes:
        first, last = start // BLOCK_BYTES, (start + length - 1) // BLOCK_BYTES
        data = bytearray(os.pread(self._base, (last - first + 1) * BLOCK_BYTES, first * BLOCK_BYTES))
        for number in range(first, last + 1):
            block = self._cached.get(number) or self._stored.get(number)
            if block is not None:
                data[(number - first) * BLOCK_BYTES : (number - first + 1) * BLOCK_BYTES] = block
        begin = start - first * BLOCK_BYTES
        return bytes(data[begin : begin + length])

    def _write(self, start: int, data: bytes) -> None:
        first, last = start // BLOCK_BYTES, (start + len(data) - 1) // BLOCK_BYTES
        whole = bytearray(self._read(first * BLOCK_BYTES, (last - first + 1) * BLOCK_BYTES))
        begin = start - first * BLOCK_BYTES
        whole[begin : begin + len(data)] = data
        blocks = {number: bytes(whole[i * BLOCK_BYTES :][:BLOCK_BYTES]) for i, number in enumerate(range(first, last + 1))}
        watched = not self.met.is_set() and start < self._place.stop and start + len(data) > self._place.start
        before = {number: self._cached.get(number) for number in blocks} if watched else {}
        self._cached.update(blocks)
        if watched and self._wanted(self._read(self._place.start, len(self._place))):
            self.met.set()
            if self._moment is Moment.BEFORE:
                self._cached = {number: data for number, data in (self._cached | before).items() if data is not None}
            if self._moment in (Moment.BEFORE, Moment.CACHED):
                self._lose_power()

    def _zero(self, start: int, length: int) -> None:
        """Write zeros. Whole blocks are one object: a new file system begins with zeros everywhere."""
        first, end = -(-start // BLOCK_BYTES), (start + length) // BLOCK_BYTES
        if first >= end:
            return self._write(start, bytes(length))
        self._cached.update(dict.fromkeys(range(first, end), _ZEROS))
        for begin, stop in ((start, first * BLOCK_BYTES), (end * BLOCK_BYTES, start + length)):
            if begin < stop:
                self._write(begin, bytes(stop - begin))

    def _flush(self) -> None:
        self._stored |= self._cached
        self._cached = {}
        if self.met.is_set() and self._moment is Moment.FLUSHED:
            self._lose_power()

    def _serve(self) -> None:
        with suppress(OSError):  # it is closed
            while True:
                connection, _ = self._listener.accept()
                with connection, suppress(ConnectionError):
                    self._greet(connection)
                    while self._answer(connection):
                        pass

    def _greet(self, connection: socket.socket) -> None:
        """Negotiate: the only export is this disk."""
        connection.sendall(b"NBDMAGICIHAVEOPT" + struct.pack(">H", 3))
        _receive(connection, 4)
        while True:
            _, option, length = struct.unpack(">8sII", _receive(connection, 16))
            _receive(connection, length)

            def reply(kind: int, data: bytes = b"", option: int = option) -> None:
                connection.sendall(struct.pack(">QIII", _OPTION_REPLY, option, kind, len(data)) + data)

            if option == _GO:
                reply(_INFO, struct.pack(">HQH", 0, os.fstat(self._base).st_size, _FEATURES))
                reply(_ACKNOWLEDGED)
                return
            reply(_ACKNOWLEDGED if option == _ABORT else _UNSUPPORTED)

    def _answer(self, connection: socket.socket) -> bool:
        """Carry out one request; False: it was the last one."""
        magic, _, kind, cookie, start, length = struct.unpack(">IHHQQI", _receive(connection, 28))
        assert magic == _REQUEST
        given, read = _receive(connection, length) if kind == _WRITE else b"", b""
        with self._lock:
            if kind == _READ:
                read = self._read(start, length)
            elif kind == _WRITE:
                self._write(start, given)
            elif kind == _ZERO:
                self._zero(start, length)
            elif kind == _FLUSH:
                self._flush()
        if self.cut.is_set():
            while connection.recv(BLOCK_BYTES):  # until the computer is off, too
                pass
        if kind == _DISCONNECT or self.cut.is_set():
            return False
        connection.sendall(struct.pack(">IIQ", _REPLY, 0, cookie) + read)
        return True


def _receive(connection: socket.socket, length: int) -> bytes:
    data = bytearray()
    while len(data) < length:
        part = connection.recv(length - len(data))
        if not part:
            raise ConnectionError
        data += part
    return bytes(data)
