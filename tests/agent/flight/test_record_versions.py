"""Records of other versions: those of version 2 of the protocol are read, those of any other one are refused in one line."""

from pathlib import Path

import msgspec
import pytest
from mcap.records import Metadata

from radron.agent.errors import FlightRecordError
from radron.agent.flight import reader, topics
from radron.agent.flight.audit import audit
from radron.agent.flight.audit_command import run_audit
from radron.agent.flight.command import run_replay
from radron.agent.flight.identify_command import run_identify
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.segment import HEADER as HEADER_RECORD
from radron.protocol.codec import decode_from
from radron.protocol.messages import Command, Status
from radron.station.replay import Records
from support.flights.recorded_flights import HEADER

RECORD = Path(__file__).parent / "records" / "protocol-2.mcap"


@pytest.fixture
def recorded_with(tmp_path, monkeypatch):
    """Return a function that makes a record whose header has other fields; None: without the field."""

    def make(**changes):
        header = msgspec.json.decode(msgspec.json.encode(HEADER)) | changes
        header = {name: value for name, value in header.items() if value is not None}
        item = Metadata(HEADER_RECORD, {"header": msgspec.json.encode(header).decode()})
        monkeypatch.setattr(reader, "items", lambda stream: iter([item]))
        file = tmp_path / "d1-0000.mcap"
        file.write_bytes(b"")
        return file

    return make


READERS = {
    "replay": run_replay,
    "audit": run_audit,
    "identify": lambda path: run_identify(path, None),
    "open": lambda path: Records([path]),
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_records_of_version_1_are_refused_by_each_reader(read, recorded_with):
    """Version 1 did not name itself, and its mission and drone file had other keys."""
    file = recorded_with(protocol=None, mission={"radius": 3})
    with pytest.raises(FlightRecordError) as refusal:
        read(file)
    assert str(refusal.value) == f"{file}: recorded with version 1 of the protocol, here 2: no release reads it"


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_records_of_a_later_version_name_the_radron_that_reads_them(read, recorded_with):
    file = recorded_with(protocol=3, versions={"radron": "2.1.0"}, boot=7)
    with pytest.raises(FlightRecordError) as refusal:
        read(file)
    text = "recorded with version 3 of the protocol, here 2: read it with the radron that recorded it (2.1.0)"
    assert str(refusal.value) == f"{file}: {text}"


def test_each_kind_of_message_of_version_2_is_read():
    records = [one for one in RecordedFlight(RECORD).records() if one.topic in (topics.MESSAGE, topics.PUBLICATION)]
    messages = [decode_from(*topics.decode_message(one.data)) for one in records]
    kinds = {type(message).__name__ for message in messages}
    assert kinds == {
        *("Command", "Cone", "Credential", "Estimate", "Exposure", "Fix", "Frame", "Plan", "Pose", "Sighting", "Status"),
    }
    (command,) = [message for message in messages if isinstance(message, Command)]
    assert (command.action, command.station, sorted(command.to)) == ("start", "lockstep", ["d1", "d2", "d3"])
    last = [message for message in messages if isinstance(message, Status)][-1]
    assert last.stage == "track"


def test_the_audit_names_signer_and_outcome_in_version_2():
    (start,) = audit(RecordedFlight(RECORD))
    assert (start.station, start.action, start.result) == ("lockstep", "start", "obeyed")
    assert start.signer.startswith("operator lockstep, serial 50d430d5c969eebc")
