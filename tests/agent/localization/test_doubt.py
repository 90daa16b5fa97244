"""A jump that was not announced, of a localisation that only the mission knows: right until then, or right from then on?"""

import math

import msgspec
import pytest
from msgspec.structs import replace

from radron.agent.frames.carried import launch_from_local
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import same
from radron.agent.navigation.ownfence import OwnFence
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.entries import Exposure
from radron.protocol.messages import Pose, Stage, Status
from support.flights.one_pilot import AREA, MISSION, SECOND, START_NS, TICK_NS, command, messages, own_pose, pilot, started, state

HERE, JUMPED = (10.0, 10.0, 3.0), (32.0, 10.0, 3.0)


@pytest.fixture
def own():
    """A hover of 0.3 s in a frame that the mission knows exactly: turned by 30 degrees, its origin at (5, 5)."""
    own = own_pose("d1", FrameGraph.from_launch_layout(MISSION))
    for tick in range(6):
        own.take(state(START_NS + tick * TICK_NS, position=HERE))
    return own


def in_mission(own):
    return own.frame.mission_from_local.apply_point(own.vehicle.position_m)


def test_it_flies_on_by_continuity_but_may_be_where_its_localisation_says(own):
    before, there = in_mission(own), own.frame.mission_from_local.apply_point(JUMPED)
    taken = own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    assert in_mission(own) == pytest.approx(before)
    assert own.otherwise.apply_point(JUMPED) == pytest.approx(there)
    assert own.doubt_m == pytest.approx(22.0, abs=0.1)
    assert taken.position_sigma_m == own.sigma_m == pytest.approx(22.0 / math.sqrt(2.0), abs=0.1)
    assert "22 m from where it believes to be" in " ".join(own.problems(START_NS + 90 * SECOND))


def test_a_jump_back_ends_the_doubt_and_the_frame_is_known_exactly_again(own):
    exactly = own.frame.mission_from_local
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    own.take(state(START_NS + 7 * TICK_NS, position=HERE))
    assert own.otherwise is None
    assert own.doubt_m == 0.0
    assert own.frame.mission_from_local == exactly
    assert own.vehicle.position_sigma_m == 0.1


def restarted(own):
    """The agent anew, with what its state file held."""
    kept = msgspec.json.decode(msgspec.json.encode(own.kept_frame), type=KeptFrame)
    again = own_pose("d1", FrameGraph.from_launch_layout(MISSION), epoch_offset=own.epoch_offset)
    again.remember(kept)
    again.take(replace(own.vehicle, stamp_ns=own.vehicle.stamp_ns + 30 * SECOND, epoch=0, position_sigma_m=0.1))
    return again


def test_the_doubt_outlives_restarts_of_the_agent(own):
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    again = restarted(restarted(own))
    assert in_mission(again) == pytest.approx(in_mission(own))
    assert again.otherwise.apply_point(JUMPED) == pytest.approx(own.otherwise.apply_point(JUMPED))
    assert again.doubt_m == pytest.approx(22.0, abs=0.1)
    assert again.vehicle.position_sigma_m == pytest.approx(22.0 / math.sqrt(2.0), abs=0.1)
    assert again.sigma_m == pytest.approx(22.0 / math.sqrt(2.0), abs=0.1)
    assert "22 m from where it believes to be" in " ".join(again.problems(again.vehicle.stamp_ns))


def test_the_frame_is_told_after_a_restart_as_before(own):
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    before, after = own.carried(1), restarted(restarted(own)).carried(1)
    assert after.translation_m == pytest.approx(before.translation_m)
    assert after.covariance == pytest.approx(before.covariance)


def test_a_jump_back_ends_the_doubt_after_a_restart_too(own):
    exactly = own.frame.mission_from_local
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    again = restarted(own)
    again.take(state(again.vehicle.stamp_ns + TICK_NS, position=HERE))
    assert again.doubt_m == 0.0
    assert same(again.frame.mission_from_local, exactly)


def test_the_frame_of_a_localisation_that_has_jumped_back_is_known_exactly_after_a_restart(own):
    """Its epoch is a later one, and where all holders of the log were restarted, no other drone gives its frame."""
    exactly = own.frame.mission_from_local
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    own.take(state(START_NS + 7 * TICK_NS, position=HERE))
    again = restarted(own)
    assert again.vehicle.epoch == 2
    assert again.frame.mission_from_local.covariance is None
    assert in_mission(again) == pytest.approx(exactly.apply_point(HERE))
    assert again.carried(2).covariance is None


@pytest.mark.parametrize("restarts", [False, True])
def test_a_jump_in_doubt_adds_nothing_to_the_doubt_that_is_told(restarts):
    """The published frame has the uncertainty in its covariance: carried on, the frame held it twice, and no alternative
    position was known.
    """
    graph = FrameGraph.from_launch_layout(MISSION)
    own = own_pose("d1", graph)
    own.take(state(START_NS, position=HERE))
    own.take(state(START_NS + TICK_NS, position=JUMPED))
    told = own.carried(1)
    graph.place("d1", 1, graph.mission_from_local("d1", 0) @ launch_from_local(told))
    own = restarted(own) if restarts else own
    own.take(state(own.vehicle.stamp_ns + TICK_NS, position=(42.0, 10.0, 3.0), epoch=1))
    assert own.doubt_m == pytest.approx(22.0, abs=0.5)
    assert launch_from_local(own.carried(2)).sigmas_at((42.0, 10.0, 3.0))[0] == pytest.approx(15.6, abs=0.5)


@pytest.mark.parametrize("gap_s", [0.05, 1.0, 2.0, 3.0])
def test_a_jump_back_that_nobody_watched_ends_the_doubt_as_far_as_the_motion_explains_the_rest(gap_s):
    """On a circle of 10 m at 3 m/s. Both hypotheses stayed to the end of the flight, and the drone flew by the worse one."""
    own = own_pose("d1", FrameGraph.from_launch_layout(MISSION))

    def at(seconds, east_m=0.0):
        angle = 0.3 * seconds
        velocity = (-3.0 * math.sin(angle), 3.0 * math.cos(angle), 0.0)
        position = (10.0 * math.cos(angle) + east_m, 10.0 * math.sin(angle), 3.0)
        return state(START_NS + round(seconds * SECOND), position=position, velocity_mps=velocity)

    for tick in range(20):
        own.take(at(0.05 * tick))
    own.take(at(1.0, 25.0))
    assert own.doubt_m > 20.0
    own.take(at(1.0 + gap_s))
    assert own.doubt_m == 0.0
    assert own.frame.mission_from_local.covariance is None


def test_after_an_announced_jump_in_a_long_gap_in_flight_the_frame_is_not_known_any_more(own):
    """The drone flew on by a place up to 40 m off, as far as its autopilot had flown meanwhile."""
    own.take(state(own.vehicle.stamp_ns + 10 * SECOND, position=JUMPED, epoch=1))
    assert own.frame is None
    assert own.is_displaced


def test_what_the_localisation_states_as_its_error_is_not_lost_at_the_second_jump(own):
    blind = {"position_trusted": False, "position_sigma_m": 9.0, "aided": False}
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED, epoch=1))
    own.take(state(START_NS + 7 * TICK_NS, position=JUMPED, epoch=1, **blind))
    own.take(state(START_NS + 8 * TICK_NS, position=(80.0, 10.0, 3.0), epoch=2))
    assert own.sigma_m == pytest.approx(9.0, abs=0.1)


def test_a_doubt_about_an_epoch_that_is_over_is_none_about_the_present_one(own):
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    again = own_pose("d1", FrameGraph.from_launch_layout(MISSION), epoch_offset=1)
    again.take(state(START_NS + 30 * SECOND, position=HERE, epoch=1))  # announced, while no agent was there
    again.remember(own.kept_frame)
    assert again.frame is None
    assert again.otherwise is None


def test_an_announced_jump_is_no_doubt_and_does_not_end_one(own):
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED, epoch=1))
    assert own.otherwise is None
    own.take(state(START_NS + 7 * TICK_NS, position=HERE, epoch=1))
    own.take(state(START_NS + 8 * TICK_NS, position=JUMPED, epoch=2))
    assert own.doubt_m == pytest.approx(22.0, abs=0.5)


def test_an_announced_jump_that_the_stated_error_of_an_untrusted_position_explains_puts_that_right(own):
    """As when a vehicle has its satellites back: PX4 goes back to their position in the same frame."""
    exactly, drifted = own.frame.mission_from_local, {"position_trusted": False, "position_sigma_m": 9.0}
    own.take(state(START_NS + 6 * TICK_NS, position=HERE, **drifted))
    own.take(state(START_NS + 7 * TICK_NS, position=JUMPED, epoch=1))
    assert own.frame.mission_from_local == exactly
    assert own.sigma_m == 0.1


def test_an_announced_jump_that_it_does_not_explain_begins_another_frame(own):
    before = in_mission(own)
    own.take(state(START_NS + 6 * TICK_NS, position=HERE, position_trusted=False, position_sigma_m=2.0))
    own.take(state(START_NS + 7 * TICK_NS, position=JUMPED, epoch=1))
    assert in_mission(own) == pytest.approx(before)
    assert own.sigma_m > 2.0  # as wrong before


def test_without_satellites_the_stated_error_explains_no_jump_and_with_them_one(own):
    """A jump back while satellites are lost, and another after they were found: each counted as the jump at their return."""
    exactly, blind = own.frame.mission_from_local, {"position_trusted": False, "position_sigma_m": 9.0, "aided": False}
    place, found = exactly.apply_point(HERE), {"position_trusted": False}
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED, epoch=1))
    own.take(state(START_NS + 7 * TICK_NS, position=JUMPED, epoch=1, **blind))
    own.take(state(START_NS + 8 * TICK_NS, position=HERE, epoch=2, **blind))
    assert in_mission(own) == pytest.approx(place, abs=0.5)
    own.take(state(START_NS + 9 * TICK_NS, position=(14.0, 10.0, 3.0), epoch=3, **found))
    assert own.frame.mission_from_local.apply_point(HERE) == pytest.approx(place, abs=0.5)  # its position was 4 m off
    before = in_mission(own)
    own.take(state(START_NS + 10 * TICK_NS, position=(34.0, 10.0, 3.0), epoch=4, **found))
    assert in_mission(own) == pytest.approx(before, abs=0.5)


def test_who_loses_its_satellites_and_does_not_jump_goes_on_in_its_frame(own):
    exactly, blind = own.frame.mission_from_local, {"position_trusted": False, "position_sigma_m": 1.0, "aided": False}
    own.take(state(START_NS + 6 * TICK_NS, position=HERE, **blind))
    own.take(state(START_NS + 7 * TICK_NS, position=HERE, epoch=1, **blind))
    assert own.frame.mission_from_local == exactly


def test_a_doubt_does_not_explain_an_announced_jump(own):
    """1390021: the drone jumped back twice, announced and not, was 5 m off without knowing it, and flew into a peer's way."""
    exactly, well = own.frame.mission_from_local, {"position_trusted": False}  # until its filter's reset is confirmed
    places = (15.0, 0), (40.0, 0), (35.0, 1), (10.0, 1)
    for tick, (east, resets) in enumerate(places, start=6):
        own.take(state(START_NS + tick * TICK_NS, position=(east, 10.0, 3.0), epoch=1 + resets, **well))
    assert own.doubt_m == 0.0
    assert own.frame.mission_from_local.apply_point(HERE) == pytest.approx(exactly.apply_point(HERE), abs=0.5)


def test_a_turn_that_was_not_announced_is_a_doubt_that_grows_with_the_way(own):
    before, turned = in_mission(own), (math.cos(0.3), 0.0, 0.0, math.sin(0.3))  # by 0.6 rad
    own.take(state(START_NS + 6 * TICK_NS, position=HERE, quaternion=turned))
    assert in_mission(own) == pytest.approx(before)
    assert own.doubt_m == pytest.approx(0.0, abs=1e-6)
    assert own.vehicle.yaw_sigma_rad > 0.4
    own.take(state(START_NS + 10 * SECOND, position=(40.0, 10.0, 3.0), quaternion=turned))
    assert own.doubt_m == pytest.approx(30.0 * 0.6, rel=0.05)
    assert own.sigma_m > 0.6 * own.doubt_m


def test_the_fence_holds_for_both_places(own):
    fence = OwnFence(AREA, own)
    alone = fence.put(own.vehicle, 0.0)
    own.take(state(START_NS + 6 * TICK_NS, position=JUMPED))
    both = fence.put(own.vehicle, 0.0)
    assert both.outline.area < 0.9 * alone.outline.area
    for frame in (own.frame.mission_from_local, own.otherwise):
        for x, y in both.outline.exterior.coords:
            u, v, _ = frame.apply_point((x, y, 0.0))
            assert (
                -AREA.fence_margin_m - 0.6 <= min(u, v) <= max(u, v) <= 50.0 + AREA.fence_margin_m + 0.6
            )  # corners are simplified


@pytest.mark.parametrize(("jump_m", "stage"), [(5.0, Stage.SURVEY), (22.0, Stage.RETURN)])
def test_a_drone_in_great_doubt_leaves_the_mission_and_tells(jump_m, stage):
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    told = []
    for tick in range(7 * 20):
        now_ns, x = START_NS + tick * TICK_NS, 0.0 if tick < 10 else jump_m
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, position=(x, 0.0, 3.0)))
        step = one.step(now_ns)
        told += messages(step, Pose) + messages(step, Status)
    assert one.stage is stage
    assert [message.position_sigma_m for message in told if isinstance(message, Pose)][-1] > 0.6 * jump_m
    assert any("from where it believes to be" in " ".join(message.problems) for message in told if isinstance(message, Status))


def test_after_a_jump_a_drone_tells_its_frame_though_its_camera_measures_nothing():
    """No peer knows that frame: the peers went on by the motion, 12 m off, for the rest of the flight."""
    one = started()
    for tick in range(8 * 20):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD, epoch=int(tick >= 10)))
        one.step(now_ns)
    assert one.frames.graph.mission_from_local("d1", 1) is not None
    assert all(entry.live_time_s == 0.0 for entry in one.fusion.log.entries(Exposure))
