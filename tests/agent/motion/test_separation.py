"""Half-planes from peers' plans, and the last resort."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import LimitsConfig
from radron.agent.motion.reference import PeerState
from radron.agent.motion.separation import LEAST_MARGIN_M, PeerPlan, escape, half_planes, keep_away

LIMITS = LimitsConfig()
SECOND = 1_000_000_000


def straight(name: str, start: tuple[float, float], velocity: tuple[float, float], measured: PeerState | None = None) -> PeerPlan:
    times = 0.2 * np.arange(21.0)[:, None]
    positions = np.hstack((np.array(start) + times * velocity, np.full((21, 1), 3.0)))
    return PeerPlan(name, SECOND, 0.2, positions.tolist(), 0.1, measured)


def test_a_plan_is_read_between_its_steps_and_beyond_its_end() -> None:
    plan = straight("b", (1.0, 2.0), (3.0, -1.0))
    for after_s in (-0.3, 0.0, 0.13, 3.95, 6.0):
        assert plan.at(SECOND, after_s) == pytest.approx((1.0 + 3.0 * after_s, 2.0 - after_s))
        assert plan.at(SECOND + SECOND // 2, after_s) == pytest.approx((2.5 + 3.0 * after_s, 1.5 - after_s))
    state = plan.state(SECOND + 300_000_000)
    assert state.position == pytest.approx((1.9, 1.7, 3.0))
    assert state.velocity == pytest.approx((3.0, -1.0, 0.0))


def test_without_a_plan_a_drone_is_taken_to_fly_straight_on() -> None:
    plan = PeerPlan.from_pose("b", SECOND, PeerState((0.0, 0.0, 3.0), (2.0, 0.0, 0.0), age_s=0.1))
    assert plan.at(SECOND) == pytest.approx((0.2, 0.0))
    assert plan.at(SECOND, 1.0) == pytest.approx((2.2, 0.0))


def test_a_plan_of_one_point_stays_there() -> None:
    plan = PeerPlan("b", SECOND, 0.2, [(1.0, 2.0, 3.0)])
    assert plan.at(SECOND) == plan.at(SECOND, 2.0) == (1.0, 2.0)
    assert plan.state(SECOND).position == (1.0, 2.0, 3.0)


def test_one_of_two_gives_way_and_both_keep_more_than_the_separation() -> None:
    first, second = straight("a", (0, 0), (0, 0)), straight("b", (0, 0), (0, 0))
    assert keep_away("b", first, 3.0) == pytest.approx(3.0 + LEAST_MARGIN_M + 0.2)
    assert 3.0 + 1.0 < keep_away("a", second, 3.0) < keep_away("b", first, 3.0)


def test_who_deviates_from_its_plans_keeps_more_and_is_kept_away_from_further() -> None:
    first = replace(straight("a", (0, 0), (0, 0)), deviation_m=1.2)
    assert keep_away("b", first, 3.0, own_m=0.5) == pytest.approx(3.0 + 3.0 * 1.3 + 0.2)
    assert keep_away("a", replace(first, id="b"), 3.0, own_m=0.5) == pytest.approx(3.0 + 0.6 * 3.0 * 1.3 + 0.2)


def test_half_planes_keep_the_distance() -> None:
    other = np.array(straight("a", (0.0, 0.0), (1.0, 0.0)).steps(SECOND, 0.2, 20))
    nominal = np.column_stack((0.2 * np.arange(1.0, 21.0), np.full(20, 6.0)))
    normals, offsets = half_planes(nominal, (0.0, 6.0), other, 5.0, yields=False)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(20))
    on_the_line = other[1:] + 5.0 * normals
    assert np.einsum("ij,ij->i", normals, on_the_line) == pytest.approx(offsets)
    assert normals == pytest.approx(np.tile([0.0, 1.0], (20, 1)))


def test_a_nominal_path_through_the_other_is_not_taken_for_one_around_it() -> None:
    other = np.zeros((21, 2))
    nominal = np.column_stack((np.linspace(-9.0, 10.0, 20), np.zeros(20)))
    normals, _ = half_planes(nominal, (-10.0, 0.0), other, 5.0, yields=False)
    assert (normals[:, 0] < 0.0).all()


def flying(x: float, y: float, u: float, v: float) -> PeerState:
    return PeerState((x, y, 3.0), (u, v, 0.0))


def test_a_collision_course_makes_both_brake_and_one_back_off() -> None:
    mine, theirs = flying(0.0, 0.0, 4.0, 0.0), flying(6.0, 0.5, -4.0, 0.0)
    with_right_of_way = escape("a", mine, [straight("b", (6, 0.5), (-4, 0), theirs)], LIMITS, 0.38)
    assert with_right_of_way == (0.0, 0.0)
    giving_way = escape("b", theirs, [straight("a", (0, 0), (4, 0), mine)], LIMITS, 0.38)
    assert giving_way is not None
    assert giving_way[0] > 1.0


@pytest.mark.parametrize(
    "theirs",
    [
        flying(30.0, 0.0, -4.0, 0.0),  # time enough to brake
        flying(6.0, 5.0, -4.0, 0.0),  # passes at a distance
        flying(4.0, 0.0, 6.0, 0.0),  # ahead and leaving
    ],
)
def test_no_alarm_without_a_cause(theirs: PeerState) -> None:
    mine = flying(0.0, 0.0, 4.0, 0.0)
    assert escape("b", mine, [straight("a", (0, 0), (0, 0), theirs)], LIMITS, 0.38) is None
    assert escape("b", mine, [straight("a", (0, 0), (0, 0), None)], LIMITS, 0.38) is None


def test_the_worst_of_several_decides() -> None:
    mine = flying(0.0, 0.0, 0.0, 0.0)
    near, nearer = flying(2.5, 0.0, -1.0, 0.0), flying(0.0, 2.0, 0.0, -1.0)
    answer = escape("z", mine, [straight("a", (0, 0), (0, 0), near), straight("b", (0, 0), (0, 0), nearer)], LIMITS, 0.38)
    assert answer is not None
    assert answer == pytest.approx((0.0, -2.0))


def test_what_is_doubted_of_where_it_is_adds_to_the_separation() -> None:
    mine, theirs = flying(0.0, 0.0, 4.0, 0.0), flying(30.0, 3.5, -4.0, 0.0)
    passing = flying(5.0, 3.5, -4.0, 0.0)
    sure = PeerPlan.from_pose("a", SECOND, passing)
    doubted = PeerPlan.from_pose("a", SECOND, passing, doubt_m=1.0)
    assert escape("b", mine, [sure], LIMITS, 0.38) is None
    assert escape("b", mine, [doubted], LIMITS, 0.38) is not None
    assert escape("b", mine, [PeerPlan.from_pose("a", SECOND, theirs, doubt_m=1.0)], LIMITS, 0.38) is None  # far away still


def test_nobody_waits_for_a_blind_drone_to_brake() -> None:
    mine, theirs = flying(0.0, 0.0, 4.0, 0.0), flying(9.0, 0.0, -2.0, 0.0)
    steered, blind = (PeerPlan.from_pose("b", SECOND, theirs, blind=blind) for blind in (False, True))
    assert escape("a", mine, [steered], LIMITS, 0.38) is None
    assert escape("a", mine, [blind], LIMITS, 0.38) == pytest.approx((-2.0, 0.0))
