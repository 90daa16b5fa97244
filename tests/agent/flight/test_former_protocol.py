"""Records of version 1 of the protocol: everything but a replay call by call still reads them."""

import re
from collections.abc import Callable
from pathlib import Path
from statistics import median

import msgspec
import pytest
from recorded_flights import rewritten

from agent.config.drone import ResponseConfig
from agent.errors import FlightRecordError
from agent.flight import topics
from agent.flight.audit import audit
from agent.flight.audit_command import lines
from agent.flight.command import run_replay
from agent.flight.former import FormerCommand, read_message
from agent.flight.identify import identify
from agent.flight.reader import RecordedFlight
from agent.flight.refold import Refolded, refold, sentence
from agent.flight.replay import replay
from agent.flight.response_records import read
from protocol.codec import encode
from protocol.errors import ProtocolError
from protocol.keys import key_of
from protocol.messages import Action, Estimate, Pose

RECORD = Path(__file__).parent / "records" / "protocol-1.mcap"
LOG = RECORD.with_name("protocol-1-log.mcap")


def contents() -> list[tuple[str, bytes]]:
    records = RecordedFlight(RECORD).records()
    return [topics.decode_message(one.data) for one in records if one.topic in (topics.MESSAGE, topics.PUBLICATION)]


def test_every_kind_of_message_is_read() -> None:
    read_ones = [read_message(*one) for one in contents()]
    kinds = {type(message).__name__ for message in read_ones}
    assert kinds == {"Pose", "Plan", "Cone", "Exposure", "Estimate", "Status", "FormerCommand"}
    (command,) = [message for message in read_ones if isinstance(message, FormerCommand)]
    assert (command.action, command.station, command.drones) == (Action.START, "lockstep", ())
    estimate = next(message for message in read_ones if isinstance(message, Estimate))
    assert len(estimate.sources) == 1
    assert max(abs(place) for place in estimate.sources[0].position_m) < 60.0
    assert estimate.sources[0].cones >= 10


def test_a_message_of_todays_protocol_is_read_as_ever() -> None:
    pose = next(message for one in contents() if isinstance(message := read_message(*one), Pose))
    assert read_message(key_of("s", pose), encode(pose)) == pose


@pytest.mark.parametrize("payload", [b"", b"\xc1", msgspec.msgpack.encode({"kind": "estimate"}), msgspec.msgpack.encode([1])])
@pytest.mark.parametrize("kind", ["d1/estimate", "station/anna/command", "d1/pose", "d1/nonsense"])
def test_what_is_no_message_is_refused(kind: str, payload: bytes) -> None:
    with pytest.raises(ProtocolError):
        read_message(f"radron/1/s/{kind}", payload)


# The estimator has changed since the record was made (it accounts for unknown walls): measured 0.03 m in the median,
# 1.5 m at most, in the first second, and 0.02 m at the end.
NEAR_M, END_M = 0.1, 0.05


def test_the_vehicles_response_is_identified() -> None:
    found = identify(read(RecordedFlight(RECORD), lambda done: None), ResponseConfig(), lambda done: None)
    assert found.flown_s > 5.0
    assert found.late_s == pytest.approx(0.0, abs=0.1)  # against the plans, which are messages


def test_the_audit_lists_its_commands() -> None:
    (line,) = lines("d1", audit(RecordedFlight(RECORD)))
    when = r"2026-01-01T00:00:00\.500Z  lockstep  unsigned  start  all"
    told = rf"{when}  d1: version 1 of the protocol did not record what became of it"
    assert re.fullmatch(told, line)


def refolded(change: Callable[[str, bytes], bytes | None], folder: Path) -> Refolded:
    return refold(rewritten(LOG, folder / "changed.mcap", change))


def test_todays_estimator_comes_to_nearly_the_same_hypotheses_of_its_log() -> None:
    """(A flight recorded by the same radron is replayed bit for bit: ``test_flight_replay.py``.)"""
    found = refold(LOG)
    assert (found.recorded, found.same_log) == (250, 250)
    assert median(found.differences_m) < NEAR_M
    assert found.differences_m[-1] < END_M
    assert not found.stands
    assert found.entries > 300


def test_a_hypothesis_that_differs_is_told_with_how_far_it_is_away(tmp_path: Path) -> None:
    def moved(topic: str, data: bytes) -> bytes:
        if topic != topics.HYPOTHESIS or data == b"null":
            return data
        told = msgspec.json.decode(data)
        told["position_m"][1] += 500.0
        return msgspec.json.encode(told)

    found = refolded(moved, tmp_path)
    assert (found.same_log, found.identical, found.stands) == (250, 0, False)
    assert found.differences_m == pytest.approx([500.0] * 250, abs=2.0)
    assert "250 differ: by 500 m in the median, 50" in sentence(found)


def test_hypotheses_of_another_log_are_not_compared(tmp_path: Path) -> None:
    def altered(topic: str, data: bytes) -> bytes:
        key, payload = topics.decode_message(data) if topic == topics.MESSAGE else ("", b"")
        return topics.encode_message(key, payload[:-1]) if key.endswith("d2/cone") else data

    found = refolded(altered, tmp_path)
    assert not found.stands
    assert (found.recorded, found.same_log, found.differences_m) == (250, 0, ())


def test_the_command_folds_the_log_and_says_that_it_is_no_replay(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_replay(LOG) == (0 if refold(LOG).stands else 1)
    told = capsys.readouterr().out
    assert "its calls are not replayed" in told
    assert "250 of 250 recorded hypotheses" in told


def test_a_record_without_log_entries_is_refused(tmp_path: Path) -> None:
    def emptied(topic: str, data: bytes) -> bytes:
        return topics.encode_message("radron/1/s/d1/pose", b"") if topic in (topics.MESSAGE, topics.PUBLICATION) else data

    with pytest.raises(FlightRecordError, match="holds no log entries of mission"):
        refolded(emptied, tmp_path)


@pytest.mark.parametrize("topic", [topics.HYPOTHESIS, topics.MESSAGE])
def test_a_record_that_cannot_be_read_is_refused(topic: str, tmp_path: Path) -> None:
    with pytest.raises(FlightRecordError, match=r"changed\.mcap: a record cannot be read: "):
        refolded(lambda one, data: b"\xff" if one == topic else data, tmp_path)


def test_a_replay_is_refused_and_names_the_radron_that_can() -> None:
    with pytest.raises(FlightRecordError, match=r"version 1 of the protocol, here 2: replay it with the radron .* \(0\.1\.0\)$"):
        replay(RECORD)
