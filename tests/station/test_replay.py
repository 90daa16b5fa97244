"""A recorded flight shows the drones' knowledge."""

import asyncio
from pathlib import Path

import msgspec
import numpy as np
import pytest

from radron.agent.errors import FlightRecordError
from radron.agent.flight.reader import UNFINISHED, RecordedFlight
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.topics import HYPOTHESIS
from radron.station.findings.facts import of_records
from radron.station.hub import Hub
from radron.station.picture.frame import Frame
from radron.station.picture.history import CONES_MS
from radron.station.picture.picture import Picture
from radron.station.replay import Records, play
from support.flights.recorded_flights import HEADER

OLDER_RECORD = Path(__file__).parents[1] / "agent" / "flight" / "records" / "protocol-2.mcap"


def played(paths):
    records = Records(paths)
    hub = Hub(Picture(records.mission, records.verifier), replay=True)
    asyncio.run(play(hub, records))
    return hub


def hypotheses(flight):
    """Messages of a record with their times: the drone's knowledge."""
    records = (record for record in RecordedFlight(flight).records() if record.topic == HYPOTHESIS)
    return [(record.log_ns, msgspec.json.decode(record.data)) for record in records]


def test_the_record_of_one_drone_gives_its_log_and_bit_for_bit_its_hypotheses(flights):
    records = Records(flights[:1])
    picture, messages, compared = Picture(records.mission, records.verifier), records.messages(), 0
    heard = next(messages)
    for at_ns, expected in hypotheses(flights[0]):
        while heard.at_ns < at_ns:
            picture.receive(heard.key, heard.payload, heard.at_ns)
            heard = next(messages)
        if picture.log.fusion.digest == expected["digest"]:  # else there are further messages of that very moment
            picture.advance(at_ns)
            while picture.log.pending:
                picture.advance(at_ns)
            assert picture.log.fusion.hypothesis.position.tolist() == expected["position_m"]
            compared += 1
    assert compared > 10
    assert not picture.log.problems(at_ns)  # every signature holds


@pytest.mark.parametrize("count", [1, 3])
def test_the_last_frame_shows_all_drones_and_the_source(flights, count):
    hub = played(flights[:count])
    assert hub.progress == 1.0
    frame = msgspec.json.decode(hub.history.frame(hub.history.last_ms), type=Frame)
    known = [expected["position_m"] for at_ns, expected in hypotheses(flights[0]) if at_ns <= frame.at_ms * 1_000_000]
    assert np.hypot(*np.subtract(frame.source.place[:2], known[-1][:2])) < 0.05
    assert [drone.id for drone in frame.drones if drone.place is not None] == ["d1", "d2", "d3"]


def test_what_several_drones_recorded_is_read_once_and_nothing_is_lost(flights):
    each = [[(heard.key, heard.payload) for heard in Records([flight]).messages()] for flight in flights]
    together = [(heard.key, heard.payload) for heard in Records(flights).messages()]
    assert len(together) == len(set(together)) < sum(map(len, each)) / 2
    assert set(together) == set().union(*each)


def test_the_history_holds_frames_layers_cones_and_events_of_the_whole_flight(flights):
    history = played(flights[:1]).history
    rows = history.overview.rows()
    seconds = [(row[0] - rows[0][0]) / 1000 for row in rows]
    assert np.diff(seconds) == pytest.approx(1.0)
    assert seconds[-1] > 15.0
    before_ms = history.last_ms - 4000
    assert all(history.layers(before_ms, None).values())
    assert len(history.cones(before_ms - CONES_MS, before_ms)) > 3
    stages = [event.values["stage"] for event in history.events if event.text == "stage" and event.values["drone"] == "d1"]
    searched = stages[stages.index("takeoff") + 1 : stages.index("return")]
    assert searched in (["track"], ["survey", "track"])  # found at once, or not
    assert sum(event.text == "source found" for event in history.events) == 1


def test_records_of_two_missions_are_not_mixed(flights, tmp_path):
    FlightRecorder(tmp_path, 100, HEADER).close()
    with pytest.raises(FlightRecordError, match="of another mission than"):
        Records([flights[0], tmp_path])


def test_half_a_record_is_said_to_lack_its_end(flights, tmp_path):
    (whole,) = flights[0].glob("*.mcap")
    half = tmp_path / whole.name
    half.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    for file, lacks in ((half, (f"{whole.name}: {UNFINISHED}; the end may be missing",)), (whole, ())):
        records = Records([file])
        assert sum(1 for _ in records.messages()) > 100
        assert of_records([file], records).flaws == lacks


def test_a_record_of_an_older_release_is_shown():
    """Its log entries count with their recorded bytes and signatures, so the digests are those of the record."""
    records = Records([OLDER_RECORD])
    picture, wanted = Picture(records.mission, records.verifier), {told["digest"] for _, told in hypotheses(OLDER_RECORD) if told}
    digests = set()
    for heard in records.messages():
        picture.receive(heard.key, heard.payload, heard.at_ns)
        digests.add(picture.log.fusion.digest)
    picture.advance(heard.at_ns)
    while picture.log.pending:
        picture.advance(heard.at_ns)
    assert len(wanted) > 40
    assert len(digests & wanted) > 0.9 * len(wanted)
    known = hypotheses(OLDER_RECORD)[-1][1]
    assert np.hypot(*np.subtract(picture.log.fusion.hypothesis.position[:2], known["position_m"][:2])) < 0.05
    assert picture.log.problems(heard.at_ns) == ()
