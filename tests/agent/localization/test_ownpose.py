"""The own pose has one owner: after a jump of the localisation, all its answers belong to the new epoch at once."""

import math

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.localization.continuity import POSES_M
from radron.agent.navigation.home import Home
from radron.protocol.entries import Sighting
from support.flights.one_pilot import MISSION, SECOND, START_NS, TICK_NS, own_pose, state

ESTIMATED = DroneInMission(id="d1", origin_m=(5.0, 5.0, 0.0), yaw_deg=30.0, localization="rtk", origin_sigma_m=0.5)
HERE, JUMPED = (0.0, 0.0, 3.0), (20.0, -5.0, 3.0)


@pytest.fixture
def graph():
    return FrameGraph.from_launch_layout(MISSION)


@pytest.fixture
def own(graph):
    """A hover of 0.3 s with the frame of the launch layout."""
    own = own_pose("d1", graph, ESTIMATED)
    for tick in range(6):
        own.take(state(START_NS + tick * TICK_NS, position=HERE))
    return own


def in_mission(own):
    return own.frame.mission_from_local.apply_point(own.vehicle.position_m)


@pytest.mark.parametrize("announced", [0, 1], ids=["unannounced", "announced"])
def test_after_a_jump_all_answers_agree_at_once(own, announced):
    home = Home(own)
    home.took_off(own.vehicle)
    before, home_before = in_mission(own), home.in_mission
    jump_ns = START_NS + 6 * TICK_NS
    taken = own.take(state(jump_ns, position=JUMPED, epoch=announced))
    assert taken is own.vehicle is own.history.newest is own.history.at(jump_ns)
    assert taken.epoch == 1
    assert own.epoch_offset == 1 - announced
    assert own.history.extrapolated(jump_ns + SECOND // 10)[:2] == (1, JUMPED)
    assert own.history.extrapolated(jump_ns - 1)[:2] == (0, HERE)  # the poses before belong to the frame before
    assert in_mission(own) == pytest.approx(before)  # the drone itself has not jumped
    assert own.in_mission(taken.epoch, jump_ns, JUMPED) == pytest.approx(before)
    assert own.frame.local_from_mission.apply_point(before) == pytest.approx(JUMPED)
    assert own.sigma_m == pytest.approx(math.hypot(POSES_M * math.sqrt(2.0), 0.1), rel=0.01)  # a gap of 50 ms adds little
    assert home.in_mission == home_before
    assert home.in_local == pytest.approx(JUMPED)
    problem = " ".join(own.problems(jump_ns))
    assert (problem == "") if announced else "without announcing it" in problem


def test_a_second_jump_before_the_log_knows_of_the_first_continues_the_continuation(own, graph):
    before = in_mission(own)
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED, epoch=1))
    own.take(state(START_NS + 7 * TICK_NS, position=(0.0, 9.0, 3.0), epoch=2))
    assert in_mission(own) == pytest.approx(before)
    better = Transform(0.1, (1.0, 2.0, 0.0))
    graph.place("d1", 2, better)  # by the log
    assert own.frame.mission_from_local is better


def test_asking_changes_no_answer(own):
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED, epoch=1))
    first = (own.frame, own.sigma_m, own.vehicle, own.in_mission(0, START_NS, HERE))
    assert (own.frame, own.sigma_m, own.vehicle, own.in_mission(0, START_NS, HERE)) == first


def test_without_a_frame_there_is_no_place_in_the_mission_frame():
    own = own_pose("d1", FrameGraph(), ESTIMATED)
    assert own.vehicle is own.frame is None
    own.take(state(START_NS, position_sigma_m=0.7))
    assert own.frame is None
    assert own.in_mission(0, START_NS, HERE) is None
    assert own.sigma_m == 0.7


@pytest.mark.parametrize(
    ("bad", "counter"),
    [
        ({"stamp_ns": START_NS}, "telemetry_older_than_known"),
        ({"position_m": (math.nan, 0.0, 0.0)}, "telemetry_implausible"),
        ({"position_m": (2e5, 0.0, 0.0)}, "telemetry_implausible"),
        ({"velocity_mps": (math.inf, 0.0, 0.0)}, "telemetry_implausible"),
        ({"velocity_mps": (math.nan, 0.0, 0.0)}, "telemetry_implausible"),
        ({"velocity_mps": (1e300, 0.0, 0.0)}, "telemetry_implausible"),
        ({"quaternion": (1e308, 0.1, 0.1, 0.0)}, "telemetry_implausible"),
        ({"quaternion": (math.nan, 0.0, 0.0, 0.0)}, "telemetry_implausible"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "telemetry_implausible"),
        ({"height_m": math.nan}, "telemetry_implausible"),
        ({"position_sigma_m": -1.0}, "telemetry_implausible"),
    ],
)
def test_bad_telemetry_is_dropped_and_counted(own, bad, counter):
    newest = own.vehicle
    assert own.take(replace(state(START_NS + 6 * TICK_NS), **bad)) is None
    assert own.vehicle is newest
    assert own._counters[counter] == 1


def test_a_sighting_relates_a_frame_without_a_heading_to_the_others():
    own = own_pose("d1", FrameGraph(), replace(ESTIMATED, localization="slam", yaw_sigma_deg=180.0))
    assert own.is_unplaced
    seen = {"drone": "d2", "mission": "0" * 16, "boot": "1" * 16, "sequence": 1, "epoch": 0, "position_m": HERE}
    own.take_entry(Sighting(stamp_ns=START_NS, target="d1", range_m=5.0, range_sigma_m=0.1, **seen))
    assert not own.is_unplaced
