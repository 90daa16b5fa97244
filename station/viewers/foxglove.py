"""Conversion of the station's data to Foxglove's messages, for an MCAP file and a live view alike."""

from __future__ import annotations

import json
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec
from foxglove.messages import Log, LogLevel

from radron.agent.frames.transform import Transform
from radron.agent.geometry import Vector3
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import Entry, Exposure
from radron.station.picture.frame import ConeCurve, DroneFrame, Event, Frame, Raster
from radron.station.picture.history import CONES_MS
from radron.station.picture.picture import Picture
from radron.station.viewers import topics
from radron.station.viewers.convert import (
    counts_table,
    drone_table,
    grid,
    planned,
    posed_in,
    source_table,
    spectrum_table,
    transforms,
)
from radron.station.viewers.onearth import OnEarth
from radron.station.viewers.scene import Scene, moment

SLOW_PERIOD_NS = 1_000_000_000  # interval of everything but poses and plans
AREA_NS = 2_000_000_000  # area and fence are repeated for later connections
SPECTRUM_NS = 10_000_000_000  # over which a spectrum is summed
TRAIL_POINTS = 60  # seconds
MAX_WAITING_EXPOSURES = 4096  # exposures between two calls
_LAYERS = {"belief": topics.POSTERIOR, "dose": topics.DOSE}
_TEXTS: dict[str, str] = json.loads((Path(__file__).parent.parent / "page" / "texts.en.json").read_text(encoding="utf-8"))
_encode_table = msgspec.json.Encoder().encode


class Encodable(Protocol):
    """A message object of Foxglove's library, which can encode itself."""

    def encode(self) -> bytes:
        """Return the message as Protocol Buffers bytes."""


class Message(NamedTuple):
    """A message for Foxglove on one topic (named stream).

    ``log_ns``: the station's time, nanoseconds UTC. ``content``: makes the content; called only for a subscriber, and at once.
    """

    topic: str
    log_ns: int
    content: Callable[[], Encodable | topics.Table]

    def encode(self) -> bytes:
        """Return the content as bytes: JSON for tables, else Protocol Buffers."""
        content = self.content()
        return _encode_table(content) if isinstance(content, topics.Table) else content.encode()


class Foxglove:
    """Converts the station's state of the swarm to messages that Foxglove can show. ``topics``: all possible topics."""

    def __init__(self, picture: Picture) -> None:
        self._picture = picture
        self._about = picture.about(replay=False)
        datum = picture.mission.datum
        self._earth = OnEarth(datum, self._about) if datum is not None else None
        self.topics = topics.topics(self._about.drones, datum is not None)
        self._ground = Ground.from_config(picture.mission)
        self._scene = Scene(self._ground)
        self._poses: dict[str, int] = {}  # stamp of the newest pose sent, by drone
        self._plans: dict[str, int] = {}
        self._trails: defaultdict[str, deque[Vector3]] = defaultdict(lambda: deque(maxlen=TRAIL_POINTS))
        self._cones: deque[ConeCurve] = deque()
        self._waiting: deque[Exposure] = deque(maxlen=MAX_WAITING_EXPOSURES)
        self._spectra: defaultdict[str, deque[Exposure]] = defaultdict(deque)
        self._slow_ns = self._area_ns = 0
        picture.on_entry.append(self._hear)

    def show(self, frame: Frame, layers: list[Raster], cones: list[ConeCurve]) -> Iterator[Message]:
        """Yield all messages about a state of the swarm; must be called with each state, and read to the end.

        ``layers`` and ``cones``: new raster layers of the map and new Compton cones.
        """
        now_ns = frame.at_ms * 1_000_000
        self._cones.extend(cones)
        while self._cones and self._cones[0].at_ms < frame.at_ms - CONES_MS:
            self._cones.popleft()
        for drone in frame.drones:
            yield from self._motion(drone, now_ns)
        while self._waiting:
            exposure = self._waiting.popleft()
            self._spectra[exposure.drone].append(exposure)
            yield Message(topics.COUNTS.format(exposure.drone), now_ns, partial(counts_table, exposure))
        for layer in layers:
            (x, y), half_m = layer.origin, 0.5 * layer.cell_m
            height_m = self._ground.height_m(x + half_m * layer.columns, y + half_m * layer.rows)
            yield Message(_LAYERS[layer.kind], now_ns, partial(grid, layer, height_m))
        if now_ns - self._area_ns >= AREA_NS:
            self._area_ns = now_ns
            yield Message(topics.AREA, now_ns, partial(self._scene.area, self._about, now_ns))
        if now_ns - self._slow_ns >= SLOW_PERIOD_NS:
            self._slow_ns = now_ns
            yield from self._seconds(frame, now_ns)

    def event(self, event: Event) -> Message:
        """Return an event of the timeline as a log message, in the words of the web page."""
        at_ns = event.at_ms * 1_000_000
        level = LogLevel.Warning if event.level == "warning" else LogLevel.Info
        text = _TEXTS.get(f"event {event.text}", event.text).format(**event.values)
        source = event.values.get("drone", "station")
        return Message(topics.EVENTS, at_ns, partial(Log, timestamp=moment(at_ns), level=level, message=text, name=source))

    def _hear(self, entry: Entry) -> None:
        if isinstance(entry, Exposure):
            self._waiting.append(entry)

    def _motion(self, drone: DroneFrame, now_ns: int) -> Iterator[Message]:
        """Yield new frames, pose and plan of a drone; the pose exactly as published by the drone."""
        member = self._picture.members[drone.id]
        pose = member.pose
        local = self._local(drone.id, pose.epoch) if pose is not None else None
        if pose is None or local is None:
            return
        if self._poses.get(drone.id) != pose.stamp_ns:
            self._poses[drone.id] = pose.stamp_ns
            yield Message(topics.TRANSFORMS, now_ns, partial(transforms, drone.id, local, pose))
            yield Message(topics.POSE.format(drone.id), now_ns, partial(posed_in, local, pose))
            if self._earth is not None:
                yield Message(topics.FIX.format(drone.id), now_ns, partial(self._earth.fix, drone, local, pose))
        plan = member.plan
        if plan is not None and plan.epoch == pose.epoch and self._plans.get(drone.id) != plan.stamp_ns:
            self._plans[drone.id] = plan.stamp_ns
            yield Message(topics.PLAN.format(drone.id), now_ns, partial(planned, local, plan))

    def _local(self, drone: str, epoch: int) -> Transform | None:
        return self._picture.members[drone].transform(epoch, self._picture.log.mission_from_local(drone, epoch))

    def _seconds(self, frame: Frame, now_ns: int) -> Iterator[Message]:
        for drone in frame.drones:
            if drone.place is not None:
                self._trails[drone.id].append(drone.place)
            yield Message(topics.STATE.format(drone.id), now_ns, partial(drone_table, drone))
            recent = self._spectra[drone.id]
            while recent and recent[0].end_ns < now_ns - SPECTRUM_NS:
                recent.popleft()
            if recent:
                yield Message(topics.SPECTRUM.format(drone.id), now_ns, partial(spectrum_table, recent))
        yield Message(topics.SWARM_SCENE, now_ns, partial(self._scene.drones, frame.drones, self._trails, now_ns))
        sources = [source for source in (frame.source, *frame.others) if source is not None]
        yield Message(topics.SOURCE_SCENE, now_ns, partial(self._scene.sources, sources, now_ns))
        yield Message(topics.CONES, now_ns, partial(self._scene.cones, self._cones, self._about.drones, now_ns))
        log = partial(topics.LogTable, entries=frame.entries, digest=frame.digest, finding=frame.finding)
        yield Message(topics.LOG, now_ns, log)
        if frame.source is not None:
            yield Message(topics.SOURCE, now_ns, partial(source_table, frame.source))
        for other in frame.others:
            yield Message(topics.OTHERS, now_ns, partial(source_table, other))
        if frame.search is not None:
            search = partial(topics.SearchTable, none=frame.search.none, excluded_bq=frame.search.excluded_bq)
            yield Message(topics.SEARCH, now_ns, search)
        if self._earth is not None:
            yield Message(topics.MAP, now_ns, partial(self._earth.outlines, sources))
            if frame.source is not None:
                yield Message(topics.SOURCE_FIX, now_ns, partial(self._earth.source_fix, frame.source, now_ns))
