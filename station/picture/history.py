"""What the page can go back to: frames, layers, cones and events by their times, as they are sent."""

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
CONES_MS = 6000  # cones are drawn for so long
MOST_CONES = 150  # drawn at a time
MOST_EVENTS = 2000
_BLOCK_MS = 1000  # of cones that are packed together
_encode = msgspec.json.Encoder().encode


class Track:
    """Things kept in the order of their times, packed."""

    def __init__(self) -> None:
        self._at_ms: list[int] = []
        self._packed: list[bytes] = []

    def add(self, at_ms: int, data: bytes) -> None:
        """Keep something that is not older than the last one."""
        self._at_ms.append(at_ms)
        self._packed.append(zlib.compress(data, 1))

    def place(self, at_ms: int) -> int:
        """Number of the newest at a time; -1 before the first."""
        return bisect_right(self._at_ms, at_ms) - 1

    def at(self, at_ms: int) -> bytes | None:
        """The newest at a time; None before the first."""
        place = self.place(at_ms)
        return zlib.decompress(self._packed[place]) if place >= 0 else None

    def between(self, after_ms: int, until_ms: int) -> Iterator[bytes]:
        """All in (after, until]."""
        return (zlib.decompress(data) for data in self._packed[self.place(after_ms) + 1 : self.place(until_ms) + 1])

    def is_due(self, at_ms: int, every_ms: int) -> bool:
        """Whether the last one is as old as that."""
        return not self._at_ms or at_ms - self._at_ms[-1] >= every_ms


class History:
    """Of 30 drones, an hour takes about 40 MB. ``overview``: of the whole flight; ``events``: the newest."""

    def __init__(self, drones: int) -> None:
        """``drones``: their number."""
        self.overview = Overview(drones)
        self.last_ms = 0  # time of the newest frame
        self.events: list[Event] = []
        self._frames, self._cones = Track(), Track()
        self._block: list[tuple[int, Raw]] = []  # of cones, the newest: times when they came, and JSON
        self._layers = {kind: Track() for kind in LAYERS}

    def add_frame(self, frame: Frame, data: bytes) -> bool:
        """Keep a frame, which is ``data`` as JSON, if one is due; whether it is kept."""
        if not self._frames.is_due(frame.at_ms, FRAME_MS):
            return False
        self._frames.add(frame.at_ms, data)
        self.overview.add(frame)
        self.last_ms = frame.at_ms
        return True

    def wants_rasters(self, at_ms: int) -> bool:
        """Whether layers and spectra are due."""
        return self._layers["spectra"].is_due(at_ms, RASTER_MS)

    def add_layer(self, kind: str, at_ms: int, data: bytes) -> None:
        """Keep a layer, or the spectra, as JSON."""
        self._layers[kind].add(at_ms, data)

    def add_cone(self, cone: ConeCurve, at_ms: int) -> None:
        """Keep a cone that came at that time."""
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
        """What was to be seen at a time, as JSON."""
        return self._frames.at(at_ms)

    def layers(self, at_ms: int, before_ms: int | None) -> dict[str, bytes | None]:
        """Layers and spectra at a time, as JSON, None where there was none; without those that were the same at ``before_ms``."""
        changed = {
            kind: track
            for kind, track in self._layers.items()
            if before_ms is None or track.place(at_ms) != track.place(before_ms)
        }
        return {kind: track.at(at_ms) for kind, track in changed.items()}

    def cones(self, after_ms: int, until_ms: int) -> list[Raw]:
        """The cones that came in (after, until], the newest ``MOST_CONES`` of them; JSON each."""
        packed = self._cones.between(after_ms, until_ms + _BLOCK_MS)
        blocks = [*(msgspec.json.decode(data, type=list[tuple[int, Raw]]) for data in packed), self._block]
        return [cone for block in blocks for came_ms, cone in block if after_ms < came_ms <= until_ms][-MOST_CONES:]
