"""A pilot to which an operator uploads a mission: acceptance and refusal, each beside the allowed case."""

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codec import decode, encode
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.messages import MAX_ORDER_AGE_NS, Action, Answer, Stage, Status, Ticket, Upload
from radron.protocol.signing import sign_command, sign_status
from radron.sim.lockstep.members import OPERATOR_NAME
from support.flights.members import AUTHORITY, FOREIGN, OPERATOR, order, trusting
from support.flights.one_pilot import MISSION, SECOND, START_NS, messages, partner, pilot, state

NEW = "abcdef0123456789"
PARTS = (b"h" * 32,)


def on_ground(one=None, now_ns=START_NS):
    one = one or trusting()
    one.observe_vehicle(state(now_ns, armed=False, in_air=False))
    return one


def offered(one, now_ns=START_NS, trust=OPERATOR, mission=NEW, **changes):
    """An upload as the operator sends it: key and payload."""
    upload = Upload(stamp_ns=START_NS, station=OPERATOR_NAME, mission=mission, to={"d1": one.ticket(now_ns)}, parts=PARTS)
    upload = replace(upload, **changes)
    upload = sign_command(upload, trust) if trust is not None else upload
    return key_of(MISSION.swarm, upload), encode(upload)


def answer(one, now_ns=START_NS):
    (status,) = messages(one.step(now_ns), Status)
    return status.upload


def test_a_mission_is_taken_from_an_operator_and_the_status_says_so():
    one = on_ground()
    verdict = one.receive(*offered(one), START_NS)
    assert (verdict.refused, one.taking.mission, one.taking.parts) == ("", NEW, PARTS)
    assert answer(one) == Answer(START_NS, NEW)


def test_the_answer_does_not_wait_for_the_next_regular_status():
    one = on_ground()
    one.step(START_NS)
    soon_ns = START_NS + SECOND // 10
    one.receive(*offered(one, soon_ns), soon_ns)
    assert answer(one, soon_ns) == Answer(START_NS, NEW)


def forged(one, now_ns):
    _, payload = offered(one, now_ns)
    upload = replace(decode(payload), mission="f" * 16)
    return key_of(MISSION.swarm, upload), encode(upload)


WRONG = {
    "unsigned": (lambda one, now_ns: offered(one, now_ns, trust=None), "without_valid_certificate"),
    "foreign": (
        lambda one, now_ns: offered(one, now_ns, FOREIGN.trust(OPERATOR_NAME, Role.OPERATOR)),
        "without_valid_certificate",
    ),
    "drone": (lambda one, now_ns: offered(one, now_ns, AUTHORITY.trust(OPERATOR_NAME)), "by_a_drone"),
    "observer": (lambda one, now_ns: offered(one, now_ns, AUTHORITY.trust(OPERATOR_NAME, "observer")), "by_a_observer"),
    "altered": (forged, "forged"),
    "delayed": (lambda one, now_ns: offered(one, now_ns - MAX_ORDER_AGE_NS), "too_old"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_an_upload_that_no_operator_of_this_swarm_has_signed_just_now_is_dropped_without_an_answer(wrong):
    one, (make, reason) = on_ground(), WRONG[wrong]
    verdict = one.receive(*make(one, START_NS), START_NS)
    assert verdict.refused == reason
    assert one.taking is None
    assert answer(one) is None
    assert one.receive(*offered(one), START_NS).refused == ""


def test_an_operators_certificate_must_be_valid_at_an_upload():
    late_ns = 3_250_000_000 * SECOND  # 2072; the certificates end in 2070
    one = on_ground(now_ns=late_ns)
    assert one.receive(*offered(one, late_ns), late_ns).refused == "with_expired_certificate"


def test_a_signature_of_a_command_is_none_of_an_upload_nor_the_reverse():
    one = on_ground()
    _, payload = offered(one)
    upload = decode(payload)
    key, payload = order(Action.LAND, START_NS)
    crossed = replace(upload, signature=decode(payload).signature)
    assert one.receive(key_of(MISSION.swarm, crossed), encode(crossed), START_NS).refused == "forged"
    crossed = replace(decode(payload), signature=upload.signature)
    assert one.receive(key, encode(crossed), START_NS).refused == "forged"


def test_an_upload_is_not_taken_twice_not_even_after_a_restart_of_the_agent():
    one = on_ground()
    recorded = offered(one)
    one.receive(*recorded, START_NS)
    one.decline("it has no folder")
    assert one.receive(*recorded, START_NS + SECOND).refused == "already_obeyed"
    again = on_ground(trusting(boot="e" * 16))
    assert again.receive(*recorded, START_NS + SECOND).refused == "too_old"
    assert again.receive(*offered(again, START_NS + SECOND), START_NS + SECOND).refused == ""


def test_uploads_and_commands_are_numbered_together():
    """An order signed for one occasion is refused after later events."""
    one = on_ground()
    early = offered(one)
    one.receive(*offered(one), START_NS)
    one.decline("it has no folder")
    ticket = one.ticket(START_NS)
    assert ticket.number == 2
    assert one.receive(*early, START_NS).refused == "already_obeyed"
    assert one.receive(*offered(one, to={"d1": Ticket(ticket.nonce, 2)}), START_NS).refused == ""


AIRBORNE = {
    "armed": ({"armed": True, "in_air": False}, "its vehicle is armed"),
    "in the air": ({"armed": False, "in_air": True}, "its vehicle is armed"),
}


@pytest.mark.parametrize("how", AIRBORNE)
def test_an_armed_vehicle_keeps_its_mission_and_a_disarmed_one_takes_the_new(how):
    one, (values, reason) = trusting(), AIRBORNE[how]
    one.observe_vehicle(state(START_NS, **values))
    verdict = one.receive(*offered(one), START_NS)
    assert (verdict.refused, verdict.because) == ("refused", reason)
    assert answer(one) == Answer(START_NS, NEW, reason)
    for later_ns in range(
        START_NS + SECOND, START_NS + 10 * SECOND, SECOND // 5
    ):  # after a flight a drone must stay down for a while
        on_ground(one, later_ns)
    assert one.receive(*offered(one, later_ns), later_ns).refused == ""


def test_a_drone_that_hears_nothing_of_its_vehicle_takes_no_mission():
    one = trusting()
    assert one.receive(*offered(one), START_NS).because == "no telemetry tells whether its vehicle is disarmed"
    on_ground(one, START_NS)
    late_ns = START_NS + 5 * SECOND
    assert one.receive(*offered(one, late_ns), late_ns).because == "no telemetry tells whether its vehicle is disarmed"
    on_ground(one, late_ns)
    assert one.receive(*offered(one, late_ns), late_ns).refused == ""


def test_no_mission_is_taken_after_the_start_nor_while_another_drone_flies():
    one = trusting()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    one.step(START_NS)
    assert one.stage is Stage.SURVEY
    assert one.receive(*offered(one), START_NS).because == "its mission has begun (survey)"
    waiting = on_ground()
    for message in partner(START_NS):
        told = sign_status(message, AUTHORITY.trust("d2")) if isinstance(message, Status) else message
        waiting.receive(key_of(MISSION.swarm, told), encode(told), START_NS)
    assert waiting.receive(*offered(waiting), START_NS).because == "others fly the present mission: d2 (track)"
    later_ns = START_NS + 11 * SECOND
    assert on_ground(waiting, later_ns).receive(*offered(waiting, later_ns), later_ns).refused == ""


def test_nothing_starts_while_a_mission_is_being_taken_and_it_does_once_that_has_failed():
    one = trusting()
    on_ground(one)
    one.receive(*offered(one), START_NS)
    one.observe_vehicle(state(START_NS + 1, FlightMode.HOLD, armed=False, in_air=False))
    verdict = one.receive(*order(Action.START, START_NS), START_NS)
    assert verdict.because == f"start refused: it takes over the mission {NEW} from {OPERATOR_NAME}"
    one.decline("the disk is full")
    assert answer(one) == Answer(START_NS, NEW, "the disk is full")
    assert one.receive(*order(Action.START, START_NS), START_NS).refused == ""


def test_a_second_operators_mission_waits_for_the_answer_to_the_first():
    one = on_ground()
    one.receive(*offered(one), START_NS)
    verdict = one.receive(*offered(one, mission="f" * 16, stamp_ns=START_NS + 1), START_NS)
    assert verdict.because == f"it is taking over the mission {NEW} from {OPERATOR_NAME}"
    assert one.taking.mission == NEW
    assert answer(one) == Answer(START_NS, NEW)


def test_the_mission_that_a_drone_has_is_not_taken_again():
    one = on_ground()
    assert one.receive(*offered(one, mission=MISSION.mission_id), START_NS).because == "it has this mission already"


def test_a_swarm_without_certificates_takes_missions_too_but_only_with_a_ticket():
    one = on_ground(pilot())
    stale = offered(one, trust=None, to={"d1": Ticket("0" * 16, 1)})
    assert one.receive(*stale, START_NS).refused == "too_old"
    assert one.receive(*offered(one, trust=None), START_NS).refused == ""
