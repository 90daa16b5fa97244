"""Conversion of flight records to an MCAP file that Foxglove opens."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import BinaryIO

from mcap.writer import CompressionType, Writer

from radron.agent.errors import FlightRecordError
from radron.agent.outputs import replacing
from radron.station.hub import Hub
from radron.station.picture.frame import ConeCurve, Event, Frame, Raster
from radron.station.picture.picture import Picture
from radron.station.replay import Records, play
from radron.station.viewers.foxglove import Foxglove, Message
from radron.station.viewers.layout import layout
from radron.station.viewers.topics import Topic

STEP_MS = 100  # interval of the frames, equal to the drones' poses


def export(paths: Sequence[Path], out: Path, progress: Callable[[float], None]) -> tuple[list[Path], tuple[str, ...]]:
    """Convert the flight records of one mission to one MCAP file for Foxglove, and write a layout of panels beside it.

    Returns:
        Both paths, and the reasons why records could not be read to their ends.

    Raises:
        FlightRecordError: records are unreadable, or of several missions; or the new file would replace a record.
        OSError: the file cannot be written.
    """
    records = Records(paths)
    if out.resolve() in {file.resolve() for file in records.files}:
        raise FlightRecordError(f"{out}: is one of the records; give another name")
    picture = Picture(records.mission, records.verifier, judges_exposures=records.judges_exposures)
    hub = Hub(picture, replay=True, progress=progress)
    foxglove = Foxglove(hub.picture)
    with replacing(out) as written, written.open("wb") as file:
        recording = _Recording(file, foxglove)
        hub.outlets.append(recording)
        asyncio.run(play(hub, records, STEP_MS))
        recording.close()
    beside = out.with_suffix(".layout.json")
    with replacing(beside) as written:
        written.write_text(layout(hub.picture.about(replay=True)), encoding="utf-8")
    return [out, beside], records.flaws


class _Recording:
    """Writes the hub's frames and events to a file."""

    def __init__(self, file: BinaryIO, foxglove: Foxglove) -> None:
        self._foxglove = foxglove
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="radron")
        schemas: dict[str, int] = {}
        self._channels = {topic.name: self._register(topic, schemas) for topic in foxglove.topics}
        self._sequence = 0

    def show(self, frame: Frame, layers: list[Raster], cones: list[ConeCurve]) -> None:
        for message in self._foxglove.show(frame, layers, cones):
            self._write(message)

    def note(self, event: Event) -> None:
        self._write(self._foxglove.event(event))

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _register(self, topic: Topic, schemas: dict[str, int]) -> int:
        schema = topic.schema
        if schema.name not in schemas:
            schemas[schema.name] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        return self._writer.register_channel(topic.name, topic.encoding, schemas[schema.name])

    def _write(self, message: Message) -> None:
        self._sequence += 1
        channel = self._channels[message.topic]
        self._writer.add_message(channel, message.log_ns, message.encode(), message.log_ns, self._sequence)
