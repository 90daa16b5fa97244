import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.frames.transform import Transform

metres = st.floats(-1e4, 1e4)
points = st.tuples(metres, metres, metres)


@st.composite
def transforms(draw):
    return Transform(draw(st.floats(-math.pi, math.pi)), draw(points))


def random_covariance(seed):
    root = np.random.default_rng(seed).normal(size=(4, 4))
    return root @ root.T * 1e-6


@given(transforms(), points)
def test_there_and_back_is_the_same_point(transform, point):
    there = transform.apply_point(point)
    assert transform.inverse().apply_point(there) == pytest.approx(point, abs=1e-9)


@given(transforms(), transforms(), points)
def test_composition_is_one_after_the_other(outer, inner, point):
    assert (outer @ inner).apply_point(point) == pytest.approx(outer.apply_point(inner.apply_point(point)), abs=1e-9)


@given(transforms(), transforms(), points)
def test_inverse_of_a_composition(outer, inner, point):
    back = (outer @ inner).inverse()
    assert back.apply_point(point) == pytest.approx((inner.inverse() @ outer.inverse()).apply_point(point), abs=1e-9)
    assert math.remainder((inner.inverse() @ outer.inverse()).yaw_rad - back.yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_by_hand():
    """A drone that faces north at (10, 20, 1): its x axis is the mission's y."""
    transform = Transform(math.pi / 2, (10.0, 20.0, 1.0))
    assert transform.apply_point((5.0, 0.0, 2.0)) == pytest.approx((10.0, 25.0, 3.0))
    assert transform.rotate_direction((0.0, 1.0, 0.0)) == pytest.approx((-1.0, 0.0, 0.0))


@given(transforms(), st.lists(points, min_size=1, max_size=5))
def test_arrays_and_single_points_agree(transform, several):
    array = np.array(several)
    np.testing.assert_allclose(transform.apply(array), [transform.apply_point(p) for p in several], atol=1e-9)
    np.testing.assert_allclose(transform.rotate(array), [transform.rotate_direction(p) for p in several], atol=1e-9)
    np.testing.assert_allclose(transform.apply(array[0]), transform.apply_point(several[0]), atol=1e-9)
    np.testing.assert_allclose(array @ transform.rotation_matrix().T, transform.rotate(array), atol=1e-9)


def test_an_input_array_is_left_alone():
    array = np.array([[1.0, 2.0, 3.0]])
    Transform(1.0, (1.0, 1.0, 1.0)).apply(array)
    np.testing.assert_array_equal(array, [[1.0, 2.0, 3.0]])


def test_yaw_of_a_composition_stays_within_a_turn():
    assert (Transform(3.0) @ Transform(3.0)).yaw_rad == pytest.approx(6.0 - math.tau)


def numbers(transform):
    return np.array([*transform.translation, transform.yaw_rad])


def disturbed(transform, error):
    x, y, z = np.array(transform.translation) + error[:3]
    return Transform(transform.yaw_rad + error[3], (x, y, z))


def sampled_covariance(function, *transforms, count=4000):
    """Covariance of function(transforms) over errors drawn from the transforms' covariances."""
    rng = np.random.default_rng(7)
    errors = [rng.multivariate_normal(np.zeros(4), t.covariance, size=count) for t in transforms]
    results = [function(*(disturbed(t, error[i]) for t, error in zip(transforms, errors, strict=True))) for i in range(count)]
    return np.cov(np.array(results).T)


def test_covariances_agree_with_sampling():
    a = Transform(0.7, (10.0, -20.0, 3.0), random_covariance(1))
    b = Transform(-2.0, (5.0, 8.0, -1.0), random_covariance(2))
    for exact, sampled in (
        (a.inverse().covariance, sampled_covariance(lambda t: numbers(t.inverse()), a)),
        ((a @ b).covariance, sampled_covariance(lambda s, t: numbers(s @ t), a, b)),
    ):
        np.testing.assert_allclose(sampled, exact, atol=0.08 * np.abs(exact).max())


@given(transforms(), points)
def test_sigmas_at_a_point_are_those_of_a_frame_whose_origin_it_is(transform, point):
    uncertain = Transform(transform.yaw_rad, transform.translation, random_covariance(3))
    there = (uncertain @ Transform(0.0, point)).covariance
    expected = math.sqrt(there[0, 0] + there[1, 1]), math.sqrt(there[3, 3])
    assert uncertain.sigmas_at(point) == pytest.approx(expected, rel=1e-6)


def test_exact_transforms_stay_exact():
    assert (Transform(1.0) @ Transform(2.0)).covariance is None
    assert Transform(1.0).inverse().covariance is None
    one_sided = Transform(1.0) @ Transform(2.0, (1.0, 0.0, 0.0), np.eye(4))
    np.testing.assert_allclose(one_sided.covariance, np.eye(4), atol=1e-12)
