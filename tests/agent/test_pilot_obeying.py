"""A revoked drone signs that it obeys and flies home: the drones that believe it, and the senders that may not say it."""

import msgspec
import pytest
from msgspec.structs import replace

from radron.agent.fusion.revocations import MAX_REFUSED_REVOCATIONS_PS
from radron.agent.mission.memory import Memory
from radron.agent.navigation.home import REVOKED_NO_NEARER_S
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.codec import decode
from radron.protocol.identity import Role
from radron.protocol.messages import Action, Pose, Stage
from radron.protocol.revocations import MAX_HELD_REVOCATIONS, Revoked
from radron.protocol.signing import sign_obeying
from support.flights.members import AUTHORITY, BOOT, full, keyed, order, passed_on, revocation, trusting
from support.flights.one_pilot import MISSION, SECOND, START_NS, fly, partner, state


def obeying(one, now_ns):
    """The drones that a pilot passes on as obeying."""
    ((_, payload),) = passed_on(one, now_ns)
    return tuple(word.drone for word in decode(payload).obeying)


def word(held, drone="d2", signer=None):
    """Of a drone that it obeys a revocation."""
    return replace(sign_obeying(held, AUTHORITY.trust(signer or drone)), drone=drone)


@pytest.mark.parametrize(
    ("mode", "tells"), [(FlightMode.OFFBOARD, ("d1",)), (FlightMode.MANUAL, ()), (FlightMode.RETURN, ())], ids=str
)
def test_a_revoked_drone_tells_that_it_obeys_while_its_agent_flies_it_home(mode, tells):
    one = full()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    one.step(START_NS)
    assert one.stage is Stage.SURVEY
    one.observe_vehicle(state(START_NS + SECOND, mode=mode))
    one.receive(*revocation(member="d1"), START_NS + SECOND)
    assert obeying(one, START_NS + SECOND) == tells
    assert one.stage is Stage.RETURN


def test_a_revoked_drone_that_has_no_telemetry_any_more_does_not_tell_that_it_obeys():
    """The drone hovers, possibly on the circle that the others took to be free."""
    one = full()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    one.step(START_NS)
    one.observe_vehicle(state(START_NS + SECOND, mode=FlightMode.OFFBOARD))
    one.receive(*revocation(member="d1"), START_NS + SECOND)
    assert obeying(one, START_NS + SECOND) == ("d1",)
    assert obeying(one, START_NS + 5 * SECOND // 2) == ()
    assert one.stage is Stage.RETURN
    assert one.step(START_NS + 4 * SECOND).command.request is Request.HOLD
    one.observe_vehicle(state(START_NS + 5 * SECOND, mode=FlightMode.OFFBOARD))
    assert obeying(one, START_NS + 5 * SECOND) == ("d1",)


@pytest.mark.parametrize(("revoked", "stage"), [(True, Stage.LANDING), (False, Stage.RETURN)])
def test_a_revoked_drone_that_gets_no_nearer_to_its_home_lands_before_the_others_take_it_to_be_down(revoked, stage):
    """Over home as high as it searches, it was kept away by the homes of others for a minute."""
    one = full()
    one.observe_vehicle(state(START_NS))
    one.receive(*order(Action.START, START_NS), START_NS)
    one.step(START_NS)
    one.receive(*(revocation(member="d1") if revoked else order(Action.RETURN, START_NS + SECOND)), START_NS + SECOND)
    fly(one, START_NS + SECOND, REVOKED_NO_NEARER_S - 1.0, FlightMode.OFFBOARD, position=(8.0, 0.0, 3.0))
    assert one.stage is Stage.RETURN
    fly(one, START_NS + round(REVOKED_NO_NEARER_S * SECOND), 3.0, FlightMode.OFFBOARD, position=(8.0, 0.0, 3.0))
    assert one.stage is stage


def test_a_revoked_drone_that_does_not_fly_tells_nothing():
    one = full()
    one.observe_vehicle(state(START_NS))
    one.receive(*revocation(member="d1"), START_NS)
    assert obeying(one, START_NS) == ()


def believed(one):
    """The drones that have left the circle in a pilot's view, or will soon."""
    beliefs = one._executive._navigator._neighbourhood._beliefs
    return tuple(name for name, belief in beliefs.items() if belief.obeys_ns is not None)


@pytest.mark.parametrize("teller", ["d2", "d3"])
def test_that_a_revoked_drone_obeys_is_believed_where_it_has_signed_it(teller):
    """By itself, or passed on."""
    one = full()
    one.receive(*revocation(), START_NS)
    one.receive(*keyed(Revoked(stamp_ns=START_NS, drone=teller, held=(), obeying=(word(one.revocations[0]),))), START_NS)
    assert obeying(one, START_NS) == ("d2",)  # and passed on
    assert believed(one) == ("d2",)


def test_a_word_is_not_passed_on_once_another_revocation_counts():
    """A peer that knows the later revocation alone would reject the word as forged."""
    one = full()
    one.receive(*revocation(last={BOOT: 6}), START_NS)
    message = Revoked(stamp_ns=START_NS, drone="d2", held=(), obeying=(word(one.revocations[0]),))
    one.receive(*keyed(message), START_NS)
    one.receive(*revocation(last={BOOT: 3}), START_NS)
    assert len(one.revocations) == 1
    assert obeying(one, START_NS) == ()
    assert believed(one) == ("d2",)  # on its way home as before
    message = Revoked(stamp_ns=START_NS, drone="d2", held=(), obeying=(word(one.revocations[0]),))
    one.receive(*keyed(message), START_NS + SECOND)
    assert obeying(one, START_NS + SECOND) == ("d2",)


@pytest.mark.parametrize("teller", ["d2", "d3"])
@pytest.mark.parametrize("attack", ["another signs", "no signature", "another revocation", "not revoked", "as an operator"])
def test_that_a_drone_obeys_is_not_believed_unless_it_has_signed_just_that(attack, teller):
    """Else any member could bring the others onto the circle of a drone that has not heard of its revocation."""
    one = full()
    one.receive(*revocation(), START_NS)
    held = one.revocations[0]
    before = decode(revocation(stamp_ns=START_NS - SECOND)[1])
    told = {
        "another signs": word(held, signer="d3"),
        "no signature": replace(word(held), signature=b""),
        "another revocation": word(before),
        "not revoked": word(held, drone="d3"),
        "as an operator": replace(word(held), certificate=AUTHORITY.trust("d2", Role.OPERATOR).certificate),
    }[attack]
    one.receive(*keyed(Revoked(stamp_ns=START_NS, drone=teller, held=(), obeying=(told,))), START_NS)
    assert obeying(one, START_NS) == believed(one) == ()
    one.receive(*keyed(Revoked(stamp_ns=START_NS, drone=teller, held=(), obeying=(word(held),))), START_NS)
    assert believed(one) == ("d2",)


def hear_two_sources(one):
    """For two seconds, under the id of d2."""
    for tick in range(20):
        now_ns = START_NS + tick * SECOND // 10
        here = next(message for message in partner(now_ns) if isinstance(message, Pose))
        east, north, up = here.position_m
        for pose in (here, replace(here, position_m=(east + 30.0, north, up))):
            one.receive(*keyed(pose), now_ns)


def test_that_a_revoked_drone_obeys_is_not_believed_where_its_key_has_shown_to_be_copied():
    """Two sources have sent under its id: the holder of the copy may say so, while the drone itself circles on."""
    one, now_ns = full(), START_NS + 2 * SECOND
    hear_two_sources(one)
    assert one._peers["d2"].sources.are_two(now_ns)
    one.receive(*revocation(), now_ns)
    message = Revoked(stamp_ns=now_ns, drone="d2", held=(), obeying=(word(one.revocations[0]),))
    for later_s in (0, 1, 60):  # no change when the two are no longer shown
        one.receive(*keyed(message), now_ns + later_s * SECOND)
    assert believed(one) == ()


def hears_that_the_copied_one_obeys(one, now_ns, *, copies):
    """The pilot finds the revocation, hears from d3 that d2 obeys, and rejects that. ``copies``: two sources are heard before."""
    if copies:
        hear_two_sources(one)
    one.receive(*revocation(), now_ns + 2 * SECOND)
    message = Revoked(stamp_ns=now_ns, drone="d3", held=(), obeying=(word(one.revocations[0]),))
    one.receive(*keyed(message), now_ns + 3 * SECOND)
    one.step(now_ns + 3 * SECOND)
    assert believed(one) == ()


def test_that_its_key_has_shown_to_be_copied_is_known_after_restarts():
    """Each finds the revocation in a file of its own, and hears the word again; the two sources are silent by then."""
    memory = Memory(mission=MISSION.mission_id, stamp_ns=START_NS, started_ns=START_NS, stage=Stage.SURVEY, resume=Stage.SURVEY)
    for restart in range(3):
        now_ns = START_NS + 5 * restart * SECOND
        one = trusting(memory=memory)
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
        hears_that_the_copied_one_obeys(one, now_ns, copies=restart == 0)
        memory = msgspec.json.decode(msgspec.json.encode(one.memory), type=Memory)


def test_that_its_key_has_shown_to_be_copied_is_known_after_restarts_on_the_ground():
    """Memory from the ground belongs to no flight: a vehicle that flies after that is unknown to this agent."""
    memory, down = None, {"armed": False, "in_air": False}
    for restart in range(3):
        now_ns = START_NS + 5 * restart * SECOND
        one = trusting(memory=memory)
        one.observe_vehicle(state(now_ns, **down))
        hears_that_the_copied_one_obeys(one, now_ns, copies=restart == 0)
        kept = one.memory
        one.step(now_ns + 60 * SECOND)
        assert one.memory is kept  # nothing new to write
        memory = msgspec.json.decode(msgspec.json.encode(kept), type=Memory)
    one = trusting(memory=memory)
    one.observe_vehicle(state(START_NS, FlightMode.OFFBOARD))
    one.step(START_NS)
    assert (one.stage, one.counters["rejoined"]) == (Stage.PREFLIGHT, 0)


def test_a_flood_of_words_that_nobody_has_signed_costs_little():
    one = full()
    one.receive(*revocation(), START_NS)
    forged = replace(word(one.revocations[0]), signature=bytes(64))
    flood = Revoked(stamp_ns=START_NS, drone="d2", held=(), obeying=(forged,) * MAX_HELD_REVOCATIONS)
    for _ in range(100):
        one.receive(*keyed(flood), START_NS)
    assert one.counters["dropped_obeying_forged"] == MAX_REFUSED_REVOCATIONS_PS
