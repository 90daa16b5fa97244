"""A path is followed at constant speed, in both directions, without skipping lanes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.motion.path import PathFollower

LANES = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 10.0), (0.0, 10.0)])
LENGTH = 210.0


def test_arc_lengths_fold_back_at_both_ends() -> None:
    follower = PathFollower(LANES)
    assert follower.length_m == LENGTH
    expected = [(0, 0), (100, 5), (0, 10), (10, 10), (0, 0), (30, 0)]
    assert follower.at(np.array([0.0, 105.0, LENGTH, LENGTH + 10.0, 2 * LENGTH, 2 * LENGTH + 30.0])).tolist() == [
        list(point) for point in expected
    ]


def test_the_reference_runs_at_constant_speed_along_the_path() -> None:
    positions, velocities = PathFollower(LANES).reference(94.0, (94.0, 0.5), speed_mps=3.0, steps=8, step_s=0.5)
    assert positions.shape == velocities.shape == (9, 2)
    assert positions[0].tolist() == [94.0, 0.0]
    assert positions[4] == pytest.approx([100.0, 0.0])
    assert positions[8] == pytest.approx([100.0, 6.0])
    assert velocities[0] == pytest.approx([3.0, 0.0])
    assert velocities[5] == pytest.approx([0.0, 3.0])


def test_the_reference_turns_back_at_the_end() -> None:
    positions, velocities = PathFollower(LANES).reference(LENGTH - 3.0, (3.0, 10.0), speed_mps=3.0, steps=4, step_s=0.5)
    assert positions[:, 0] == pytest.approx([3.0, 1.5, 0.0, 1.5, 3.0])
    assert velocities[-1] == pytest.approx([3.0, 0.0])


def test_a_drone_off_the_path_is_led_to_it_at_the_same_speed() -> None:
    positions, velocities = PathFollower(LANES).reference(0.0, (0.0, -9.0), speed_mps=3.0, steps=6, step_s=1.0)
    assert positions[:3].tolist() == [[0.0, -9.0], [0.0, -6.0], [0.0, -3.0]]
    assert positions[4] == pytest.approx([3.0, 0.0])
    assert np.hypot(*velocities.T) == pytest.approx(3.0)


@given(st.floats(0.0, 1000.0), st.floats(0.0, 8.0), st.floats(-1.5, 1.5))
def test_progress_is_found_again_from_a_point_beside_the_path(s: float, ahead: float, aside: float) -> None:
    follower = PathFollower(LANES)
    start, end = follower.at(np.array([s + ahead - 1e-4, s + ahead + 1e-4]))
    tangent = (end - start) / max(float(np.hypot(*(end - start))), 1e-9)
    point = 0.5 * (start + end) + aside * np.array([-tangent[1], tangent[0]])
    found = follower.advance(s, tuple(point), reach_m=8.5)
    assert s <= found <= s + 8.5
    gap = float(np.hypot(*(follower.at(np.array([found]))[0] - point)))
    best = np.hypot(*(follower.at(s + np.linspace(0.0, 8.5, 400)) - point).T).min()
    assert gap <= best + 1e-6


def test_progress_neither_goes_back_nor_skips_a_lane() -> None:
    follower = PathFollower(LANES)
    assert follower.advance(50.0, (20.0, 0.0), reach_m=5.0) == 50.0
    assert follower.advance(50.0, (52.0, 9.0), reach_m=5.0) == pytest.approx(52.0)


def test_a_whole_flight_covers_the_path_once_forth_and_back() -> None:
    follower = PathFollower(LANES)
    s, position = 0.0, np.array([0.0, 0.0])
    trail = [position]
    for _ in range(int(2 * LENGTH / 3.0 / 0.2)):
        s = follower.advance(s, position, reach_m=3.0)
        positions, _ = follower.reference(s, position, speed_mps=3.0, steps=1, step_s=0.2)
        position = positions[1]
        trail.append(position)
    assert s == pytest.approx(2 * LENGTH, abs=1.5)
    assert np.array(trail)[:, 1].max() == pytest.approx(10.0)
    assert position == pytest.approx([0.0, 0.0], abs=1.5)


@pytest.mark.parametrize("path", [[(3.0, 4.0)], [(3.0, 4.0), (3.0, 4.0)]])
def test_a_single_point_is_held(path: list[tuple[float, float]]) -> None:
    follower = PathFollower(np.array(path))
    positions, velocities = follower.reference(7.0, (3.0, 4.0), speed_mps=3.0, steps=3, step_s=0.2)
    assert (positions == [3.0, 4.0]).all()
    assert (velocities == 0.0).all()
    assert follower.advance(7.0, (9.0, 9.0), reach_m=5.0) == 7.0


def test_an_empty_path_is_refused() -> None:
    with pytest.raises(ValueError, match="M >= 1"):
        PathFollower(np.empty((0, 2)))


def test_neither_end_is_cut_short_when_the_position_is_noisy() -> None:
    """At an end the way there and the way back are equally near; noise must not turn the drone before it is there."""
    noise = np.random.default_rng(1)
    follower = PathFollower(LANES)
    s, position = 0.0, np.array([0.0, 0.0])
    trail = []
    for _ in range(int(2.2 * LENGTH / 3.0 / 0.2)):
        s = follower.advance(s, position + noise.normal(0.0, 0.15, 2))
        positions, _ = follower.reference(s, position, speed_mps=3.0, steps=1, step_s=0.2)
        position = positions[1]
        trail.append(position)
    far_end = np.hypot(*(np.array(trail) - LANES[-1]).T).min()
    near_end = np.hypot(*(np.array(trail[len(trail) // 2 :]) - LANES[0]).T).min()
    assert max(far_end, near_end) < 1.5


def test_points_that_are_apart_by_less_than_the_length_resolves_are_one() -> None:
    follower = PathFollower(np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 1e-15), (100.0, 10.0)]))
    assert follower.length_m == 110.0
    assert follower.at(np.array([50.0, 105.0])).tolist() == [[50.0, 0.0], [100.0, 5.0]]
    assert follower.advance(99.0, (100.0, 0.5)) == pytest.approx(100.5)


def test_a_path_of_next_to_no_length_is_a_place_to_stay_at():
    follower = PathFollower(np.array([[3.0, 4.0], [3.0 + 1e-9, 4.0]]))
    assert follower.length_m == 0.0
    assert follower.advance(0.0, (3.0, 4.0)) == 0.0  # and not billions of laps
    np.testing.assert_array_equal(follower.at(np.array([0.0, 5.0])), [[3.0, 4.0], [3.0, 4.0]])
