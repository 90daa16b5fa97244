"""Errors against the truth, and whether their stated uncertainty matches."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from radron.sim.scoring.score import Claim, Score
from radron.sim.scoring.statistics import ecdf

Array = np.ndarray
SOURCE = (10.0, 20.0)


@dataclass
class Sight:
    position: Array


@dataclass
class Belief:
    position: Array
    covariance: Array
    activity_bq: float | None = None
    activity_sigma_bq: float | None = None
    evidence: float | None = None
    sights: dict[str, Array] = field(default_factory=dict)

    def sight_of(self, drone: str) -> Sight:
        return Sight(self.sights.get(drone, self.position))


def at(x: float, y: float, variance: float = 1.0, **more: object) -> Belief:
    return Belief(np.array([x, y, 0.0]), variance * np.diag([1.0, 1.0, 0.0]), **more)


def score(drones: int = 2, sample_after_s: float = 1.0) -> Score:
    return Score("bayes", [f"d{k + 1}" for k in range(drones)], sample_after_s)


def test_the_error_in_a_vehicles_own_frame_is_against_the_source_as_its_localisation_sees_it() -> None:
    """Each vehicle is wrong about where it is; a sight that is wrong by just as much has no error for that vehicle."""
    biases = np.array([[1.0, 0.0, 5.0], [0.0, -2.0, 5.0]])
    belief = at(10.0, 20.3, sights={"d1": np.array([11.0, 20.0, 0.0]), "d2": np.array([10.0, 18.5, 0.0])})
    scored = score()
    scored.sample(0.2, [belief, belief], SOURCE, biases)
    assert scored.relative_m == pytest.approx([0.0, 0.5])
    assert scored.errors_m == pytest.approx([0.3, 0.3])


def test_an_estimator_that_knows_no_biases_is_off_by_them_in_the_vehicles_frames() -> None:
    scored = score()
    scored.sample(0.2, [at(*SOURCE), None], SOURCE, np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]]))
    assert scored.errors_m == [0.0]
    assert scored.relative_m == [5.0]


def test_where_position_errors_are_unknown_there_is_no_relative_error() -> None:
    scored = score()
    scored.sample(0.2, [at(*SOURCE), at(*SOURCE)], SOURCE, None)
    assert scored.relative_m == []
    assert len(scored.errors_m) == 2


def test_x0_is_noted_once_with_its_own_claim() -> None:
    scored = score()
    scored.record_x0(1.0, None, SOURCE)
    scored.record_x0(2.0, at(13.0, 24.0, variance=8.0), SOURCE)
    scored.record_x0(3.0, at(*SOURCE), SOURCE)
    assert (scored.x0_s, scored.x0_error_m, scored.x0_rms_m) == (2.0, 5.0, 4.0)


def test_without_a_source_a_first_hypothesis_has_no_error_to_give() -> None:
    scored = score()
    scored.record_x0(2.0, at(1.0, 1.0), None)
    assert (scored.x0_s, scored.x0_error_m) == (2.0, None)
    assert scored.x0_rms_m == pytest.approx(2.0**0.5)


def test_one_claim_of_the_first_drone_half_way_through() -> None:
    scored = score(sample_after_s=1.0)
    for tracked_s, off in ((0.5, 3.0), (1.0, 2.0), (1.5, 1.0)):
        scored.sample(tracked_s, [at(10.0 + off, 20.0, 4.0), at(50.0, 50.0)], SOURCE, None)
    assert scored.sampled == Claim(2.0, 1.0)


def test_a_run_that_ends_before_gives_its_last_claim() -> None:
    scored = score(sample_after_s=100.0)
    for tracked_s, off in ((0.5, 3.0), (1.0, 2.0)):
        scored.sample(tracked_s, [at(10.0 + off, 20.0), None], SOURCE, None)
    assert scored.sampled == Claim(2.0, 4.0)


def test_a_calibrated_estimators_regions_are_uniform() -> None:
    """Errors drawn from the very covariance that is claimed: the truth is in the p region with probability p."""
    rng = np.random.default_rng(1)
    covariance = np.array([[4.0, 1.5, 0.0], [1.5, 1.0, 0.0], [0.0, 0.0, 0.0]])
    regions = []
    for error in rng.multivariate_normal([0.0, 0.0], covariance[:2, :2], 4000):
        one = score(1)
        one.sample(5.0, [Belief(np.array([*(np.array(SOURCE) + error), 0.0]), covariance)], SOURCE, None)
        assert one.sampled is not None
        regions.append(one.sampled.region)
    values, share = ecdf(regions)
    assert np.abs(values - share).max() < 1.63 / 4000**0.5  # Kolmogorov and Smirnov at the level of 1 %


def test_a_covariance_without_extent_claims_nothing() -> None:
    scored = score(1)
    scored.sample(5.0, [at(*SOURCE, variance=0.0)], SOURCE, None)
    assert scored.nees == []
    assert scored.sampled is not None
    assert scored.sampled.region is None
