"""A step of the own clock in flight: inside the agent nothing moves, and what it publishes has the new time."""

import msgspec
import pytest
from msgspec.structs import replace

from radron.agent.flight import topics
from radron.agent.flight.recorded import RecordedPilot
from radron.agent.mission.memory import Memory
from radron.agent.vehicle.interface import FlightMode, GnssFix, Request
from radron.protocol.codec import decode_from, encode
from radron.protocol.entries import Fix
from radron.protocol.keys import key_of
from radron.protocol.messages import Action, Plan, Pose, Stage, Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, command, messages, partner, pilot, state, tracking

MS = 1_000_000
STEPS_S = [-3600.0, -5.0, -0.5, 0.5, 1.5, 5.0]
BEGIN_NS = START_NS + 5 * SECOND
FIX = GnssFix(stamp_ns=0, latitude_deg=50.0, longitude_deg=14.0, altitude_m=300.0, horizontal_sigma_m=1.2, vertical_sigma_m=2.0)


def flown(step_s, *, seconds=4):
    """Steps of a tracking drone, with news of a partner; its clock is set after half of the time."""
    one, steps = tracking(), []
    for tick in range(1, seconds * 20 + 1):
        now_ns = BEGIN_NS + tick * TICK_NS
        if tick == seconds * 10:
            one.observe_clock(round(step_s * SECOND), now_ns)
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
        ahead_ns = one._utc.ahead_ns
        for message in partner(now_ns):
            told = replace(message, delays_ns={"d1": -ahead_ns + 2 * MS}) if isinstance(message, Status) else message
            one.receive(key_of("radron", told), encode(told), now_ns + 2 * MS)
        steps.append(one.step(now_ns + 2 * MS))
    return one, steps


@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_step_neither_interrupts_the_flight_nor_begins_another_plan(step_s):
    """A step of -5 s was answered by a hold of 0.2 s, because telemetry was of the future, and then by a new plan."""
    still, set_on = flown(0.0)[1], flown(step_s)[1]
    assert {one.command.request for one in set_on} == {Request.OFFBOARD}
    assert [one.command.setpoint for one in set_on] == [one.command.setpoint for one in still]
    for kind in (Plan, Pose, Status):
        before, after = ([message.stamp_ns for one in steps for message in messages(one, kind)] for steps in (still, set_on))
        cut = sum(stamp_ns < BEGIN_NS + 2 * SECOND for stamp_ns in before)
        late = [stamp_ns - round(step_s * SECOND) for stamp_ns in after if stamp_ns not in before[:cut]]
        assert late[-1] == before[-1]


def test_the_peers_are_told_at_once():
    _, steps = flown(-5.0)
    (set_on,) = messages(steps[39], Status)
    assert set_on.stamp_ns == BEGIN_NS + 2 * SECOND + 2 * MS - 5 * SECOND
    assert "d2" in set_on.delays_ns


@pytest.mark.parametrize("step_s", STEPS_S)
def test_peers_stay_as_old_as_they_are(step_s):
    one, _ = flown(step_s)
    now_ns = BEGIN_NS + 4 * SECOND
    assert one._peers["d2"].pose.stamp_ns == pytest.approx(now_ns, abs=2 * MS)
    assert len(one._peers["d2"].poses) > 55
    assert not any(count for name, count in one.counters.items() if name in ("dropped_stale", "dropped_from_the_future"))


@pytest.mark.parametrize("step_s", [-5.0, 5.0])
def test_a_ticket_of_before_holds(step_s):
    """After a step forward it was refused as too old; after a step back it could be used for 5 s longer."""
    for age_s, stage in ((1.0, Stage.HOLD), (5.5, Stage.TRACK)):
        one, _ = flown(0.0)
        now_ns = BEGIN_NS + 4 * SECOND
        held = command(Action.HOLD, stamp_ns=now_ns)
        one.observe_clock(round(step_s * SECOND), now_ns)
        later_ns = now_ns + round(age_s * SECOND)
        one.observe_vehicle(state(later_ns, FlightMode.OFFBOARD))
        one.receive(*held, later_ns)
        assert one.stage is stage


@pytest.mark.parametrize("step_s", [-5.0, 5.0])
def test_state_for_a_restart_is_continued_in_the_utc_of_then(step_s):
    one, _ = flown(step_s)
    kept = msgspec.json.decode(msgspec.json.encode(one.memory), type=Memory)
    assert kept.ahead_ns == round(step_s * SECOND)
    utc = kept.in_utc()
    assert utc.ahead_ns == 0
    assert utc.tracking_since_ns - kept.tracking_since_ns == round(step_s * SECOND)
    assert utc.started_ns == kept.started_ns == START_NS  # a stamp of the operator
    assert utc.others["d2"].pose.stamp_ns - kept.others["d2"].pose.stamp_ns == round(step_s * SECOND)
    back_ns = BEGIN_NS + 5 * SECOND + round(step_s * SECOND)
    again = pilot(memory=kept, boot="3" * 16)
    again.observe_vehicle(state(back_ns, FlightMode.OFFBOARD))
    again.step(back_ns)
    assert again.counters["rejoined"] == 1
    assert again._executive._mission.flight.tracking_since_ns == utc.tracking_since_ns


def test_entries_have_the_new_time():
    one, _ = flown(-5.0)
    now_ns = BEGIN_NS + 4 * SECOND
    ((key, payload),) = one.observe_fix(replace(FIX, stamp_ns=now_ns))
    fix = decode_from(key, payload)
    assert isinstance(fix, Fix)
    assert fix.stamp_ns == now_ns - 5 * SECOND


def test_a_start_is_judged_by_utc():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.observe_clock(3600 * SECOND, START_NS)
    one.receive(*command(stamp_ns=START_NS), START_NS)
    assert one.counters["dropped_command_too_old"] == 1
    key, payload = command(stamp_ns=START_NS)
    order = replace(decode_from(key, payload), stamp_ns=START_NS + 3600 * SECOND)
    one.receive(key, encode(order), START_NS)
    one.step(START_NS)
    assert one.stage is Stage.SURVEY


def test_a_record_holds_the_steps_of_the_clock_alone():
    written = []

    class Sink:
        def write(self, topic, data, log_ns=None):
            written.append((topic, data, log_ns))

    recorded = RecordedPilot(pilot(), Sink())
    for tick, ahead_ns in enumerate((0, 0, -5, -5, 0)):
        recorded.observe_clock(ahead_ns, START_NS + tick)
    assert written == [(topics.CLOCK, b"-5", START_NS + 2), (topics.CLOCK, b"0", START_NS + 4)]


def test_the_circle_leads_by_the_age_of_the_hypothesis_although_the_clock_is_wrong():
    """The age was taken by the own clock, and was 5 s too long: the hypothesis is of the common time."""
    one, now_ns = pilot(), START_NS
    for delays_ns in ({}, {"d1": -5 * SECOND + 2 * MS}):
        told = Status(
            stamp_ns=now_ns, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.TRACK, delays_ns=delays_ns
        )
        one.receive(key_of("radron", told), encode(told), now_ns + 2 * MS)
    one.observe_clock(5 * SECOND, now_ns + 2 * MS)
    assert one._clocks.own_ns_of_common(one._clocks.common_ns(now_ns)) == now_ns
