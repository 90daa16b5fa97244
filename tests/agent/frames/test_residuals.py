import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.frames.residuals import (
    fix_evidence,
    fix_residuals,
    inlier_probability,
    sighting_evidence,
    sighting_residuals,
    turned,
)

SMALL = 1e-6


def drawn(seed, count=8):
    """Poses (M, 4) of observers and targets some 20 m apart, displacements, and the measurements."""
    rng = np.random.default_rng(seed)
    observer = np.concatenate([rng.uniform(-20, 20, (count, 3)), rng.uniform(-3, 3, (count, 1))], axis=1)
    target = observer + np.concatenate(
        [rng.choice([-1, 1], (count, 3)) * rng.uniform(2, 20, (count, 3)), rng.uniform(-3, 3, (count, 1))], 1
    )
    moved = rng.uniform(-3, 3, (2, count, 3))
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return observer, target, moved[0], moved[1], direction, rng.uniform(1, 40, count)


def numerical(function, poses):
    """(M, K, 4) derivative of function(poses) (M, K) by each row's own pose."""
    columns = []
    for axis in range(4):
        step = np.zeros(4)
        step[axis] = SMALL
        columns.append((function(poses + step) - function(poses - step)) / (2 * SMALL))
    return np.stack(columns, axis=-1)


@given(st.integers(0, 2**32))
def test_jacobians_of_sightings_are_those_of_differences(seed):
    observer, target, *rest = drawn(seed)
    _, by_observer, by_target = sighting_residuals(observer, target, *rest)
    np.testing.assert_allclose(by_observer, numerical(lambda p: sighting_residuals(p, target, *rest)[0], observer), atol=1e-6)
    np.testing.assert_allclose(by_target, numerical(lambda p: sighting_residuals(observer, p, *rest)[0], target), atol=1e-6)


@given(st.integers(0, 2**32))
def test_jacobians_of_fixes_are_those_of_differences(seed):
    pose, _, moved, place, _, _ = drawn(seed)
    _, jacobian = fix_residuals(pose, moved, place)
    np.testing.assert_allclose(jacobian, numerical(lambda p: fix_residuals(p, moved, place)[0], pose), atol=1e-6)


@given(st.integers(0, 2**32))
def test_what_is_measured_without_error_leaves_no_residual(seed):
    observer, target, moved_observer, moved_target, *_ = drawn(seed)
    apart = target[:, :3] + turned(target[:, 3], moved_target) - observer[:, :3] - turned(observer[:, 3], moved_observer)
    distance = np.linalg.norm(apart, axis=1)
    direction = turned(-observer[:, 3], apart / distance[:, None])
    residual, _, _ = sighting_residuals(observer, target, moved_observer, moved_target, direction, distance)
    np.testing.assert_allclose(residual, 0.0, atol=1e-9)
    opposite, _, _ = sighting_residuals(observer, target, moved_observer, moved_target, -direction, distance)
    np.testing.assert_allclose(np.linalg.norm(opposite[:, :3], axis=1), 2.0, atol=1e-9)


def test_what_fits_is_believed_and_what_does_not_is_not():
    sigma = math.radians(2.0)

    def of(angle, off_m):
        chord = 2.0 * math.sin(angle / 2.0)
        return float(
            inlier_probability(*sighting_evidence(np.array(chord**2), np.array(sigma**2), np.array(off_m**2), np.array(0.09)))
        )

    assert of(sigma, 0.3) > 0.99
    assert of(sigma, 3.0) < 0.01  # a range that is wrong makes the direction with it worth nothing
    assert of(math.radians(20.0), 0.0) < 0.01
    assert of(math.pi, 0.0) < 0.01


def test_a_part_that_was_not_measured_counts_neither_way():
    one, var, none = np.array([0.5]), np.array([0.04]), np.array([np.inf])
    true, false = sighting_evidence(one, none, one, var)
    assert true - false == pytest.approx(
        math.log(0.9 / 0.1) - 0.5 * 0.5 / 0.04 - 0.5 * math.log(2 * math.pi * 0.04) + math.log(60.0), abs=1e-12
    )
    assert inlier_probability(*sighting_evidence(one, none, one, none)) == pytest.approx(0.9)


def test_a_fix_that_is_twenty_metres_off_is_a_false_one():
    var = np.full((2, 3), 1.0)
    good, bad = inlier_probability(*fix_evidence(np.array([[1.0, 4.0, 1.0], [400.0, 0.0, 0.0]]), var))
    assert good > 0.99
    assert bad < 0.01
