"""History of a flight for the web page's time slider: states of the swarm, map layers, cones and events in encoded form."""

from __future__ import annotations

import zlib
from bisect import bisect_right
from collections.abc import Iterator

import msgspec
from msgspec import Raw

from radron.station.picture.frame import ConeCurve, Event, Frame
from radron.station.picture.overview import Overview

FRAME_MS = 1000  # interval of the frames kept
RASTER_MS = 2000
LAYERS = ("belief", "dose", "spectra")
CONES_MS = 6000  # a cone is drawn for this time
MAX_DRAWN_CONES = 150  # drawn at a time
MAX_EVENTS = 2000
_BLOCK_MS = 1000  # duration of a block of cones, packed together
_encode = msgspec.json.Encoder().encode


class Track:
    """Stores messages in the order of their times, compressed."""

    def __init__(self) -> None:
        self._at_ms: list[int] = []
        self._packed: list[bytes] = []

    def add(self, at_ms: int, data: bytes) -> None:
        """Store a message that is not older than the last stored message."""
        self._at_ms.append(at_ms)
        self._packed.append(zlib.compress(data, 1))

    def place(self, at_ms: int) -> int:
        """Return the index of the newest message at a time (ms); -1 before the first message."""
        return bisect_right(self._at_ms, at_ms) - 1

    def at(self, at_ms: int) -> bytes | None:
        """Return the newest message at a time (ms); None before the first message."""
        place = self.place(at_ms)
        return zlib.decompress(self._packed[place]) if place >= 0 else None

    def between(self, after_ms: int, until_ms: int) -> Iterator[bytes]:
        """Yield all messages later than ``after_ms`` and not later than ``until_ms``."""
        return (zlib.decompress(data) for data in self._packed[self.place(after_ms) + 1 : self.place(until_ms) + 1])

    def is_due(self, at_ms: int, every_ms: int) -> bool:
        """Return whether the last stored message is at least ``every_ms`` old, so that a new one should be stored."""
        return not self._at_ms or at_ms - self._at_ms[-1] >= every_ms


class History:
    """Stores a whole flight so that web pages can look back in time; an hour of 30 drones takes about 40 MB.

    ``overview``: coarse course of the whole flight. ``events``: the newest events of the timeline.
    """

    def __init__(self, drones: int) -> None:
        """``drones``: number of drones."""
        self.overview = Overview(drones)
        self.last_ms = 0  # time of the newest frame
        self.events: list[Event] = []
        self._frames, self._cones = Track(), Track()
        self._block: list[tuple[int, Raw]] = []  # the newest block of cones: times of receipt, and JSON
        self._layers = {kind: Track() for kind in LAYERS}

    def add_frame(self, frame: Frame, data: bytes) -> bool:
        """Store a state of the swarm if the last stored state is old enough; return whether it was stored.

        ``data``: the state as JSON.
        """
        if not self._frames.is_due(frame.at_ms, FRAME_MS):
            return False
        self._frames.add(frame.at_ms, data)
        self.overview.add(frame)
        self.last_ms = frame.at_ms
        return True

    def wants_rasters(self, at_ms: int) -> bool:
        """Return whether new map layers and spectra should be stored."""
        return self._layers["spectra"].is_due(at_ms, RASTER_MS)

    def add_layer(self, kind: str, at_ms: int, data: bytes) -> None:
        """Store a map layer, or the spectra, as JSON."""
        self._layers[kind].add(at_ms, data)

    def add_cone(self, cone: ConeCurve, at_ms: int) -> None:
        """Store a Compton cone received at this time (ms)."""
        if self._block and at_ms // _BLOCK_MS != self._block[-1][0] // _BLOCK_MS:
            self._cones.add(self._block[-1][0], _encode(self._block))
            self._block = []
        self._block.append((at_ms, Raw(_encode(cone))))

    def add_event(self, event: Event) -> None:
        """Store an event of the timeline."""
        self.events.append(event)
        del self.events[:-MAX_EVENTS]

    def frames(self) -> Iterator[Frame]:
        """All stored states of the swarm, in the order of their times."""
        return (msgspec.json.decode(data, type=Frame) for data in self._frames.between(-1, self.last_ms))

    def frame(self, at_ms: int) -> bytes | None:
        """Return the state of the swarm at a time (ms) as JSON; None before the first state."""
        return self._frames.at(at_ms)

    def layers(self, at_ms: int, before_ms: int | None) -> dict[str, bytes | None]:
        """Return the map layers and spectra at a time (ms), by kind, each as JSON or None.

        Kinds that have not changed since ``before_ms`` are left out.
        """
        changed = {
            kind: track
            for kind, track in self._layers.items()
            if before_ms is None or track.place(at_ms) != track.place(before_ms)
        }
        return {kind: track.at(at_ms) for kind, track in changed.items()}

    def cones(self, after_ms: int, until_ms: int) -> list[Raw]:
        """Return the Compton cones received later than ``after_ms`` and not later than ``until_ms``, each as JSON.

        At most the newest ``MAX_DRAWN_CONES`` are returned.
        """
        packed = self._cones.between(after_ms, until_ms + _BLOCK_MS)
        blocks = [*(msgspec.json.decode(data, type=list[tuple[int, Raw]]) for data in packed), self._block]
        return [cone for block in blocks for came_ms, cone in block if after_ms < came_ms <= until_ms][-MAX_DRAWN_CONES:]
