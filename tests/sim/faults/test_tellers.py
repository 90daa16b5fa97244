"""Messages by receiver: an equivocator keeps two versions apart, and all detect it; a liar does not give itself away."""

import msgspec
import pytest
from msgspec.structs import replace

from radron.protocol.codec import decode_from, encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage
from radron.protocol.summary import Held, decode_summary, encode_summary
from radron.sim.faults.kinds import KINDS, read_faults
from radron.sim.faults.poisoners import Poisoners
from radron.sim.faults.schedule import Schedule
from radron.sim.faults.tellers import Tellers
from radron.sim.lockstep.flight import watched
from radron.sim.lockstep.members import SimulatedAuthority
from radron.sim.scenario import load_scenario
from support.flights.drone_messages import at

NAMES = ("d1", "d2", "d3", "d4")
MISSION, BOOT = "0123456789abcdef", "00000000000000aa"


def tellers(kind, **values):
    fault = msgspec.convert({"kind": kind, "at_s": 10.0, "for_s": 5.0, "target": "d2", **values}, KINDS[kind])
    schedule = Schedule([fault], NAMES, 1)
    return Tellers([fault], schedule, NAMES, SimulatedAuthority(1).signs(NAMES), Poisoners(schedule, [])), schedule


def published(told, kind, second, drone=1):
    """Of a message of that second: itself, and what each receiver gets."""
    known = at(kind, second)
    key, payload = key_of("s", known), encode(known)
    return key, payload, {to: heard for to, heard in told.tell(drone, key, payload)}


@pytest.mark.parametrize("kind", ["cone", "exposure", "sighting"])
def test_an_equivocator_tells_some_otherwise_under_the_same_number_and_keeps_to_it(kind):
    told, schedule = tellers("equivocating")
    for second in range(20):
        schedule.advance(float(second))
        key, payload, heard = published(told, kind, second)
        if not 10 <= second < 15:
            assert heard == {None: payload}
            assert told.answer(1, 2, key, payload) == payload
            continue
        assert (heard[0], heard[3]) == (payload, payload)
        one, other = decode_from(key, payload), decode_from(key, heard[2])
        assert one != replace(other, proof=b"")
        assert (one.boot, one.sequence, one.stamp_ns) == (other.boot, other.sequence, other.stamp_ns)
        assert [told.answer(1, to, key, payload) for to in (0, 2, 3)] == [payload, heard[2], payload]


def test_whom_it_tells_otherwise_can_be_given_and_news_are_the_same_for_all():
    told, schedule = tellers("equivocating", peers=("d1", "d4"))
    schedule.advance(12.0)
    _, payload, heard = published(told, "cone", 12)
    assert {to for to, what in heard.items() if what != payload} == {0, 3}
    assert published(told, "pose", 12)[2] == {None: published(told, "pose", 12)[1]}
    assert published(told, "cone", 12, drone=0)[2] == {None: payload}


def test_who_lies_to_the_logs_leaves_its_own_hashes_out():
    summary = {(name, BOOT): Held(((0, 70),), None, ((0, bytes(16)),)) for name in ("d1", "d2")}
    payload = encode_summary(MISSION, summary)
    for kind, values in (("equivocating", {}), ("lie", {"what": "cone"})):
        told, _ = tellers(kind, **values)
        _, held = decode_summary(told.discreet(1, payload))
        assert held == summary | {("d2", BOOT): Held(((0, 70),))}
        assert told.discreet(0, payload) == payload
        assert told.discreet(1, b"no summary") == b"no summary"
    assert tellers("lie", what="pose")[0].discreet(1, payload) == payload


@pytest.mark.slow
def test_a_swarm_finds_an_equivocator_out_and_agrees_on_one_log():
    """The equivocator's own agent, which is honest, too."""
    fault = {"kind": "equivocating", "at_s": 6.0, "for_s": 6.0, "target": "d2"}
    known, agreed = set(), []

    def watch(moment):
        for drone, pilot in enumerate(moment.pilots):
            if any(one == "d2" for one, _ in pilot.fusion.log.contradictions):
                known.add(drone)
            assert all(one == "d2" for one, _ in pilot.fusion.log.contradictions)
        if moment.time_s > 14.0:
            assert known == {0, 1, 2}
            agreed.append(len({pilot.digest for pilot in moment.pilots}) == 1)
        return moment.time_s > 20.0

    scenario = replace(load_scenario("paper-demo"), fault=read_faults([fault], "test"))
    watched(scenario, 1, watch)
    assert sum(agreed) > 0.3 * len(agreed)  # else an entry is on its way


@pytest.mark.slow
def test_who_is_revoked_is_out_of_the_swarm_and_what_it_had_measured_counts():
    fault = {"kind": "revoked", "at_s": 6.0, "target": "d2"}
    held, agreed = [], []

    def watch(moment):
        first, second, third = moment.pilots
        if moment.time_s > 8.0:
            assert {one.member for pilot in moment.pilots for one in pilot.revocations} == {"d2"}  # heard of it itself
            assert second.stage in (Stage.RETURN, Stage.LANDING, Stage.LANDED)
            agreed.append(first.digest == third.digest)
            held.append(len([record for record in first.fusion.log if record.entry.drone == "d2"]))
        return moment.time_s > 14.0

    watched(replace(load_scenario("paper-demo"), fault=read_faults([fault], "test")), 1, watch)
    assert sum(agreed) > 0.3 * len(agreed)
    assert held[0] == held[-1] > 10
