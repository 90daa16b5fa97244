"""A pilot with certificates: forged entries and commands do nothing, and are reported; each beside the allowed case."""

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from radron.agent.mission.orders import NONCE_NS, START_AGE_NS
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Credential, Entry
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.messages import MAX_ORDER_AGE_NS, Action, Command, Stage, Status
from radron.protocol.signing import Verifier, sign_command, sign_status
from radron.sim.lockstep.members import OPERATOR_NAME
from support.flights.members import AUTHORITY, FOREIGN, OPERATOR, cones, credential, give, order, trusting
from support.flights.one_pilot import MISSION, SECOND, START_NS, messages, state


def ready():
    """Not started yet, but in the air already, which a start accepts too."""
    one = trusting()
    one.observe_vehicle(state(START_NS))
    return one


def flying():
    one = ready()
    one.receive(*order(Action.START, START_NS), START_NS)
    one.step(START_NS)
    assert one.stage is Stage.SURVEY
    return one


def told(one, now_ns):
    (status,) = messages(one.step(now_ns), Status)
    return status.problems


def test_signed_entries_get_into_the_log_and_forged_ones_are_counted_and_told():
    one = trusting()
    give(one, credential(), *cones([1, 2, 3]))
    assert len(one.fusion.log) == 4
    digest = one.digest
    give(one, *cones([4, 5], sign=AUTHORITY.trust("d1").sign), replace(cones([6])[0], apex_sigma_m=3.0))
    assert one.digest == digest
    assert "messages of d2 that it has not signed were dropped: 3 x cone" in told(one, START_NS)
    give(one, *cones([4, 5]))
    assert len(one.fusion.log) == 6
    assert not any("not signed" in text for text in told(one, START_NS + 20 * SECOND))


def test_entries_that_come_before_their_certificate_wait_for_it():
    one, first = trusting(), credential()
    give(one, *cones([1, 2, 3]), *cones([4], sign=FOREIGN.trust("d2").sign))
    assert len(one.fusion.log) == 0
    give(one, first)
    assert len(one.fusion.log) == 4  # all but the foreign one
    assert "messages of d2 that it has not signed were dropped: 1 x cone" in told(one, START_NS)


def test_what_waits_is_bounded_and_the_log_query_brings_the_rest():
    one, other = trusting(), trusting("d2", boot="2" * 16)
    entries, first = cones(range(1, 700)), credential()
    give(one, *entries)
    give(other, first, *entries)
    give(one, first)
    assert len(one.fusion.log) == 501
    for _ in range(2):
        for key, payload in other.log_answer(one.log_summary()):
            one.receive(key, payload, START_NS)
    assert one.digest == other.digest


def test_an_answer_to_the_log_query_is_believed_only_as_far_as_it_is_signed():
    asking, honest = trusting("d1", boot="f" * 16), trusting("d2", boot="2" * 16)
    give(honest, credential(), *cones([1, 2, 3]))
    answer = honest.log_answer(asking.log_summary())
    forged = [decode_from(key, payload) for key, payload in answer]
    forged = [entry if isinstance(entry, Credential) else replace(entry, separation_mm=1.7) for entry in forged]
    give(asking, *forged)
    assert len(asking.fusion.log) == 1
    for key, payload in answer:
        asking.receive(key, payload, START_NS)
    assert asking.digest == honest.digest


def test_what_a_pilot_publishes_its_peers_accept():
    one, other = trusting(), trusting("d2", boot="2" * 16)
    one.observe_vehicle(state(START_NS))
    entries = [cone for cone in cones([1, 2], "d1", one._boot)]
    one._record([replace(entry, proof=b"") for entry in entries], START_NS)
    sent = [(key, payload) for key, payload in one.step(START_NS).publications if isinstance(decode_from(key, payload), Entry)]
    for key, payload in sent:
        other.receive(key, payload, START_NS)
    assert len(sent) == len(other.fusion.log) == 3
    assert one.digest == other.digest


def test_a_signed_start_is_obeyed_once():
    one = flying()
    again = order(Action.START, START_NS)
    one.receive(*again, START_NS + SECOND)
    assert one.counters["dropped_command_already_obeyed"] == 1


def unsigned(now_ns):
    key, payload = order(Action.LAND, now_ns)
    return key, encode(replace(decode_from(key, payload), signature=b"", certificate=b""))


def altered(now_ns):
    key, payload = order(Action.HOLD, now_ns)
    return key, encode(replace(decode_from(key, payload), action=Action.LAND))


WRONG = {
    "unsigned": unsigned,
    "foreign": lambda now_ns: order(Action.LAND, now_ns, FOREIGN.trust(OPERATOR_NAME, Role.OPERATOR)),
    "drone": lambda now_ns: order(Action.LAND, now_ns, AUTHORITY.trust(OPERATOR_NAME)),
    "observer": lambda now_ns: order(Action.LAND, now_ns, AUTHORITY.trust(OPERATOR_NAME, "observer")),
    "another": lambda now_ns: order(Action.LAND, now_ns, AUTHORITY.trust("tower", Role.OPERATOR)),
    "altered": altered,
    "elsewhere": lambda now_ns: order(Action.LAND, now_ns, mission="0" * 16),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_command_that_no_operator_of_this_swarm_has_signed_is_not_obeyed(wrong):
    one, now_ns = flying(), START_NS + SECOND
    one.receive(*WRONG[wrong](now_ns), now_ns)
    assert one.stage is Stage.SURVEY
    assert sum(number for name, number in one.counters.items() if name.startswith("dropped_command")) == 1
    one.receive(*order(Action.LAND, now_ns), now_ns)
    assert one.stage is Stage.LANDING


@pytest.mark.parametrize("action", [Action.HOLD, Action.RETURN, Action.LAND, Action.ABORT])
@pytest.mark.parametrize("ahead_s", [-(10**9), 10**8])
def test_a_laptop_with_a_wrong_clock_commands_everything_but_a_start(action, ahead_s):
    one, now_ns = flying(), START_NS + SECOND
    one.receive(*order(action, now_ns, stamp_ns=now_ns + ahead_s * SECOND), now_ns)
    assert one.stage is not Stage.SURVEY
    ground = ready()
    ground.receive(*order(Action.START, START_NS, stamp_ns=START_NS + ahead_s * SECOND), START_NS)
    assert ground.stage is Stage.PREFLIGHT
    assert ground.counters["dropped_command_too_old"] == 1


def test_recorded_delayed_and_reordered_commands_are_not_obeyed():
    one, now_ns = flying(), START_NS + SECOND
    hold, resume = order(Action.HOLD, now_ns), order(Action.RESUME, now_ns + SECOND)
    one.receive(*hold, now_ns)
    one.receive(*resume, now_ns + SECOND)
    assert one.stage is Stage.SURVEY
    one.receive(*hold, now_ns + 2 * SECOND)
    assert one.stage is Stage.SURVEY  # a recorded message, sent again
    late = order(Action.HOLD, now_ns + 3 * SECOND)
    later_ns = now_ns + 3 * SECOND + MAX_ORDER_AGE_NS
    one.receive(*late, later_ns)
    assert one.stage is Stage.SURVEY  # held back by an attacker, never seen before
    one.receive(*order(Action.HOLD, later_ns), later_ns)
    assert one.stage is Stage.HOLD


@pytest.mark.parametrize("action", [Action.HOLD, Action.RETURN, Action.LAND, Action.ABORT])
@pytest.mark.parametrize("into_period", [0, NONCE_NS - 1])
def test_no_command_is_obeyed_five_seconds_after_it_was_given_by_the_drones_clock(action, into_period):
    given_ns = START_NS - START_NS % NONCE_NS + 2 * SECOND + into_period
    for age_ns, is_obeyed in ((4 * SECOND, True), (5 * SECOND, False), (15 * SECOND, False)):
        one = flying()
        one.receive(*order(action, given_ns), given_ns + age_ns)
        assert (one.stage is not Stage.SURVEY) == is_obeyed
        assert one.counters["dropped_command_too_old"] == (not is_obeyed)


def test_a_command_with_the_largest_number_does_not_keep_later_ones_out():
    one, now_ns = flying(), START_NS + SECOND
    hold = decode_from(*order(Action.HOLD, now_ns))
    last = sign_command(replace(hold, to={"d1": replace(hold.to["d1"], number=2**63 - 1)}), OPERATOR)
    one.receive(key_of(MISSION.swarm, last), encode(last), now_ns)
    assert one.counters["dropped_command_numbered_too_high"] == 1
    (status,) = messages(one.step(now_ns), Status)
    landing = sign_command(replace(hold, action=Action.LAND, to={"d1": status.ticket}), OPERATOR)
    one.receive(key_of(MISSION.swarm, landing), encode(landing), now_ns)
    assert one.stage is Stage.LANDING


def test_after_a_restart_old_commands_are_refused_and_new_ones_obeyed():
    one, now_ns = flying(), START_NS + SECOND
    landing = order(Action.LAND, now_ns)
    again = trusting(boot="e" * 16, memory=one.memory)
    again.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
    again.step(now_ns)
    assert again.stage is Stage.SURVEY
    again.receive(*landing, now_ns)
    assert again.stage is Stage.SURVEY
    command = decode_from(*landing)
    renewed = sign_command(replace(command, to={"d1": again.ticket(now_ns)}), OPERATOR)
    again.receive(key_of(MISSION.swarm, renewed), encode(renewed), now_ns)
    assert again.stage is Stage.LANDING


def test_the_status_carries_the_ticket_that_the_next_command_needs():
    one = flying()
    (status,) = messages(one.step(START_NS + SECOND), Status)
    command = Command(stamp_ns=0, station=OPERATOR_NAME, mission=MISSION.mission_id, action=Action.LAND, to={"d1": status.ticket})
    signed = sign_command(command, OPERATOR)
    one.receive(key_of(MISSION.swarm, signed), encode(signed), START_NS + 2 * SECOND)
    assert one.stage is Stage.LANDING


STATUS = Status(stamp_ns=START_NS, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.TRACK)
NOT_OF_D2 = {
    "unsigned": STATUS,
    "foreign": sign_status(STATUS, FOREIGN.trust("d2")),
    "another drone's": sign_status(STATUS, AUTHORITY.trust("d3")),
    "an operator's": sign_status(STATUS, AUTHORITY.trust("d2", Role.OPERATOR)),
    "altered": replace(sign_status(STATUS, AUTHORITY.trust("d2")), started_ns=1),
    "a command's signature": replace(sign_status(STATUS, AUTHORITY.trust("d2")), signature=AUTHORITY.trust("d2").sign(b"x")),
}


@pytest.mark.parametrize("wrong", NOT_OF_D2)
def test_a_status_that_its_drone_has_not_signed_counts_for_nothing(wrong):
    one = trusting()
    key = key_of(MISSION.swarm, STATUS)
    one.receive(key, encode(NOT_OF_D2[wrong]), START_NS)
    assert not one._peers.statuses(START_NS)
    assert one.counters["dropped_unsigned_status"] == 1
    assert "messages of d2 that it has not signed were dropped: 1 x status" in told(one, START_NS)
    one.receive(key, encode(sign_status(STATUS, AUTHORITY.trust("d2"))), START_NS)
    assert one._peers.statuses(START_NS)["d2"].stage is Stage.TRACK


def test_the_status_of_a_pilot_is_accepted_by_its_peers():
    one, other = flying(), trusting("d2", boot="2" * 16)
    status = next(sent for sent in one.step(START_NS + SECOND).publications if sent[0].endswith("/status"))
    other.receive(*status, START_NS + SECOND)
    assert other._peers.statuses(START_NS + SECOND)["d1"].stage is Stage.SURVEY


def test_a_start_whose_stamp_is_far_off_is_refused_though_it_was_given_just_now():
    for off_ns, stage in ((START_AGE_NS, Stage.TAKEOFF), (START_AGE_NS + SECOND, Stage.PREFLIGHT)):
        one = ready()
        one.receive(*order(Action.START, START_NS, stamp_ns=START_NS - off_ns), START_NS)
        assert one.stage is stage


def test_a_status_names_the_last_order_that_was_obeyed_and_who_signed_it():
    one = flying()
    now_ns = START_NS + SECOND
    one.receive(*order(Action.HOLD, now_ns), now_ns)
    refused_ns = now_ns + SECOND
    one.receive(*order(Action.LAND, refused_ns, FOREIGN.trust("anna", Role.OPERATOR), station="anna"), refused_ns)
    (status,) = messages(one.step(refused_ns), Status)
    told = status.obeyed
    assert (told.order, told.station, told.stamp_ns, told.number) == ("hold", OPERATOR_NAME, now_ns, status.ticket.number - 1)
    assert Verifier(AUTHORITY).accepts_obeyed(status)


def test_a_status_names_no_order_before_the_first_one():
    (status,) = messages(ready().step(START_NS), Status)
    assert status.obeyed is UNSET
