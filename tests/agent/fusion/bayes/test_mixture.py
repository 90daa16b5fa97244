"""The Gaussian sum of the Bayesian estimator: its start from the search, and its prediction."""

import numpy as np
import pytest

from radron.agent.fusion.bayes.mixture import Mixture
from radron.agent.fusion.bayes.motion import ACTIVITY, BIAS, BIASES, GAIN, Motion

MOTION = Motion(
    velocity_variance=np.array([0.0, 0.49, 4.0]),
    velocity_s=np.array([1e9, 120.0, 5.0]),
    switching_ps=np.array([[0.0, 5e-4, 5e-4], [5e-4, 0.0, 3e-3], [5e-4, 3e-3, 0.0]]),
    bias_drift=np.array([9e-4, 9e-4, 2.7e-5, 9e-6]),
)
SIGMA_M, BIAS_M = 2.0, 1.0


def of_one_place(*heard):
    """Three vehicles; the heard ones have biases of 1 m."""
    biases = np.zeros((3, BIAS))
    biases[list(heard)] = [BIAS_M**2, BIAS_M**2, 0.0027, 0.0025]
    one = np.ones(1)
    return Mixture.of_sites(
        100.0, np.array([[0.5, 0.3, 0.2]]), 10 * one, 20 * one, SIGMA_M * one, 0 * one, 0.3 * one, MOTION, biases.ravel()
    )


@pytest.mark.parametrize("heard", [(0,), (0, 2), (0, 1, 2)])
def test_a_search_by_biased_vehicles_knows_the_true_place_less_well(heard):
    """The search knows the place where the vehicles see the source: the true place is off by the mean of their biases."""
    covariance = of_one_place(*heard).covariance[0, 0]
    count = len(heard)
    assert covariance[0, 0] == pytest.approx(SIGMA_M**2 + BIAS_M**2 / count)
    seen = np.zeros(len(covariance))
    seen[0] = seen[BIASES + BIAS * heard[0]] = 1.0  # where the first vehicle sees it
    assert seen @ covariance @ seen == pytest.approx(SIGMA_M**2 + BIAS_M**2 * (1.0 - 1.0 / count))
    common = np.zeros(len(covariance))
    common[0] = 1.0
    common[BIASES + BIAS * np.array(heard)] = 1.0 / count  # and where they see it in the mean
    assert common @ covariance @ common == pytest.approx(SIGMA_M**2)
    counted = np.zeros(len(covariance))
    counted[ACTIVITY] = 1.0
    counted[BIASES + BIAS * np.array(heard) + GAIN] = 1.0 / count
    assert counted @ covariance @ counted == pytest.approx(0.09)


def test_modes_stay_probabilities_however_long_nothing_is_heard():
    track = of_one_place(0)
    for time_s in (101.0, 150.0, 5000.0):
        track = track.later(MOTION, time_s)
        assert track.weight.min() >= 0.0
        assert track.weight.sum() == pytest.approx(1.0)
        assert np.linalg.eigvalsh(track.covariance).min() > -1e-9
    assert track.weight[0] == pytest.approx(np.full(3, 1 / 3), abs=0.05)  # the rates are the same both ways


def test_what_rests_stays_and_what_runs_may_be_anywhere_near():
    later = of_one_place(0).later(MOTION, 100.9)  # the modes are not mixed yet
    spread = later.covariance[0, :, 0, 0]
    assert spread[0] == pytest.approx(SIGMA_M**2 + BIAS_M**2)
    assert spread[0] < spread[1] < spread[2]
    assert spread[2] == pytest.approx(spread[0] + 4.0 * 0.9**2, rel=0.05)


def test_biases_are_open_again_by_as_much_as_the_frame_was_moved():
    track = of_one_place(0, 1).later(MOTION, 160.0)
    told = (BIAS_M**2, BIAS_M**2, 0.0027, 0.0025)
    assert track.with_vehicle(0, told) is track
    moved = track.with_vehicle(0, told, (0.5, -2.0, 0.1, 0.0))
    more = np.diagonal(moved.covariance - track.covariance, axis1=-2, axis2=-1)
    expected = np.zeros(len(more[0, 0]))
    expected[BIASES : BIASES + BIAS] = [0.25, 4.0, 0.01, 0.0]
    np.testing.assert_allclose(more, np.broadcast_to(expected, more.shape), atol=1e-12)
    np.testing.assert_array_equal(moved.mean, track.mean)


def walking(weight, away_m, sigma_m=1.0):
    """A source that rests at (10, 20), known to 0.3 m, or walks with that probability, ``away_m`` east of there."""
    track = of_one_place(0)
    mean, covariance = track.mean.copy(), track.covariance.copy()
    mean[0, 1, 0] += away_m
    covariance[0, 0, :2, :2], covariance[0, 1, :2, :2] = 0.09 * np.eye(2), sigma_m**2 * np.eye(2)
    return Mixture(100.0, 100.0, np.array([[1.0 - weight, weight, 0.0]]), mean, covariance, track.bias_variance, track.hidden)


def told_sigmas(track, place):
    """The distance of the published Gaussian from a place."""
    mean, covariance = track.moments()
    off, told = np.array(place) - mean[:2], covariance[:2, :2] + track.hedge(mean, covariance)
    return np.sqrt(off @ np.linalg.solve(told, off))


@pytest.mark.parametrize("weight", [0.005, 0.01, 0.03])
def test_what_is_told_does_not_exclude_a_place_where_the_source_may_walk(weight):
    track = walking(weight, 6.0, 2.0)
    _, covariance = track.moments()
    assert np.sqrt(np.linalg.inv(covariance[:2, :2])[0, 0]) * 6.0 > 5.0  # else it would
    assert told_sigmas(track, (16.0, 20.0)) < 3.0
    assert told_sigmas(track, (16.0, 22.0)) < 4.5


@pytest.mark.parametrize(("weight", "away_m"), [(0.002, 6.0), (0.01, 0.5), (0.4, 6.0)])
def test_what_is_told_is_as_sure_as_the_sum_where_no_likely_mode_is_far_from_it(weight, away_m):
    track = walking(weight, away_m)
    assert track.hedge(*track.moments()) == pytest.approx(np.zeros((2, 2)))
