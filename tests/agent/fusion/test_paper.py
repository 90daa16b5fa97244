import math

import numpy as np
import pytest
from shapely import Polygon

from radron.agent.config.estimators import PaperEstimatorConfig
from radron.agent.frames.transform import Transform
from radron.agent.fusion.estimator import GridStep
from radron.agent.fusion.initial import InitialSearch
from radron.agent.fusion.observation import observe
from radron.agent.fusion.paper import PaperEstimator, PaperState, Track
from radron.agent.fusion.projection import project

CONFIG = PaperEstimatorConfig(process_noise_m2ps=2.0, measurement_variance_m2=100.0, initial_variance_m2=100.0)
NS = 1_000_000_000


@pytest.fixture(params=["paper", "geometric"])
def estimator(request):
    search = InitialSearch(Polygon([(0, 0), (100, 0), (100, 100), (0, 100)]))
    return PaperEstimator(CONFIG, search, request.param)


@pytest.fixture
def cones(kit):
    def make(rng, count, every_s=0.4, arm_rad=0.1, around=12.0):
        mission, made = kit.mission_of(), []
        for sequence in range(count):
            phase = 0.5 * sequence
            apex = np.array([50.0 + around * math.cos(phase), 50.0 + around * math.sin(phase), 3.0])
            axis, theta = kit.cone_towards(rng, apex, (50.0, 50.0, 0.0), arm_rad)
            entry = kit.cone_entry(mission, sequence * every_s, apex, axis, theta, sequence=sequence)
            made.append(observe(entry, Transform()))
        return made

    return make


def step_at(stamp_ns, width_ns=NS // 2):
    index = stamp_ns // width_ns
    return GridStep(index, index * width_ns, (index + 1) * width_ns)


def fold(estimator, cones, state=None):
    state = estimator.initial(None) if state is None else state
    for cone in cones:
        state = estimator.step(state, step_at(cone.stamp_ns), [cone])
    return state


def dense_filter(x, covariance, cones, rule, stamp_ns):
    """The LKF in the paper's own terms: 3 x 3 matrices, R = P R_C P^T by a rotation, z known to be 0."""
    ground = np.diag([1.0, 1.0, 0.0])
    rho, factor = CONFIG.measurement_variance_m2, CONFIG.cross_axis_factor
    for cone in cones:
        covariance = covariance + CONFIG.process_noise_m2ps * (cone.stamp_ns - stamp_ns) / NS * ground
        stamp_ns = cone.stamp_ns
        reading = cone.forward
        correction = project(tuple(x), reading.apex, reading.axis, reading.theta_rad, rule)
        rotation, _ = np.linalg.qr(np.column_stack([correction.normal, np.eye(3)[:, :2] + 0.1]))  # first column +-normal
        noise = rotation @ np.diag([rho, rho * factor, rho * factor]) @ rotation.T
        gain = covariance @ np.linalg.inv(covariance + noise)
        x = x + gain @ np.array(correction.innovation)
        covariance = (np.eye(3) - gain) @ covariance
    return x, covariance


def test_it_is_the_papers_filter_in_matrices(estimator, cones):
    seen = cones(np.random.default_rng(1), 40)
    begun = PaperState(track=Track(seen[0].stamp_ns, 53.0, 46.0, 100.0, 0.0, 100.0, 0, seen[0].stamp_ns))
    track = fold(estimator, seen, begun).track
    x, covariance = dense_filter(
        np.array([53.0, 46.0, 0.0]), np.diag([100.0, 100.0, 0.0]), seen, estimator._rule, seen[0].stamp_ns
    )
    assert (track.x, track.y, 0.0) == pytest.approx(x, abs=1e-7)
    np.testing.assert_allclose([[track.pxx, track.pxy], [track.pxy, track.pyy]], covariance[:2, :2], rtol=1e-7)
    np.testing.assert_allclose(covariance[2], 0.0, atol=1e-12)


def test_x0_comes_with_the_mth_cone(estimator, cones):
    seen = cones(np.random.default_rng(2), 10, arm_rad=0.0)
    almost = fold(estimator, seen[:9])
    assert estimator.hypothesis(almost, step_at(seen[9].stamp_ns)) is None
    hypothesis = estimator.hypothesis(fold(estimator, seen[9:], almost), step_at(seen[9].stamp_ns))
    assert hypothesis.position == pytest.approx((50.0, 50.0, 0.0), abs=0.01)
    assert hypothesis.x0_stamp_ns == seen[9].stamp_ns
    assert hypothesis.cones == 10
    np.testing.assert_allclose(hypothesis.covariance, np.diag([100.0, 100.0, 0.0]))


def test_cones_from_one_place_are_no_baseline(estimator, cones, kit):
    rng = np.random.default_rng(3)
    state = fold(estimator, cones(rng, 30, around=0.0))
    assert len(state.gathered) == 1
    assert state.track is None
    mission, apexes = kit.mission_of(), [(10.0 + 3.0 * index, 20.0, 3.0) for index in range(9)]
    flown = [kit.cone_entry(mission, 60.0 + i, apex, (0.0, 1.0, 0.0), 0.5, sequence=i) for i, apex in enumerate(apexes)]
    seen = [observe(entry, Transform()) for entry in flown]
    assert fold(estimator, seen[:8], state).track is None
    assert fold(estimator, seen, state).track.cones == 39  # cones without use for x0 count, too


def test_noise_grows_with_time_and_not_with_the_number_of_steps(estimator, cones):
    seen = cones(np.random.default_rng(4), 10)
    state = fold(estimator, seen)
    later = estimator.hypothesis(state, step_at(seen[-1].stamp_ns + 10 * NS))
    grown_s = (later.stamp_ns - seen[-1].stamp_ns) / NS
    assert 9.0 < grown_s <= 10.0
    assert later.covariance[0, 0] == pytest.approx(100.0 + 2.0 * grown_s)
    assert estimator.hypothesis(state, step_at(seen[-1].stamp_ns)).stamp_ns == seen[-1].stamp_ns
    idle = estimator.step(state, step_at(seen[-1].stamp_ns + 5 * NS), [])
    assert idle == state


def test_a_cone_through_the_hypothesis_sharpens_it_across_its_surface_only(estimator, kit):
    """The camera is to the east, on the ground, and the cone's surface there is the vertical plane to the hypothesis."""
    begun = PaperState(track=Track(kit.T0_NS, 50.0, 50.0, 100.0, 0.0, 100.0, 10, kit.T0_NS))
    theta = 1.0
    entry = kit.cone_entry(kit.mission_of(), 0.0, (62.0, 50.0, 0.0), (-math.cos(theta), math.sin(theta), 0.0), theta)
    track = fold(estimator, [observe(entry, Transform())], begun).track
    assert (track.x, track.y) == pytest.approx((50.0, 50.0), abs=1e-9)
    assert track.pyy == pytest.approx(50.0, rel=1e-9)  # 100 against rho = 100
    assert track.pxx == pytest.approx(100.0, rel=1e-3)  # next to nothing is said along the surface
    assert track.pxx < 100.0


@pytest.mark.parametrize("height", [0.0, 3.0])
def test_degenerate_cones_leave_the_hypothesis_where_it_is(estimator, kit, height):
    """The camera exactly above (or at) the hypothesis, its axis through it."""
    begun = PaperState(track=Track(kit.T0_NS, 50.0, 50.0, 90.0, 1.0, 80.0, 10, kit.T0_NS))
    entry = kit.cone_entry(kit.mission_of(), 0.0, (50.0, 50.0, height), (0.0, 0.0, -1.0), 0.7)
    track = fold(estimator, [observe(entry, Transform())], begun).track
    assert track == Track(kit.T0_NS, 50.0, 50.0, 90.0, 1.0, 80.0, 11, kit.T0_NS)


def random_cone(kit, rng, sequence, reach_m):
    """Any cone at all whose apex is within reach_m of the origin along each axis."""
    axis = rng.normal(size=3)
    apex = (*rng.uniform(-reach_m, reach_m, 2), rng.uniform(0.0, 100.0))
    entry = kit.cone_entry(
        kit.mission_of(), 0.4 * sequence, apex, axis / np.linalg.norm(axis), rng.uniform(0.0, 3.1), sequence=sequence
    )
    return observe(entry, Transform())


@pytest.mark.parametrize("reach_m", [290.0, 2000.0, 1e5])
def test_no_cone_takes_the_hypothesis_away(estimator, cones, kit, reach_m):
    """Neither cones from far away nor many from just within the limit: after each it is at most 200 m from the area."""
    rng = np.random.default_rng(8)
    state = fold(estimator, cones(rng, 10))
    moved = 0
    for sequence in range(500):
        before, state = state, fold(estimator, [random_cone(kit, rng, 100 + sequence, reach_m)], state)
        assert -200.0 <= state.track.x <= 300.0
        assert -200.0 <= state.track.y <= 300.0
        moved += state.track.x != before.track.x
    assert moved > 0 or reach_m > 1e4


def test_a_cone_from_far_away_is_as_if_it_had_not_been(estimator, cones, kit):
    seen = cones(np.random.default_rng(9), 12)
    far = kit.cone_entry(kit.mission_of(), 1.0, (50.0, -99_000.0, 3.0), (0.0, 1.0, 0.0), 0.8, sequence=77)
    strange = observe(far, Transform())
    assert fold(estimator, [*seen[:3], strange, *seen[3:]]) == fold(estimator, seen)  # of no use for x0
    begun = fold(estimator, seen)
    assert fold(estimator, [strange], begun).track.cones == begun.track.cones


def test_covariance_stays_positive_over_a_long_flight(estimator, cones):
    track = fold(estimator, cones(np.random.default_rng(5), 2000, arm_rad=0.3)).track
    eigenvalues = np.linalg.eigvalsh([[track.pxx, track.pxy], [track.pxy, track.pyy]])
    assert eigenvalues[0] > 1.0
    assert eigenvalues[1] < 100.0


def test_arrays_of_a_hypothesis_are_read_only(estimator, cones):
    hypothesis = estimator.hypothesis(fold(estimator, cones(np.random.default_rng(6), 10)), step_at(2_000_000_000 * NS))
    with pytest.raises(ValueError, match="read-only"):
        hypothesis.position[0] = 1.0
