"""A pilot with an estimated frame: its reports of the frame, and the time from which it may start."""

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.frames.drift import Drift
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform
from radron.agent.localization.poseproblems import UNSURE_M
from radron.agent.mission.memory import Memory
from radron.agent.vehicle.interface import FlightMode, SeenDrone
from radron.protocol.codec import encode
from radron.protocol.entries import Exposure
from radron.protocol.keys import key_of
from radron.protocol.messages import Frame, Pose, Stage, Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, command, messages, own_pose, pilot, state

NONE = PixelHits(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16))
LAYOUT = DroneInMission(
    id="d1", origin_m=(5.0, 5.0, 0.0), yaw_deg=30.0, localization="rtk", origin_sigma_m=0.5, yaw_sigma_deg=2.0
)


def mission_of(member=LAYOUT):
    return replace(MISSION, drones=(member, DroneInMission(id="d2", localization="rtk")))


def flown(one, seconds=4.0, mission=None, began_ns=START_NS, jump_at_s=None, camera=True, **values):
    """Its last message of each kind; hovering, with a readout every 0.2 s. ``jump_at_s``: time of a jump by 15 m."""
    last = {}
    if mission is not None:
        one.observe_vehicle(state(began_ns, **values))
        one.receive(*command(mission=mission, stamp_ns=began_ns), began_ns)
        one.step(began_ns)  # in the air and holding already
    for tick in range(1, round(seconds * 20)):
        now_ns = began_ns + tick * TICK_NS
        x = 15.0 if jump_at_s is not None and tick >= jump_at_s * 20 else 0.0
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, position=(x, 0.0, 3.0), **values))
        told = []
        if camera and tick % 4 == 0:
            told = one.observe_detector(Readout(now_ns - 4 * TICK_NS, now_ns, now_ns - 4 * TICK_NS, 0.2, NONE))
        step = one.step(now_ns)
        step = replace(step, publications=[*told, *step.publications])
        for kind in (Exposure, Frame, Status):
            for message in messages(step, kind):
                last[kind] = message
        if messages(step, Frame):
            last[Transform] = one.frames.graph.mission_from_local("d1", 0)  # as it was then
    return last


def test_the_frame_of_the_layout_is_known_after_the_first_keyframe_and_published():
    one = pilot(mission=mission_of())
    last = flown(one, mission=mission_of())
    frame, known = last[Frame], last[Transform]
    assert frame.translation_m == known.translation == pytest.approx((5.0, 5.0, 0.0), abs=0.1)
    assert frame.yaw_rad == known.yaw_rad == pytest.approx(np.radians(30.0), abs=0.02)
    assert np.array(frame.covariance).reshape(4, 4) == pytest.approx(known.covariance)
    other = pilot("d2", mission_of())
    other.receive(key_of("radron", frame), encode(frame), frame.stamp_ns)
    assert other.frames.graph.mission_from_local("d1", 0) is None  # every agent derives frames from its own log
    assert not any(name.startswith("dropped") for name in other.counters)


def test_a_drone_without_a_camera_tells_where_it_is_where_its_frame_is_estimated():
    mission = mission_of()
    last = flown(pilot("d1", mission), 6.0, mission, camera=False)
    assert last[Exposure].live_time_s == 0.0
    assert last[Frame].translation_m == pytest.approx((5.0, 5.0, 0.0), abs=0.1)
    assert Exposure not in flown(pilot(), 6.0, MISSION, camera=False)


def test_exact_frames_are_not_published():
    assert Frame not in flown(pilot(), mission=MISSION)


def test_a_drone_with_an_uncertain_position_reports_it():
    vague = replace(LAYOUT, origin_sigma_m=2.0 * UNSURE_M)
    one = pilot(mission=mission_of(vague))
    last = flown(one, mission=mission_of(vague))
    both_axes = "its position in the mission frame is uncertain: 1 sigma = 14 m"
    assert both_axes in last[Status].problems


def test_a_start_without_a_heading_needs_a_sight_and_then_the_drone_waits_for_its_frame():
    lost = replace(LAYOUT, localization="slam", yaw_sigma_deg=180.0)
    one = pilot(mission=mission_of(lost))
    last = flown(one, mission=mission_of(lost), armed=False)
    assert one.stage is Stage.PREFLIGHT
    assert "its heading is not known, and it has neither seen another drone nor been seen by one yet" in last[Status].problems
    seen = SeenDrone(stamp_ns=START_NS + 3 * SECOND, target="d2", range_m=6.0, range_sigma_m=0.1)
    assert one.observe_sightings([seen])
    last = flown(one, mission=mission_of(lost), began_ns=START_NS + 5 * SECOND)
    assert one.stage is Stage.SURVEY
    assert one.counters["waited_without_frame"] > 0
    assert "d1: its frame is not known yet" in last[Status].problems


def test_a_jump_begins_an_epoch_in_everything_that_is_said_and_the_flight_goes_on():
    one = pilot(mission=mission_of())
    last = flown(one, mission=mission_of(), jump_at_s=2.0)
    assert last[Exposure].epoch == 1
    assert "its localisation jumped by 15 m without announcing it" in last[Status].problems
    assert one.counters["waited_without_frame"] < 40  # only until the first keyframe
    assert one.memory.epoch_offset == 1
    again = pilot(mission=mission_of(), memory=one.memory)
    last = flown(again, began_ns=START_NS + 5 * SECOND)
    assert last[Exposure].epoch == 1


def reckoned(one, now_ns):
    """Its predicted position of d2, which hovers 20 m from its launch; own local frame."""
    told = Pose(
        stamp_ns=now_ns,
        drone="d2",
        epoch=0,
        position_m=(20.0, 0.0, 3.0),
        velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )
    one.receive(key_of("radron", told), encode(told), now_ns)
    flown(one, 0.5, began_ns=now_ns)
    return [other.measured.position for other in one.reckoning.others if other.measured is not None]


def test_an_agent_restarted_in_flight_goes_on_by_the_frames_of_before_until_its_log_tells_them():
    """All holders of the log were restarted: with a heading from sightings alone it would wait, at a place unknown to the
    others.
    """
    mission, covariance = mission_of(replace(LAYOUT, localization="slam", yaw_sigma_deg=180.0)), np.diag([0.1, 0.1, 0.1, 0.01])
    one = pilot(mission=mission)
    flown(one, 1.0, began_ns=START_NS - SECOND, armed=False)
    one.observe_sightings([SeenDrone(stamp_ns=START_NS - SECOND // 2, target="d2", range_m=6.0, range_sigma_m=0.1)])
    flown(one, mission=mission)
    assert one.stage is Stage.SURVEY
    assert one.whereabouts is None
    one.frames.graph.place("d1", 0, Transform(0.5, (4.0, 5.0, 0.0), covariance))
    one.frames.graph.place("d2", 0, Transform(0.0, (1.0, 0.0, 0.0), covariance))
    (place,) = reckoned(one, START_NS + 5 * SECOND)
    flown(one, 6.0, began_ns=START_NS + 6 * SECOND)
    kept = msgspec.json.decode(msgspec.json.encode(one.memory), type=Memory)

    back_ns = START_NS + 14 * SECOND
    other = pilot(mission=mission, memory=kept, boot="f" * 16)
    other.observe_vehicle(state(back_ns, FlightMode.RETURN, healthy=False))
    other.step(back_ns)
    assert other.whereabouts.place_m == pytest.approx((4.0, 5.0, 3.0), abs=1e-6)
    assert other.whereabouts.sigma_m > one.whereabouts.sigma_m + 0.1  # drifted since
    assert reckoned(other, back_ns + SECOND) == [pytest.approx(place)]
    graph = other.frames.graph
    graph.place("d1", 0, Transform(0.5, (6.0, 5.0, 0.0), covariance))
    other.observe_vehicle(state(back_ns + 2 * SECOND, FlightMode.OFFBOARD))
    assert other.whereabouts.place_m == pytest.approx((6.0, 5.0, 3.0), abs=1e-6)
    graph.replace_from("d1", 0, 0, [(0, None)])
    other.observe_vehicle(state(back_ns + 3 * SECOND, FlightMode.OFFBOARD))
    assert other.whereabouts is None  # a frame that the log no longer gives is not believed


@pytest.mark.parametrize(("away_s", "flown_s"), [(12, 0), (12, 48), (60, 0)])
def test_the_frame_of_before_a_restart_drifts_until_the_log_tells_it(away_s, flown_s):
    """All holders of the log were restarted, and no sighting gives the heading: the drone flies by that frame to the end."""
    member, before = replace(LAYOUT, localization="slam", yaw_sigma_deg=180.0), Transform(0.5, (4.0, 5.0, 0.0), 0.01 * np.eye(4))
    drift, own = Drift(mission_of(member)), own_pose("d1", FrameGraph(), member)
    back_ns = START_NS + away_s * SECOND
    own.take(state(back_ns))
    own.remember(KeptFrame.of(0, START_NS, before))
    for tick in range(flown_s * 20):
        own.take(state(back_ns + tick * TICK_NS))
    aged = drift.aged("d1", before, away_s + flown_s, (0.0, 0.0, 3.0))
    assert own.sigma_m == pytest.approx(aged.sigmas_at((0.0, 0.0, 3.0))[0], rel=0.02)  # anew once a second
    assert own.whereabouts.place_m == pytest.approx((4.0, 5.0, 3.0))


@pytest.mark.parametrize("jump_s", [1, 30])
def test_the_frame_of_a_jump_after_a_restart_drifts_until_the_log_tells_it(jump_s):
    """As the frame before: the log has given neither."""
    member, before = replace(LAYOUT, localization="slam", yaw_sigma_deg=180.0), Transform(0.5, (4.0, 5.0, 0.0), 0.01 * np.eye(4))
    one, other = (own_pose("d1", FrameGraph(), member) for _ in range(2))
    for own in (one, other):
        own.remember(KeptFrame.of(0, START_NS, before))
        for tick in range(60 * 20):
            epoch = int(own is one and tick >= jump_s * 20)
            own.take(state(START_NS + tick * TICK_NS, position=(15.0 * epoch, 0.0, 3.0), epoch=epoch))
    assert one.whereabouts.place_m == pytest.approx(other.whereabouts.place_m)
    assert other.sigma_m > 0.5
    assert one.sigma_m >= 0.95 * other.sigma_m  # once a second each


@pytest.mark.parametrize("left_out", [True, False])
def test_a_drone_whose_entries_count_no_more_goes_on_by_the_frame_known_last_and_it_drifts(left_out):
    known, graph = Transform(0.5, (4.0, 5.0, 0.0), 0.01 * np.eye(4)), FrameGraph()
    own = own_pose("d1", graph, LAYOUT)
    graph.place("d1", 0, known)
    own.take(state(START_NS))
    if left_out:
        own.left_out()
    graph.replace_from("d1", 0, 0, [(0, None)])
    assert (own.whereabouts is not None) is left_out
    for tick in range(1, 30 * 20):
        own.take(state(START_NS + tick * TICK_NS))
    assert own.is_lost is False
    if left_out:
        assert own.whereabouts.place_m == pytest.approx((4.0, 5.0, 3.0))
        assert own.sigma_m > known.sigmas_at((0.0, 0.0, 3.0))[0] + 0.1


@pytest.mark.parametrize("contradicts", [True, False])
def test_a_drone_whose_entries_count_no_more_before_it_knew_its_place_returns(contradicts):
    """The drone hovered over its takeoff place to the end, and was carried along by the others, which circled there."""
    mission = mission_of(replace(LAYOUT, localization="slam", yaw_sigma_deg=180.0))
    one = pilot(mission=mission)
    flown(one, 1.0, began_ns=START_NS - SECOND, armed=False)
    one.observe_sightings([SeenDrone(stamp_ns=START_NS - SECOND // 2, target="d2", range_m=6.0, range_sigma_m=0.1)])
    exposure = flown(one, mission=mission)[Exposure]
    other = replace(exposure, live_time_s=0.5 * exposure.live_time_s) if contradicts else exposure
    one.receive(key_of("radron", other), encode(other), START_NS + 4 * SECOND)
    flown(one, 7.0, began_ns=START_NS + 4 * SECOND)
    assert one.whereabouts is None
    assert one.stage is (Stage.RETURN if contradicts else Stage.SURVEY)
