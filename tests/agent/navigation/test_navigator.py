"""The flight around a source with an estimator that states its covariance."""

from __future__ import annotations

from math import dist

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission, EncirclementConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.fusion.estimator import Sight
from radron.agent.navigation.moment import Moment
from radron.agent.navigation.myself import Self
from radron.agent.navigation.navigator import Navigator
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.surveying import InformedSearch, Prospect, Search
from radron.agent.navigation.unheard.crossing import climb_s, crossing_height_m
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Plan, Pose, Stage, Status
from support.flights.one_navigator import AT_ONCE, MISSION, PLACE, flown, hypothesis, made, nobody
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, own_pose, state


def test_what_a_plan_was_made_with_is_known_until_somebody_else_flies():
    navigator, own, frames = made()
    local = frames.mission_from_local("d1", 0).inverse()
    assert navigator.reckoning is None
    vehicle = own.take(state(START_NS, FlightMode.OFFBOARD, local.apply_point((35.0, 25.0, 3.0))))
    peers = Peers(["d2"])
    far = (25.0, 25.0, 3.0)
    there = frames.mission_from_local("d2", 0).inverse().apply_point(far)
    seen = state(START_NS, position=there)
    told = {"position_m": there, "velocity_mps": seen.velocity_mps, "quaternion": seen.quaternion, "epoch": 0}
    peers.receive(Pose(stamp_ns=START_NS, drone="d2", position_sigma_m=0.1, yaw_sigma_rad=0.01, **told), START_NS)
    navigator.step(Moment(START_NS, Stage.TRACK, START_NS, vehicle, hypothesis(START_NS)), peers)
    reckoning = navigator.reckoning
    assert reckoning.distance_m("d2", 0.0, far) == pytest.approx(10.0, abs=0.1)
    assert reckoning.distance_m("d3", 0.0, far) == np.inf
    area = MISSION.area
    assert reckoning.corners_m[:, 0].max() == pytest.approx(max(x for x, _ in area.polygon_m) + area.fence_margin_m, abs=0.5)
    navigator.rest(START_NS + SECOND, peers)
    assert navigator.reckoning is None


@pytest.mark.parametrize("age_s", [0.0, 0.6, 0.9])
def test_a_vehicle_that_is_not_heard_flies_on_towards_the_others(age_s):
    """By telemetry of 0.9 s ago a peer 8 m ahead seemed 4.5 m farther away, and the plan did not brake before it."""
    navigator, own, frames = made()
    local, peers = frames.mission_from_local("d1", 0).inverse(), Peers(["d2"])
    there = frames.mission_from_local("d2", 0).inverse().apply_point((35.0, 33.0, 3.0))
    seen = state(START_NS, position=there)
    told = {"position_m": there, "velocity_mps": (0.0, 0.0, 0.0), "quaternion": seen.quaternion, "epoch": 0}
    assert peers.receive(Pose(stamp_ns=START_NS, drone="d2", position_sigma_m=0.1, yaw_sigma_rad=0.01, **told), START_NS) is None
    velocity, heard_ns = local.rotate_direction((0.0, 5.0, 0.0)), START_NS - round(age_s * SECOND)
    at_then = local.apply_point((35.0, 25.0 - 5.0 * age_s, 3.0))
    vehicle = own.take(replace(state(heard_ns, FlightMode.OFFBOARD, at_then), velocity_mps=velocity))
    navigator.step(Moment(START_NS, Stage.RETURN, START_NS, vehicle, None), peers)
    planned = frames.mission_from_local("d1", 0).apply(navigator.reckoning.planned)
    assert planned[0, :2] == pytest.approx((35.0, 25.0), abs=0.05)
    assert np.hypot(*(planned[:, :2] - (35.0, 33.0)).T).min() > 3.5


@pytest.mark.parametrize(("on_s", "flown_m"), [(1.5, 0.0), (0.9, 0.0), (0.9, 4.0)])
def test_no_setpoint_leaps_ahead_where_the_clock_is_set_on(on_s, flown_m):
    """By 4.5 m at 5 m/s. After as long a gap in which the vehicle has flown its plan it goes on with it."""
    navigator, own, frames = made()
    local, peers = frames.mission_from_local("d1", 0).inverse(), Peers(["d2"])
    velocity, leaps = local.rotate_direction((0.0, 5.0, 0.0)), []
    for tick, way_m in ((0, 0.0), (1, flown_m), (2, flown_m)):
        now_ns = START_NS + tick * TICK_NS + (round(on_s * SECOND) if tick else 0)
        place = local.apply_point((35.0, 25.0 + way_m, 3.0))
        vehicle = own.take(replace(state(now_ns, FlightMode.OFFBOARD, place), velocity_mps=velocity))
        setpoint, _ = navigator.step(Moment(now_ns, Stage.TRACK, START_NS, vehicle, hypothesis(START_NS)), peers)
        leaps.append(dist(setpoint.position_m, place))
    assert max(leaps) < 1.2


def radii(places, centre=PLACE):
    return np.hypot(*(places[:, :2] - np.asarray(centre)[..., :2]).T)


def test_a_source_that_is_known_well_is_encircled_nearly_and_low():
    places = flown(hypothesis)[-200:]
    assert radii(places) == pytest.approx(np.full(200, 5.2), abs=0.1)
    assert places[:, 2] == pytest.approx(np.full(200, 2.3), abs=0.02)


def test_a_source_that_is_known_badly_is_encircled_from_further_away():
    assert np.median(radii(flown(lambda now_ns: hypothesis(now_ns, rms_m=5.0))[-200:])) == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize(
    ("evidence", "encirclement"), [(None, EncirclementConfig()), (20.0, EncirclementConfig(law="paper"))], ids=["paper", "law"]
)
def test_the_baseline_keeps_its_circle(evidence, encirclement):
    mission = replace(MISSION, encirclement=encirclement)
    places = flown(lambda now_ns: hypothesis(now_ns, evidence=evidence), mission=mission)[-200:]
    assert np.median(radii(places)) == pytest.approx(12.0, abs=0.1)
    assert places[:, 2] == pytest.approx(np.full(200, 3.0), abs=0.02)


def test_it_encircles_what_its_own_localisation_sees():
    sight = Sight(np.array([28.0, 25.0, 0.0]), np.diag([0.01, 0.01, 0.0]))
    places = flown(lambda now_ns: hypothesis(now_ns, sights={"d1": sight}))[-210:]  # one round at 3 m/s
    assert places[:, :2].mean(axis=0) == pytest.approx([28.0, 25.0], abs=0.5)


def test_the_centre_of_its_circle_stays_over_a_fast_source():
    """3 m/s, published every half a second and half a second late: without a lead the circle would be 2 m behind."""

    def source(now_ns):
        return np.array([-10.0 + 3.0 * (now_ns - START_NS) / SECOND, 25.0, 0.0])

    def believed(now_ns):
        known_ns = now_ns - now_ns % (SECOND // 2) - SECOND // 2
        return hypothesis(known_ns, velocity=(3.0, 0.0), place=source(known_ns))

    mission = replace(MISSION, area=replace(MISSION.area, fence_margin_m=200.0))
    places = flown(believed, mission=mission)
    late = np.arange(len(places))[-220:]  # one round relative to the source
    relative = places[late, :2] - np.array([source(START_NS + tick * TICK_NS)[:2] for tick in late])
    assert relative.mean(axis=0) == pytest.approx([0.0, 0.0], abs=0.6)
    speeds = np.hypot(*np.diff(places[:, :2], axis=0).T) * SECOND / TICK_NS
    assert speeds[200:].max() < MISSION.limits.speed_mps


def test_what_was_lost_is_encircled_where_the_posterior_is():
    places = flown(lambda now_ns: hypothesis(now_ns, rms_m=18.0), seconds=60.0, stage=Stage.REACQUIRE)
    assert np.median(radii(places[-400:])) == pytest.approx(18.0, abs=0.2)


def test_the_rest_of_a_takeoff_goes_straight_up_whatever_is_known_of_the_source():
    places = flown(hypothesis, seconds=8.0, stage=Stage.TAKEOFF, height_m=1.0)
    assert np.abs(places[:, :2] - (35.0, 25.0)).max() < 0.05
    assert places[-1, 2] == pytest.approx(MISSION.survey.height_m, abs=0.05)


@pytest.mark.parametrize(("missing", "again_s"), [(True, 99.0), (True, 10.0), (False, 99.0)], ids=["gone", "again", "landed"])
def test_who_misses_another_drone_comes_home_in_its_own_layer(missing, again_s):
    """The other one may be on its way home too, and hears as little of this one; or is heard again when this one is over it."""
    peers = Peers(["d2"])
    far = state(START_NS, position=(40.0, 40.0, 3.0))
    placed = {"position_m": far.position_m, "velocity_mps": far.velocity_mps, "quaternion": far.quaternion, "epoch": 0}
    pose = Pose(stamp_ns=START_NS, drone="d2", position_sigma_m=0.1, yaw_sigma_rad=0.01, **placed)
    stage = Stage.TRACK if missing else Stage.LANDED
    status = Status(stamp_ns=START_NS, drone="d2", mission=MISSION.mission_id, boot="1" * 16, stage=stage)
    assert {peers.receive(message, START_NS) for message in (pose, status)} == {None}

    def believed(now_ns: int) -> None:
        if now_ns > START_NS + again_s * SECOND:
            peers.receive(replace(pose, stamp_ns=now_ns), now_ns)

    places = flown(believed, stage=Stage.RETURN, peers=peers, home_m=(10.0, 25.0, 0.0))
    across = places[(places[:, 0] < 27.0) & (places[:, 0] > 12.0)]  # the peer is still heard for a second
    layer_m = MISSION.return_height_m("d1") if missing else MISSION.survey.height_m
    assert len(across) > 50
    assert across[:, 2] == pytest.approx(np.full(len(across), layer_m), abs=1.1)
    assert places[-1] == pytest.approx((10.0, 25.0, MISSION.survey.height_m), abs=0.3)


def test_a_climb_begun_anew_after_a_hold_waits_anew_for_the_climbs_of_others():
    """A drone whose way home was held crossed at once: the wait counted from the first climb."""
    peers, again_s, place = Peers(["d2"]), 25.0, {"position_m": (40.0, 40.0, 3.0), "velocity_mps": (0.0, 0.0, 0.0)}
    told = {"quaternion": (1.0, 0.0, 0.0, 0.0), "position_sigma_m": 0.1, "yaw_sigma_rad": 0.01, "stage": Stage.TRACK}
    assert peers.receive(Pose(stamp_ns=START_NS, drone="d2", epoch=0, **place, **told), START_NS) is None

    def stage(now_ns: int) -> Stage:
        return Stage.HOLD if 3.0 < (now_ns - START_NS) / SECOND < again_s else Stage.RETURN

    places = flown(lambda _: None, again_s + 20.0, stage=stage, peers=peers, home_m=(10.0, 25.0, 0.0))
    after = places[round(again_s * SECOND / TICK_NS) :]
    left_s = np.flatnonzero(np.hypot(*(after - after[0])[:, :2].T) > 1.0)[0] * TICK_NS / SECOND
    wait_s = climb_s(MISSION, "d1")
    assert wait_s - 1.0 < left_s < wait_s + 3.0


def test_who_misses_others_comes_home_around_theirs_in_a_row_before_its_own():
    """The lost peers may land on the row; the drone stopped before it, and hovered until they had to be down."""
    row = tuple(DroneInMission(id=f"d{k}", origin_m=(22.0, y, 0.0)) for k, y in enumerate((13.0, 19.0, 25.0, 31.0, 37.0), 2))
    mission, peers = replace(MISSION, drones=(MISSION.drones[0], *row)), Peers([one.id for one in row])
    for name in peers.names:
        pose = Pose(
            stamp_ns=START_NS,
            drone=name,
            epoch=0,
            position_m=(20.0, 0.0, 3.0),
            velocity_mps=(0.0, 0.0, 0.0),
            quaternion=(1.0, 0.0, 0.0, 0.0),
            position_sigma_m=0.1,
            yaw_sigma_rad=0.01,
        )
        status = Status(stamp_ns=START_NS, drone=name, mission=mission.mission_id, boot="1" * 16, stage=Stage.TRACK)
        assert {peers.receive(message, START_NS) for message in (pose, status)} == {None}
    places = flown(lambda _: None, mission=mission, stage=Stage.RETURN, peers=peers, home_m=(10.0, 25.0, 0.0))
    assert places[-1, :2] == pytest.approx((10.0, 25.0), abs=0.5)
    apart_m = min(np.hypot(*(places[:, :2] - member.origin_m[:2]).T).min() for member in row)
    assert apart_m > mission.limits.separation_m + 1.0


@pytest.mark.parametrize("held_mps", [0.0, 0.4])
def test_who_comes_home_flies_around_two_that_human_pilots_hold_beside_each_other(held_mps):
    """There is no way between the two, 8 m apart; it stopped before them, and landed there after a minute."""
    held = {"d2": (22.0, 21.0, 3.0), "d3": (22.0, 29.0, 3.0)}
    pilots = tuple(DroneInMission(id=name, origin_m=(22.0, y, 0.0)) for name, y in (("d2", 5.0), ("d3", 45.0)))
    mission, peers = replace(MISSION, drones=(MISSION.drones[0], *pilots)), Peers(list(held))
    frames = FrameGraph.from_launch_layout(mission)

    def keep_on(now_ns: int) -> None:
        for name, place in held.items():
            local = frames.mission_from_local(name, 0).inverse().apply_point(place)
            told = {"stamp_ns": now_ns, "drone": name, "epoch": 0}
            if now_ns == START_NS:  # since then under manual override
                assert peers.receive(Plan(**told, step_ns=SECOND, positions_m=(local, local)), now_ns) is None
                status = Status(stamp_ns=now_ns, drone=name, mission=mission.mission_id, boot="1" * 16, stage=Stage.HOLD)
                assert peers.receive(status, now_ns) is None
            sway_mps = held_mps * np.cos((now_ns - START_NS) / SECOND)
            pose = Pose(
                **told,
                position_m=local,
                velocity_mps=(0.0, sway_mps, 0.0),
                quaternion=(1.0, 0.0, 0.0, 0.0),
                position_sigma_m=0.1,
                yaw_sigma_rad=0.01,
                steered=False,
            )
            assert peers.receive(pose, now_ns) is None

    places = flown(keep_on, mission=mission, stage=Stage.RETURN, peers=peers, home_m=(10.0, 25.0, 0.0))
    assert places[-1, :2] == pytest.approx((10.0, 25.0), abs=0.5)
    apart_m = min(np.hypot(*(places[:, :2] - place[:2]).T).min() for place in held.values())
    assert apart_m > mission.limits.separation_m + 1.0


def test_the_place_on_the_circle_that_is_kept_for_one_that_is_not_heard_is_reckoned_with():
    """The peer was heard at the other end of the circle, at 3 m/s; a second later its link is lost, after another second it
    stands, as its vehicle may hover.
    """
    navigator, own, frames = made()
    local, theirs = (frames.mission_from_local(name, 0).inverse() for name in ("d1", "d2"))
    vehicle_at, peers = local.apply_point((30.0, 25.0, 3.0)), Peers(["d2"])
    for now_ns in range(START_NS, START_NS + 3 * SECOND + 1, SECOND // 5):
        told = {"stamp_ns": now_ns, "drone": "d2"}
        at = {
            "position_m": theirs.apply_point((20.0, 25.0, 3.0)),
            "velocity_mps": (0.0, -3.0, 0.0),
            "quaternion": (1.0, 0.0, 0.0, 0.0),
        }
        status = Status(**told, mission=MISSION.mission_id, boot="1" * 16, stage=Stage.TRACK)
        for message in (Pose(**told, **at, epoch=0, position_sigma_m=0.1, yaw_sigma_rad=0.01), status):
            assert now_ns > START_NS + SECOND // 5 or peers.receive(message, now_ns) is None
        vehicle = own.take(state(now_ns, FlightMode.OFFBOARD, vehicle_at))
        navigator.step(Moment(now_ns, Stage.TRACK, START_NS, vehicle, hypothesis(now_ns)), peers)
    (kept,) = navigator.reckoning.divided
    assert kept.id == "d2"
    x, y = frames.mission_from_local("d1", 0).apply_point((*kept.at(now_ns), 3.0))[:2]
    assert np.arctan2(25.0 - y, 25.0 - x) == pytest.approx(np.arctan2(6.0, 5.0), abs=0.05)
    assert navigator.reckoning.distance_m("d2", 0.0, (x, y, 3.0)) < 11.0


def test_the_circle_of_a_drone_that_misses_another_has_room_again_when_its_centre_moves_into_the_fence():
    """The drone stops near the fence, and circles on when the source is elsewhere: having once been too near is no reason to
    return.
    """
    navigator, own, frames = made(replace(MISSION, area=replace(MISSION.area, fence_margin_m=5.0)))
    x_max = max(x for x, _ in MISSION.area.polygon_m)
    peers, position = Peers(["d2"]), frames.mission_from_local("d1", 0).inverse().apply_point((35.0, 25.0, 3.0))
    far = state(START_NS, position=(10.0, 10.0, 3.0))
    placed = {"position_m": far.position_m, "velocity_mps": far.velocity_mps, "quaternion": far.quaternion, "epoch": 0}
    status = Status(stamp_ns=START_NS, drone="d2", mission=MISSION.mission_id, boot="1" * 16, stage=Stage.TRACK)
    for message in (Pose(stamp_ns=START_NS, drone="d2", position_sigma_m=0.1, yaw_sigma_rad=0.01, **placed), status):
        assert peers.receive(message, START_NS) is None
    rooms = []
    for tick, x in enumerate((x_max - 25.0, x_max, x_max, x_max - 25.0)):
        now_ns = START_NS + (tick + 1) * 2 * SECOND
        vehicle = own.take(state(now_ns, FlightMode.OFFBOARD, position))
        believed = hypothesis(now_ns, evidence=None, place=(x, 25.0, 0.0))
        navigator.step(Moment(now_ns, Stage.TRACK, START_NS, vehicle, believed), peers)
        rooms.append(navigator.has_room)
    assert rooms == [True, False, False, True]


def test_who_has_to_stay_stops_ahead_of_itself_and_does_not_fly_back():
    """At 6 m/s; the drone flew back by 5 m to where it had begun to brake, against the drones behind it."""
    navigator, own, frames = made()
    local = frames.mission_from_local("d1", 0).inverse()
    position, velocity, travelled = local.apply_point((20.0, 25.0, 3.0)), local.rotate_direction((6.0, 0.0, 0.0)), []
    for tick in range(round(8.0 * SECOND / TICK_NS)):
        now_ns = START_NS + tick * TICK_NS
        seen = replace(state(now_ns, FlightMode.OFFBOARD, position), velocity_mps=velocity, position_trusted=False)
        setpoint, _ = navigator.step(Moment(now_ns, Stage.TRACK, START_NS, own.take(seen), hypothesis(now_ns)), Peers([]))
        position, velocity = setpoint.position_m, setpoint.velocity_mps
        travelled.append(frames.mission_from_local("d1", 0).apply_point(position)[0] - 20.0)
    assert max(travelled) < 8.0
    assert max(travelled) - travelled[-1] < 1.0


def flown_in(frame_at, seconds: float = 40.0):
    """The way (T, 2) in the mission frame, by its newest transform, around a source near the fence, 10 m from the area at x = 50.

    frame_at: mission from local, by the time since the start in s.
    """
    mission = replace(MISSION, area=replace(MISSION.area, fence_margin_m=10.0))
    frames = FrameGraph()
    frames.place("d1", 0, frame_at(0.0))
    search, informed = Search(mission, "d1", frames), InformedSearch(mission, Prospect(lambda: None))
    own = own_pose("d1", frames)
    navigator = Navigator(mission, AT_ONCE, own, frames, search, informed, nobody)
    position, velocity, places = frame_at(0.0).inverse().apply_point((35.0, 25.0, 3.0)), (0.0, 0.0, 0.0), []
    for tick in range(round(seconds * SECOND / TICK_NS)):
        now_ns, newest = START_NS + tick * TICK_NS, frame_at(tick * TICK_NS / SECOND)
        if newest is not frames.mission_from_local("d1", 0):
            frames.place("d1", 0, newest)
        vehicle = own.take(replace(state(now_ns, FlightMode.OFFBOARD, position), velocity_mps=velocity))
        believed = hypothesis(now_ns, rms_m=6.0, place=(54.0, 25.0, 0.0))
        setpoint, _ = navigator.step(Moment(now_ns, Stage.TRACK, START_NS, vehicle, believed), Peers([]))
        position, velocity = setpoint.position_m, setpoint.velocity_mps
        places.append(newest.apply_point(position)[:2])
    return np.array(places)


SURE = Transform(0.3, (5.0, 5.0, 0.0), np.diag([1e-4, 1e-4, 1e-4, 1e-8]))
UNSURE = Transform(0.3, (5.0, 5.0, 0.0), np.diag([2.0, 2.0, 0.1, 1e-8]))  # 2 m
SHIFTED = Transform(0.3, (12.0, 5.0, 0.0), SURE.covariance)


def test_the_fence_is_nearer_for_a_drone_that_knows_less_of_where_it_is():
    assert flown_in(lambda _: SURE)[:, 0].max() == pytest.approx(60.0 - 1.5, abs=0.5)
    assert flown_in(lambda _: UNSURE)[:, 0].max() == pytest.approx(60.0 - 2 * 2.0 - 1.5, abs=0.5)


def test_the_fence_stays_in_the_mission_frame_when_the_own_frame_is_corrected():
    """By 7 m towards the fence, in the midst of the flight: the drone comes back, and flies along the same fence again."""
    east = flown_in(lambda time_s: SURE if time_s < 30.0 else SHIFTED, seconds=60.0)[:, 0]
    assert east[:600].max() == pytest.approx(60.0 - 1.5, abs=0.5)
    assert east[700:].max() == pytest.approx(60.0 - 1.5, abs=0.5)


def test_small_corrections_of_the_own_frame_do_not_shake_the_flight():
    """0.2 m to and fro each second: setpoints move on as smoothly as without, within the vehicle's limits."""
    other = Transform(0.3, (5.2, 5.0, 0.0), SURE.covariance)
    places = flown_in(lambda time_s: other if int(time_s) % 2 else SURE)
    local = [other.inverse() if int(tick * 0.05) % 2 else SURE.inverse() for tick in range(len(places))]
    told = np.array([frame.apply_point((x, y, 0.0))[:2] for frame, (x, y) in zip(local, places, strict=True)])
    speeds = np.hypot(*np.diff(told, axis=0).T) * SECOND / TICK_NS
    assert np.abs(np.diff(speeds)).max() < 0.4  # m/s from tick to tick: 8 m/s2; a setpoint that jumped by 0.2 m would show 4


@pytest.mark.parametrize(("taken_s", "least_s"), [(5.0, 5.0), (0.0, 2.0)], ids=["taken over", "refused"])
def test_a_vehicle_that_somebody_else_flies_publishes_no_plan_and_would_go_on_from_where_it_is(taken_s, least_s):
    """After 5 s in offboard the pilot stops the vehicle, or it never gets there."""
    navigator, own, frames = made()
    position, velocity = frames.mission_from_local("d1", 0).inverse().apply_point((35.0, 25.0, 3.0)), (0.0, 0.0, 0.0)
    published, apart_m = [], []
    for tick in range(round(10.0 * SECOND / TICK_NS)):
        now_ns, follows = START_NS + tick * TICK_NS, tick * TICK_NS < taken_s * SECOND
        mode = FlightMode.OFFBOARD if follows else FlightMode.HOLD
        vehicle = own.take(replace(state(now_ns, mode, position), velocity_mps=velocity))
        setpoint, plan = navigator.step(Moment(now_ns, Stage.TRACK, START_NS, vehicle, hypothesis(now_ns)), Peers([]))
        published += [tick * TICK_NS / SECOND] if plan is not None else []
        apart_m.append(np.hypot(*np.subtract(setpoint.position_m, position)[:2]))
        position, velocity = (setpoint.position_m, setpoint.velocity_mps) if follows else (position, (0.0, 0.0, 0.0))
    assert least_s - 0.3 < max(published) < least_s + 0.05
    assert max(apart_m[-100:]) < 0.5


def test_jumps_of_the_others_are_bridged_while_it_plans_nothing_itself():
    """The drone holds for 3 s, while the peer's localisation jumps by 10 m and both fly on at 2 m/s."""
    navigator, own, frames = made()
    peers, hold_s = Peers(["d2"]), 3.0
    launch = frames.mission_from_local("d2", 0)
    for tick in range(round(hold_s * SECOND / TICK_NS)):
        now_ns, elapsed_s = START_NS + tick * TICK_NS, tick * TICK_NS / SECOND
        x, epoch = (2.0 * elapsed_s, 0) if elapsed_s < 1.0 else (10.0 + 2.0 - 2.0 * (elapsed_s - 1.0), 1)  # and turns back
        velocity_mps = (2.0 if epoch == 0 else -2.0, 0.0, 0.0)
        here = state(now_ns, FlightMode.HOLD, (x, 0.0, 3.0))
        peers.receive(
            Pose(
                stamp_ns=now_ns,
                drone="d2",
                epoch=epoch,
                position_m=here.position_m,
                velocity_mps=velocity_mps,
                quaternion=here.quaternion,
                position_sigma_m=0.1,
                yaw_sigma_rad=0.01,
            ),
            now_ns,
        )
        navigator.rest(now_ns, peers)
    own.take(state(now_ns, FlightMode.HOLD, (0.0, 0.0, 3.0)))
    me = Self(now_ns, 0, 0.1, own.frame.local_from_mission)
    (other,) = navigator._neighbourhood.around(peers, me)
    true = own.frame.local_from_mission.apply_point(launch.apply_point((x - 10.0, 0.0, 3.0)))
    assert np.hypot(*np.subtract(other.plan.positions[0], true)[:2]) < 1.0


def test_one_that_is_restarted_without_its_log_climbs_and_searches_above_those_that_circled_with_it():
    """Two drones descended from there to search, each at the other's place on the circle: 1.2 m."""
    heard_ns, peers = START_NS - 3 * SECOND, Peers(["d2"])
    where = {"position_m": (0.0, 0.0, 3.0), "velocity_mps": (0.0, 0.0, 0.0), "quaternion": (1.0, 0.0, 0.0, 0.0)}
    pose = Pose(stamp_ns=heard_ns, drone="d2", epoch=0, position_sigma_m=0.1, yaw_sigma_rad=0.01, stage=Stage.TRACK, **where)
    peers["d2"].recall(pose)
    places = flown(lambda _: None, 120.0, stage=Stage.SURVEY, peers=peers)
    over_m = crossing_height_m(MISSION, "d1")
    low = places[places[:, 2] < over_m - 1.5]
    assert np.hypot(*(low[:, :2] - (35.0, 25.0)).T).max() < 1.0
    assert places[-600:, 2] == pytest.approx(np.full(600, over_m), abs=0.2)  # as long as no peer is heard
    assert np.ptp(places[-600:, :2], axis=0).max() > 20.0
