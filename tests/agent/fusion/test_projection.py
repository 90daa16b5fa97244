import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from radron.agent.fusion.projection import project

RULES = ("paper", "geometric")
metres = st.floats(-50.0, 50.0)
points = st.tuples(metres, metres, metres)
angles = st.floats(0.05, 3.09)


@st.composite
def axes(draw):
    polar, azimuth = draw(st.floats(0.0, math.pi)), draw(st.floats(-math.pi, math.pi))
    return (math.sin(polar) * math.cos(azimuth), math.sin(polar) * math.sin(azimuth), math.cos(polar))


def angle_from(axis, apex, point):
    v = np.subtract(point, apex)
    return math.atan2(float(np.linalg.norm(np.cross(axis, v))), float(np.dot(axis, v)))


def by_the_paper(point, apex, axis, theta):
    """Eq. (projection) as printed: w is v turned by -beta about the normal of the plane of u and v."""
    u, v = np.array(axis), np.subtract(point, apex)
    length = np.linalg.norm(v)
    v = v / length
    alpha = math.acos(np.clip(u @ v, -1.0, 1.0))
    if alpha >= math.pi / 2:
        return np.array(apex)
    beta = alpha - theta
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal)
    w = v * math.cos(-beta) + np.cross(normal, v) * math.sin(-beta)
    return np.array(apex) + w * length * math.cos(beta)


def surface(apex, axis, theta, reach):
    """A fine net of points on the cone's surface up to ``reach`` metres from the apex, apex included."""
    u = np.array(axis)
    helper = np.eye(3)[int(np.argmin(np.abs(u)))]
    first = np.cross(u, helper)
    first /= np.linalg.norm(first)
    second = np.cross(u, first)
    azimuth = np.linspace(0.0, 2 * math.pi, 361)[:, None, None]
    along = np.linspace(0.0, reach, 401)[None, :, None]
    ray = math.cos(theta) * u + math.sin(theta) * (np.cos(azimuth) * first + np.sin(azimuth) * second)
    return (np.array(apex) + along * ray).reshape(-1, 3)


@given(points, points, axes(), angles)
def test_paper_rule_is_the_printed_equation(point, apex, axis, theta):
    alpha = angle_from(axis, apex, point)
    assume(0.01 < alpha < math.pi - 0.01 and abs(alpha - math.pi / 2) > 1e-6 and math.dist(point, apex) > 0.01)
    correction = project(point, apex, axis, theta, "paper")
    np.testing.assert_allclose(np.add(point, correction.innovation), by_the_paper(point, apex, axis, theta), atol=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_geometric_rule_is_the_nearest_point_of_the_surface(seed):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis = tuple(axis / np.linalg.norm(axis))
    point, apex, theta = tuple(rng.uniform(-10, 10, 3)), tuple(rng.uniform(-10, 10, 3)), rng.uniform(0.1, 3.0)
    correction = project(point, apex, axis, theta, "geometric")
    found = float(np.linalg.norm(correction.innovation))
    net = surface(apex, axis, theta, 2.0 * math.dist(point, apex))
    nearest = float(np.min(np.linalg.norm(net - np.array(point), axis=1)))
    spacing = 2.0 * math.dist(point, apex) * math.radians(1.0)
    assert found <= nearest + 1e-9  # no point of the net is nearer
    assert math.sqrt(max(nearest**2 - found**2, 0.0)) <= spacing  # and the net comes as near as its meshes allow


@given(points, points, axes(), angles)
def test_where_the_foot_is_on_the_surface_the_rules_agree(point, apex, axis, theta):
    alpha = angle_from(axis, apex, point)
    assume(alpha < math.pi / 2 - 1e-6 and abs(alpha - theta) < math.pi / 2 - 1e-6)
    assert project(point, apex, axis, theta, "paper") == project(point, apex, axis, theta, "geometric")


def test_the_rules_differ_for_a_wide_cone():
    """alpha = 100 deg, theta = 90 deg: the point is 10 deg off the surface; the paper pulls it to the apex."""
    point = (math.cos(math.radians(100)) * 10.0, math.sin(math.radians(100)) * 10.0, 0.0)
    to_apex = project(point, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), math.pi / 2, "paper")
    assert np.add(point, to_apex.innovation) == pytest.approx((0.0, 0.0, 0.0))
    near = project(point, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), math.pi / 2, "geometric")
    assert math.hypot(*near.innovation) == pytest.approx(10.0 * math.sin(math.radians(10.0)))


def test_the_papers_mirror_image():
    """alpha = 10 deg, theta = 150 deg: by the letter of the paper the point goes behind the apex, truly to it."""
    point = (math.cos(math.radians(10)) * 10.0, math.sin(math.radians(10)) * 10.0, 0.0)
    mirrored = np.add(point, project(point, (0.0,) * 3, (1.0, 0.0, 0.0), math.radians(150), "paper").innovation)
    assert angle_from((1.0, 0.0, 0.0), (0.0,) * 3, mirrored) == pytest.approx(math.radians(30))
    nearest = np.add(point, project(point, (0.0,) * 3, (1.0, 0.0, 0.0), math.radians(150), "geometric").innovation)
    assert nearest == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize("rule", RULES)
def test_normal_is_a_unit_vector_along_the_innovation(rule):
    rng = np.random.default_rng(5)
    for _ in range(100):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        correction = project(tuple(rng.normal(size=3)), tuple(rng.normal(size=3)), tuple(axis), rng.uniform(0.1, 3.0), rule)
        assert math.hypot(*correction.normal) == pytest.approx(1.0)
        np.testing.assert_allclose(np.cross(correction.normal, correction.innovation), 0.0, atol=1e-9)


@pytest.mark.parametrize("rule", RULES)
def test_degenerate_points(rule):
    apex, axis = (1.0, 2.0, 3.0), (0.0, 0.0, 1.0)
    assert project(apex, apex, axis, 1.0, rule) is None  # at the apex
    assert project((1.0, 2.0, 8.0), apex, axis, 1.0, rule) is None  # on the axis
    behind = project((1.0, 2.0, -2.0), apex, axis, 1.0, rule)  # on the axis, behind: the apex is nearest, no doubt
    assert behind.innovation == pytest.approx((0.0, 0.0, 5.0))


@pytest.mark.parametrize("rule", RULES)
def test_a_point_on_the_surface_stays_and_has_the_surfaces_normal(rule):
    theta = 0.6
    point = (math.sin(theta) * 7.0, 0.0, math.cos(theta) * 7.0)
    correction = project(point, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), theta, rule)
    assert correction.innovation == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert correction.normal == pytest.approx((math.cos(theta), 0.0, -math.sin(theta)))
