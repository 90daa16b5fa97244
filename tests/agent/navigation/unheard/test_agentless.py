"""The possible positions of a vehicle with its agent lost."""

from math import inf

import numpy as np
import pytest

from radron.agent.config.mission import (
    AreaConfig,
    DroneInMission,
    EncirclementConfig,
    GroundConfig,
    LimitsConfig,
    MissionConfig,
    SafetyConfig,
)
from radron.agent.config.survey import SurveyConfig
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.unheard.agentless import Agentless
from radron.protocol.messages import Stage

HOME = (0.0, 0.0, 0.0)
NOW = np.array([3.0, 5.0, 7.0])


COMES_DOWN_S = 10.0  # a drone that lands at its home by setpoints settles there, and lands from a few metres, in this time


def course(stage=Stage.TRACK, place=(30.0, 0.0, 2.0), velocity=(0.0, 2.0, 0.0), steered=True, **safety):
    """The course of drone b: home at the origin, return altitude 14 m."""
    mission = MissionConfig(
        name="test",
        area=AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0)), ceiling_m=40.0),
        drones=(DroneInMission(id="a"), DroneInMission(id="b", origin_m=HOME)),
        safety=SafetyConfig(**safety),
    )
    return flown_by(Agentless(mission), "b", stage, place, velocity, steered=steered)


def flown_by(agentless, name, stage=Stage.TRACK, place=(30.0, 0.0, 2.0), velocity=(0.0, 2.0, 0.0), *, steered=True):
    return agentless.course(name, PeerState(place, velocity), stage, agentless.launch(name), steered=steered)


def test_it_stops_climbs_and_goes_home():
    """The vehicle is still where it stopped, or on its way already, by 6 m/s at most; in the end it must be down."""
    flown = course()
    assert flown.cruise_m == 14.0
    assert flown.departs_s == pytest.approx(2.5 + 12.0 / 2.2)
    stop, way = flown.stretches(flown.departs_s + np.array([0.0, 2.0, 3.0]), below_m=20.0)
    assert (stop.start, stop.end) == ((30.0, 0.0), (30.0, 4.0))
    assert (way.start, way.end) == ((30.0, 3.0), (0.0, 0.0))
    assert way.front == pytest.approx((0.0, 12.0, 18.0))
    assert way.back == pytest.approx((0.0, 0.0, 0.0))
    left = flown.stretches(NOW + flown.leaves_s, below_m=20.0)
    assert len(left) == 1
    assert left[0].back == pytest.approx((9.0, 15.0, 21.0))
    assert flown.stretches(NOW + flown.down_s, below_m=20.0) == []


def test_a_revoked_drone_can_wait_for_the_others_to_be_home_and_still_be_down_when_they_count_with_it():
    """The revoked drone waits for vehicles with lost agents, and descends at 2 m/s: from the lowest of six layers for the
    highest, too.
    """
    names = "abcdef"
    drones = tuple(DroneInMission(id=name, origin_m=(6.0 * k, 0.0, 0.0)) for k, name in enumerate(names))
    area = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0)), ceiling_m=40.0)
    agentless = Agentless(mission := MissionConfig(name="test", area=area, drones=drones))
    flown = {name: flown_by(agentless, name, place=(15.0, 40.0, 2.0)) for name in names}
    for mine, height_m in zip(names, mission.return_heights_m, strict=True):
        descent_s = height_m / mission.limits.climb_mps + COMES_DOWN_S
        assert max(flown[other].arrives_s for other in names if other != mine) + descent_s < flown[mine].down_s


@pytest.mark.parametrize(
    ("stage", "steered", "least_m"), [(Stage.TRACK, True, 1.0), (Stage.TRACK, False, 0.0), (Stage.HOLD, True, 0.0)]
)
def test_it_goes_on_at_first_where_it_flew_by_setpoints(stage, steered, least_m):
    """A following drone expected it beside itself, went around that place, and flew on below where it stopped."""
    stop, *_ = course(stage, steered=steered).stretches(np.array([0.0, 0.5, 1.0, 4.0]), below_m=20.0)
    assert stop.back == pytest.approx((0.0, 0.5 * least_m, least_m, least_m))
    behind = np.tile((30.0, -5.0), (4, 1))
    assert stop.nearest(behind)[:, 1] == pytest.approx(stop.back)
    assert stop.nearest(-behind)[:, 1] == pytest.approx(4.0)


@pytest.mark.parametrize(("rise_m", "measured_s"), [(2.0, 4.2), (10.0, 8.4), (20.0, 12.0), (27.0, 13.8), (51.0, 21.8)])
def test_it_departs_no_earlier_than_a_climb_allows_and_no_later_than_a_slow_one(rise_m, measured_s):
    """Departures of a real PX4, from 27 m on of the emulated one. Ways home that began after a second had pushed climbing drones
    together: 1.3 m.
    """
    flown = course(place=(30.0, 0.0, 14.0 - rise_m))
    assert flown.departs_s < measured_s < flown.leaves_s


def test_a_climb_in_progress_or_without_the_agent_has_no_stop_before_it():
    """A pose 4 m below the height of return: 2.5 s late if the stop is counted once more."""
    below = (30.0, 0.0, 10.0)
    assert course(place=below, velocity=(0.0, 0.0, 0.4)).departs_s == pytest.approx(2.5 + 4.0 / 2.2)
    assert course(place=below, velocity=(0.0, 0.0, 2.0)).departs_s == pytest.approx(4.0 / 2.2)
    assert course(place=below, steered=False).departs_s == pytest.approx(4.0 / 2.2)


def returning(name="b", place=(30.0, 0.0, 2.0), **sections):
    """The course of a drone in a mission with these sections; launch places and heights as in ``course``."""
    area = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0)), ceiling_m=40.0, fence_margin_m=10.0)
    drones = DroneInMission(id="a"), DroneInMission(id="b", origin_m=HOME)
    mission = MissionConfig(name="test", area=area, drones=drones, **sections)
    return flown_by(Agentless(mission), name, place=place, velocity=(0.0, 0.0, 0.0))


def test_an_agent_that_climbs_and_flies_faster_is_on_its_way_sooner():
    flown = returning(limits=LimitsConfig(climb_mps=4.0, speed_mps=12.0), survey=SurveyConfig(speed_mps=9.0))
    assert flown.departs_s == pytest.approx(2.5 + 12.0 / 4.0)
    _, way = flown.stretches(flown.departs_s + np.array([0.0, 1.0, 2.0]), below_m=20.0)
    assert way.front == pytest.approx((0.0, 9.0, 18.0))
    assert flown.home_from_s == pytest.approx(flown.departs_s + 30.0 / 12.0)


@pytest.mark.parametrize(
    ("sections", "top_m"),
    [
        ({}, 14.0),
        ({"encirclement": EncirclementConfig(height_m=8.0)}, 19.0),  # both layers 5 m higher, to be above the circles
        ({"ground": GroundConfig(slope=(0.1, 0.0))}, 20.0),  # the fence is 60 m east of home
        ({"ground": GroundConfig(slope=(-0.1, 0.0))}, 15.0),  # the fence is 10 m west of home
    ],
)
def test_its_agent_may_bring_it_home_higher_than_the_autopilot_would(sections, top_m):
    """In its altitude layer above the ground below it. Only a drone that flies by the separation above passes over it."""
    flown = returning(**sections)
    assert flown.cruise_m == 14.0
    times = NOW + flown.leaves_s
    assert flown.stretches(times, below_m=30.0, above_m=top_m) == []
    assert flown.stretches(times, below_m=30.0, above_m=top_m - 0.1) != []
    late = NOW + flown.home_from_s
    assert not flown.is_over_home(late, above_m=top_m)
    assert flown.is_over_home(late, above_m=top_m - 0.1)


def test_a_drone_without_a_home_holds_whatever_the_mission_says():
    """With SLAM alone the autopilot cannot return; its stop is that of a hold, 2.3 s of its velocity."""
    area = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0)))
    mission = MissionConfig(name="test", area=area, drones=(DroneInMission(id="a", localization="slam"),))
    flown = flown_by(Agentless(mission), "a")
    assert flown.leaves_s == inf
    assert flown.stop.end == pytest.approx((30.0, 4.6))


def test_where_it_is_at_once_it_may_depart_at_once():
    assert course(place=(30.0, 0.0, 14.0)).departs_s == 1.0  # at its height
    assert course(place=(8.0, 0.0, 2.0)).departs_s == 1.0  # near its home it may return low


def test_what_crosses_high_above_is_not_in_the_way_until_it_comes_down():
    flown = course()
    home_s = flown.departs_s + np.hypot(30.0, 3.0) / 8.0  # at the greatest speed of the mission
    assert flown.stretches(NOW - NOW[-1] + home_s - 0.1, below_m=8.0) == []  # has left its stop, upward
    assert [one.start for one in flown.stretches(NOW - NOW[-1] + home_s + 0.1, below_m=8.0)] == [(0.0, 0.0)]
    assert [one.start for one in flown.stretches(NOW + flown.leaves_s, below_m=8.0)] == [(0.0, 0.0)]


def test_what_crosses_below_is_not_in_the_way():
    """Nor is its stop, nor its home: the vehicle is never above its height of return."""
    flown = course()
    for now_s in (0.0, flown.departs_s, flown.leaves_s + 5.0):
        assert flown.stretches(NOW + now_s, below_m=23.0, above_m=14.0) == []
        assert flown.stretches(NOW + now_s, below_m=23.0, above_m=13.9) != []


def test_a_climbing_drone_meets_it_only_until_it_is_above():
    """The front stays where it was when both were last at one height."""
    flown = course()
    times = flown.departs_s + np.array([0.0, 1.0, 2.0, 3.0])
    *_, way = flown.stretches(times, below_m=30.0, above_m=np.array([10.0, 12.0, 14.0, 16.0]))
    assert way.front == pytest.approx((0.0, 6.0, 6.0, 6.0))


@pytest.mark.parametrize("x_m", [30.0, 8.0])
def test_it_has_left_where_it_stops_once_it_must_have_climbed_above_those_below(x_m):
    """The vehicle stops for 3.5 s at most and climbs at 1.5 m/s or more, from 2 m; near its home it may leave lower, but no later
    than at that height.
    """
    flown, climbed_s = course(place=(x_m, 0.0, 2.0)), 3.5 + (8.0 - 2.0) / 1.5

    def stops(now_s, below_m):
        return (x_m, 4.0) in [one.end for one in flown.stretches(NOW - NOW[0] + now_s, below_m)]

    assert stops(climbed_s - 0.1, 8.0)
    assert not stops(climbed_s + 0.1, 8.0)
    assert stops(climbed_s + 0.1, 20.0)
    assert stops(flown.leaves_s - 0.1, 20.0)
    assert not stops(flown.leaves_s + 0.1, 20.0)
    assert stops(3.4, 1.0)  # climbs no earlier than its possible stop


def test_near_its_home_it_may_return_low():
    (_, way) = course(place=(8.0, 0.0, 2.0)).stretches(NOW, below_m=8.0)
    assert way.start != way.end


@pytest.mark.parametrize(
    ("stage", "lost", "leaves_s", "stop_s"),
    [
        (Stage.TRACK, "hold", inf, 2.3),  # a hold takes longest (test_stop_without_agent.py)
        (Stage.TRACK, "land", 17.5, 2.0),
        (Stage.LANDING, "return", 17.5, 2.0),
    ],
)
def test_it_stays_where_it_stops(stage, lost, leaves_s, stop_s):
    flown = course(stage, agent_lost=lost)
    assert flown.leaves_s == leaves_s
    assert [one.end for one in flown.stretches(NOW, below_m=20.0)] == [(30.0, pytest.approx(2.0 * stop_s))]
