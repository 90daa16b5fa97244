"""The audit of every command: its operator, the certificate, and the drone's verdict."""

import re

import pytest
from msgspec.structs import replace

from radron.agent.cli import main
from radron.agent.config.drone import DroneConfig
from radron.agent.flight import topics
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.recorded import MOST_REFUSED, RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import replay
from radron.protocol.codec import decode_from, encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Action
from radron.protocol.revocations import Revoked
from support.flights.members import AUTHORITY, FOREIGN, OPERATOR, order, revocation
from support.flights.one_pilot import MISSION, SECOND, START_NS, nonce_key_of, state
from support.flights.one_pilot import command as plain_command
from support.flights.recorded_flights import rewritten

BOOT = "0" * 15 + "1"  # the boot to which the commands below are addressed


D1 = AUTHORITY.trust("d1")


def flown(folder, messages, trust=D1):
    """The record of a drone in the air that receives these messages: time after the start (s), key and payload."""
    header = FlightHeader.of(MISSION, DroneConfig(id="d1"), BOOT, START_NS, None, trust, nonce_key=nonce_key_of(BOOT))
    recorder = FlightRecorder(folder, 100, header)
    folder.mkdir(exist_ok=True)
    pilot = RecordedPilot(header.pilot(folder, trust), recorder)
    pilot.observe_vehicle(state(START_NS))
    for after_s, (key, payload) in messages:
        now_ns = START_NS + round(after_s * SECOND)
        pilot.receive(key, payload, now_ns)
        pilot.observe_vehicle(state(now_ns + 1))
        pilot.step(now_ns + 1)
    recorder.close()
    return folder


def audited(monkeypatch, capsys, folder):
    """Exit code of the command, its lines after the mission's line, and its stderr."""
    monkeypatch.setattr("sys.argv", ["radron-agent", "audit", str(folder)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    mission, *lines = said.out.splitlines() or ["d1: mission "]
    assert mission.startswith("d1: mission ")
    return ended.value.code, lines, said.err.strip()


@pytest.fixture
def told(monkeypatch, capsys):
    return lambda folder: audited(monkeypatch, capsys, folder)


def at(after_s):
    return START_NS + round(after_s * SECOND)


def unsigned(action, now_ns):
    key, payload = order(action, now_ns)
    return key, encode(replace(decode_from(key, payload), signature=b"", certificate=b""))


def altered(now_ns):
    key, payload = order(Action.HOLD, now_ns)
    return key, encode(replace(decode_from(key, payload), action=Action.LAND))


OBSERVER = AUTHORITY.trust("lockstep", "observer")
START = order(Action.START, START_NS)
FLIGHT = [
    (0, START),
    (1, START),
    (2, START),
    (3, unsigned(Action.LAND, at(3))),
    (4, order(Action.LAND, at(4), OBSERVER)),
    (5, order(Action.LAND, at(5), FOREIGN.trust("lockstep", "operator"))),
    (6, altered(at(6))),
    (7, order(Action.LAND, at(7), mission="0" * 16)),
    (8, order(Action.LAND, at(8), AUTHORITY.trust("tower", "operator"))),
    (9, order(Action.RESUME, at(9))),
    (10, (START[0], b"nonsense")),
    (40, order(Action.LAND, at(11))),
    (41, order(Action.HOLD, at(41), to={"d2": decode_from(*START).to["d2"]})),
    (42, order(Action.LAND, at(42))),
]
MEMBER = r"{} {}, serial [0-9a-f]{{16}}, until 2070-01-01 00:00"
BY_OPERATOR, BY_OBSERVER, BY_TOWER = (
    MEMBER.format("operator", "lockstep"),
    MEMBER.format("observer", "lockstep"),
    MEMBER.format("operator", "tower"),
)
FOREIGNER = "certificate is not signed by this swarm's authority"
BOTH = "d1,d2"
LINES = [
    ("00", BY_OPERATOR, "start", BOTH, "obeyed"),
    (
        "01",
        BY_OPERATOR,
        "start",
        BOTH,
        r"refused: replayed: it has been carried out before, or a later one has \(2 times, the last 2027-01-15T08:00:02\.000Z\)",
    ),
    ("03", "unsigned", "land", BOTH, "refused: it is not signed"),
    ("04", BY_OBSERVER, "land", BOTH, "refused: its certificate is not an operator's, but of the role observer"),
    ("05", FOREIGNER, "land", BOTH, f"refused: its {FOREIGNER}"),
    ("06", BY_OPERATOR, "land", BOTH, "refused: its signature is not valid: it was altered, or forged"),
    ("07", BY_OPERATOR, "land", BOTH, "refused: it is for another mission"),
    ("08", BY_TOWER, "land", BOTH, "refused: its certificate is that of tower"),
    ("09", BY_OPERATOR, "resume", BOTH, "refused: resume: not holding"),
    ("10", "-", "-", "-", "refused: it cannot be read, or is not of the station under whose name it came"),
    ("40", BY_OPERATOR, "land", BOTH, "refused: replayed or delayed: its nonce is not valid any more"),
    ("42", BY_OPERATOR, "land", BOTH, "obeyed"),
]


def test_a_line_tells_who_commanded_what_by_which_certificate_and_what_became_of_it(tmp_path, told):
    folder = flown(tmp_path / "d1", FLIGHT)
    code, out, err = told(folder)
    assert (code, err) == (0, "")
    assert len(out) == len(LINES)
    for line, (second, signer, action, drones, result) in zip(out, LINES, strict=True):
        expected = rf"2027-01-15T08:00:{second}\.000Z  lockstep  {signer} +{action} +{drones} +d1: {result}"
        assert re.fullmatch(expected, line), line
    serial = f"{AUTHORITY.verify(OPERATOR.certificate).serial:x}"
    assert f"serial {serial[:16]}," in out[0]
    report = replay(folder)
    assert report.identical
    assert report.compared[topics.VERDICT] == 12  # all but the unreadable command and the command to d2


def test_a_swarm_without_certificates(tmp_path, told):
    code, out, _ = told(flown(tmp_path / "d1", [(0, plain_command())], trust=None))
    assert code == 0
    assert re.fullmatch(r"2027-01-15T08:00:00\.000Z  tester  unsigned  start  d1,d2  d1: obeyed", out[0])


def test_a_flight_without_commands_says_so(tmp_path, told):
    assert told(flown(tmp_path / "d1", [])) == (0, ["d1: no commands"], "")


def test_of_a_flood_the_record_tells_a_bounded_number_and_still_every_command_that_is_obeyed(tmp_path, told):
    flood = [(1.0 + 0.001 * place, unsigned(Action.LAND, at(1) + place)) for place in range(500)]
    folder = flown(tmp_path / "d1", [(0, START), *flood, (1.6, order(Action.LAND, at(1.6)))])
    records = [record for record in RecordedFlight(folder).records() if record.topic == topics.VERDICT]
    assert len(records) == MOST_REFUSED + 2
    code, out, _ = told(folder)
    assert code == 0
    assert len(out) == MOST_REFUSED + 3
    untold = [line for line in out if "does not say" in line]
    assert len(untold) == 1
    assert re.match(r"2027-01-15T08:00:01\.020Z  lockstep  - +- +- ", untold[0])
    assert f"({500 - MOST_REFUSED} times, the last 2027-01-15T08:00:01.499Z)" in untold[0]
    assert out[-1].endswith("d1: obeyed")
    assert replay(folder).identical


def test_what_is_no_record_ends_in_one_line(tmp_path, told):
    code, out, err = told(tmp_path / "flight.mcap")
    assert (code, out, err) == (2, [], f"radron-agent: {tmp_path}/flight.mcap: no such file")
    (tmp_path / "flight.mcap").write_bytes(b"no such thing")
    code, out, err = told(tmp_path / "flight.mcap")
    assert (code, out, len(err.splitlines())) == (2, [], 1)
    assert "not a" in err


def only_segment(folder):
    (segment,) = folder.glob("*.mcap")
    return segment


def test_a_record_of_another_protocol_ends_in_one_line(tmp_path, told, monkeypatch):
    monkeypatch.setattr("radron.agent.flight.header.PROTOCOL", 3)
    folder = flown(tmp_path / "d1", FLIGHT[:1])
    monkeypatch.undo()
    code, out, err = told(folder)
    assert (code, out) == (2, [])
    told = "recorded with version 3 of the protocol, here 2: read it with the radron that recorded it ("
    assert err.startswith(f"radron-agent: {only_segment(folder)}: {told}")


def test_a_torn_record_is_told_as_far_as_it_goes(tmp_path, told):
    segment = only_segment(flown(tmp_path / "d1", FLIGHT))
    cut = tmp_path / segment.name
    cut.write_bytes(segment.read_bytes()[:-500])
    code, out, err = told(cut)
    assert code == 0
    assert "d1: obeyed" in out[0]
    assert "the process was killed" in err


def without(places):
    """Leave out these records of a segment."""
    count = iter(range(10_000))

    def change(topic, data):
        return None if next(count) in places else data

    return change


def test_a_command_whose_verdict_was_cut_off(tmp_path, told):
    segment = only_segment(flown(tmp_path / "d1", FLIGHT[:1]))
    place = [record.topic for record in RecordedFlight(segment).records()].index(topics.VERDICT)
    cut = rewritten(segment, tmp_path / segment.name, without(set(range(place, 1000))))
    assert told(cut)[1] == ["2027-01-15T08:00:00.000Z  lockstep  -  -  -  d1: the record ends here"]


def test_a_command_to_another_swarm_or_under_another_name(tmp_path, told):
    key, payload = START
    elsewhere, named = key.replace("/radron/station/", "/other/station/"), key.replace("/lockstep/", "/eve/")
    code, out, _ = told(flown(tmp_path / "d1", [(0, (elsewhere, payload)), (1, (named, payload)), (2, START)]))
    assert code == 0
    assert [line.rsplit("d1: ")[-1] for line in out] == [
        "refused: it is for another swarm",
        "refused: it cannot be read, or is not of the station under whose name it came",
        "obeyed",
    ]
    assert "  eve " in out[1]


def test_a_gap_and_a_missing_beginning_are_told_and_what_is_there_is_printed(tmp_path, told):
    segment = only_segment(flown(tmp_path / "d1", FLIGHT))
    total = len(list(RecordedFlight(segment).records()))
    gapped = rewritten(segment, tmp_path / segment.name, without({total - 5}))
    code, out, err = told(gapped)
    assert code == 2
    assert "d1: obeyed" in out[0]
    assert err.startswith(f"radron-agent: {gapped}: not the whole flight could be read. It lacks its end: 1 records are missing")
    (tmp_path / "late").mkdir()
    late = rewritten(segment, tmp_path / "late" / segment.name, without(set(range(10))))
    code, out, err = told(late)
    assert code == 2
    assert "d1: obeyed" in out[-1]
    assert "It lacks its beginning: its first file was removed" in err


@pytest.mark.parametrize("verdict", [b"{", b'{"refused": "\xff"}'], ids=["cut", "no UTF-8"])
def test_a_verdict_that_cannot_be_read_ends_in_one_line(tmp_path, told, verdict):
    segment = only_segment(flown(tmp_path / "d1", FLIGHT[:1]))
    broken = rewritten(segment, tmp_path / segment.name, lambda topic, data: verdict if topic == topics.VERDICT else data)
    code, out, err = told(broken)
    assert (code, out, len(err.splitlines())) == (2, [], 1)
    assert "a record of out/verdict cannot be read" in err


def test_revocations_are_listed_with_who_gave_them_and_the_copies_that_others_pass_on_are_not(told, tmp_path):
    given = revocation(last={"2" * 16: 7})
    passed_on = Revoked(stamp_ns=at(2), drone="d2", held=(decode_from(*given),))
    flight = [
        (0, revocation(trust=AUTHORITY.trust("bert", "operator"))),
        (1, given),
        (2, (key_of(MISSION.swarm, passed_on), encode(passed_on))),
        (3, revocation(member="anna", stamp_ns=at(3))),
    ]
    folder = flown(tmp_path / "flight", flight)
    code, lines, _ = told(folder)
    assert code == 0
    refused, first, second = lines
    assert re.search(
        r"bert +operator bert, serial \w+, until .* revoke +d2 +d1: refused: its certificate does not carry", refused
    )
    assert re.search(r"lockstep +operator lockstep, serial \w+, until .* revoke +d2 +d1: obeyed$", first)
    assert re.search(r"lockstep .* revoke +anna +d1: obeyed$", second)
    assert replay(folder).identical


def test_a_revocation_that_was_passed_on_is_listed_too(told, tmp_path):
    passed_on = Revoked(stamp_ns=at(2), drone="d2", held=(decode_from(*revocation()),))
    code, lines, _ = told(flown(tmp_path / "flight", [(2, (key_of(MISSION.swarm, passed_on), encode(passed_on)))]))
    assert code == 0
    assert [line.split()[-3:] for line in lines] == [["d2", "d1:", "obeyed"]]
