"""Estimated sources against true ones: the matching, and the resulting scores."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.protocol.messages import Source as Found
from radron.sim.scoring.heard import Heard
from radron.sim.scoring.sourcescore import SourceScore, score_sources
from radron.sim.world.frame import LocalFrames
from radron.sim.world.sources import Source


def true(x, y, nuclide="Cs-137", activity_bq=1e9, z=0.0):
    return Source(nuclide, activity_bq, (x, y, z))


def found(x, y, nuclide="Cs-137", activity_bq=1e9, z=0.0, sigma_m=1.0, sigma_z_m=0.0):
    covariance = (sigma_m**2, 0.0, 0.0, sigma_m**2, 0.0, sigma_z_m**2)
    return Found(position_m=(x, y, z), covariance_m2=covariance, nuclide=nuclide, activity_bq=activity_bq)


def test_three_sources_of_which_one_is_missed_and_one_estimate_is_false():
    truths = [true(10.0, 10.0), true(30.0, 10.0, "Co-60", 2e9), true(80.0, 80.0, "Ir-192")]
    told = [found(30.4, 10.3, "Co-60", 2.2e9), found(10.0, 9.0, "Co-60", 0.7e9), found(60.0, 60.0, "Cs-137")]
    assert score_sources(truths, told) == SourceScore(
        sources_true=3,
        sources_found=3,
        number_right=False,  # a missed source, a false one
        false_sources=1,
        nuclides_right=1,
        matched_error_median_m=pytest.approx(0.75),
        matched_error_p90_m=pytest.approx(0.95),
        activity_error_median=pytest.approx(0.2),
        in_region_90=1.0,
        height_error_median_m=None,
    )


def test_the_matching_is_the_best_of_all_not_the_nearest_first():
    """The estimate in the middle is nearest to the first truth, but then the other one would match nothing."""
    truths, told = [true(0.0, 0.0), true(6.0, 0.0)], [found(-4.9, 0.0), found(2.5, 0.0)]
    score = score_sources(truths, told)
    assert score.number_right
    assert score.matched_error_median_m == pytest.approx((4.9 + 3.5) / 2.0)


def test_two_nuclides_at_one_place_are_matched_by_their_nuclides():
    truths = [true(0.0, 0.0, "Cs-137"), true(0.3, 0.0, "Co-60")]
    told = [found(0.0, 0.0, "Co-60"), found(0.3, 0.0, "Cs-137")]
    score = score_sources(truths, told)
    assert (score.nuclides_right, score.matched_error_median_m) == (2, pytest.approx(0.3))


def test_a_source_of_an_unknown_nuclide_is_not_taken_for_one_of_the_missions():
    heard = Heard(LocalFrames([((0.0, 0.0, 0.0), 0.0)]), "Cs-137")
    told = found("Cs-137", 0.0, 0.0, 1e9)
    assert heard._told(replace(told, nuclide=None)).nuclide == "Cs-137"
    assert heard._told(replace(told, nuclide=None, lines_kev=())).nuclide == "unknown"


def test_an_estimate_beyond_the_limit_is_false_and_its_source_is_missed():
    assert score_sources([true(0.0, 0.0)], [found(3.0, 3.99)]).false_sources == 0
    far = score_sources([true(0.0, 0.0)], [found(3.0, 4.01)])
    assert (far.false_sources, far.number_right, far.matched_error_median_m, far.in_region_90) == (1, False, None, None)


def test_nothing_there_and_nothing_told_is_right_and_anything_told_is_false():
    nothing = score_sources([], [])
    assert (nothing.sources_true, nothing.sources_found, nothing.number_right, nothing.false_sources) == (0, 0, True, 0)
    assert nothing.matched_error_median_m is None
    false = score_sources([], [found(1.0, 2.0)])
    assert (false.number_right, false.false_sources) == (False, 1)


def test_the_90_percent_region_is_that_of_a_gaussian_over_the_plane():
    edge_m = 2.0 * np.sqrt(-2.0 * np.log(0.1))
    truths = [true(0.0, 0.0), true(50.0, 0.0)]
    told = [found(0.999 * edge_m, 0.0, sigma_m=2.0), found(50.0, 1.001 * edge_m, sigma_m=2.0)]
    assert score_sources(truths, told).in_region_90 == 0.5


def test_heights_count_where_they_are_estimated_and_not_where_they_follow_from_the_ground():
    truths = [true(0.0, 0.0, z=12.0), true(50.0, 0.0, z=3.0)]
    told = [found(0.0, 0.0, z=11.5, sigma_z_m=0.4), found(50.0, 0.0, z=0.0)]
    assert score_sources(truths, told).height_error_median_m == pytest.approx(0.5)
    # On a slope of 0.5 to the east, z = 0.5 x: zz = 0.25, xz = 0.5.
    slope = Found(position_m=(0.0, 0.0, 0.0), covariance_m2=(1.0, 0.0, 0.5, 1.0, 0.0, 0.25))
    assert score_sources(truths[:1], [slope]).height_error_median_m is None
