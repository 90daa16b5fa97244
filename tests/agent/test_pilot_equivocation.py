"""A drone that signs two different entries under one number: all leave the same out, in any order of arrival, and report it."""

from itertools import permutations

import pytest
from msgspec.structs import replace

from radron.protocol.messages import Status
from radron.protocol.signing import sign_entries
from support.flights.members import AUTHORITY, cones, credential, give, trusting
from support.flights.one_pilot import SECOND, START_NS, messages, state

NUMBER = 17
COUNTED = list(cones(range(1, NUMBER)))


def signed(entry):
    return next(sign_entries([replace(entry, proof=b"")], AUTHORITY.trust("d2").sign))


def versions():
    """A cone, another of the same stamp and number, and a third of the same number and another stamp."""
    (cone,) = cones([NUMBER])
    order, other = cone.orders
    turned = replace(cone, orders=(replace(order, axis=other.axis), replace(other, axis=order.axis)))
    return cone, signed(turned), signed(replace(cone, stamp_ns=cone.stamp_ns + SECOND))


def after(*entries):
    """A pilot that has got these entries, and so much more that it has a hypothesis."""
    one = trusting()
    give(one, *entries, now_ns=START_NS + 6 * SECOND)
    give(one, *COUNTED, *cones(range(NUMBER + 1, 30)), now_ns=START_NS + 6 * SECOND)
    for _ in range(20):
        one.advance(START_NS + 8 * SECOND)
    return one


def payloads(one):
    return [record.payload for record in one.fusion.log]


@pytest.mark.parametrize("order", [*permutations(range(4))], ids=str)
def test_two_versions_of_an_entry_leave_all_logs_the_same_in_any_order(order):
    first = (credential(), *versions())
    one, other = after(*first), after(*(first[place] for place in order))
    assert one.digest == other.digest
    assert payloads(one) == payloads(other)
    assert one.hypothesis is not None
    assert one.hypothesis.covariance.tolist() == other.hypothesis.covariance.tolist()


def test_nothing_counts_from_the_contradiction_on_and_an_honest_drones_entries_are_all_kept():
    numbers = [record.entry.sequence for record in after(credential(), *versions()[:2]).fusion.log]
    assert sorted(numbers) == list(range(NUMBER))
    assert len(after(credential(), versions()[0]).fusion.log) == 30


def test_hypotheses_are_those_of_a_swarm_that_never_got_what_does_not_count():
    """However much was folded before the contradiction was known."""
    one, plain = after(credential(), versions()[0]), trusting()
    folded = one.hypothesis
    give(one, versions()[1], now_ns=START_NS + 8 * SECOND)
    give(plain, credential(), *COUNTED, now_ns=START_NS + 6 * SECOND)
    for _ in range(40):
        one.advance(START_NS + 8 * SECOND)
        plain.advance(START_NS + 8 * SECOND)
    assert one.digest == plain.digest
    assert one.hypothesis.covariance.tolist() == plain.hypothesis.covariance.tolist() != folded.covariance.tolist()


def test_drones_that_were_told_different_versions_find_out_and_tell_the_operator():
    one, other = (after(credential(), version) for version in versions()[:2])
    assert one.digest != other.digest
    for asking, asked in ((one, other), (other, one)):
        for key, payload in asked.log_answer(asking.log_summary()):
            asking.receive(key, payload, START_NS + 8 * SECOND)
        for _ in range(20):
            asking.advance(START_NS + 8 * SECOND)
    assert one.digest == other.digest
    for told in (one, other):
        told.observe_vehicle(state(START_NS + 9 * SECOND))
        (status,) = messages(told.step(START_NS + 9 * SECOND), Status)
        (notice,) = status.notices
        assert notice.startswith(f"d2 has published two different log entries with the number {NUMBER}")
    assert one.log_answer(other.log_summary()) == other.log_answer(one.log_summary()) == []


def test_without_the_drones_signature_a_second_version_changes_nothing():
    """Else an attacker could take a drone's measurements out of the swarm's logs."""
    one, plain = (after(credential(), versions()[0]) for _ in range(2))
    give(one, replace(versions()[1], proof=versions()[0].proof), now_ns=START_NS + 8 * SECOND)
    assert one.digest == plain.digest
    assert not one.fusion.log.contradictions
