"""Recorded flights replay with identical results, and any difference is found."""

import os
import signal
import subprocess
import sys
from contextlib import closing

import msgspec
import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.errors import FlightRecordError
from radron.agent.flight import topics
from radron.agent.flight.audit import audit
from radron.agent.flight.command import run_replay
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import replay
from radron.agent.mission.commanding import Verdict
from radron.protocol.codec import decode_from
from radron.protocol.codes import Code
from radron.protocol.messages import Action, Status
from radron.protocol.texts import CodedText
from radron.sim.lockstep.members import SimulatedAuthority, SimulatedOperator
from support import PATH
from support.flights import recorded_flights
from support.flights.one_pilot import START_NS, TICK_NS, state
from support.flights.recorded_flights import HEADER, MISSION, fly_recorded, rewritten, telemetry

ZSTD_FRAME = b"\x28\xb5\x2f\xfd"  # first bytes of a compressed chunk


@pytest.fixture(scope="module")
def segment(flights):
    """The only file of the second drone."""
    (file,) = flights[1].iterdir()
    return file


def test_every_drones_flight_comes_out_identical(flights):
    for folder in flights:
        report = replay(folder)
        assert report.identical
        assert not report.truncated
        assert report.compared["out/hypothesis"] > 30
        assert report.compared["out/command"] == report.calls["call/step"] > 400
        assert report.compared["out/publication"] > 400
        assert report.calls["in/message"] > report.calls["call/advance"] > 200  # one for each burst


def test_a_record_of_other_tables_is_refused_with_its_release(segment, monkeypatch):
    assert RecordedFlight(segment).header.tables
    monkeypatch.setattr("radron.agent.flight.header.tables_version", lambda: "0" * 16)
    told = r"recorded with other tables of what a camera counts: replay it with the radron that recorded it \(.+\)$"
    with pytest.raises(FlightRecordError, match=told) as refused:
        replay(segment)
    assert str(refused.value).count("\n") == 0


@pytest.mark.slow
def test_a_flight_with_fixes_and_sights_comes_out_identical(tmp_path):
    for folder in fly_recorded(tmp_path, name="mixed-frames", mission__track__duration_s=2.0):
        report = replay(folder)
        assert report.identical
        assert report.calls["in/sightings"] > 40
        assert report.calls.get("in/fix", 0) >= 5 or folder.name == "d3"  # d3 has no receiver


def test_the_audit_of_a_whole_mission_lists_its_start(flights):
    for folder in flights:
        (start,) = audit(RecordedFlight(folder))
        assert (start.action, start.drones, start.result) == ("start", ("d1", "d2", "d3"), "obeyed")


def test_the_records_tell_what_was_believed_commanded_and_when(segment):
    records = list(RecordedFlight(segment).records())
    assert all(record.publish_ns > 0 for record in records)
    places = [place for place, record in enumerate(records) if record.topic == topics.HYPOTHESIS]
    assert all(records[place - 1].topic in (topics.ADVANCE, topics.COMMAND) for place in places)
    assert all(records[place].publish_ns >= records[place - 1].publish_ns for place in places)
    assert b'"digest":' in records[places[-1]].data


def flip_cone(which, place=-20):
    """Change one bit in the payload of a received cone."""
    seen = 0

    def change(topic, data):
        nonlocal seen
        if topic == topics.MESSAGE and b"/cone" in data:
            seen += 1
            if seen == which:
                damaged = bytearray(data)
                damaged[place] ^= 1
                return bytes(damaged)
        return data

    return change


@pytest.mark.parametrize("place", [-1, -200])
def test_a_flipped_bit_in_a_cone_is_found(segment, tmp_path, place, capsys):
    changed = rewritten(segment, tmp_path / segment.name, flip_cone(5, place))
    report = replay(changed)
    assert not report.identical
    assert report.first is not None
    assert report.differing[report.first.topic] >= 1
    assert 0.0 < report.first.time_s <= report.duration_s
    assert run_replay(changed) == 1
    assert f"{report.first.log_ns} ns UTC" in capsys.readouterr().out


def test_a_setpoint_that_differs_in_the_last_bit_is_found(segment, tmp_path):
    def change(topic, data):
        return data.replace(b"0.3", b"0.30000000000000004", 1) if topic == topics.COMMAND else data

    report = replay(rewritten(segment, tmp_path / segment.name, change))
    assert set(report.differing) == {topics.COMMAND}


def test_a_record_that_cannot_be_read_is_a_difference_and_not_the_end(segment, tmp_path):
    def change(topic, data):
        return b"{" if topic == topics.VEHICLE and b'"in_air":true' in data else data

    report = replay(rewritten(segment, tmp_path / segment.name, change))
    assert "cannot be read" in report.first.replayed


def test_lost_records_end_the_comparison_and_say_so(segment, tmp_path, capsys):
    lost = iter(range(3000))

    def change(topic, data):
        return None if next(lost, 0) == 2000 else data

    gapped = rewritten(segment, tmp_path / segment.name, change)
    report = replay(gapped)
    assert not report.differing
    assert report.flaw == f"1 records are missing in {segment.name}"
    assert not report.identical
    assert run_replay(gapped) == 2
    assert "up to there" in capsys.readouterr().out


def test_damaged_bytes_on_the_disk_are_noticed(segment, tmp_path):
    content = segment.read_bytes()
    chunks = [place for place in range(len(content)) if content.startswith(ZSTD_FRAME, place)]
    damaged = bytearray(content)
    damaged[chunks[len(chunks) // 2] + 1000] ^= 0xFF
    target = tmp_path / segment.name
    target.write_bytes(damaged)
    report = replay(target)
    assert "damaged" in report.flaw
    assert not report.differing
    assert report.calls[topics.STEP] > 10


@pytest.mark.parametrize("share", [0.3, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_identical_as_far_as_it_goes(segment, tmp_path, share):
    content = segment.read_bytes()
    target = tmp_path / segment.name
    target.write_bytes(content[: int(share * len(content))])
    report = replay(target)
    assert report.identical
    assert report.truncated


@pytest.mark.slow
def test_after_a_kill_the_records_reach_to_the_last_second(tmp_path, capsys):
    process = subprocess.Popen(
        [sys.executable, "-m", recorded_flights.__name__, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": PATH},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        stamps = [int(process.stdout.readline()) for _ in range(60)]
    finally:
        os.kill(process.pid, signal.SIGKILL)
        stamps += [int(line) for line in process.stdout.read().split("\n")[:-1]]
        process.wait(10.0)
        process.stdout.close()
    records = list(RecordedFlight(tmp_path).records())
    assert records[-1].publish_ns > stamps[-1] - 1_000_000_000
    report = replay(tmp_path)
    assert report.identical
    assert report.truncated
    assert run_replay(tmp_path) == 0
    assert "the process was killed" in capsys.readouterr().out


def test_telemetry_of_any_kind_replays_with_the_same_bits(tmp_path):
    folder = tmp_path / "made"
    folder.mkdir()
    recorder = FlightRecorder(tmp_path / "flight", 100, HEADER)
    pilot = RecordedPilot(HEADER.pilot(folder), recorder)
    odd = [float("nan"), float("inf"), -0.0, 5e-324, 1e300, 0.1 + 0.2]
    for count, value in enumerate(odd):
        pilot.observe_vehicle(replace(telemetry(10**18 + count), position_m=(value, 0.0, 0.0)))
        pilot.step(10**18 + count)
    recorder.close()
    assert pilot.counters["telemetry_implausible"] == 3
    assert replay(tmp_path / "flight").identical
    kept = [topics.decode_state(r.data) for r in RecordedFlight(tmp_path / "flight").records() if r.topic == topics.VEHICLE]
    assert np.array([state.position_m[0] for state in kept]).tobytes() == np.array(odd).tobytes()


def test_several_flights_in_one_folder(segment, tmp_path):
    for boot in ("0000000000000001", "0000000000000002"):
        (tmp_path / f"d1-20260101T000000Z-{boot}-0000.mcap").write_bytes(segment.read_bytes())
    with pytest.raises(FlightRecordError, match="holds 2 flights; name a file of one of them: d1-20260101T000000Z-0000"):
        replay(tmp_path)


@pytest.mark.parametrize("content", [b"", b"no such thing", b"\x89MCAP0\r\n"])
def test_what_is_no_flight_says_so(tmp_path, content):
    file = tmp_path / "flight.mcap"
    with pytest.raises(FlightRecordError, match="no such file"):
        replay(file)
    file.write_bytes(content)
    with pytest.raises(FlightRecordError, match="not a"):
        replay(file)


def test_a_record_from_before_statuses_named_the_obeyed_order_comes_out_identical(tmp_path):
    authority, boot = SimulatedAuthority(1), "0" * 16
    trust, drone = authority.trust("d1"), DroneConfig(id="d1")
    header = FlightHeader.of(MISSION, drone, boot, START_NS, trust=trust, nonce_key=b"key")
    former = msgspec.json.decode(msgspec.json.encode(header), type=dict)
    del former["tells_obeyed"], former["tells_codes"]
    header = msgspec.json.decode(msgspec.json.encode(former), type=FlightHeader)
    operator = SimulatedOperator(authority, MISSION.swarm, MISSION.mission_id)
    with closing(FlightRecorder(tmp_path, 100, header)) as recorder:
        pilot = RecordedPilot(header.pilot(tmp_path, trust), recorder)
        pilot.warn((CodedText(Code.NO_CONTACT, "no contact with d2 (none)", "d2"),))
        for tick in range(50):
            now_ns = START_NS + tick * TICK_NS
            pilot.observe_vehicle(state(now_ns, armed=tick > 20))
            if tick == 20:
                payload = operator.ordered(now_ns, Action.START, {"d1": pilot.ticket(now_ns)})
                assert pilot.receive(operator.key, payload, now_ns) == Verdict()
            pilot.step(now_ns)
    records = [record for record in RecordedFlight(tmp_path).records() if record.topic == topics.PUBLICATION]
    statuses = [one for record in records if isinstance(one := decode_from(*topics.decode_message(record.data)), Status)]
    assert statuses[-1].ticket.number > statuses[0].ticket.number
    assert all(status.obeyed is UNSET and status.codes is UNSET for status in statuses)
    assert any(status.problems for status in statuses)
    report = replay(tmp_path)
    assert report.identical
    assert report.compared["out/publication"] >= len(statuses) > 2
