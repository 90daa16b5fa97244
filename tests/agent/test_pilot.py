"""The pilot alone: its messages, its refusals, and its resistance to any input."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.estimators import FusionConfig
from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import ConfigError
from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import FlightMode, Request, VehicleCommand
from radron.protocol.codec import decode_from, encode
from radron.protocol.codes import Code
from radron.protocol.entries import Exposure
from radron.protocol.errors import ProtocolError
from radron.protocol.keys import key_of
from radron.protocol.messages import Action, Plan, Pose, Stage, Status
from radron.protocol.texts import CodedText
from support.flights import schema_messages
from support.flights.one_pilot import (
    AREA,
    MISSION,
    SECOND,
    START_NS,
    TICK_NS,
    command,
    cone_of,
    fly,
    messages,
    partner,
    pilot,
    started,
    state,
    tracking,
)


def test_a_drone_that_is_not_in_the_mission():
    with pytest.raises(ConfigError, match="drone 'd9' is not in the mission; its drones are d1, d2"):
        pilot("d9")


@pytest.mark.parametrize("epoch", [0, 1])
def test_a_drone_whose_localisation_jumped_before_its_agent_was_started_does_not_know_where_it_stands_and_does_not_start(epoch):
    """The drone took off, and three others, without its position either, flew home through it (0.3 m)."""
    one = pilot()
    one.observe_vehicle(state(START_NS, armed=False, in_air=False, epoch=epoch))
    one.step(START_NS)
    verdict = one.receive(*command(), START_NS)
    assert (one.stage is Stage.TAKEOFF) == (verdict.because == "") == (epoch == 0)
    assert ("its localisation jumped before this agent was started" in verdict.because) == (epoch == 1)


def test_reports_pose_at_10_hz_and_status_at_1_hz():
    one, poses, statuses = pilot(), 0, 0
    for tick in range(100):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, armed=False, in_air=False))
        step = one.step(now_ns)
        poses += len(messages(step, Pose))
        statuses += len(messages(step, Status))
        assert step.command.request is Request.STAY
    assert poses == 50
    assert statuses == 5


def test_a_cone_is_in_the_hypothesis_without_waiting_for_the_next_step():
    one = tracking()
    before, now_ns = one.hypothesis, START_NS + 5 * SECOND + 1
    one.advance(now_ns)
    assert one.hypothesis is before  # nothing came in
    cone = cone_of("d2", 30, START_NS + 5 * SECOND)
    one.receive(key_of("radron", cone), encode(cone), now_ns)
    one.advance(now_ns)
    assert one.hypothesis.cones == before.cones + 1


def test_what_the_shell_reports_is_told_and_only_a_block_stands_against_a_start():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.block((CodedText(Code.NOT_READY_TO_ARM, "PX4 says: compass not calibrated"),))
    one.warn([CodedText(Code.NO_CONTACT, words, "d2") for words in ("no peer reached", "x" * 300, "no peer reached")])
    one.receive(*command(), START_NS)
    assert one.stage is Stage.PREFLIGHT
    (status,) = messages(one.step(START_NS), Status)
    assert status.problems == ("PX4 says: compass not calibrated", "no peer reached", "x" * 256)
    assert [(text.code, text.about) for text in status.texts.problems] == [
        ("not-ready-to-arm", None),
        ("no-contact", "d2"),
        ("no-contact", "d2"),
    ]
    one.block(())
    one.receive(*command(stamp_ns=START_NS + 1), START_NS)
    assert one.stage is Stage.TAKEOFF


def test_status_says_what_stands_against_a_start():
    (status,) = messages(pilot().step(START_NS), Status)
    assert status.problems == ("no telemetry from the vehicle yet",)


def test_start_takes_off_and_then_surveys():
    one = pilot()
    grounded = state(START_NS, armed=False, in_air=False, position=(0.0, 0.0, 0.0))
    one.observe_vehicle(grounded)
    one.receive(*command(), START_NS)
    assert one.step(START_NS).command.request is Request.TAKEOFF
    one.observe_vehicle(state(START_NS + 5 * SECOND))
    step = one.step(START_NS + 5 * SECOND)
    assert step.command.request is Request.OFFBOARD
    assert step.command.setpoint is not None
    (plan,) = messages(step, Plan)
    assert plan.positions_m[0] == pytest.approx((0.0, 0.0, 3.0), abs=1e-6)  # where the vehicle is, in its own local frame


@pytest.mark.parametrize(
    ("refused", "counter"),
    [
        (command(stamp_ns=START_NS - 60 * SECOND), "dropped_command_too_old"),
        (command(mission=MissionConfig(name="other", area=AREA, drones=MISSION.drones)), "dropped_command_of_another_mission"),
        (command(Action.HOLD), "dropped_command_refused"),
    ],
)
def test_commands_that_are_not_obeyed(refused, counter):
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*refused, START_NS)
    assert one.stage is Stage.PREFLIGHT
    assert one.counters[counter] == 1


def test_a_command_to_others_is_not_for_me():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*command(drones=("d2",)), START_NS)
    assert one.stage is Stage.PREFLIGHT


def test_differing_missions_refuse_to_start():
    one, other = pilot(), pilot("d2", MissionConfig(name="newer", area=AREA, drones=MISSION.drones))
    one.observe_vehicle(state(START_NS))
    for key, payload in other.step(START_NS).publications:
        one.receive(key, payload, START_NS)
    one.receive(*command(), START_NS)
    assert one.stage is Stage.PREFLIGHT
    (status,) = messages(one.step(START_NS), Status)
    assert "d2 has another mission" in status.problems[0]


@pytest.mark.parametrize(("began_s", "expected_s"), [(-300, -300), (-100_000, 0), (5, 0), (None, 0)])
def test_who_is_started_later_begins_with_the_others(began_s, expected_s):
    """So all leave out the same earlier measurements. No drone has been flying for more than a day, or begins in the future."""
    one = pilot()
    one.observe_vehicle(state(START_NS))
    began_ns = None if began_s is None else START_NS + began_s * SECOND
    other = Status(
        stamp_ns=START_NS, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.SURVEY, started_ns=began_ns
    )
    one.receive(key_of(MISSION.swarm, other), encode(other), START_NS)
    assert messages(one.step(START_NS - TICK_NS), Status)[0].started_ns is None
    one.receive(*command(), START_NS)
    own = messages(one.step(START_NS + SECOND), Status)[0]
    assert own.started_ns == START_NS + expected_s * SECOND
    assert one.memory.started_ns == own.started_ns


def test_who_is_started_later_believes_most_of_the_others_of_when_they_began():
    """A liar made it count entries that the others leave out: with the same log it had another hypothesis."""
    mission = replace(MISSION, drones=tuple(DroneInMission(id=f"d{number}") for number in range(1, 5)))
    one = pilot(mission=mission)
    one.observe_vehicle(state(START_NS))
    for name, began_s in (("d2", -7200), ("d3", -60), ("d4", -60)):
        told = {"stage": Stage.SURVEY, "started_ns": START_NS + began_s * SECOND}
        other = Status(stamp_ns=START_NS, drone=name, mission=mission.mission_id, boot="2" * 16, **told)
        one.receive(key_of(mission.swarm, other), encode(other), START_NS)
    one.receive(*command(mission=mission), START_NS)
    assert messages(one.step(START_NS + SECOND), Status)[0].started_ns == START_NS - 60 * SECOND


def test_a_resumption_that_was_refused_is_not_carried_out_later():
    """Sent again after the pilot had the drone hold, the command took the vehicle from him."""
    one = tracking()
    now_ns = START_NS + 5 * SECOND
    resume = command(Action.RESUME, stamp_ns=now_ns)
    assert one.receive(*resume, now_ns).because == "resume: not holding"
    fly(one, now_ns, 3.0, FlightMode.HOLD)
    assert one.stage is Stage.HOLD
    assert one.receive(*resume, now_ns + 3 * SECOND).refused == "already_obeyed"
    assert one.stage is Stage.HOLD


def test_two_agents_with_one_id_notice():
    one, twin = pilot(), Pilot(MISSION, DroneConfig(id="d1"), boot="f" * 16, nonce_key=b"twin")
    one.observe_vehicle(state(START_NS))
    for key, payload in twin.step(START_NS).publications:
        one.receive(key, payload, START_NS)
    (status,) = messages(one.step(START_NS), Status)
    assert status.problems == ("another agent is running as d1",)


def test_exposures_follow_each_other_without_gaps():
    one, found = pilot(), []
    none = PixelHits(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16))
    for tick in range(0, 200, 4):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, position=(tick * 0.1, 0.0, 3.0)))
        if tick:
            published = one.observe_detector(Readout(now_ns - 4 * TICK_NS, now_ns, START_NS, 0.2, none))
            found += [decode_from(key, payload) for key, payload in published]
        assert not messages(one.step(now_ns), Exposure)  # already sent
    assert len(found) == 16
    assert all(before.end_ns == after.stamp_ns for before, after in pairwise(found))
    assert all(entry.live_time_s == pytest.approx((entry.end_ns - entry.stamp_ns) * 1e-9) for entry in found)
    assert [len(entry.poses) for entry in found] == [6] * 16
    assert found[3].poses[1].position_m[0] == pytest.approx((found[3].stamp_ns + SECOND // 10 - START_NS) / TICK_NS * 0.1)


@pytest.mark.slow
@settings(max_examples=40)
@given(data=st.data())
def test_nothing_from_outside_stops_the_flight(data):
    """Any valid message of any kind from a peer or a station, any damaged one, any bytes: the drone flies on."""
    one = tracking()
    for tick in range(1, 9):
        now_ns = START_NS + (100 + tick) * TICK_NS
        for known in partner(now_ns):
            one.receive(key_of("radron", known), encode(known), now_ns)
        message = data.draw(schema_messages.messages())
        if data.draw(st.booleans()):  # of a member of this mission, and newer than its known messages
            message = replace(message, stamp_ns=now_ns + 1)
            message = replace(message, drone="d2") if hasattr(message, "drone") else message
            message = replace(message, mission=MISSION.mission_id) if hasattr(message, "mission") else message
        try:
            key, payload = key_of("radron", message), encode(message)
        except ProtocolError:  # the changes made it contradict itself
            continue
        one.receive(key, payload, now_ns)
        if data.draw(st.booleans()):
            place = data.draw(st.integers(0, len(payload) - 1))
            one.receive(key, payload[:place] + data.draw(st.binary(max_size=3)) + payload[place + 1 :], now_ns)
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
        step = one.step(now_ns)
        setpoint = step.command.setpoint
        assert setpoint is None or np.isfinite([*setpoint.position_m, *setpoint.velocity_mps, setpoint.yaw_rad]).all()
        assert all(decode_from(*publication) for publication in step.publications)


def test_stale_and_foreign_news_is_counted_and_dropped():
    one, other = started(), pilot("d2")
    other.observe_vehicle(state(START_NS))
    publications = other.step(START_NS).publications
    for key, payload in publications:
        one.receive(key, payload, START_NS + 60 * SECOND)
        one.receive(key.replace("/radron/", "/others/"), payload, START_NS)
    assert one.counters["dropped_stale"] == len(publications)
    assert one.counters["dropped_other_swarm"] == len(publications)


@pytest.mark.parametrize("position", [(float("nan"), 0.0, 3.0), (0.0, 2e5, 3.0), (0.0, 0.0, float("inf"))])
def test_implausible_telemetry_is_dropped_and_the_drone_holds_when_there_is_no_other(position):
    one = started()
    late_ns = START_NS + 3 * SECOND
    one.observe_vehicle(state(late_ns, FlightMode.OFFBOARD, position))
    assert one.counters["telemetry_implausible"] == 1
    assert one.step(late_ns).command.request is Request.HOLD
    one.observe_vehicle(state(late_ns + TICK_NS, FlightMode.OFFBOARD))
    assert one.step(late_ns + TICK_NS).command.request is Request.OFFBOARD


def test_without_telemetry_a_vehicle_is_left_to_the_failsafe_it_was_in():
    """On a link that loses 93 % of all packets a hold ended the return for good (1460337)."""
    one = started()
    seen_ns, late_ns = START_NS + TICK_NS, START_NS + 2 * SECOND
    one.observe_vehicle(replace(state(seen_ns, FlightMode.RETURN), healthy=False))
    assert one.step(seen_ns).command.setpoint is not None  # ends a failsafe for want of setpoints
    assert one.step(late_ns).command == VehicleCommand(Request.OFFBOARD)
    one.observe_vehicle(state(late_ns + TICK_NS, FlightMode.OFFBOARD))
    assert one.step(late_ns + TICK_NS).command.setpoint is not None


def test_older_telemetry_does_not_replace_newer():
    one = started()
    one.observe_vehicle(state(START_NS - SECOND, position=(9.0, 9.0, 9.0)))
    assert one.counters["telemetry_older_than_known"] == 1


def test_a_copy_of_a_landing_command_does_not_take_the_vehicle_from_a_human_pilot():
    one = started()
    landing = command(Action.LAND, stamp_ns=START_NS + SECOND)
    one.observe_vehicle(state(START_NS + SECOND, FlightMode.LAND))
    one.receive(*landing, START_NS + SECOND)
    assert one.step(START_NS + SECOND).command.request is Request.LAND
    for tick in range(21, 60):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, FlightMode.MANUAL))
        step = one.step(now_ns)
    assert step.command.request is Request.RELEASE
    one.receive(*landing, now_ns)
    assert one.step(now_ns).command.request is Request.RELEASE
    one.receive(*command(Action.LAND, stamp_ns=now_ns), now_ns)  # a new command is the operator's present will
    assert one.step(now_ns).command.request is Request.LAND


def test_a_frame_that_jumps_does_not_move_the_drone():
    """The search goes on in the new epoch from where the vehicle says that it is now, as fast as before."""
    one, place, velocity = started(), (0.0, 0.0, 3.0), (0.0, 0.0, 0.0)
    for tick in range(1, 101):
        now_ns, jumped = START_NS + tick * TICK_NS, 15.0 if tick > 60 else 0.0
        x, y, z = place
        telemetry = {"position": (x + jumped, y - jumped, z), "epoch": int(tick > 60)}
        one.observe_vehicle(
            state(now_ns, FlightMode.OFFBOARD, velocity_mps=velocity if tick > 1 else (0.0, 0.0, 0.0), **telemetry)
        )
        setpoint = one.step(now_ns).command.setpoint
        (x, y, z), velocity = setpoint.position_m, setpoint.velocity_mps
        assert np.hypot(x - jumped - place[0], y + jumped - place[1]) < 7.0  # leads the vehicle, in turns by 4 m and more
        place = place[0] + velocity[0] / 20, place[1] + velocity[1] / 20, place[2] + velocity[2] / 20
    assert one.counters["waited_without_frame"] == 0
    assert np.hypot(*velocity[:2]) > 2.0


def test_what_cannot_be_sent_is_counted_and_the_flight_goes_on():
    one = started()
    now_ns = START_NS + 2 * SECOND
    one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, yaw_sigma_rad=900.0))
    assert one.step(now_ns).command.setpoint is not None
    assert one.counters["unsendable_pose"] == 1


def test_a_twin_and_a_foreign_mission_are_forgotten_when_they_are_gone():
    one, twin = pilot(), Pilot(MISSION, DroneConfig(id="d1"), boot="f" * 16, nonce_key=b"twin")
    other = pilot("d2", MissionConfig(name="newer", area=AREA, drones=MISSION.drones))
    for key, payload in twin.step(START_NS).publications + other.step(START_NS).publications:
        one.receive(key, payload, START_NS)
    one.observe_vehicle(state(START_NS))
    (status,) = messages(one.step(START_NS), Status)
    assert len(status.problems) == 2
    for second in range(1, 21):
        later_ns = START_NS + second * SECOND
        one.observe_vehicle(state(later_ns))
        (status,) = messages(one.step(later_ns), Status)
    assert status.problems == ()


def test_a_cone_from_the_future_does_not_hide_a_loss():
    one = tracking()
    for second in range(6, 30):
        now_ns = START_NS + second * SECOND
        if second == 6:
            cone = cone_of("d2", 1000, now_ns + 86_400 * SECOND)
            one.receive(key_of("radron", cone), encode(cone), now_ns)
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
        one.step(now_ns)
    assert one.stage is Stage.REACQUIRE


def searching(survey, seconds):
    """A pilot that flies by ``bayes`` and counts nothing but a bare background, and its last status."""
    mission = replace(MISSION, fusion=FusionConfig(estimator="bayes"), survey=survey)
    one, statuses = pilot(mission=mission), []
    one.observe_vehicle(state(START_NS))
    one.receive(*command(mission=mission), START_NS)
    one.step(START_NS)  # in the air and holding already
    for tick in range(1, seconds * 20):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
        statuses += messages(one.step(now_ns), Status)
    return one, statuses


def test_a_search_that_has_lasted_long_enough_ends_with_a_finding_and_the_way_home():
    one, statuses = searching(SurveyConfig(duration_s=5.0), 8)
    assert statuses[3].finding == ""
    assert statuses[3].stage is Stage.SURVEY
    assert statuses[-1].finding.startswith("nothing found in 5 s")
    assert one.stage is Stage.LANDING  # the vehicle has stayed over its home


def test_a_search_that_is_to_continue_tells_its_finding_and_goes_on():
    one, statuses = searching(SurveyConfig(duration_s=5.0, then="continue"), 8)
    assert statuses[-1].finding.startswith("nothing found")
    assert one.stage is Stage.SURVEY


def test_poses_report_stage_contacts_home_and_the_alternative_frame_after_a_jump():
    """What the other drones used to infer: from statuses, lists of lost links, poses on the ground, and an uncertainty."""
    one, poses = started(), []
    for tick in range(1, 81):
        now_ns = START_NS + tick * TICK_NS
        for message in partner(now_ns) if tick <= 40 else ():
            one.receive(key_of("radron", message), encode(message), now_ns)
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, (15.0 if tick > 60 else 0.0, 0.0, 3.0)))
        poses += messages(one.step(now_ns), Pose)
    assert {pose.stage for pose in poses} == {Stage.SURVEY}
    assert [poses[index].silences_ns["d2"] for index in (15, -1)] == pytest.approx([0, 2 * SECOND], abs=SECOND // 10)
    assert poses[-1].home_m == pytest.approx((5.0, 5.0, 3.0), abs=0.01)
    assert poses[20].alternative is UNSET
    assert poses[-1].alternative.translation_m == pytest.approx((5.0, 5.0, 0.0))
