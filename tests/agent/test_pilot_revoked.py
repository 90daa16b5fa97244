"""Revocation in flight, as pilots see it: each attack beside the allowed case, and all pilots with one log whatever the order."""

import random
from dataclasses import replace as replace_in
from math import isinf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.fusion.revocations import MAX_REFUSED_REVOCATIONS_PS
from radron.agent.mission.commanding import Verdict
from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codec import decode, encode
from radron.protocol.entries import Coverage
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.messages import Action, Pose, Stage, Status
from radron.protocol.revocations import MAX_HELD_REVOCATIONS, Revoked
from radron.protocol.signing import sign_entries
from support.flights.members import (
    AUTHORITY,
    BOOT,
    FOREIGN,
    LATER,
    NUMBERS,
    cones,
    credential,
    full,
    give,
    keyed,
    order,
    passed_on,
    revocation,
    trusting,
)
from support.flights.one_pilot import MISSION, SECOND, START_NS, fly, messages, partner, state

ANNA = AUTHORITY.trust("anna", Role.OPERATOR, may_revoke=True)
OBEYED = Verdict()


def counted(one):
    """The numbers that count of d2, by boot."""
    one.advance(START_NS)
    entries = [record.entry for record in one.fusion.log]
    return {boot: [entry.sequence for entry in entries if entry.boot == boot] for boot in (BOOT, LATER)}


def status_of(one, now_ns=START_NS):
    (status,) = messages(one.step(now_ns), Status)
    return status


def test_a_revocation_leaves_out_what_lies_beyond_its_numbers():
    one, never = full(), trusting(boot="e" * 16)
    give(never, credential(), *cones(NUMBERS)[:6])
    assert one.receive(*revocation(last={BOOT: 6}), START_NS) == OBEYED
    assert counted(one) == {BOOT: [0, 1, 2, 3, 4, 5, 6], LATER: []}
    assert one.digest == never.digest
    assert one.log_summary() == never.log_summary()
    assert "d2 has been revoked by lockstep" in status_of(one).notices


@pytest.mark.parametrize(
    ("wrong", "refused"),
    [
        ({"trust": AUTHORITY.trust("bert", Role.OPERATOR)}, "without_the_right"),
        ({"trust": AUTHORITY.trust("d1")}, "by_a_drone"),
        ({"trust": AUTHORITY.trust("eve", Role.OBSERVER)}, "by_a_observer"),
        ({"trust": AUTHORITY.trust("eve", Role.OBSERVER, may_revoke=True)}, "by_a_observer"),
        ({"trust": FOREIGN.trust("lockstep", Role.OPERATOR, may_revoke=True)}, "without_valid_certificate"),
        ({"trust": ANNA, "station": "lockstep"}, "without_valid_certificate"),
        ({"signature": b""}, "forged"),
        ({"signature": bytes(64)}, "forged"),
        ({"member": "d1", "altered": {"member": "d2"}}, "forged"),
        ({"last": {BOOT: 9}, "altered": {"last": {}}}, "forged"),
        ({"until_ns": START_NS - 1}, "void"),
        ({"stamp_ns": 0}, "with_expired_certificate"),
    ],
)
def test_only_an_operator_with_the_right_revokes(wrong, refused):
    one = full()
    before = one.digest
    assert one.receive(*revocation(**wrong), START_NS).refused == refused
    one.advance(START_NS)
    assert one.digest == before
    assert one.counters[f"dropped_revocation_{refused}"] == 1
    assert not passed_on(one)
    assert one.receive(*revocation(), START_NS) == OBEYED  # the twin
    one.advance(START_NS)
    assert one.digest != before
    assert passed_on(one, START_NS + SECOND)


def test_whom_the_authority_has_revoked_revokes_nobody():
    trust = AUTHORITY.trust("d1")
    gone = replace_in(trust, revoked=frozenset({AUTHORITY.verify(ANNA.certificate).serial}))
    one = Pilot(MISSION, DroneConfig(id="d1"), boot="f" * 16, trust=gone, nonce_key=b"")
    assert one.receive(*revocation(trust=ANNA), START_NS).refused == "with_revoked_certificate"
    assert one.receive(*revocation(), START_NS) == OBEYED


def test_a_key_whose_certificate_has_ended_revokes_nobody_but_what_was_taken_in_time_counts():
    """The stamp of a revocation is its signer's word: the finder of an old laptop could choose an earlier one."""
    one, late_ns = full(), AUTHORITY.verify(ANNA.certificate).not_after_ns + SECOND
    key, payload = revocation(trust=ANNA, until_ns=2 * late_ns)
    assert one.receive(key, payload, late_ns).refused == "with_expired_certificate"
    assert one.revocations == ()
    passed_on = Revoked(stamp_ns=late_ns, drone="d2", held=(decode(payload),))
    assert one.receive(*keyed(passed_on), late_ns) == OBEYED
    in_time = full(boot="e" * 16)
    assert in_time.receive(key, payload, START_NS) == OBEYED
    for pilot in (one, in_time):
        pilot.advance(START_NS)
    assert one.digest == in_time.digest


def test_a_swarm_without_certificates_revokes_nobody():
    one = Pilot(MISSION, DroneConfig(id="d1"), boot="f" * 16, nonce_key=b"")
    assert one.receive(*revocation(), START_NS).refused == "without_certificates"


def test_an_old_revocation_that_is_sent_again_changes_nothing():
    one, old, newer = full(), revocation(last={BOOT: 8, LATER: 3}), revocation(last={BOOT: 4}, stamp_ns=START_NS + SECOND)
    assert one.receive(*old, START_NS) == OBEYED
    assert one.receive(*old, START_NS) is None
    assert one.receive(*newer, START_NS) == OBEYED
    digest = counted(one) and one.digest
    assert one.receive(*old, START_NS) is None
    assert counted(one) == {BOOT: [0, 1, 2, 3, 4], LATER: []}
    assert one.digest == digest
    assert len(one.revocations) == 1


def test_entries_beyond_the_number_are_refused_from_everybody_and_others_are_taken():
    one, unaware = trusting(boot="f" * 16), full(boot="e" * 16)
    give(one, credential(), *cones(NUMBERS)[:2])
    one.receive(*revocation(last={BOOT: 6}), START_NS)
    early = replace(cones([3])[0], stamp_ns=START_NS - 50 * SECOND, sequence=7, proof=b"")
    give(one, *sign_entries([early], AUTHORITY.trust("d2").sign))  # backdated
    give(one, *cones([7]), credential(boot="4" * 16), *cones([1], boot="4" * 16))  # directly, and in a boot of its own
    for _ in range(3):
        for key, payload in unaware.log_answer(one.log_summary()):
            one.receive(key, payload, START_NS)
    assert counted(one) == {BOOT: [0, 1, 2, 3, 4, 5, 6], LATER: []}
    assert one.digest != unaware.digest
    unaware.receive(*revocation(last={BOOT: 6}), START_NS)
    unaware.advance(START_NS)
    assert one.digest == unaware.digest


def test_entries_that_wait_for_their_certificate_are_left_out_too():
    one = trusting()
    give(one, *cones(NUMBERS))
    one.receive(*revocation(last={BOOT: 6}), START_NS)
    give(one, credential())
    assert counted(one)[BOOT] == [0, 1, 2, 3, 4, 5, 6]


cuts = st.dictionaries(st.sampled_from([BOOT, LATER]), st.integers(0, 11))


@settings(max_examples=40)
@given(st.lists(cuts, min_size=1, max_size=3), st.randoms(use_true_random=False))
def test_logs_and_digests_are_equal_whatever_the_order(lasts, chance: random.Random):
    """Entries and revocations in any order, with work in between: all leave out the same."""
    entries = [credential(), *cones(NUMBERS), credential(boot=LATER), *cones(NUMBERS, boot=LATER)]
    told = [(key_of(MISSION.swarm, entry), encode(entry)) for entry in entries]
    told += [revocation(last=last, stamp_ns=START_NS + number) for number, last in enumerate(lasts)]
    found = []
    for boot in ("e" * 16, "f" * 16):
        one = trusting(boot=boot)
        chance.shuffle(told)
        for key, payload in told:
            one.receive(key, payload, START_NS)
            if chance.random() < 0.2:
                one.advance(START_NS)
        found.append((counted(one), one.digest))
    least = {boot: min(last.get(boot, -1) for last in lasts) for boot in (BOOT, LATER)}
    assert found[0] == found[1]
    assert found[0][0] == {boot: list(range(min(last, 10) + 1)) for boot, last in least.items()}


def test_a_forged_source_is_forgotten():
    """The hypothesis is that of a drone that never heard of the entries left out."""
    one, never = trusting(), trusting()
    true = [credential(), *cones(range(1, 21))]
    turned = [replace(cone, apex_m=(cone.apex_m[0] + 15.0, *cone.apex_m[1:]), proof=b"") for cone in cones(range(21, 41))]
    for pilot, entries in ((one, [*true, *sign_entries(turned, AUTHORITY.trust("d2").sign)]), (never, true)):
        pilot.observe_vehicle(state(START_NS))
        pilot.receive(*order(Action.START, START_NS), START_NS)
        give(pilot, *entries, now_ns=START_NS + 9 * SECOND)
        for _ in range(5):
            pilot.advance(START_NS + 9 * SECOND)
    assert one.hypothesis.position.tolist() != never.hypothesis.position.tolist()
    for pilot in (one, never):
        pilot.receive(*revocation(last={BOOT: 20}), START_NS + 9 * SECOND)
        for _ in range(50):
            pilot.advance(START_NS + 10 * SECOND)
    assert one.digest == never.digest
    assert one.hypothesis.position.tolist() == never.hypothesis.position.tolist()
    assert not one.fusion.pending


def test_the_revoked_drone_itself_has_no_hypothesis_any_more_and_keeps_the_log():
    one = trusting()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    give(one, credential(), *cones(range(1, 21)), now_ns=START_NS + 9 * SECOND)
    one.advance(START_NS + 9 * SECOND)
    assert one.hypothesis is not None
    digest = one.digest
    assert one.receive(*revocation(member="d1"), START_NS + 9 * SECOND) == OBEYED
    give(one, *cones(range(21, 41)), now_ns=START_NS + 10 * SECOND)
    one.advance(START_NS + 10 * SECOND)
    assert (one.hypothesis, one.outlook, one.pending, one.backlog_s) == (None, None, False, 0.0)
    assert one.digest != digest


def test_a_revoked_drone_that_climbs_keeps_from_the_circle_of_those_that_it_does_not_hear():
    """The others circle on around the source; the revoked drone has no estimate of it any more."""
    one = trusting()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    give(one, credential(), *cones(range(1, 21)), now_ns=START_NS + 9 * SECOND)
    for message in partner(START_NS + 9 * SECOND):
        one.receive(*keyed(message), START_NS + 9 * SECOND)
    fly(one, START_NS + 9 * SECOND, 0.5, FlightMode.OFFBOARD, position=(10.0, 0.0, 3.0))
    assert one.stage is Stage.TRACK
    assert one.receive(*revocation(member="d1"), START_NS + 10 * SECOND) == OBEYED
    fly(one, START_NS + 10 * SECOND, 6.0, FlightMode.OFFBOARD, position=(10.0, 0.0, 3.0))
    assert (one.stage, one.hypothesis) == (Stage.RETURN, None)
    assert [plan.id for plan in one.reckoning.others if not isinf(plan.radius_m)] == ["d2"]


def test_what_a_revoked_drone_has_searched_is_searched_again():
    path = tuple((float(x), 10.0) for x in range(8))
    width_m = MISSION.survey.lane_spacing_m
    bare = Coverage(
        stamp_ns=START_NS + SECOND,
        drone="d2",
        mission=MISSION.mission_id,
        boot=BOOT,
        sequence=11,
        epoch=0,
        path_m=path,
        swath_m=width_m,
    )
    one = trusting()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    give(
        one,
        credential(),
        *sign_entries([bare, replace(bare, sequence=12, stamp_ns=START_NS + 6 * SECOND)], AUTHORITY.trust("d2").sign),
    )
    searched = one._executive._search._covered
    searched.work(100.0)
    both_m2 = searched.area.area
    one.receive(*revocation(last={BOOT: 11}), START_NS)
    searched.work(100.0)
    assert searched.area.area == pytest.approx(both_m2)  # the same stretch twice
    one.receive(*revocation(last={BOOT: 10}, stamp_ns=START_NS + 1), START_NS)
    searched.work(100.0)
    assert searched.area.area == 0.0 < both_m2


def test_a_revocation_is_passed_on_and_reaches_who_has_not_heard_the_operator():
    one, other, late = full(), full(boot="e" * 16), full(boot="d" * 16)
    one.receive(*revocation(last={BOOT: 6}), START_NS)
    ((key, payload),) = passed_on(one)
    assert key == "radron/2/radron/d1/revoked"
    assert other.receive("radron/2/radron/d2/revoked", encode(_as_from(payload, "d2")), START_NS) == OBEYED
    assert not passed_on(one, START_NS + SECOND // 2)
    ((key, payload),) = passed_on(one, START_NS + 20 * SECOND)  # again and again
    late.receive("radron/2/radron/d2/revoked", encode(_as_from(payload, "d2")), START_NS + 20 * SECOND)
    for pilot in (one, other, late):
        pilot.advance(START_NS)
    assert one.digest == other.digest == late.digest
    assert one.revocations == other.revocations == late.revocations


def _as_from(payload, drone):
    """The messages that d1 passes on, as from another drone: the pilots here are all d1."""
    return replace(decode(payload), drone=drone)


def test_what_is_passed_on_is_believed_only_as_it_was_signed():
    one = full()
    before = one.digest
    genuine = full(boot="e" * 16)
    genuine.receive(*revocation(last={BOOT: 6}), START_NS)
    forged = replace(genuine.revocations[0], last={})
    verdict = one.receive(*keyed(Revoked(stamp_ns=START_NS, drone="d2", held=(forged,))), START_NS)
    one.advance(START_NS)
    assert verdict.refused == "forged"
    assert one.digest == before
    assert one.receive(*keyed(Revoked(stamp_ns=START_NS, drone="d2", held=(forged, genuine.revocations[0]))), START_NS) == OBEYED


def test_news_of_a_revoked_drone_are_dropped_and_its_last_place_is_kept():
    one = full()
    for message in partner(START_NS):
        one.receive(*keyed(message), START_NS)
    one.receive(*revocation(), START_NS)
    for message in partner(START_NS + SECOND):
        one.receive(*keyed(message), START_NS + SECOND)
    assert one.counters["dropped_revoked"] == 2
    assert one._executive._navigator.excluded == {"d2"}
    assert isinstance(one._peers["d2"].pose, Pose)
    assert one._peers["d2"].pose.stamp_ns == START_NS
    unaware = full()
    for message in (*partner(START_NS), *partner(START_NS + SECOND)):
        unaware.receive(*keyed(message), START_NS + SECOND)
    assert unaware._peers["d2"].pose.stamp_ns == START_NS + SECOND


def test_a_revoked_operator_commands_no_more_but_its_revocations_stand():
    one = full()
    one.observe_vehicle(state(START_NS))
    assert one.receive(*revocation(last={BOOT: 6}, trust=ANNA), START_NS) == OBEYED
    assert one.receive(*revocation(member="anna"), START_NS) == OBEYED
    assert one.receive(*_of_anna(Action.START), START_NS).refused == "with_revoked_certificate"
    assert one.stage is Stage.PREFLIGHT
    assert counted(one)[BOOT] == [0, 1, 2, 3, 4, 5, 6]
    assert one.receive(*order(Action.START, START_NS), START_NS) == OBEYED


def test_an_operator_that_is_not_revoked_commands():
    one = full()
    one.observe_vehicle(state(START_NS))
    assert one.receive(*_of_anna(Action.START), START_NS) == OBEYED


def _of_anna(action):
    return order(action, START_NS, trust=ANNA, station="anna")


def test_the_revoked_drone_itself_says_so_and_does_not_start():
    one = full()
    one.observe_vehicle(state(START_NS))
    assert one.receive(*revocation(member="d1"), START_NS) == OBEYED
    assert "d1 has been revoked by lockstep: no other drone hears it any more" in status_of(one).problems
    assert "revoked" in one.receive(*order(Action.START, START_NS), START_NS).because


def test_revocations_are_bounded():
    one = full()
    for number in range(MAX_HELD_REVOCATIONS):
        assert one.receive(*revocation(member=f"x{number}"), START_NS) == OBEYED
    assert one.receive(*revocation(member="y"), START_NS).refused == "one_too_many"
    ((_, payload),) = passed_on(one)
    assert len(payload) < 16_000


def test_a_flood_of_forged_revocations_costs_little_and_a_genuine_one_of_that_drone_gets_through_afterwards():
    one, forged = full(), decode(revocation(signature=bytes(64))[1])
    flood = Revoked(stamp_ns=START_NS, drone="d2", held=(forged,) * MAX_HELD_REVOCATIONS)
    for _ in range(100):
        one.receive(*keyed(flood), START_NS)
    assert one.counters["dropped_revocation_forged"] == MAX_REFUSED_REVOCATIONS_PS
    assert one.counters["dropped_revocation_flood"] > 50
    assert one.receive(*keyed(replace(flood, held=(decode(revocation()[1]),))), START_NS) is None  # by the same drone
    assert one.receive(*keyed(replace(flood, held=(decode(revocation()[1]),))), START_NS + SECOND) == OBEYED


def test_whoever_sends_forged_revocations_uses_up_nobody_elses_share():
    one, forged = full(), decode(revocation(signature=bytes(64))[1])
    flood = Revoked(stamp_ns=START_NS, drone="d2", held=(forged,) * MAX_HELD_REVOCATIONS)
    for _ in range(100):
        one.receive(*keyed(flood), START_NS)
    assert one.receive(*revocation(), START_NS) == OBEYED
