"""The MPC tracker alone."""

from __future__ import annotations

from math import exp, hypot

import numpy as np
import pytest
import shapely
from shapely.ops import nearest_points

from radron.agent.config.drone import ResponseConfig
from radron.agent.config.mission import LimitsConfig
from radron.agent.motion.fence import Fence
from radron.agent.motion.prediction import predict
from radron.agent.motion.qp import LimitedProblem
from radron.agent.motion.reference import PeerState, Reference
from radron.agent.motion.separation import PeerPlan
from radron.agent.motion.tracker import Status, Tracker, TrackerPlan

LIMITS = LimitsConfig()
WIDE = Fence(shapely.box(-500.0, -500.0, 500.0, 500.0), 1.5, 60.0)
STEP_NS = 200_000_000
UP = np.array([0.0, 0.0, 3.0])


def stay(x: float, y: float, z: float = 3.0) -> Reference:
    return Reference(np.tile([x, y, z], (31, 1)), np.zeros((31, 3)), 0.2)


def follow(
    tracker: Tracker, references: list[Reference], start: tuple[float, float, float] = (0.0, 0.0, 3.0)
) -> list[TrackerPlan]:
    """Plans of a vehicle that follows perfectly."""
    state, plans = PeerState(start), []
    for step, reference in enumerate(references):
        plans.append(tracker.plan(step * STEP_NS, state, reference))
        state = tracker.state((step + 1) * STEP_NS)
    return plans


def test_jumping_references_never_break_the_limits() -> None:
    rng = np.random.default_rng(0)
    references = [stay(*goal) for goal in rng.uniform((-60, -60, 2), (60, 60, 30), (5, 3)).tolist() for _ in range(70)]
    plans = follow(Tracker(LIMITS, WIDE), references)
    assert {plan.status for plan in plans} == {Status.FREE, Status.CONSTRAINED}
    speeds = [np.hypot(plan.velocities[:, 0], plan.velocities[:, 1]).max() for plan in plans]
    pulls = [np.hypot(plan.accelerations[:, 0], plan.accelerations[:, 1]).max() for plan in plans]
    jerks = [np.abs(np.diff(plan.accelerations[:, :2], axis=0)).max() / 0.2 for plan in plans]
    climbs = [np.abs(plan.velocities[:, 2]).max() for plan in plans]
    assert max(speeds) < 1.01 * LIMITS.speed_mps
    assert max(pulls) < 1.01 * LIMITS.acceleration_mps2
    assert max(jerks) < 1.001 * LIMITS.jerk_mps3
    assert max(climbs) < 1.02 * LIMITS.climb_mps
    assert max(speeds) > 0.9 * LIMITS.speed_mps  # and they are made use of
    assert max(pulls) > 0.9 * LIMITS.acceleration_mps2


def test_the_plan_arrives() -> None:
    plans = follow(Tracker(LIMITS, WIDE), [stay(30.0, -20.0, 10.0)] * 60)
    assert plans[-1].positions[0] == pytest.approx((30.0, -20.0, 10.0), abs=0.05)
    assert plans[-1].status is Status.FREE


def test_without_active_limits_osqp_agrees_with_the_matrix_product() -> None:
    prediction = predict(20, 0.2)
    problem = LimitedProblem(prediction, 0.2, 2, (1e3, 1e3, 1e3), 3)
    wanted = np.random.default_rng(1).normal(0.0, 2.0, (42, 2))
    optimum = (prediction.optimum @ wanted).reshape(4, 20, 2)
    start = np.array([(0.0, 0.0), wanted[0], wanted[1]])
    found = problem.solve(start, optimum, None, np.zeros((20, 2)))
    assert found is not None
    assert found == pytest.approx(optimum[0], abs=0.05)


def test_the_matrix_product_minimises_the_cost() -> None:
    prediction, rng = predict(10, 0.2), np.random.default_rng(2)
    data = rng.normal(0.0, 2.0, (22, 1))
    jerk = (prediction.optimum @ data)[:10]

    def cost(u: np.ndarray) -> float:
        free = prediction.free.reshape(3, 10, 2) @ data[:2]
        position = free[0] + prediction.position @ u - data[2:12]
        velocity = free[1] + prediction.velocity @ u - data[12:]
        return float((position**2).sum() + 0.3 * (velocity**2).sum() + 0.05 * (u**2).sum())

    best = cost(jerk)
    assert all(cost(jerk + 0.01 * rng.normal(0.0, 1.0, (10, 1))) > best for _ in range(50))


def test_samples_are_continuous_and_ahead_by_the_dead_time() -> None:
    reference = Reference(np.outer(0.2 * np.arange(31), (3.0, 0.0, 0.0)) + UP, np.tile([3.0, 0.0, 0.0], (31, 1)), 0.2)
    tracker = Tracker(LIMITS, WIDE, response=ResponseConfig(lag_s=0.4, drag_ps=0.0))
    tracker.reset((0.0, 0.0, 3.0), (3.0, 0.0, 0.0))
    tracker.plan(0, PeerState((0.0, 0.0, 3.0), (3.0, 0.0, 0.0)), reference)
    position, velocity, acceleration = tracker.sample(1_000_000_000)
    assert position == pytest.approx((3.0 * 1.4, 0.0, 3.0))
    assert velocity == pytest.approx((3.0, 0.0, 0.0))
    assert acceleration == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    tracker.plan(STEP_NS, PeerState((0.6, 0.0, 3.0)), stay(5.0, 7.0))
    path = np.array([tracker.sample(STEP_NS + k * 10_000_000)[0] for k in range(300)])
    assert np.abs(np.diff(path, axis=0)).max() < 0.15


def test_a_replan_continues_where_the_plan_before_it_is() -> None:
    tracker = Tracker(LIMITS, WIDE)
    tracker.plan(0, PeerState((0.0, 0.0, 3.0)), stay(20.0, 0.0))
    before = tracker.sample(1_130_000_000)[0]
    expected = tracker.state(1_130_000_000)
    plan = tracker.plan(1_130_000_000, PeerState(expected.position), stay(20.0, 0.0))
    assert plan.positions[0] == pytest.approx(expected.position)
    assert plan.velocities[0] == pytest.approx(expected.velocity)
    assert tracker.sample(1_130_000_000)[0] == pytest.approx(before, abs=0.05)


def test_an_old_plan_ends_in_a_standstill() -> None:
    tracker = Tracker(LIMITS, WIDE)
    plan = tracker.plan(0, PeerState((0.0, 0.0, 3.0)), stay(20.0, 0.0))
    position, velocity, _ = tracker.sample(60_000_000_000)
    assert position == pytest.approx(plan.positions[-1])
    assert velocity == (0.0, 0.0, 0.0)


def test_a_vehicle_that_is_elsewhere_or_a_reset_begins_anew() -> None:
    tracker = Tracker(LIMITS, WIDE)
    tracker.plan(0, PeerState((0.0, 0.0, 3.0)), stay(1.0, 0.0))
    near = tracker.plan(STEP_NS, PeerState((1.0, 1.0, 3.0)), stay(1.0, 0.0))
    assert near.positions[0] == pytest.approx((0.0, 0.0, 3.0), abs=0.1)
    far = tracker.plan(2 * STEP_NS, PeerState((10.0, 5.0, 3.0), (1.0, 0.0, 0.0)), stay(1.0, 0.0))
    assert far.positions[0] == pytest.approx((10.0, 5.0, 3.0))
    assert far.velocities[0] == pytest.approx((1.0, 0.0, 0.0))
    tracker.reset((4.0, 4.0, 4.0))
    assert tracker.plan(3 * STEP_NS, PeerState((4.1, 4.0, 4.0)), stay(1.0, 0.0)).positions[0] == pytest.approx((4.0, 4.0, 4.0))


def test_there_is_nothing_to_sample_before_the_first_plan() -> None:
    with pytest.raises(RuntimeError, match=r"call plan\(\) first"):
        Tracker(LIMITS, WIDE).sample(0)


def test_a_vehicle_beyond_its_limits_is_brought_back() -> None:
    tracker = Tracker(LIMITS, WIDE)
    plan = tracker.plan(0, PeerState((0.0, 0.0, 3.0), (14.0, 0.0, 0.0)), stay(40.0, 0.0))
    assert plan.status is Status.CONSTRAINED
    speeds = np.hypot(plan.velocities[:, 0], plan.velocities[:, 1])
    assert speeds.max() < 14.2
    assert speeds[-1] < LIMITS.speed_mps
    assert np.hypot(plan.accelerations[:, 0], plan.accelerations[:, 1]).max() < 1.01 * LIMITS.acceleration_mps2


@pytest.mark.parametrize(
    ("outline", "goal"),
    [
        (shapely.box(-20.0, -20.0, 20.0, 20.0), (60.0, 25.0)),
        (shapely.Polygon([(-20, -20), (40, -20), (40, 5), (10, 5), (10, 40), (-20, 40)]), (35.0, 35.0)),
    ],
)
def test_the_fence_holds_against_references_beyond_it(outline: shapely.Polygon, goal: tuple[float, float]) -> None:
    plans = follow(Tracker(LIMITS, Fence(outline, 1.5, 60.0)), [stay(*goal)] * 50)
    flown = np.array([plan.positions[0] for plan in plans])
    assert all(outline.contains(shapely.Point(x, y)) for x, y, _ in flown.tolist())
    nearest = nearest_points(outline, shapely.Point(goal))[0]
    assert hypot(flown[-1, 0] - nearest.x, flown[-1, 1] - nearest.y) < 25.0
    assert np.hypot(*plans[-1].velocities[0, :2]) < 0.5  # at rest inside


def test_floor_and_ceiling_hold() -> None:
    up = follow(Tracker(LIMITS, WIDE), [stay(0.0, 0.0, 90.0)] * 200)
    assert up[-1].positions[0, 2] == pytest.approx(59.5, abs=0.1)
    assert max(plan.positions[:, 2].max() for plan in up) < 60.05
    down = follow(Tracker(LIMITS, WIDE), [stay(0.0, 0.0, -5.0)] * 60, start=(0.0, 0.0, 20.0))
    assert min(plan.positions[:, 2].min() for plan in down) > 1.45


def test_a_standing_peer_in_the_way_is_flown_around() -> None:
    tracker, state, closest = Tracker(LIMITS, WIDE, drone_id="b"), PeerState((0.0, 0.0, 3.0)), 1e9
    for step in range(60):
        there = PeerState((15.0, 0.0, 3.0))
        peer = PeerPlan("a", step * STEP_NS, 0.2, [(15.0, 0.0, 3.0)] * 21, 0.1, there)
        tracker.plan(step * STEP_NS, state, stay(30.0, 0.0), [peer])
        state = tracker.state((step + 1) * STEP_NS)
        closest = min(closest, hypot(state.position[0] - 15.0, state.position[1]))
    assert closest > LIMITS.separation_m + 1.0
    assert state.position == pytest.approx((30.0, 0.0, 3.0), abs=0.3)


def test_without_an_answer_of_the_solver_the_drone_brakes_within_its_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    tracker = Tracker(LIMITS, WIDE)
    tracker.reset((0.0, 0.0, 3.0), (6.0, 2.0, 0.0))
    monkeypatch.setattr(LimitedProblem, "solve", lambda *_: None)
    plan = tracker.plan(0, PeerState((0.0, 0.0, 3.0), (6.0, 2.0, 0.0)), stay(-60.0, 0.0))
    assert plan.status is Status.BRAKING
    assert np.hypot(*plan.velocities[-1, :2]) < 0.2
    assert np.hypot(plan.accelerations[:, 0], plan.accelerations[:, 1]).max() <= 1.001 * LIMITS.acceleration_mps2
    assert plan.positions[-1, 0] > 0.0


def test_a_drone_that_shoots_at_another_is_stopped() -> None:
    tracker = Tracker(LIMITS, WIDE, drone_id="b")
    mine, theirs = PeerState((0.0, 0.0, 3.0), (7.0, 0.0, 0.0)), PeerState((7.0, 0.0, 3.0))
    tracker.reset(mine.position, mine.velocity)
    plan = tracker.plan(0, mine, stay(30.0, 0.0), [PeerPlan("a", 0, 0.2, [(7.0, 0.0, 3.0)] * 21, 0.1, theirs)])
    assert plan.status is Status.ESCAPING
    assert plan.velocities[-1, 0] < -1.0
    assert np.hypot(plan.accelerations[:, 0], plan.accelerations[:, 1]).max() <= 1.001 * LIMITS.acceleration_mps2


def test_the_same_inputs_give_the_same_plans_bit_for_bit() -> None:
    rng = np.random.default_rng(3)
    references = [stay(*goal) for goal in rng.uniform((-40, -40, 2), (40, 40, 20), (20, 3)).tolist() for _ in range(3)]
    first, second = follow(Tracker(LIMITS, WIDE), references), follow(Tracker(LIMITS, WIDE), references)
    assert all(np.array_equal(a.positions, b.positions) for a, b in zip(first, second, strict=True))


def test_a_reference_with_other_steps_is_resampled() -> None:
    times = 0.5 * np.arange(5.0)
    coarse = Reference(np.outer(times, (2.0, 0.0, 0.0)) + UP, np.tile([2.0, 0.0, 0.0], (5, 1)), 0.5)
    tracker = Tracker(LIMITS, WIDE)
    tracker.reset((0.0, 0.0, 3.0), (2.0, 0.0, 0.0))
    plan = tracker.plan(0, PeerState((0.0, 0.0, 3.0), (2.0, 0.0, 0.0)), coarse)
    assert plan.positions[:, 0] == pytest.approx(2.0 * 0.2 * np.arange(21.0), abs=1e-6)


def test_between_a_drone_that_is_heard_and_one_that_is_not_it_keeps_clear_of_the_former_first() -> None:
    """Both have the right of way and are too near: 5 m are wanted of each, and there are 8.5 m between them."""
    heard = PeerPlan("a", 0, 0.2, [(-4.0, 0.0, 3.0)] * 2, measured=PeerState((-4.0, 0.0, 3.0)))
    unheard = PeerPlan("b", 0, 0.2, [(4.5, 0.0, 3.0)] * 2, blind=True)
    tracker = Tracker(LIMITS, WIDE, drone_id="m")
    tracker.reset((0.0, 0.0, 3.0))
    made = tracker.plan(0, PeerState((0.0, 0.0, 3.0)), stay(0.0, 0.0), [heard, unheard])
    x, y, _ = made.positions[-1].tolist()
    assert hypot(x + 4.0, y) > hypot(x - 4.5, y) + 0.3


def test_who_catches_up_with_its_place_on_the_circle_does_not_cut_short_around_one_whose_place_is_doubtful() -> None:
    """10.5 m are wanted of it, and there is room; 7.4 m were left (2.3 m between two vehicles, mission 1250032)."""
    tracker, state, apart_m = Tracker(LIMITS, WIDE, drone_id="m"), PeerState((-12.0, 8.0, 3.0), (-1.0, -2.5, 0.0)), []
    tracker.reset(state.position, state.velocity)
    for step in range(40):
        angles = np.pi + 0.9 + (3.1 / 12.8) * 0.2 * (step + np.arange(31.0))
        along = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(31)))
        places, speeds = np.array((-3.0, 8.0, 3.0)) + 12.8 * along, 3.1 * along[:, [1, 0, 2]] * (-1.0, 1.0, 0.0)
        doubtful = PeerPlan("a", step * STEP_NS, 0.2, [(-6.6, 0.7, 3.0)] * 2, 2.75, blind=True)
        tracker.plan(step * STEP_NS, state, Reference(places, speeds, 0.2), [doubtful])
        state = tracker.state((step + 1) * STEP_NS)
        apart_m.append(hypot(state.position[0] + 6.6, state.position[1] - 0.7))
    assert min(apart_m) > 8.5


def test_a_vehicle_that_returns_to_its_plan_as_slowly_as_vehicles_do_passes_at_the_whole_distance() -> None:
    """The vehicle flies 1.6 m beside its plan, on the side of a hovering drone, of which plans keep 5 m clear."""
    tracker, apart_m = Tracker(LIMITS, WIDE, drone_id="m"), []
    tracker.reset((0.0, 0.0, 3.0), (6.0, 0.0, 0.0))
    state, ahead = PeerState((0.0, 0.0, 3.0), (6.0, 0.0, 0.0)), np.outer(6.0 * 0.2 * np.arange(31.0), (1.0, 0.0, 0.0))
    for step in range(25):
        now_s = 0.2 * step
        (x, y, z), velocity = state.position, state.velocity
        vehicle = PeerState((x, y - 1.6 * exp(-((now_s / 3.4) ** 2)), z), velocity)
        straight = Reference(ahead + np.array((6.0 * now_s, 0.0, 3.0)), np.tile([6.0, 0.0, 0.0], (31, 1)), 0.2)
        hovers = PeerPlan.from_pose("a", step * STEP_NS, PeerState((12.0, -5.0, 3.0)))
        tracker.plan(step * STEP_NS, vehicle, straight, [hovers])
        state = tracker.state((step + 1) * STEP_NS)
        apart_m.append(hypot(vehicle.position[0] - 12.0, vehicle.position[1] + 5.0))
    assert 5.0 < min(apart_m) < 5.5


def test_a_drone_whose_place_is_doubtful_does_not_push_it_into_one_whose_place_is_sure() -> None:
    """9.6 m are wanted of the former, and not to be had; the latter, at 6 m, lost as much of the 4.2 that are wanted of it."""
    tracker, state, apart_m = Tracker(LIMITS, WIDE, drone_id="a"), PeerState((0.0, 0.0, 3.0)), []
    for step in range(30):
        now_ns = step * STEP_NS
        doubtful = PeerPlan.from_pose("b", now_ns, PeerState((-4.5, 0.0, 3.0)), sigma_m=2.3, doubt_m=1.0)
        sure = PeerPlan.from_pose("c", now_ns, PeerState((6.0, 0.0, 3.0)))
        tracker.plan(now_ns, state, stay(0.0, 0.0), [doubtful, sure])
        state = tracker.state(now_ns + STEP_NS)
        apart_m.append(hypot(state.position[0] - 6.0, state.position[1]))
    assert min(apart_m) > LIMITS.separation_m
    assert hypot(state.position[0] + 4.5, state.position[1]) > 8.0  # in the end farther from the uncertain neighbour, too


def test_pushed_aside_by_a_line_a_drone_keeps_clear_of_one_that_is_far_from_its_unconstrained_way() -> None:
    """Drawn across the line, the drone slides along it, where the other hovers, and planned for seconds to end beside the
    other.
    """
    tracker, state, clear_m = Tracker(LIMITS, WIDE, drone_id="b"), PeerState((0.0, 0.0, 3.0)), []
    tracker.reset(state.position)
    for step in range(30):
        now_ns = step * STEP_NS
        line = [(x, 5.0, 3.0) for x, _, _ in tracker.ahead(now_ns, state.position).tolist()]
        others = [
            PeerPlan("c", now_ns, 0.2, line, blind=True, away=np.tile((0.0, -1.0), (21, 1))),
            PeerPlan.from_pose("a", now_ns, PeerState((18.0, 0.0, 3.0))),
        ]
        plan = tracker.plan(now_ns, state, stay(20.0, 30.0), others)
        state = tracker.state(now_ns + STEP_NS)
        clear_m.append(float(np.hypot(plan.positions[:, 0] - 18.0, plan.positions[:, 1]).min()))
    assert clear_m[0] < LIMITS.separation_m  # before it knows where it is pushed to
    assert min(clear_m[1:]) > LIMITS.separation_m


def test_pushed_on_by_three_who_come_behind_it_a_drone_keeps_clear_of_the_one_ahead() -> None:
    """Its way home leads back through the three, which take all half-planes of a step: it planned to end 4 m from the fourth."""
    tracker, state, clear_m = Tracker(LIMITS, WIDE, drone_id="e"), PeerState((0.0, 0.0, 3.0), (0.0, 2.0, 0.0)), []
    tracker.reset(state.position, state.velocity)
    ahead = PeerPlan.from_pose("d", 0, PeerState((1.0, 14.0, 3.0)), sigma_m=1.5, doubt_m=1.0)
    for step in range(12):
        now_ns, y = step * STEP_NS, -6.0 + 0.4 * step
        behind = [
            PeerPlan.from_pose(name, now_ns, PeerState((x, y, 3.0), (0.0, 2.0, 0.0)), sigma_m=0.3, doubt_m=0.6)
            for name, x in (("a", -4.0), ("b", 0.0), ("c", 4.0))
        ]
        plan = tracker.plan(now_ns, state, stay(0.0, -10.0), [*behind, ahead])
        state = tracker.state(now_ns + STEP_NS)
        clear_m.append(float(np.hypot(plan.positions[:, 0] - 1.0, plan.positions[:, 1] - 14.0).min()))
    assert min(clear_m) > LIMITS.separation_m + 2.0 * ahead.sigma_m


@pytest.mark.parametrize("sigma_m", [1.7, 5.0])
def test_between_two_lines_without_room_for_both_distances_a_drone_goes_on_along_its_reference(sigma_m: float) -> None:
    """The lines are 13 m apart, and farther by 7 cm in a metre ahead: it flew there, with 7.4 m/s, and through the fence."""
    fence = Fence(shapely.box(-200.0, -20.0, 200.0, 58.0), 1.5, 60.0)
    tracker, state, farthest_m = Tracker(LIMITS, fence, drone_id="d4"), PeerState((0.0, 9.0, 3.0), (-2.0, 3.0, 0.0)), 0.0
    tracker.reset(state.position, state.velocity)
    for step in range(60):
        now_ns = step * STEP_NS
        ahead = [state.position[1]] * 21
        if tracker.has_plan:
            ahead = [tracker.state(now_ns + k * STEP_NS).position[1] for k in range(21)]
        lines = []
        for name, x, slope in (("d3", -6.0, 0.03), ("d5", 7.0, 0.04)):
            away = np.array([1.0, -slope]) if x < 0.0 else np.array([-1.0, slope])
            places = [(x + slope * (y - 9.0), y, 3.0) for y in ahead]
            lines.append(PeerPlan(name, now_ns, 0.2, places, sigma_m, blind=True, away=np.tile(away, (21, 1))))
        y = np.minimum(state.position[1] + 0.6 * np.arange(31.0), 37.0)
        moving = np.where(y < 37.0, 3.0, 0.0)
        along = Reference(np.column_stack((0.0 * y, y, 0.0 * y + 3.0)), np.column_stack((0.0 * y, moving, 0.0 * y)), 0.2)
        tracker.plan(now_ns, state, along, lines)
        state = tracker.state(now_ns + STEP_NS)
        farthest_m = max(farthest_m, state.position[1])
    assert farthest_m == pytest.approx(37.0, abs=0.3)
    assert -6.0 + LIMITS.separation_m < state.position[0] < 7.0 - LIMITS.separation_m


def test_pushed_out_of_the_circle_of_others_a_drone_brakes_in_time_before_the_fence() -> None:
    """A drone with its link lost may be anywhere on the circle; the reference lies inside, far from the fence."""
    fence = Fence(shapely.box(-20.5, -200.0, 200.0, 200.0), 1.5, 60.0)
    tracker, state, clearances = Tracker(LIMITS, fence, drone_id="d1"), PeerState((-6.0, -1.0, 3.0), (-0.7, -2.4, 0.0)), []
    tracker.reset(state.position, state.velocity)
    ahead = np.tile(state.position[:2], (21, 1))
    for step in range(60):
        outward = ahead / np.hypot(*ahead.T)[:, None]
        circle = [(x, y, 3.0) for x, y in (12.8 * outward).tolist()]
        now_ns = step * STEP_NS
        tracker.plan(now_ns, state, stay(-8.0, 2.0), [PeerPlan("d2", now_ns, 0.2, circle, blind=True, away=outward)])
        state = tracker.state(now_ns + STEP_NS)
        ahead = np.array([tracker.state(now_ns + (k + 1) * STEP_NS).position[:2] for k in range(21)])
        clearances.append(fence.clearance(*state.position[:2]))
    assert min(clearances) > 0.75  # half of the margin that plans keep: fence and circle give way to each other
    assert hypot(*state.position[:2]) == pytest.approx(12.8 + 5.0, abs=0.1)


def test_before_a_gap_that_gets_too_narrow_a_drone_stays_rather_than_be_pushed_through() -> None:
    """Ahead on the left a drone stops, on the right is a line, behind it a drone of uncertain position: it passed at 2.9 m."""
    tracker, state, apart_m = Tracker(LIMITS, WIDE, drone_id="m"), PeerState((0.0, 0.0, 3.0), (-0.5, 3.0, 0.0)), []
    tracker.reset(state.position, state.velocity)
    for step in range(30):
        now_ns, stopped = step * STEP_NS, step > 8
        ahead_m = 4.8 + 0.2 * min(step, 9)
        places = [(4.1, y, 3.0) for _, y, _ in tracker.ahead(now_ns, state.position).tolist()]
        others = [
            PeerPlan.from_pose("c", now_ns, PeerState((-3.1, ahead_m, 3.0), (0.0, 0.0 if stopped else 1.0, 0.0))),
            PeerPlan("d", now_ns, 0.2, places, blind=True, away=np.tile((-1.0, 0.0), (21, 1))),
            PeerPlan("e", now_ns, 0.2, [(6.1, -3.3, 3.0)] * 2, 5.0, blind=True),
        ]
        tracker.plan(now_ns, state, stay(9.6, 4.0), others)
        state = tracker.state(now_ns + STEP_NS)
        apart_m.append(hypot(state.position[0] + 3.1, state.position[1] - ahead_m))
    assert min(apart_m) > LIMITS.separation_m + 0.5


def test_the_way_ahead_climbs_as_planned_from_the_measured_height() -> None:
    tracker = Tracker(LIMITS, WIDE)
    plan = follow(tracker, [stay(0.0, 0.0, 20.0)] * 5)[-1]
    later_ns = plan.stamp_ns + STEP_NS // 2
    climbs = tracker.ahead(later_ns, (0.0, 0.0, 5.0))[:, 2]
    middles = 0.5 * (plan.positions[:-1, 2] + plan.positions[1:, 2])
    assert climbs[0] == 5.0
    assert climbs[:-1] - 5.0 == pytest.approx(middles - middles[0])
    assert climbs[-2] > 11.0  # 2 m/s for 3.8 s
