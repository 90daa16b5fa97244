"""A second mission on the same drone without a restart of its agent: nothing of the first one remains."""

import pytest

from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.codec import encode
from radron.protocol.entries import Coverage, Entry
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from support.flights.one_pilot import SECOND, START_NS, command, cone_of, messages, started, state, tracking

AGAIN_NS = START_NS + 120 * SECOND
GROUND = {"armed": False, "in_air": False, "position": (2.0, 1.0, 0.0)}


def landed():
    """Two minutes after its first start: it has tracked, and stands on the ground."""
    one = tracking()
    for tick in range(200):  # ten seconds more, with reports of its searched area
        now_ns = START_NS + 5 * SECOND + tick * SECOND // 20
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, position=(0.1 * tick, 0.0, 3.0)))
        one.step(now_ns)
    for before_s in (5, 1):  # a single report does not end a flight
        one.observe_vehicle(state(AGAIN_NS - before_s * SECOND, **GROUND))
        one.step(AGAIN_NS - before_s * SECOND)
    assert one.stage is Stage.LANDED
    assert one.hypothesis is not None
    return one


def test_a_second_start_begins_anew() -> None:
    one = landed()
    one.observe_vehicle(state(AGAIN_NS, **GROUND))
    one.receive(*command(stamp_ns=AGAIN_NS), AGAIN_NS)
    step = one.step(AGAIN_NS)
    assert (one.stage, step.command.request) == (Stage.TAKEOFF, Request.TAKEOFF)
    assert one.counters["dropped_command_refused"] == 0
    assert one.hypothesis is None
    later_ns = AGAIN_NS + 10 * SECOND
    one.observe_vehicle(state(later_ns))
    told = [*messages(one.step(later_ns), Status), *messages(one.step(later_ns + SECOND), Status)]
    assert told[-1].started_ns == AGAIN_NS
    assert one.stage is Stage.SURVEY  # cones of before its start do not lead it


def test_what_is_measured_after_the_second_start_counts() -> None:
    one = landed()
    one.observe_vehicle(state(AGAIN_NS, **GROUND))
    one.receive(*command(stamp_ns=AGAIN_NS), AGAIN_NS)
    for sequence in range(100, 120):
        cone = cone_of("d2", sequence, AGAIN_NS + (sequence - 99) * SECOND // 5)
        one.receive(key_of("radron", cone), encode(cone), cone.stamp_ns)
    now_ns = AGAIN_NS + 10 * SECOND
    one.observe_vehicle(state(now_ns))
    one.step(now_ns)
    assert one.hypothesis is not None
    assert one.stage is Stage.TRACK


def test_a_start_of_drones_that_still_fly_the_first_mission_joins_them() -> None:
    one = landed()
    one.observe_vehicle(state(AGAIN_NS, **GROUND))
    other = Status(stamp_ns=AGAIN_NS, drone="d2", mission=mission_id(one), boot="2" * 16, stage=Stage.TRACK, started_ns=START_NS)
    one.receive(key_of("radron", other), encode(other), AGAIN_NS)
    one.receive(*command(stamp_ns=AGAIN_NS), AGAIN_NS)
    one.step(AGAIN_NS)
    assert one.stage is Stage.TAKEOFF
    assert one.hypothesis is not None  # found by the swarm so far


def mission_id(one):
    return one._mission_id


def test_what_was_searched_in_the_first_mission_is_searched_again() -> None:
    one = landed()
    first = [entry for entry in one.fusion.log.entries(Coverage) if isinstance(entry, Entry)]
    one.observe_vehicle(state(AGAIN_NS, **GROUND))
    one.receive(*command(stamp_ns=AGAIN_NS), AGAIN_NS)
    one.step(AGAIN_NS)
    assert one._executive._search._covered.area.is_empty
    assert one.fusion.log.entries(Coverage) == first


@pytest.mark.parametrize(("measured_s", "now_s", "missed"), [(-2, 5, False), (1, 5, True), (1, 3700, False)])
def test_one_that_was_never_heard_is_missed_if_it_has_measured_since_the_start_and_may_still_fly(measured_s, now_s, missed):
    """Its camera measured before the start, on the ground, and it was switched off there; or its battery must be empty by now."""
    one = started()
    cone = cone_of("d2", 0, START_NS + measured_s * SECOND)
    one.receive(key_of("radron", cone), encode(cone), START_NS + SECOND)
    assert len(one.fusion.log) == 1
    told = []
    for tick in range(60):
        now_ns = START_NS + now_s * SECOND + tick * SECOND // 20
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
        told += messages(one.step(now_ns), Status)
    assert ("does not hear d2 any more" in told[-1].problems) is missed
