"""An agent that is restarted in flight: when and how it resumes, and when it leaves the vehicle alone."""

import math

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import MissionConfig, TrackConfig
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform
from radron.agent.localization.poseproblems import NO_PLACE
from radron.agent.mission.memory import OLDEST_NS, REFRESH_NS, Memory
from radron.agent.navigation.identification import FoundResponse
from radron.agent.shell.statestore import State, decode_state, encode_state
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.codec import encode
from radron.protocol.entries import Coverage
from radron.protocol.keys import key_of
from radron.protocol.messages import Action, Plan, Pose, Stage, Status
from support.flights.one_pilot import (
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
    state,
    tracking,
)

BACK_NS = START_NS + 30 * SECOND  # when the agent is there again
HOME = (5.0, 5.0, 3.0)
KEPT = Memory(
    mission=MISSION.mission_id,
    stamp_ns=START_NS + 25 * SECOND,
    started_ns=START_NS,
    stage=Stage.SURVEY,
    resume=Stage.SURVEY,
    home_m=HOME,
)
NEW_BOOT = "f" * 16
LOW = (10.0, 10.0, 1.2)  # below the floor, and not near the ground


def back(memory=KEPT, mission=MISSION, **vehicle):
    """The restarted agent after its first telemetry, and its first step."""
    one = pilot(mission=mission, memory=memory, boot=NEW_BOOT)
    one.observe_vehicle(state(BACK_NS, **{"mode": FlightMode.RETURN, "healthy": False, **vehicle}))
    return one, one.step(BACK_NS)


def test_what_is_remembered_follows_the_flight_and_fits_a_file():
    one = pilot()
    one.step(START_NS)
    assert one.memory is None
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    one.step(START_NS)
    assert (one.memory.stage, one.memory.started_ns, one.memory.mission) == (Stage.SURVEY, START_NS, MISSION.mission_id)
    assert msgspec.json.decode(msgspec.json.encode(one.memory), type=Memory) == one.memory
    fly(one, START_NS, 2.0, FlightMode.OFFBOARD)
    kept = one.memory
    assert not kept.holds  # offboard is reached
    fly(one, START_NS + 2 * SECOND, REFRESH_NS / SECOND - 3.0, FlightMode.OFFBOARD)
    assert one.memory is kept  # nothing new to write
    fly(one, START_NS + 4 * SECOND, 2.0, FlightMode.OFFBOARD)
    assert one.memory.stamp_ns > kept.stamp_ns
    fly(one, START_NS + 6 * SECOND, 3.0, FlightMode.HOLD, position=(0.0, 0.0, 0.1), armed=False, in_air=False)
    assert one.stage is Stage.LANDED
    assert one.memory is None


def test_what_was_found_of_the_vehicle_is_remembered_with_the_next_stamp_and_gone_on_with():
    one, _ = back(replace(KEPT, response=FoundResponse(0.9, 0.11, 0.3)))
    fly(one, BACK_NS, 2.0 * REFRESH_NS / SECOND, FlightMode.OFFBOARD)
    assert one.memory.response.drag_ps == 0.9
    assert msgspec.json.decode(msgspec.json.encode(one.memory), type=Memory) == one.memory
    kept = one.memory
    fly(one, BACK_NS + 2 * REFRESH_NS, REFRESH_NS / SECOND - 1.0, FlightMode.OFFBOARD, position=(0.5, 0.0, 3.0))
    assert one.memory is kept  # the deviation has changed meanwhile, and waits


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -14.5])
def test_a_response_that_cannot_be_a_vehicles_is_neither_stored_nor_believed_and_the_rest_is(wrong):
    found = FoundResponse(wrong, 0.11, 0.3)
    memory = decode_state(encode_state(State(memory=replace(KEPT, response=found)))).memory
    one, _ = back(memory)
    assert (one.stage, one.memory.home_m) == (Stage.SURVEY, HOME)
    estimator = one._executive._navigator.response
    assert estimator.response.drag_ps == 0.5  # the drone file's
    estimator.response = replace(estimator.response, drag_ps=wrong)
    one._executive.remembering.note(BACK_NS + REFRESH_NS, one._peers)
    assert one.memory.response is None


WRONG = Transform(0.3, (4.0, 5.0, 0.0), np.full((4, 4), math.nan))
RIGHT = KeptFrame(epoch=1, yaw_rad=0.3, translation_m=(4.0, 5.0, 0.0), covariance=None)


def test_a_new_epoch_is_stored_at_once_with_its_frame():
    one, _ = back()
    fly(one, BACK_NS, 1.0, FlightMode.OFFBOARD)
    assert one.memory.frames == {}
    fly(one, BACK_NS + SECOND, 0.1, FlightMode.OFFBOARD, position=(20.0, 0.0, 3.0), epoch=1)  # announced
    assert one.memory.stamp_ns == BACK_NS - BACK_NS % REFRESH_NS
    assert one.memory.frames["d1"].epoch == 1


@pytest.mark.parametrize("jumped", [False, True], ids=["announced", "unannounced"])
def test_what_is_stored_after_a_restart_is_the_present_own_frame_and_not_the_one_of_before(jumped):
    """A second restart would find that of an epoch that is over, and neither its frame nor the uncertainty of it."""
    one, _ = back(replace(KEPT, frames={"d1": RIGHT}), epoch=1)
    fly(one, BACK_NS, 1.0, FlightMode.OFFBOARD, epoch=1)
    fly(one, BACK_NS + SECOND, 0.1, FlightMode.OFFBOARD, position=(20.0, 0.0, 3.0), epoch=1 if jumped else 2)
    stored = one.memory.frames["d1"]
    assert stored.epoch == one.memory.epoch == 2
    assert (stored.otherwise is not None) == jumped
    again, _ = back(replace(one.memory, stamp_ns=BACK_NS), epoch=2 - one.memory.epoch_offset, position=(20.0, 0.0, 3.0))
    assert again.whereabouts.place_m == pytest.approx(one.whereabouts.place_m)


@pytest.mark.parametrize("epoch", [0, 1])
def test_a_jump_that_was_announced_while_its_agent_was_down_leaves_it_without_its_place_and_it_says_so(epoch):
    one, _ = back(epoch=epoch)
    fly(one, BACK_NS, 3.0, FlightMode.OFFBOARD, epoch=epoch)
    assert (one.whereabouts is None) == (NO_PLACE in one.problems) == (epoch == 1)


def test_a_drone_that_will_never_know_its_frame_waits_where_it_is_and_lands_soon():
    """The drone has no way home, and others kept clear of all its possible positions for two minutes, and landed beside their
    homes.
    """
    one, _ = back(epoch=1)
    places, stages = [], []
    for tick in range(1, 12 * 20):
        now_ns = BACK_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, position=places[-1] if places else (0.0, 0.0, 3.0), epoch=1))
        command = one.step(now_ns).command
        stages.append(one.stage)
        places += [command.setpoint.position_m] if command.setpoint is not None else []
    assert places[:20] == pytest.approx(np.tile((0.0, 0.0, 3.0), (20, 1)), abs=0.01)
    assert one.stage is Stage.LANDING
    assert 4.5 * 20 < stages.index(Stage.RETURN) < 6 * 20
    assert one.counters["waited_without_frame"] > 9 * 20


def test_a_frame_whose_numbers_are_not_finite_is_not_stored_and_the_rest_is():
    one, _ = back()
    one.frames.graph.place("d2", 1, RIGHT.mission_from_local)
    for message in partner(BACK_NS):
        told = replace(message, epoch=1) if isinstance(message, Pose) else message
        one.receive(key_of("radron", told), encode(told), BACK_NS)
    fly(one, BACK_NS, 0.5, FlightMode.OFFBOARD)
    one._executive.remembering.note(BACK_NS + REFRESH_NS, one._peers)
    assert one.memory.frames.keys() == {"d2"}
    one.frames.graph.place("d2", 1, WRONG)
    one._executive.remembering.note(BACK_NS + 2 * REFRESH_NS, one._peers)
    assert one.memory.frames == {}
    assert one.counters["kept_frame_implausible"] == 1
    found = decode_state(encode_state(State(memory=one.memory))).memory
    assert (found.stage, found.home_m) == (Stage.SURVEY, HOME)


def test_the_frame_of_another_drone_that_has_jumped_is_stored_at_once():
    """An agent restarted a second later did not know where that drone was, and flew into it."""
    one, _ = back()
    for epoch, since_ns in ((0, BACK_NS), (1, BACK_NS + SECOND // 2)):
        for message in partner(since_ns):
            told = replace(message, epoch=epoch) if isinstance(message, Pose) else message
            one.receive(key_of("radron", told), encode(told), since_ns)
        fly(one, since_ns, 0.5, FlightMode.OFFBOARD)
        assert [kept.epoch for kept in one.memory.frames.values()] == ([1] if epoch else [])
    before = one.memory
    fly(one, BACK_NS + SECOND, 0.1, FlightMode.OFFBOARD)
    assert one.memory is before  # nothing new to write


def test_of_the_stored_frames_those_that_cannot_be_frames_are_counted_and_the_others_are_believed():
    memory = decode_state(encode_state(State(memory=replace(KEPT, frames={"d1": RIGHT, "d2": KeptFrame.of(1, 0, WRONG)})))).memory
    one, _ = back(memory, epoch=1)
    assert one.stage is Stage.SURVEY
    assert one.counters["kept_frame_implausible"] == 1
    assert one.whereabouts.place_m == pytest.approx((4.0, 5.0, 3.0))


def test_who_flew_is_remembered_and_reckoned_with_until_it_is_heard_again():
    one = tracking()
    now_ns = START_NS + 5 * SECOND
    for message in partner(now_ns):
        one.receive(key_of("radron", message), encode(message), now_ns)
    fly(one, now_ns, 1.0, FlightMode.OFFBOARD)
    assert one.memory.others.keys() == set()  # not stored yet
    fly(one, now_ns + SECOND, 0.5, FlightMode.OFFBOARD)  # it is not heard any more
    kept = decode_state(encode_state(State(memory=one.memory))).memory
    assert kept.others["d2"].pose.position_m == (30.0, 20.0, 3.0)
    for memory, expected in ((kept, {"d2"}), (replace(kept, others={}), set())):
        again, _ = back(replace(memory, stamp_ns=BACK_NS), mode=FlightMode.OFFBOARD)
        fly(again, BACK_NS, 2.0, FlightMode.OFFBOARD)
        assert {other.id for other in again.reckoning.others} == expected
        assert again.memory.others.keys() == expected


@pytest.mark.parametrize("mode", [FlightMode.RETURN, FlightMode.LAND])
def test_goes_on_from_the_failsafe_by_streaming_setpoints(mode):
    one, step = back(mode=mode)
    assert one.stage is Stage.SURVEY
    assert step.command.request is Request.OFFBOARD
    assert step.command.setpoint is not None
    assert fly(one, BACK_NS, 2.0, mode, healthy=False) == [Request.OFFBOARD] * 40
    assert fly(one, BACK_NS + 2 * SECOND, 10.0, FlightMode.OFFBOARD) == [Request.OFFBOARD] * 200
    assert one.stage is Stage.SURVEY


def test_what_the_failsafe_has_brought_below_the_floor_rises_where_it_is_before_it_searches():
    low = (5.0, 5.0, 1.2)
    one, _ = back(mode=FlightMode.LAND, position=low)
    assert set(fly(one, BACK_NS, 1.0, FlightMode.LAND, healthy=False, position=low)) == {Request.OFFBOARD}
    one.observe_vehicle(state(BACK_NS + 2 * SECOND, FlightMode.OFFBOARD, low))
    setpoint = one.step(BACK_NS + 2 * SECOND).command.setpoint
    assert one.stage is Stage.TAKEOFF
    assert setpoint.velocity_mps[:2] == pytest.approx((0.0, 0.0), abs=0.01)
    fly(one, BACK_NS + 2 * SECOND, 1.0, FlightMode.OFFBOARD, position=(5.0, 5.0, 1.8))
    assert one.stage is Stage.SURVEY


@pytest.mark.parametrize(("height_m", "then"), [(9.0, Stage.SURVEY), (1.2, Stage.SURVEY), (0.7, Stage.LANDING)])
def test_an_agent_whose_takeoff_is_the_last_that_was_stored_takes_its_vehicle_back_from_the_failsafe(height_m, then):
    """A full disk stored nothing later; it asked for a takeoff, sent no setpoints, and gave the vehicle up after 3 s."""
    place = (5.0, 5.0, height_m)
    one, step = back(replace(KEPT, stage=Stage.TAKEOFF), position=place)
    assert step.command.request is (Request.LAND if then is Stage.LANDING else Request.OFFBOARD)
    mode = FlightMode.LAND if then is Stage.LANDING else FlightMode.OFFBOARD
    fly(one, BACK_NS, 3.0, FlightMode.RETURN, healthy=False, position=place)
    fly(one, BACK_NS + 3 * SECOND, 3.0, mode, position=(5.0, 5.0, max(height_m, 1.9 if then is Stage.SURVEY else 0.0)))
    assert one.stage is then


@pytest.mark.parametrize(
    ("stage", "sinks_mps", "then"),
    [(Stage.SURVEY, 0.8, Stage.TAKEOFF), (Stage.SURVEY, 0.1, Stage.SURVEY), (Stage.RETURN, 0.8, Stage.LANDING)],
)
def test_what_sinks_too_fast_to_stop_above_the_floor_counts_as_below_it(stage, sinks_mps, then):
    """A simulated vehicle at 1.59 m and 0.8 m/s stopped at 1.36 m, 0.5 s later; and published heights are not exact."""
    low = (5.0, 5.0, 1.85)
    one, _ = back(replace(KEPT, stage=stage), mode=FlightMode.LAND, position=low, velocity_mps=(0.0, 0.0, -sinks_mps))
    assert one.stage is then


@pytest.mark.parametrize(("stage", "height_m"), [(Stage.SURVEY, 0.7), (Stage.TRACK, 0.7), (Stage.RETURN, 1.2)])
def test_what_the_failsafe_has_brought_near_the_ground_lands(stage, height_m):
    low = (5.0, 5.0, height_m)
    one, step = back(replace(KEPT, stage=stage), mode=FlightMode.LAND, position=low)
    assert (one.stage, step.command.request) == (Stage.LANDING, Request.LAND)
    fly(one, BACK_NS, 1.0, FlightMode.LAND, position=low)
    assert any("near the ground" in problem for problem in one.problems)
    assert fly(one, BACK_NS + SECOND, 3.0, FlightMode.HOLD, position=low, armed=False, in_air=False)[-1] is Request.STAY


def test_surveys_until_the_log_is_back_and_then_tracks_by_the_remembered_times():
    mission = MissionConfig(
        name="test",
        area=MISSION.area,
        drones=MISSION.drones,
        fusion=MISSION.fusion,
        track=TrackConfig(no_cone_timeout_s=None, duration_s=60.0),
    )
    kept = replace(KEPT, mission=mission.mission_id, stage=Stage.TRACK, tracking_since_ns=START_NS + 10 * SECOND)
    one, _ = back(kept, mission)
    assert one.stage is Stage.SURVEY
    for sequence in range(20):
        cone = replace(cone_of("d2", sequence, START_NS + sequence * SECOND // 5), mission=mission.mission_id)
        one.receive(key_of("radron", cone), encode(cone), BACK_NS)
    fly(one, BACK_NS, 1.0, FlightMode.OFFBOARD)
    assert one.stage is Stage.TRACK
    fly(one, START_NS + 69 * SECOND, 0.9, FlightMode.OFFBOARD)
    assert one.stage is Stage.TRACK
    fly(one, START_NS + 70 * SECOND, 0.2, FlightMode.OFFBOARD, position=(30.0, 0.0, 3.0))
    assert one.stage is Stage.RETURN
    assert one.memory.home_m == HOME


def test_the_time_of_its_search_goes_on():
    """A mission that gives up after a while, or searches for so long at least, would have it search on by itself."""
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    fly(one, START_NS, 20.0, FlightMode.OFFBOARD)
    again, _ = back(one.memory)
    assert again._executive._mission.flight.searched_s(BACK_NS) == pytest.approx(30.0, abs=0.1)


def test_a_mode_that_stays_is_somebodys_will():
    one, _ = back()
    requests = fly(one, BACK_NS, 9.0, FlightMode.RETURN, healthy=False)
    assert requests[:100] == [Request.OFFBOARD] * 100
    assert requests[-1] is Request.RELEASE
    assert one.stage is Stage.RETURN
    assert one.memory.released


@pytest.mark.parametrize(
    "vehicle",
    [
        {"mode": FlightMode.MANUAL, "healthy": True},
        {"mode": FlightMode.MANUAL, "healthy": False},
        {"mode": FlightMode.RETURN, "healthy": True},  # no failsafe: sent home
        {"mode": FlightMode.LAND, "healthy": True},
        {"mode": FlightMode.HOLD, "healthy": True},  # stopped
    ],
)
def test_never_wrests_the_vehicle_from_a_human_pilot(vehicle):
    one, step = back(**vehicle)
    assert step.command.request is Request.RELEASE
    assert set(fly(one, BACK_NS, 8.0, **vehicle)) == {Request.RELEASE}


def test_a_pilot_who_takes_over_while_it_rejoins():
    one, _ = back()
    assert fly(one, BACK_NS, 2.0, FlightMode.MANUAL)[-1] is Request.RELEASE
    assert one.stage is Stage.HOLD


def test_one_that_had_been_taken_over_stays_so_until_told_to_resume():
    kept = replace(KEPT, stage=Stage.HOLD, resume=Stage.SURVEY, released=True)
    one, step = back(kept, mode=FlightMode.HOLD, healthy=True)
    assert (one.stage, step.command.request) == (Stage.HOLD, Request.RELEASE)
    one.receive(*command(Action.RESUME, stamp_ns=BACK_NS, boot=NEW_BOOT), BACK_NS)
    assert fly(one, BACK_NS, 1.0, FlightMode.HOLD)[-1] is Request.OFFBOARD


@pytest.mark.parametrize(
    ("stage", "mode", "request_"),
    [
        (Stage.HOLD, FlightMode.HOLD, Request.HOLD),
        (Stage.RETURN, FlightMode.RETURN, Request.OFFBOARD),
        (Stage.LANDING, FlightMode.LAND, Request.LAND),
        (Stage.ABORT, FlightMode.LAND, Request.LAND),
        (Stage.TAKEOFF, FlightMode.TAKEOFF, Request.TAKEOFF),
    ],
)
def test_goes_on_with_what_it_was_doing(stage, mode, request_):
    away = (10.0, 0.0, 3.0)
    flies = stage is not Stage.TAKEOFF
    healthy = mode is not FlightMode.RETURN
    one, step = back(replace(KEPT, stage=stage), mode=mode, healthy=healthy, position=away, in_air=flies)
    assert (one.stage, step.command.request) == (stage, request_)
    follows = mode if request_ is not Request.OFFBOARD else FlightMode.OFFBOARD
    assert set(fly(one, BACK_NS, 3.0, follows, position=away, in_air=flies)) == {request_}


@pytest.mark.parametrize(
    ("memory", "vehicle"),
    [
        (KEPT, {"armed": False, "in_air": False}),
        (replace(KEPT, mission="0" * 16), {}),
        (replace(KEPT, stamp_ns=BACK_NS - OLDEST_NS - 1), {}),
        (None, {}),
    ],
)
def test_what_does_not_fit_is_forgotten_and_nothing_is_done_to_the_vehicle(memory, vehicle):
    one, step = back(memory, **vehicle)
    assert (one.stage, step.command.request) == (Stage.PREFLIGHT, Request.STAY)
    assert one.memory is None
    assert fly(one, BACK_NS, 2.0, FlightMode.RETURN, healthy=False, **vehicle)[-1] in (Request.STAY, Request.RELEASE)


@pytest.mark.parametrize(
    ("mode", "stage"),
    [
        (FlightMode.RETURN, Stage.RETURN),
        (FlightMode.LAND, Stage.LANDING),
        (FlightMode.HOLD, Stage.HOLD),
        (FlightMode.MANUAL, Stage.HOLD),
    ],
)
def test_a_flight_that_it_knows_nothing_of_is_told_and_left_to_whoever_flies_it(mode, stage):
    one, _ = back(memory=None)
    assert set(fly(one, BACK_NS, 0.4, mode, healthy=False)) == {Request.STAY}  # not by one packet
    assert set(fly(one, BACK_NS + 2 * SECOND // 5, 5.0, mode, healthy=False)[5:]) == {Request.RELEASE}
    assert one.stage is stage
    now_ns = BACK_NS + 6 * SECOND
    one.observe_vehicle(state(now_ns, mode, armed=False, in_air=False, position=(0.0, 0.0, 0.1)))
    assert fly(one, now_ns, 3.0, FlightMode.HOLD, armed=False, in_air=False, position=(0.0, 0.0, 0.1))[-1] is Request.STAY
    assert one.stage is Stage.LANDED


@pytest.mark.parametrize("vehicle", [{"position": (0.0, 0.0, 0.4)}, {"in_air": False}, {"armed": False}])
def test_what_only_one_report_says_is_no_flight(vehicle):
    one, _ = back(memory=None, **vehicle)
    assert set(fly(one, BACK_NS, 3.0, FlightMode.HOLD, **vehicle)) == {Request.STAY}
    assert one.stage is Stage.PREFLIGHT


def test_an_operator_resumes_a_flight_that_it_knows_nothing_of_as_the_others_fly_it():
    one, _ = back(memory=None)
    began_ns = START_NS + 3 * SECOND
    told = Status(stamp_ns=BACK_NS, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.TRACK, started_ns=began_ns)
    fly(one, BACK_NS, 1.0, FlightMode.HOLD)
    assert one.memory.started_ns == 0  # no peer heard yet
    one.receive(key_of("radron", told), encode(told), BACK_NS + SECOND)
    fly(one, BACK_NS + SECOND, 1.0, FlightMode.HOLD)
    assert (one.memory.started_ns, one.memory.home_m) == (began_ns, MISSION.member("d1").origin_m)
    now_ns = BACK_NS + 2 * SECOND
    one.receive(*command(Action.RESUME, stamp_ns=now_ns, boot=NEW_BOOT), now_ns)
    assert fly(one, now_ns, 1.0, FlightMode.HOLD)[-1] is Request.OFFBOARD
    assert one.stage is Stage.SURVEY


def test_a_command_to_a_flight_that_it_knows_nothing_of_begins_no_mission():
    """The mission seemed to have begun with the return: the agent left out, for good, the others' earlier measurements."""
    one, _ = back(memory=None)
    fly(one, BACK_NS, 1.0, FlightMode.HOLD)
    now_ns, began_ns = BACK_NS + SECOND, START_NS + 3 * SECOND
    one.receive(*command(Action.RETURN, stamp_ns=now_ns, boot=NEW_BOOT), now_ns)
    fly(one, now_ns, 1.0, FlightMode.OFFBOARD)
    assert (one.stage, one.memory.started_ns) == (Stage.RETURN, 0)
    told = Status(
        stamp_ns=now_ns + SECOND, drone="d2", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.TRACK, started_ns=began_ns
    )
    one.receive(key_of("radron", told), encode(told), now_ns + SECOND)
    fly(one, now_ns + SECOND, 1.0, FlightMode.OFFBOARD)
    assert one.memory.started_ns == began_ns


def test_one_that_resumes_alone_leaves_out_what_is_older_than_any_flight():
    """Entries of another day came to it from landed drones."""
    one, _ = back(memory=None)
    fly(one, BACK_NS, 1.0, FlightMode.HOLD)
    now_ns = BACK_NS + SECOND
    one.receive(*command(Action.RESUME, stamp_ns=now_ns, boot=NEW_BOOT), now_ns)
    fly(one, now_ns, 1.0, FlightMode.OFFBOARD)
    assert one.memory.started_ns == pytest.approx(now_ns - 3600 * SECOND, abs=SECOND)


def test_armed_on_the_ground_waits_for_the_truth():
    one, step = back(in_air=False)  # the landed state may not have been heard yet
    assert (step.command.request, one.memory) == (Request.STAY, KEPT)
    assert fly(one, BACK_NS, 0.1, FlightMode.RETURN, healthy=False)[-1] is Request.OFFBOARD


def test_own_entries_from_before_are_taken_in_and_are_no_twin():
    before = tracking()
    one, _ = back(replace(KEPT, stage=Stage.TRACK, tracking_since_ns=START_NS + SECOND))
    for sequence in range(20):
        cone = cone_of("d1", sequence, START_NS + sequence * SECOND // 5, boot="0" * 15 + "1")
        one.receive(key_of("radron", cone), encode(cone), BACK_NS)
    assert len(one.fusion.log) == len(before.fusion.log)
    fly(one, BACK_NS, 1.0, FlightMode.OFFBOARD)
    assert one.stage is Stage.REACQUIRE  # the last cone is too long ago
    (status,) = messages(one.step(BACK_NS + 2 * SECOND), Status)
    assert not [problem for problem in status.problems if "another agent" in problem]


def test_what_it_covered_before_is_not_searched_again():
    """All but the east of the area is covered, by its own entries from before the restart: it flies east."""
    one = pilot("d2", memory=replace(KEPT, home_m=None), boot=NEW_BOOT)  # its frame is the mission's
    here = {"position": (1.0, 25.0, 3.0), "healthy": False}
    down = Status(stamp_ns=BACK_NS, drone="d1", mission=MISSION.mission_id, boot="2" * 16, stage=Stage.LANDED)
    one.receive(key_of("radron", down), encode(down), BACK_NS)  # or it would wait for that drone, and search in its layer
    one.observe_vehicle(state(BACK_NS, FlightMode.RETURN, **here))
    one.step(BACK_NS)
    for sequence, x in enumerate((5.0, 15.0, 25.0, 35.0)):
        coverage = Coverage(
            stamp_ns=START_NS + (20 + 5 * sequence) * SECOND,
            drone="d2",
            mission=MISSION.mission_id,
            boot="0" * 15 + "2",
            sequence=sequence,
            epoch=0,
            path_m=((x, -5.0), (x, 55.0)),
            swath_m=MISSION.survey.lane_spacing_m,
        )
        one.receive(key_of("radron", coverage), encode(coverage), BACK_NS)
    plans = []
    for tick in range(1, 9):
        now_ns = BACK_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, **here))
        plans += messages(one.step(now_ns), Plan)
    (x, y, _), (to_x, to_y, _) = plans[-1].positions_m[0], plans[-1].positions_m[-1]
    assert to_x - x > max(8.0, abs(to_y - y))


def test_a_landing_goes_on_whose_agent_was_restarted_before_the_autopilot_showed_it():
    """The earlier hold counted as the pilot's: the drone hovered with a spent battery."""
    kept = replace(KEPT, stage=Stage.LANDING, holds=True)
    one, step = back(kept, mode=FlightMode.HOLD, healthy=True)
    assert (one.stage, step.command.request) == (Stage.LANDING, Request.LAND)
    fly(one, BACK_NS, 3.0, FlightMode.HOLD)
    assert one.stage is Stage.LANDING


@pytest.mark.parametrize("mode", [FlightMode.RETURN, FlightMode.LAND, FlightMode.OFFBOARD])
def test_a_return_that_was_to_follow_on_a_rise_outlives_a_restart(mode):
    """The drone rose to the floor, and went on to search."""
    one, _ = back(
        replace(KEPT, stage=Stage.TAKEOFF, resume=Stage.RETURN), mode=mode, healthy=mode is FlightMode.OFFBOARD, position=LOW
    )
    assert one.stage is Stage.TAKEOFF
    fly(one, BACK_NS, 3.0, FlightMode.OFFBOARD, position=(10.0, 10.0, 3.0))
    assert one.stage is Stage.RETURN
