"""Sources above the ground, where the mission allows for them."""

import numpy as np
import pytest

from radron.agent.fusion.sources.moves import _joined
from radron.agent.fusion.sources.solution import Solution


def raised():
    bias = np.array([(0.05, -0.1, 0.02), (-0.1, 0.1, -0.03)])
    places, heights = np.array([(12.5, 19.6), (29.5, 15.3)]), np.array([2.0, 7.0])
    return Solution((0, 2), places, np.array([1.0, -0.6]), 0.1, bias, 0.004, 0.05, heights)


@pytest.fixture(scope="module")
def problem(among):
    mission = among.mission_of()
    sources = [("Cs-137", 12.0, 20.0, 3e9, 2.2), ("Ir-192", 30.0, 15.0, 5e8, 6.5)]
    entries = among.entries_of(mission, np.random.default_rng(1), 30.0, sources)
    return among.problem_of(mission, entries, height=(0.0, 20.0))


@pytest.mark.parametrize("number", range(15))
def test_the_gradient_is_that_of_the_value(problem, number):
    """Central differences, as for sources on the ground."""
    solution, step = raised(), np.zeros(15)
    step[number] = 1e-5
    after, before = (problem.value(solution.moved(solution.vector + sign * step)) for sign in (1, -1))
    gradient, _ = problem._scored(solution)[1]()
    assert gradient[number] == pytest.approx((after - before) / 2e-5, rel=1e-4, abs=1e-2)


@pytest.mark.parametrize("heights", [(2.0, 6.0), None])
def test_two_that_are_one_are_joined_where_their_activity_is(heights):
    """Three times as strong is the first: a quarter of the way from it to the second, and as strong as both."""
    places, activities = np.array([(12.0, 20.0), (12.4, 19.2), (30.0, 15.0)]), np.log([3.0, 1.0, 0.5])
    above = None if heights is None else np.array([*heights, 9.0])
    one = _joined(Solution((0, 0, 2), places, activities, 0.1, np.zeros((2, 3)), height=above), 0, 1)
    assert one.nuclide == (0, 2)
    assert one.place == pytest.approx(np.array([(12.1, 19.8), (30.0, 15.0)]))
    assert np.exp(one.log_activity) == pytest.approx([4.0, 0.5])
    assert [one.height_of(k) for k in range(2)] == pytest.approx([0.0, 0.0] if heights is None else [3.0, 9.0])


def test_sources_keep_their_heights_in_any_order():
    solution = raised()
    assert np.array_equal(solution.moved(solution.vector).height, solution.height)
    assert solution.only([1, 0]).height.tolist() == [7.0, 2.0]
    assert solution.plus(1, np.zeros(2), 0.0, 4.0).height.tolist() == [2.0, 7.0, 4.0]
    assert solution.without(0).height_of(0) == 7.0
    assert (Solution.nothing(2).size, Solution.nothing(2, raised=True).size) == (3, 4)


@pytest.mark.parametrize("height_m", [1.0, 5.0, 12.0])
def test_the_height_is_found_on_either_side_of_the_cameras(among, estimated, height_m):
    """Cameras fly 3 m high, so that by counts alone 5 m is as good as 1 m. Four standard deviations, or 5 cm more."""
    mission = among.mission_of(source_height_m=(0.0, 20.0), moved_s=20.0)
    source = ("Cs-137", 18.0, 22.0, 3e9, height_m)
    hypothesis = estimated(mission, among.entries_of(mission, np.random.default_rng(5), 40.0, [source]), 42.0)
    assert hypothesis.others == ()
    assert hypothesis.nuclide == "Cs-137"
    sigma_m = np.sqrt(np.diag(hypothesis.covariance))
    assert np.all(np.abs(hypothesis.position - (18.0, 22.0, height_m)) < 4.0 * sigma_m + 0.05)
    assert sigma_m[2] < 1.0
    assert hypothesis.sight_of("a").position[2] == hypothesis.position[2]


def test_on_the_ground_the_height_is_that_of_the_ground(among, estimated):
    mission = among.mission_of(moved_s=20.0)
    source = ("Cs-137", 18.0, 22.0, 3e9)
    hypothesis = estimated(mission, among.entries_of(mission, np.random.default_rng(5), 20.0, [source]), 22.0)
    assert hypothesis.position[2] == hypothesis.covariance[2, 2] == 0.0
