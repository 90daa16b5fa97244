"""The true local frames: their initial errors, drift, and events in flight."""

import numpy as np
import pytest

from radron.agent.config.mission import DatumConfig
from radron.agent.errors import ConfigError
from radron.sim.scenario import load_scenario, override
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.localizers import EventTruth, LiarTruth, SlamTruth, VehicleTruth
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.streams import streams

DATUM = DatumConfig(latitude_deg=47.4, longitude_deg=8.5)
STEP_S = 0.05
EXACT = SlamTruth(drift=0.0, vertical=0.0, yaw_degpm=0.0)


def frames(vehicles, seed=1, liar=None, layout=None, names=None):
    names = names or list(vehicles)
    layout = layout or [((6.0 * k, 2.0, 0.0), 0.0) for k in range(len(names))]
    truth = LocalizationTruth(vehicles=vehicles, liar=liar)
    return MovingFrames(truth, names, layout, DATUM, STEP_S, streams(seed, len(names)))


def fly(moving, seconds, place=(0.0, 0.0, 3.0), velocity=(0.0, 0.0, 0.0), start_s=0.0):
    """All vehicles fly together; returns where they are."""
    here = np.tile(np.array(place, dtype=float), (len(moving.origin), 1))
    for step in range(round(seconds / STEP_S)):
        here = here + np.array(velocity) * STEP_S
        moving.step(start_s + step * STEP_S, here)
    return here


def slams(seeds, **truth):
    return [frames({"d1": VehicleTruth(kind="slam", **truth)}, seed) for seed in seeds]


def test_frames_of_which_nothing_is_said_stay_exactly_where_the_layout_has_them():
    layout = [((1.0, 2.0, 3.0), 40.0), ((5.0, 0.0, 0.0), 0.0)]
    moving = frames({}, layout=layout, names=["d1", "d2"])
    fly(moving, 5.0, velocity=(3.0, 0.0, 0.0))
    assert not moving.moving
    assert moving.origin.tolist() == [[1.0, 2.0, 3.0], [5.0, 0.0, 0.0]]
    assert moving.yaw_rad == pytest.approx([np.radians(40.0), 0.0])
    assert (moving.epoch, moving.told_m, moving.reframing) == ([0, 0], [0.0, 0.0], [None, None])


def test_slam_begins_near_the_layout_with_any_heading():
    begun = slams(range(300), origin_m=1.5, yaw_deg=180.0)
    origins, yaws = np.array([one.origin[0] for one in begun]), np.array([one.yaw_rad[0] for one in begun])
    assert (origins - [0.0, 2.0, 0.0]).std(axis=0) == pytest.approx([1.5, 1.5, 0.15], rel=0.13)  # three sigmas of 300
    assert np.histogram(yaws, bins=4, range=(-np.pi, np.pi))[0].min() > 50
    assert begun[0].local(np.array([[7.0, 1.0, 0.5]]))[0] == pytest.approx(
        begun[0].matrix[0].T @ (np.array([7.0, 1.0, 0.5]) - origins[0])
    )


@pytest.mark.slow
def test_slam_drifts_with_the_distance_flown_and_not_while_it_hovers():
    after = []
    for moving in slams(range(150)):
        here = fly(moving, 10.0)
        assert np.abs(moving.own_error_m(here)).max() < 1e-9
        there = fly(moving, 100.0 / 3.0, velocity=(3.0, 0.0, 0.0), start_s=10.0)
        after.append([*moving.own_error_m(there)[0], np.degrees(moving.yaw_rad[0])])
    spread = np.sqrt((np.array(after) ** 2).mean(axis=0))
    # The integral over 100 m of a rate that changes after 25 m; the turn adds across.
    factor = (2.0 * 25.0 * (100.0 - 25.0 * (1.0 - np.exp(-4.0)))) ** 0.5
    assert spread[0] == pytest.approx(0.01 * factor, rel=0.17)  # three sigmas
    assert spread[1] > spread[0]
    assert spread[2] == pytest.approx(0.003 * factor, rel=0.17)
    assert spread[3] == pytest.approx(0.015 * factor, rel=0.17)


def test_a_drifting_frame_leaves_the_position_where_it_is_and_turns_what_is_flown_next():
    """Over one step the local position moves by the velocity that the vehicle measures in its frame, and by the drift alone."""
    (moving,) = slams([3], yaw_deg=180.0, slam=SlamTruth(drift=0.0, vertical=0.0, yaw_degpm=1.0))
    here = fly(moving, 5.0, velocity=(3.0, 0.0, 0.0))
    turned = moving.yaw_rad[0]
    before = np.array(moving.local(here)[0])
    moving.step(5.0, here)
    np.testing.assert_allclose(moving.local(here)[0], before, atol=1e-9)
    there = here + np.array([[0.15, 0.0, 0.0]])
    moved = np.array(moving.local(there)[0]) - before
    np.testing.assert_allclose(moved, np.array(moving.turn(there - here)[0]), atol=1e-9)
    assert abs(turned - moving.yaw_rad[0]) < 1e-9


def test_satellites_keep_the_place_within_their_error_and_north_where_it_is():
    errors, told = [], None
    for seed in range(120):
        moving = frames({"d1": VehicleTruth(kind="gnss"), "d2": VehicleTruth(kind="rtk")}, seed)
        here = fly(moving, 20.0, velocity=(3.0, 0.0, 0.0))
        errors.append(moving.own_error_m(here))
        assert not moving.yaw_rad.any()
        told = moving.told_m
    spread = np.array(errors).std(axis=0)
    assert spread[0, :2] == pytest.approx([1.0, 1.0], rel=0.2)
    assert spread[1, :2] == pytest.approx([0.015, 0.015], rel=0.2)
    assert spread[0, 2] < 0.6  # of the receiver's 1.5 m; barometer and rangefinder hold the rest
    assert told == pytest.approx([2.0**0.5 * np.hypot(1.0, 0.2), 2.0**0.5 * np.hypot(0.015, 0.01)])


def test_a_fix_and_the_place_flown_by_have_the_same_error():
    """A receiver's fixes agree with the vehicle's own place in a frame at the layout's origin, but for white noise and lag."""
    moving = frames({"d1": VehicleTruth(kind="gnss")}, seed=4)
    here = fly(moving, 30.0)
    receiver = moving.receiver[0]
    assert receiver is not None
    np.testing.assert_allclose(moving.own_error_m(here)[0, :2], receiver.error_m[:2], atol=0.5)


@pytest.mark.parametrize("announced", [True, False])
def test_a_jump_shifts_the_place_by_so_much_and_only_who_is_told_can_undo_it(announced):
    event = EventTruth(at_s=1.0, jump_m=15.0, turn_deg=30.0, announced=announced)
    (moving,) = slams([5], yaw_deg=180.0, slam=EXACT, events=(event,))
    here = fly(moving, 1.0, place=(30.0, 20.0, 3.0))
    before, yaw = np.array(moving.local(here)[0]), moving.yaw_rad[0]
    ahead = np.array(moving.local(here + np.array([[4.0, 1.0, 0.0]]))[0])
    moving.step(1.0, here)
    after = np.array(moving.local(here)[0])
    assert abs(abs(moving.yaw_rad[0] - yaw) - np.radians(30.0)) < 1e-9
    assert moving.epoch == [int(announced)]
    if not announced:
        assert moving.reframing == [None]
        assert np.hypot(*moving.own_error_m(here)[0, :2]) == pytest.approx(15.0)
        return
    assert np.abs(moving.own_error_m(here)).max() < 1e-9
    (reframing,) = moving.reframing
    assert reframing is not None
    assert reframing.point(tuple(before)) == pytest.approx(after)
    assert reframing.point(tuple(ahead)) == pytest.approx(moving.local(here + np.array([[4.0, 1.0, 0.0]]))[0])
    moving.step(1.05, here)
    assert moving.reframing == [None]


def test_satellites_are_lost_and_slam_goes_on_from_where_it_is():
    lost = EventTruth(at_s=10.0, switch_to="slam")
    moving = frames({"d1": VehicleTruth(kind="gnss", events=(lost,))}, seed=6)
    here = fly(moving, 10.0)
    error = moving.own_error_m(here)[0]
    receiver = moving.receiver[0]
    assert receiver is not None
    assert receiver.available
    there = fly(moving, 60.0, place=here[0], start_s=10.0)  # hovers: nothing drifts any more, however the satellites wander
    assert not receiver.available
    assert moving.epoch == [1]
    np.testing.assert_allclose(moving.own_error_m(there)[0], error, atol=0.1)
    assert moving.told_m == [0.1]
    far = fly(moving, 60.0, place=here[0], velocity=(3.0, 0.0, 0.0), start_s=70.0)
    assert np.hypot(*(moving.own_error_m(far)[0] - error)[:2]) > 0.2


def test_satellites_that_come_back_bring_the_place_back():
    events = (EventTruth(at_s=1.0, switch_to="rtk"),)
    slam = SlamTruth(drift=0.1)
    moving = frames({"d1": VehicleTruth(kind="slam", yaw_deg=180.0, slam=slam, events=events)}, seed=8)
    assert moving.receiver[0] is not None
    assert not moving.receiver[0].available
    here = fly(moving, 1.05, velocity=(50.0, 0.0, 0.0))
    assert moving.epoch == [1]
    assert moving.yaw_rad.tolist() == [0.0]
    assert np.abs(moving.own_error_m(here)).max() < 0.1


def test_a_loop_closure_takes_most_of_the_drift_back():
    slam = SlamTruth(drift=0.05, yaw_degpm=0.1, closure_s=20.0, closure_share=0.9)
    moving = frames({"d1": VehicleTruth(kind="slam", slam=slam)}, seed=9)
    here, closed = np.zeros((1, 3)), 0
    for step in range(4000):
        here = here + np.array([[0.15, 0.0, 0.0]])
        before = moving.own_error_m(here)[0]
        moving.step(step * STEP_S, here)
        if moving.reframing[0] is not None:
            closed += 1
            left = np.linalg.norm(moving.own_error_m(here)[0]) / np.linalg.norm(before)
            assert left < 0.2  # a tenth, and what one more step drifts
    assert 4 <= closed <= 20
    assert moving.epoch == [closed]


def test_the_liar_is_one_of_the_drones_and_everything_it_says_is_shifted_alike():
    vehicles = {name: VehicleTruth(kind=kind, slam=EXACT) for name, kind in (("d1", "gnss"), ("d2", "rtk"), ("d3", "slam"))}
    liars = set()
    for seed in range(12):
        honest, lying = frames(vehicles, seed), frames(vehicles, seed, LiarTruth(shift_m=20.0))
        here = fly(lying, 10.0)
        fly(honest, 10.0)
        shift = lying.own_error_m(here) - honest.own_error_m(here)
        (liar,) = np.flatnonzero(np.hypot(*shift[:, :2].T) > 1.0).tolist()
        assert np.hypot(*shift[liar, :2]) == pytest.approx(20.0, abs=0.01)
        liars.add(liar)
        receiver = lying.receiver[liar]
        if receiver is not None:
            np.testing.assert_allclose(receiver.error_m - honest.receiver[liar].error_m, shift[liar], atol=0.01)
        assert lying.epoch == [0, 0, 0]
    assert liars == {0, 1, 2}


def test_one_vehicles_parameters_change_nothing_of_anothers_flight():
    both = {"d1": VehicleTruth(kind="slam", yaw_deg=180.0), "d2": VehicleTruth(kind="gnss")}
    other = {**both, "d1": VehicleTruth(kind="rtk")}
    one, two = frames(both), frames(other)
    fly(one, 5.0, velocity=(3.0, 0.0, 0.0))
    fly(two, 5.0, velocity=(3.0, 0.0, 0.0))
    np.testing.assert_array_equal(one.origin[1], two.origin[1])
    assert one.origin[0].tolist() != two.origin[0].tolist()


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("localization.vehicles", {"d9": {"kind": "rtk"}}, "no drone 'd9' in the mission; there are d1, d2, d3"),
        ("localization.vehicles", {"d1": {"kind": "rtk", "yaw_deg": 5.0}}, "only slam frames start with any heading"),
        ("localization.vehicles", {"d1": {"kind": "gnss", "events": [{"at_s": 1.0, "turn_deg": 5.0}]}}, "only slam frames turn"),
        (
            "localization.vehicles",
            {"d1": {"kind": "slam", "events": [{"at_s": 2.0}, {"at_s": 1.0}]}},
            "give them in order of at_s",
        ),
        ("mission.datum", None, "d1 has a satellite receiver, but there is no mission.datum"),
        ("localization.vehicles", {}, "give localization.vehicles, one of which is the liar"),
    ],
)
def test_what_cannot_be_is_refused(path, value, message):
    with pytest.raises(ConfigError, match=message):
        override(load_scenario("lying-drone"), {path: value})
