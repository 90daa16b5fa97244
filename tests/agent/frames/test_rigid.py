import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from agent.frames.rigid import Rigid
from agent.frames.transform import Transform

metres = st.floats(-100.0, 100.0)
points = st.tuples(metres, metres, metres)
turns = st.tuples(*[st.floats(-1.8, 1.8)] * 3)


@st.composite
def rigids(draw):
    return Rigid(Rotation.from_rotvec(draw(turns)), draw(points))


def random_covariance(rng, size=6, scale=1e-6):
    root = rng.normal(size=(size, size))
    return root @ root.T * scale


def perturbed(transform, error):
    """The transform that is true where ``transform`` is believed and its error is this one (6,)."""
    x, y, z = (np.array(transform.translation) + error[:3]).tolist()
    return Rigid(Rotation.from_rotvec(error[3:]) * transform.rotation, (x, y, z))


def error_of(believed, true):
    """(6,): the error of which ``perturbed`` would make ``true``."""
    turn = (true.rotation * believed.rotation.inv()).as_rotvec()
    return np.concatenate((np.array(true.translation) - believed.translation, turn))


@given(rigids(), points)
def test_there_and_back_is_the_same_point(transform, point):
    np.testing.assert_allclose(transform.inverse().apply(transform.apply(np.array(point))), point, atol=1e-9)
    np.testing.assert_allclose((transform @ transform.inverse()).apply(np.array(point)), point, atol=1e-9)


@given(rigids(), rigids(), points)
def test_composition_is_one_after_the_other(outer, inner, point):
    np.testing.assert_allclose((outer @ inner).apply(np.array(point)), outer.apply(inner.apply(np.array(point))), atol=1e-9)


@given(st.floats(-math.pi, math.pi), points, points)
def test_a_level_one_goes_there_and_back(yaw, translation, point):
    flat = Transform(yaw, translation)
    rigid = Rigid.from_level(flat)
    np.testing.assert_allclose(rigid.apply(np.array(point)), flat.apply_point(point), atol=1e-9)
    back, tilt = rigid.level()
    assert back.translation == translation
    assert math.remainder(back.yaw_rad - yaw, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert tilt == pytest.approx(0.0, abs=1e-7)


@given(st.floats(-3.0, 3.0), st.floats(0.0, 0.3), st.floats(0.0, math.tau), points)
def test_levelling_says_by_how_much_it_is_wrong(yaw, tilt, about, point):
    lean = Rotation.from_rotvec([tilt * math.cos(about), tilt * math.sin(about), 0.0])
    rigid = Rigid(lean * Rotation.from_euler("z", yaw), (1.0, 2.0, 3.0))
    flat, told = rigid.level()
    assert told == pytest.approx(tilt, abs=1e-7)
    assert flat.yaw_rad == pytest.approx(yaw, abs=1e-9)
    wrong = math.dist(rigid.apply(np.array(point)), flat.apply_point(point))
    assert wrong <= 2.0 * math.sin(told / 2.0) * math.hypot(*point) + 1e-6


def test_the_level_covariance_is_kept():
    covariance = random_covariance(np.random.default_rng(1), 4)
    rigid = Rigid.from_level(Transform(0.3, (1.0, 2.0, 3.0), covariance), tilt_sigma_rad=0.01)
    np.testing.assert_allclose(rigid.level()[0].covariance, covariance)
    up_error = rigid.point_covariance(np.array([10.0, 0.0, 0.0]))[2, 2]
    assert up_error == pytest.approx(covariance[2, 2] + (0.01 * 10.0) ** 2)


def sampled(operation, transforms, believed, count):
    """(6, 6): covariance of what an operation makes of transforms whose errors are drawn from their covariances."""
    rng = np.random.default_rng(5)
    draws = [rng.multivariate_normal(np.zeros(6), each.covariance, count) for each in transforms]
    errors = [
        error_of(believed, operation(*(perturbed(each, draw[k]) for each, draw in zip(transforms, draws, strict=True))))
        for k in range(count)
    ]
    return np.cov(np.array(errors).T)


def assert_alike(covariance, sample, count):
    """Same covariance within sampling: an element's standard error is sqrt((S_ii S_jj + S_ij^2) / count); 5 of them."""
    variance = np.diag(covariance)
    deviation = np.sqrt((np.outer(variance, variance) + covariance**2) / count)
    assert (np.abs(sample - covariance) < 5.0 * deviation).all()


@pytest.fixture
def pair():
    rng = np.random.default_rng(2)
    return (
        Rigid(Rotation.from_rotvec([0.4, -0.8, 1.1]), (12.0, -7.0, 3.0), random_covariance(rng)),
        Rigid(Rotation.from_rotvec([-0.2, 0.5, 2.0]), (-4.0, 9.0, 6.0), random_covariance(rng)),
    )


def test_the_inverse_has_the_covariance_that_sampling_gives(pair):
    inverse = pair[0].inverse()
    assert_alike(inverse.covariance, sampled(Rigid.inverse, pair[:1], inverse, 4000), 4000)


def test_the_composition_has_the_covariance_that_sampling_gives(pair):
    together = pair[0] @ pair[1]
    assert_alike(together.covariance, sampled(Rigid.__matmul__, pair, together, 4000), 4000)


def test_a_point_has_the_covariance_that_sampling_gives(pair):
    point = np.array([5.0, -3.0, 2.0])
    rng = np.random.default_rng(6)
    errors = rng.multivariate_normal(np.zeros(6), pair[0].covariance, 4000)
    moved = np.array([perturbed(pair[0], error).apply(point) for error in errors])
    assert_alike(pair[0].point_covariance(point), np.cov(moved.T), 4000)


def test_what_is_exact_stays_exact():
    exact = Rigid(Rotation.from_rotvec([0.1, 0.2, 0.3]), (1.0, 2.0, 3.0))
    assert exact.inverse().covariance is None
    assert (exact @ exact).covariance is None
    assert not exact.point_covariance(np.ones(3)).any()
