"""The history behind the page's time slider: frames, layers, cones and events by their times, in their encoded form."""

from __future__ import annotations

import zlib
from bisect import bisect_right
from collections.abc import Iterator

import msgspec
from msgspec import Raw

from station.picture.frame import ConeCurve, Event, Frame
from station.picture.overview import Overview

FRAME_MS = 1000  # interval of the frames kept
RASTER_MS = 2000
LAYERS = ("belief", "dose", "spectra")
CONES_MS = 6000  # a cone is drawn for this time
MOST_CONES = 150  # drawn at a time
MOST_EVENTS = 2000
_BLOCK_MS = 1000  # duration of a block of cones, packed together
_encode = msgspec.json.Encoder().encode


class Track:
    """Messages kept in the order of their times, packed."""

    def __init__(self) -> None:
        self._at_ms: list[int] = []
        self._packed: list[bytes] = []

    def add(self, at_ms: int, data: bytes) -> None:
        """Keep a message not older than the last."""
        self._at_ms.append(at_ms)
        self._packed.append(zlib.compress(data, 1))

    def place(self, at_ms: int) -> int:
        """Return the index of the newest message at a time; -1 before the first."""
        return bisect_right(self._at_ms, at_ms) - 1

    def at(self, at_ms: int) -> bytes | None:
        """Return the newest message at a time; None before the first."""
        place = self.place(at_ms)
        return zlib.decompress(self._packed[place]) if place >= 0 else None

    def between(self, after_ms: int, until_ms: int) -> Iterator[bytes]:
        """Yield all messages in (after, until]."""
        return (zlib.decompress(data) for data in self._packed[self.place(after_ms) + 1 : self.place(until_ms) + 1])

    def is_due(self, at_ms: int, every_ms: int) -> bool:
        """Return whether the last message is at least as old as the interval."""
        return not self._at_ms or at_ms - self._at_ms[-1] >= every_ms


class History:
    """The history of a flight; an hour of 30 drones takes about 40 MB. ``overview``: the whole flight; ``events``: the newest."""

    def __init__(self, drones: int) -> None:
        """``drones``: number of drones."""
        self.overview = Overview(drones)
        self.last_ms = 0  # time of the newest frame
        self.events: list[Event] = []
        self._frames, self._cones = Track(), Track()
        self._block: list[tuple[int, Raw]] = []  # the newest block of cones: times of receipt, and JSON
        self._layers = {kind: Track() for kind in LAYERS}

    def add_frame(self, frame: Frame, data: bytes) -> bool:
        """Keep a frame (``data``: its JSON) if a frame is due; return whether it is kept."""
        if not self._frames.is_due(frame.at_ms, FRAME_MS):
            return False
        self._frames.add(frame.at_ms, data)
        self.overview.add(frame)
        self.last_ms = frame.at_ms
        return True

    def wants_rasters(self, at_ms: int) -> bool:
        """Return whether layers and spectra are due."""
        return self._layers["spectra"].is_due(at_ms, RASTER_MS)

    def add_layer(self, kind: str, at_ms: int, data: bytes) -> None:
        """Keep a layer, or the spectra, as JSON."""
        self._layers[kind].add(at_ms, data)

    def add_cone(self, cone: ConeCurve, at_ms: int) -> None:
        """Keep a cone received at that time."""
        if self._block and at_ms // _BLOCK_MS != self._block[-1][0] // _BLOCK_MS:
            self._cones.add(self._block[-1][0], _encode(self._block))
            self._block = []
        self._block.append((at_ms, Raw(_encode(cone))))

    def add_event(self, event: Event) -> None:
        """Keep an event."""
        self.events.append(event)
        del self.events[:-MOST_EVENTS]

    def frames(self) -> Iterator[Frame]:
        """All frames kept."""
        return (msgspec.json.decode(data, type=Frame) for data in self._frames.between(-1, self.last_ms))

    def frame(self, at_ms: int) -> bytes | None:
        """Return the frame at a time, as JSON; None before the first."""
        return self._frames.at(at_ms)

    def layers(self, at_ms: int, before_ms: int | None) -> dict[str, bytes | None]:
        """Return layers and spectra at a time by kind, as JSON or None; without the kinds unchanged since ``before_ms``."""
        changed = {
            kind: track
            for kind, track in self._layers.items()
            if before_ms is None or track.place(at_ms) != track.place(before_ms)
        }
        return {kind: track.at(at_ms) for kind, track in changed.items()}

    def cones(self, after_ms: int, until_ms: int) -> list[Raw]:
        """Return the cones received in (after, until], at most the newest ``MOST_CONES``; JSON each."""
        packed = self._cones.between(after_ms, until_ms + _BLOCK_MS)
        blocks = [*(msgspec.json.decode(data, type=list[tuple[int, Raw]]) for data in packed), self._block]
        return [cone for block in blocks for came_ms, cone in block if after_ms < came_ms <= until_ms][-MOST_CONES:]
