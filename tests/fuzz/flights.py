"""Flight records, torn and with flipped bits: ``FlightRecordError``, or a flight that is read up to its first damage."""

from __future__ import annotations

from pathlib import Path
from random import Random

import msgpack
import msgspec
import numpy as np
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import RadronError
from radron.agent.flight.audit import audit
from radron.agent.flight.audit_command import lines
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.replay import replay
from radron.agent.flight.segment import Segment, segment_path
from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode, GnssFix, SeenDrone
from radron.protocol.codec import encode
from radron.protocol.codes import Code
from radron.protocol.keys import key_of
from radron.protocol.texts import CodedText
from support.flights.one_pilot import MISSION, SECOND, START_NS, command, cone_of, partner, state
from support.flights.recorded_flights import rewritten
from tests.fuzz.mutation import broken, broken_text, hostile, mutated
from tests.fuzz.target import Probe, Target, expect

_REPLAYED = 20  # of so many files one is replayed and audited
_HEADER = FlightHeader.of(MISSION, DroneConfig(id="d1"), "1" * 16, START_NS, nonce_key=b"")


class Flights(Target):
    """The record of a second of flight: its bytes, and the contents of its records."""

    name = "flights"
    inputs = 100_000
    batch = 20
    limit_s = 2.0

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._whole = _record(folder)
        self._example = self._whole.read_bytes()

    def case(self, rng: Random, probe: Probe) -> None:
        """A series of files, under the same name."""
        path = self.folder / "fuzzed" / self._whole.name
        path.parent.mkdir(exist_ok=True)
        for _ in range(self.batch):
            if rng.random() < 0.9:
                path.write_bytes(self._bytes(rng))
            else:
                path.unlink(missing_ok=True)
                rewritten(self._whole, path, lambda topic, data: _odd(rng, data) if rng.random() < 0.1 else data)
            probe.feed(path.read_bytes(), _read, path)
            if rng.randrange(_REPLAYED) == 0:
                probe.timed(_replay, path)
                probe.timed(_audit, path)

    def _bytes(self, rng: Random) -> bytes:
        pick, data = rng.random(), self._example
        if pick < 0.2:
            return data[: rng.randrange(len(data))]
        if pick < 0.3:  # in the header's document, without checksums
            begin, end = data.index(b'{"mission"'), data.index(b'"versions"')
            return data[:begin] + broken_text(rng, data[begin:end]) + data[end:]
        if pick < 0.5:  # in what comes first: lengths and kinds of records
            return broken(rng, data[:3000], [data]) + data[3000:]
        return broken(rng, data, [data])


def _read(path: Path) -> None:
    try:
        flight = RecordedFlight(path)
        records = sum(1 for _ in flight.records())
    except RadronError as error:
        expect(
            "\n" not in str(error) and path.name in str(error), f"an error of several lines or without file: {str(error)[:200]!r}"
        )
        return
    expect(flight.flaw is None or "\n" not in flight.flaw, f"a flaw of several lines: {flight.flaw!r}")
    expect(flight.read_bytes <= flight.size_bytes, f"more than all is read: {records} records")


def _replay(path: Path) -> None:
    try:
        replay(path)
    except RadronError:
        return


def _audit(path: Path) -> None:
    try:
        found = lines("d1", audit(RecordedFlight(path, whole=False)))
    except RadronError as error:
        expect(
            "\n" not in str(error) and path.name in str(error), f"an error of several lines or without file: {str(error)[:200]!r}"
        )
        return
    expect(not any("\n" in line for line in found), "a command of several lines")


def _odd(rng: Random, data: bytes) -> bytes | None:
    pick = rng.random()
    if pick < 0.2:
        return None
    if pick < 0.5:
        return broken(rng, data)
    try:
        document = msgspec.json.decode(data)
    except (msgspec.DecodeError, ValueError):
        return bytes(msgpack.packb(rng.choice(([], {}, [1, 2], ["a"], ["radron", 1], [b"a", b"b"], None, ["a", b"b", 1]))))
    return msgspec.json.encode(mutated(rng, document, lambda rng: rng.choice((hostile(rng), None, rng.random()))))


class _Into:
    """A sink that writes at once, so that the file is the same each time."""

    def __init__(self, segment: Segment) -> None:
        self._segment = segment
        self._sequence = 0

    def write(self, topic: str, data: bytes, log_ns: int | None = None) -> None:
        stamp_ns = START_NS + self._sequence * 1_000_000
        self._segment.write(topic, data, stamp_ns if log_ns is None else log_ns, stamp_ns, self._sequence)
        self._sequence += 1


def _record(folder: Path) -> Path:
    """A second of a flight with every kind of input."""
    path = segment_path(folder, _HEADER, 0)
    path.unlink(missing_ok=True)
    segment = Segment(path, _HEADER, 0)
    pilot = RecordedPilot(Pilot(MISSION, DroneConfig(id="d1"), _HEADER.boot, nonce_key=b""), _Into(segment))
    pilot.observe_vehicle(state(START_NS))
    pilot.receive(*command(), START_NS)
    pilot.step(START_NS)
    for tick in range(1, 20):
        now_ns = START_NS + tick * SECOND // 20
        pilot.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, position=(0.1 * tick, 0.0, 3.0)))
        for message in partner(now_ns):
            pilot.receive(key_of(MISSION.swarm, message), encode(message), now_ns)
        cone = replace(cone_of("d2", tick, now_ns), mission=MISSION.mission_id)
        pilot.receive(key_of(MISSION.swarm, cone), encode(cone), now_ns)
        if tick % 4 == 0:
            _sense(pilot, tick, now_ns)
        pilot.step(now_ns)
    segment.close()
    return path


def _sense(pilot: RecordedPilot, tick: int, now_ns: int) -> None:
    hits = PixelHits(np.arange(40, dtype=np.int64) * 1000, np.arange(40, dtype=np.uint16), np.full(40, 20, np.uint16))
    pilot.observe_detector(Readout(now_ns - SECOND // 5, now_ns, now_ns - SECOND // 5, 0.2, hits))
    pilot.observe_fix(
        GnssFix(
            stamp_ns=now_ns, latitude_deg=50.0, longitude_deg=14.0, altitude_m=300.0, horizontal_sigma_m=1.0, vertical_sigma_m=2.0
        )
    )
    pilot.observe_sightings([SeenDrone(stamp_ns=now_ns, target="d2", range_m=10.0 + tick, range_sigma_m=0.1)])
    pilot.warn((CodedText(Code.NO_CONTACT, f"tick {tick}", "d2"),))
    pilot.block(())
    pilot.log_answer(pilot.log_summary())
    pilot.advance(now_ns)
