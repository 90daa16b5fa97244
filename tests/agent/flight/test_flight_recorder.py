"""The recorder keeps its limits, survives disk errors, and never delays the flight."""

import errno
import random
import resource
import shutil
import struct
import time
from base64 import b64encode
from contextlib import suppress
from types import SimpleNamespace

import msgspec
import numpy as np
import psutil
import pytest
from mcap.opcode import Opcode
from msgspec.structs import replace

import radron.agent.flight.recorder
from radron.agent.errors import FlightRecordError
from radron.agent.flight import topics
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import replay
from radron.agent.flight.segment import Segment
from radron.agent.fusion.estimator import Hypothesis
from support.flights.recorded_flights import HEADER, telemetry

NOISE = random.Random(1).randbytes(3_000_000)  # does not compress


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr(radron.agent.flight.recorder, "WRITE_S", 0.01)


def until(condition, deadline_s=10.0):
    end_s = time.monotonic() + deadline_s
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def size_of(folder):
    total = 0
    for file in folder.glob("*.mcap"):
        with suppress(FileNotFoundError):  # removed by the recorder's thread meanwhile
            total += file.stat().st_size
    return total


def test_the_folder_stays_within_its_limit_and_the_oldest_go_first(tmp_path):
    other = tmp_path / "d1-20200101T000000Z-0000000000000001-0000.mcap"
    other.write_bytes(NOISE)
    recorder = FlightRecorder(tmp_path, 5, HEADER)
    largest = 0
    for count in range(160):
        recorder.write(topics.MESSAGE, NOISE[count * 7 : count * 7 + 100_000])
        until(lambda: not recorder._waiting)
        largest = max(largest, size_of(tmp_path))
    recorder.close()
    assert 4_000_000 < largest < 5_500_000  # a chunk and an index over the limit
    assert not other.exists()
    assert recorder.problems == ()
    with pytest.raises(FlightRecordError, match="its first file was removed to keep the folder within its limit"):
        replay(tmp_path)


def test_segments_of_one_flight_are_read_as_one(tmp_path):
    folder = tmp_path / "flight"
    (tmp_path / "made").mkdir()
    recorder = FlightRecorder(folder, 8, HEADER)
    pilot = RecordedPilot(HEADER.pilot(tmp_path / "made"), recorder)
    for count in range(50):
        pilot.receive("radron/2/radron/d1/pose", NOISE[count * 60_000 :][:60_000], 10**18 + count)
        pilot.observe_vehicle(telemetry(10**18 + count))
        pilot.step(10**18 + count)
        until(lambda: not recorder._waiting)
    recorder.close()
    files = sorted(folder.iterdir())
    assert len(files) == 2
    for path in (folder, *files):
        report = replay(path)
        assert (report.files, report.calls[topics.STEP], report.identical) == (2, 50, True)


def test_a_length_with_a_flipped_bit_is_damage_and_takes_no_memory(tmp_path):
    recorder = FlightRecorder(tmp_path, 8, HEADER)
    recorder.write(topics.VEHICLE, b"{}")
    recorder.close()
    (file,) = tmp_path.glob("*.mcap")
    data = bytearray(file.read_bytes())
    data[data.rindex(topics.VEHICLE.encode()) - 1] ^= 0x80  # of the topic in the index at the file's end: 2 GB
    file.write_bytes(data)
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + 1_000_000_000, before[1]))
    try:
        flight = RecordedFlight(file)
        assert [record.data for record in flight.records()] == [b"{}"]
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert flight.flaw == f"{file.name} is damaged: EndOfFile"


def test_a_length_that_no_memory_has_is_damage(tmp_path):
    file = tmp_path / "d1-0000.mcap"
    chunk = struct.pack("<QQQIIQ", 0, 0, 0, 0, 0, 1 << 63)
    file.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", Opcode.CHUNK, len(chunk)) + chunk)
    with pytest.raises(FlightRecordError, match=r"^\S*d1-0000.mcap: not a recorded flight: .*integer"):
        RecordedFlight(file)


def test_a_full_disk_is_reported_and_the_recording_goes_on_when_there_is_room(tmp_path, monkeypatch):
    full = False

    class Disk(Segment):
        def write(self, *record):
            if full:
                raise OSError(errno.ENOSPC, "No space left on device")
            super().write(*record)

    monkeypatch.setattr(radron.agent.flight.recorder, "Segment", Disk)
    monkeypatch.setattr(radron.agent.flight.recorder, "RETRY_S", 0.3)
    recorder = FlightRecorder(tmp_path, 100, HEADER)
    recorder.write(topics.WARN, b"[]")
    until(lambda: not recorder._waiting)
    full = True
    recorder.write(topics.WARN, b'["lost"]')
    until(lambda: recorder.problems)
    assert recorder.problems == (f"flight records are being lost: No space left on device ({tmp_path})",)
    full = False
    until(lambda: not recorder.problems)
    recorder.write(topics.WARN, b'["found"]')
    recorder.close()
    flight = RecordedFlight(sorted(tmp_path.iterdir())[0])
    assert [record.data for record in flight.records()] == [b"[]"]
    assert "records are missing" in flight.flaw


def test_a_folder_removed_in_flight_is_told_and_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(radron.agent.flight.recorder, "FLUSH_S", 0.02)
    folder = tmp_path / "flights"
    recorder = FlightRecorder(folder, 100, HEADER)
    recorder.write(topics.WARN, b"[]")
    shutil.rmtree(folder)
    until(lambda: recorder.problems)
    assert "the file has been removed" in recorder.problems[0]
    monkeypatch.setattr(radron.agent.flight.recorder, "RETRY_S", 0.0)
    until(lambda: not recorder.problems)
    recorder.write(topics.WARN, b"[]")
    recorder.close()
    assert len(list(folder.glob("*.mcap"))) == 1


def test_a_file_that_cannot_be_begun_is_not_left_behind(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Segment, "flush", refuse)
    with pytest.raises(FlightRecordError, match="No space left on device"):
        FlightRecorder(tmp_path, 100, HEADER)
    assert list(tmp_path.iterdir()) == []


def test_a_stalled_disk_costs_records_but_no_time_and_no_memory(tmp_path, monkeypatch):
    monkeypatch.setattr(radron.agent.flight.recorder, "MOST_WAITING_BYTES", 1_000_000)
    monkeypatch.setattr(radron.agent.flight.recorder, "WRITE_S", 60.0)  # a writer that does not come round
    recorder = FlightRecorder(tmp_path, 100, HEADER)
    for _ in range(100):
        recorder.write(topics.MESSAGE, NOISE[:100_000])
    assert recorder.counters["records_lost"] > 80
    assert sum(len(record.data) for record in recorder._waiting) < 1_200_000
    assert recorder.problems == (f"flight records are being lost: the disk is too slow ({tmp_path})",)
    recorder.close()
    assert recorder.problems == ()


def test_closing_takes_no_time_and_ends_the_thread(tmp_path):
    recorder = FlightRecorder(tmp_path, 100, HEADER)
    recorder.write(topics.WARN, b"[]")
    began_s = time.monotonic()
    recorder.close()
    assert time.monotonic() - began_s < 1.0
    assert not recorder._thread.is_alive()
    recorder.write(topics.WARN, b"[]")  # after the end: neither kept nor raised
    flight = RecordedFlight(tmp_path)
    assert (len(list(flight.records())), flight.truncated) == (1, False)


def test_a_folder_that_cannot_be_written_to(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FlightRecordError, match=r"flight records cannot be written: .*; see recorder.folder in the drone file"):
        FlightRecorder(tmp_path / "file", 100, HEADER)


class Kept(list):
    def write(self, topic, data, log_ns=None):
        self.append((topic, data))


def test_an_exception_of_the_pilot_is_recorded_and_passed_on():
    class Failing:
        hypothesis = None

        def step(self, now_ns):
            raise ValueError("as it happened")

    kept = Kept()
    with pytest.raises(ValueError, match="as it happened"):
        RecordedPilot(Failing(), kept).step(5)
    assert kept == [(topics.STEP, b"{}"), (topics.ERROR, b'"ValueError: as it happened"')]


def test_a_hypothesis_that_comes_out_again_as_before_is_recorded_once():
    """Computed again it is another object, or, shared by agents in lockstep, the same: the record must not tell (1070129)."""
    fusion = SimpleNamespace(hypothesis_digest="0" * 32)
    pilot = SimpleNamespace(advance=lambda now_ns: None, fusion=fusion, hypothesis=None)
    kept = Kept()
    recorded = RecordedPilot(pilot, kept)
    for x in (1.0, 1.0, 2.0, 1.0):
        pilot.hypothesis = Hypothesis(0, np.array([x, 2.0, 0.0]), np.eye(3), np.zeros(3), 0, 0, 1e9, 1e8)
        recorded.advance(5)
    told = [msgspec.json.decode(data)["position_m"][0] for topic, data in kept if topic == topics.HYPOTHESIS]
    assert told == [1.0, 2.0, 1.0]


def test_the_header_brings_everything_the_pilot_was_made_of(tmp_path):
    texts = {f"{name}.txt": "\n".join([" ".join(["1.5"] * 256)] * 256) for name in "abct"} | {"drift.txt": "71.5\n"}
    calibration = tmp_path / "camera"
    calibration.mkdir()
    for name, text in texts.items():
        (calibration / name).write_text(text)
    drone = replace(HEADER.drone, calibration=str(calibration))
    header = type(HEADER).of(HEADER.mission, drone, HEADER.boot, HEADER.started_ns, nonce_key=b"drawn")
    recorder = FlightRecorder(tmp_path / "flight", 100, header)
    recorder.close()
    for file in calibration.iterdir():
        file.unlink()
    read = RecordedFlight(tmp_path / "flight").header
    assert read == header
    assert read.calibration == texts
    (tmp_path / "made").mkdir()
    assert read.pilot(tmp_path / "made").digest == "0" * 32
    assert {file.name for file in (tmp_path / "made").iterdir()} == set(texts)


def test_the_header_brings_a_configuration_of_pixet(tmp_path):
    constants = {"caliba": 1.6, "calibb": 24.0, "calibc": 60.0, "calibt": 1.8}
    body = "".join(f"<{name}>{b64encode(np.full(65536, value).tobytes()).decode()}</{name}>" for name, value in constants.items())
    file = tmp_path / "camera.xml"
    file.write_text(f"<xml><chip>{body}</chip></xml>")
    drone = replace(HEADER.drone, calibration=str(file))
    header = type(HEADER).of(HEADER.mission, drone, HEADER.boot, HEADER.started_ns, nonce_key=b"drawn")
    assert list(header.calibration) == ["camera.xml"]
    (tmp_path / "made").mkdir()
    assert header.pilot(tmp_path / "made").digest == "0" * 32
