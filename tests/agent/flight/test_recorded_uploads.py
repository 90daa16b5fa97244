"""An uploaded mission in the flight record: replayed to the bit, and reported by the audit."""

from pathlib import Path

from radron.agent.config.drone import DroneConfig
from radron.agent.flight.audit import audit, mission_of
from radron.agent.flight.header import FlightHeader
from radron.agent.flight.reader import RecordedFlight
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.flight.recorder import FlightRecorder
from radron.agent.flight.replay import replay
from radron.agent.mission.uploads import Origin
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Upload
from radron.protocol.signing import sign_command
from radron.sim.lockstep.members import OPERATOR_NAME
from support.flights.members import AUTHORITY, OPERATOR
from support.flights.one_pilot import MISSION, SECOND, START_NS, nonce_key_of, state

BOOT = "0" * 15 + "1"
NEW, OTHER = "abcdef0123456789", "f" * 16
ORIGIN = Origin(station=OPERATOR_NAME, certificate=OPERATOR.certificate, taken_ns=START_NS, instead_of="0" * 16)


def offered(pilot: RecordedPilot, mission: str, now_ns: int) -> tuple[str, bytes]:
    upload = Upload(stamp_ns=now_ns, station=OPERATOR_NAME, mission=mission, to={"d1": pilot.ticket(now_ns)}, parts=(b"h" * 32,))
    signed = sign_command(upload, OPERATOR)
    return key_of(MISSION.swarm, signed), encode(signed)


def recorded(folder: Path, origin: Origin | None = None) -> RecordedFlight:
    """A drone on the ground that takes a mission, cannot keep it, takes it again, and is offered a third one meanwhile."""
    trust = AUTHORITY.trust("d1")
    header = FlightHeader.of(MISSION, DroneConfig(id="d1"), BOOT, START_NS, None, trust, origin, nonce_key=nonce_key_of(BOOT))
    recorder = FlightRecorder(folder, 100, header)
    pilot = RecordedPilot(header.pilot(folder, trust), recorder)
    for second, mission in enumerate((NEW, NEW, OTHER)):
        now_ns = START_NS + second * SECOND
        pilot.observe_vehicle(state(now_ns, armed=False, in_air=False))
        pilot.receive(*offered(pilot, mission, now_ns), now_ns)
        pilot.step(now_ns)
        if second == 0:
            pilot.decline("the disk is full")
        pilot.step(now_ns + SECOND // 2)
    recorder.close()
    return RecordedFlight(folder, whole=False)


def test_uploads_are_replayed_to_the_bit(tmp_path: Path) -> None:
    recorded(tmp_path)
    report = replay(tmp_path)
    assert report.first is None
    assert report.identical
    assert report.calls["in/decline"] == 1


def test_the_audit_tells_uploads_and_whose_mission_is_in_force(tmp_path: Path) -> None:
    flight = recorded(tmp_path, ORIGIN)
    told = [(one.action, one.signer.split(",")[0], one.result) for one in audit(flight)]
    assert told == [
        (f"upload {NEW}", "operator lockstep", "not taken over: the disk is full"),
        (f"upload {NEW}", "operator lockstep", "taken over"),
        (f"upload {OTHER}", "operator lockstep", f"refused: it is taking over the mission {NEW} from lockstep"),
    ]
    text = mission_of(flight)
    assert text.startswith(
        f"mission {MISSION.mission_id} (test), uploaded 2027-01-15 08:00:00 UTC by lockstep, operator lockstep, "
    )


def test_a_mission_of_the_file_is_told_as_such(tmp_path: Path) -> None:
    assert mission_of(recorded(tmp_path)) == f"mission {MISSION.mission_id} (test), from its mission file"
