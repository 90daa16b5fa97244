"""Statistics of many flights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from radron.sim.result import RunResult
from radron.sim.scoring.statistics import (
    ecdf,
    hypothesis_steps,
    mean,
    median,
    median_interval,
    settling_times,
    share_interval,
    summarise,
)


def run(seed: int = 0, **changes: object) -> RunResult:
    fields: dict[str, object] = {
        "scenario": "s",
        "seed": seed,
        "estimator": "paper",
        "drones": 3,
        "time_to_x0_s": 30.0,
        "x0_error_m": 4.0,
        "tracking_time_s": 180.0,
        "lost": False,
        "error_median_m": 2.0,
        "error_mean_m": 2.5,
        "error_p90_m": 4.0,
        "nees_mean": 2.0,
        "cones": 100,
        "hits": 1000,
        "min_separation_m": 5.0,
        "fence_breaches": 0,
        "sim_s": 250.0,
        "wall_s": 2.0,
        "realtime_factor": 125.0,
    } | changes
    return RunResult(**fields)  # type: ignore[arg-type]


NOTHING = {
    "time_to_x0_s": None,
    "x0_error_m": None,
    "tracking_time_s": 0.0,
    "lost": True,
    "error_median_m": None,
    "error_mean_m": None,
    "error_p90_m": None,
    "nees_mean": None,
}


def test_a_run_without_x0_counts_as_the_slowest_in_the_median() -> None:
    summary = summarise([run(0, time_to_x0_s=10.0), run(1, time_to_x0_s=20.0), run(2, **NOTHING)])
    assert (summary.runs, summary.found, summary.lost) == (3, 2, 1)
    assert summary.time_to_x0_median_s == 20.0
    assert summary.time_to_x0_max_s == 20.0
    assert summary.tracking_time_mean_s == pytest.approx(120.0)
    assert summary.error_median_m == 2.0


def test_no_median_time_where_most_runs_found_nothing() -> None:
    summary = summarise([run(0, time_to_x0_s=10.0), run(1, **NOTHING), run(2, **NOTHING)])
    assert summary.time_to_x0_median_s is None
    assert summary.time_to_x0_max_s == 10.0
    assert summary.error_median_m == 2.0  # of the only run that tracked


def test_no_runs_and_no_numbers_give_none() -> None:
    assert summarise([]).error_median_m is None
    summary = summarise([run(0, **NOTHING)])
    assert summary.error_mean_m is None
    assert summary.time_to_x0_max_s is None
    assert summary.tracking_time_max_s == 0.0


def test_separation_and_breaches_over_all_runs() -> None:
    summary = summarise(
        [run(0, min_separation_m=4.0), run(1, min_separation_m=3.2, fence_breaches=2), run(2, min_separation_m=None)]
    )
    assert summary.min_separation_m == 3.2
    assert summary.fence_breaches == 2
    assert summarise([run(0, min_separation_m=None)]).min_separation_m is None


def test_error_is_the_median_over_runs_of_their_medians_and_the_mean_of_means() -> None:
    runs = [
        run(k, error_median_m=median_m, error_mean_m=mean_m) for k, (median_m, mean_m) in enumerate([(1, 2), (2, 3), (9, 10)])
    ]
    summary = summarise(runs)
    assert summary.error_median_m == 2
    assert summary.error_mean_m == 5


@given(st.lists(st.floats(0.0, 1e4), min_size=1, max_size=40), st.randoms(use_true_random=False))
def test_the_order_of_the_runs_does_not_matter(errors: list[float], random: object) -> None:
    runs = [run(k, error_median_m=error, error_mean_m=error, time_to_x0_s=error) for k, error in enumerate(errors)]
    shuffled = list(runs)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    assert summarise(shuffled) == summarise(runs)
    assert median(errors) == pytest.approx(float(np.median(errors)))
    assert mean(errors) == pytest.approx(float(np.mean(errors)))


def test_median_interval_has_the_promised_coverage() -> None:
    values = list(range(1, 51))
    low, high = median_interval(values)
    assert (low, high) == (18, 33)  # the tabulated order statistics for n = 50
    assert 1 - 2 * binom.cdf(low - 1, 50, 0.5) >= 0.95
    assert 1 - 2 * binom.cdf(low, 50, 0.5) < 0.95
    assert median_interval([1.0, 2.0, 3.0]) == (None, None)
    assert median_interval([]) == (None, None)
    assert median_interval([1.0] * 10 + [math.inf] * 10) == (1.0, None)


def test_ecdf_is_over_all_runs() -> None:
    values, share = ecdf([3.0, None, 1.0, 2.0])
    assert values.tolist() == [1.0, 2.0, 3.0]
    assert share.tolist() == [0.25, 0.5, 0.75]
    assert ecdf([None])[0].size == 0


def test_steps_of_the_hypothesis() -> None:
    time = np.arange(0.0, 10.0)
    position = np.zeros((10, 3))
    position[:2] = np.nan
    position[5:, 0] = 10.0
    position[8:, 1] = 1.0
    assert hypothesis_steps(time, position, 5.0).tolist() == [5.0]


def test_settling_is_when_all_are_back_for_good() -> None:
    time = np.arange(0.0, 20.0)
    error = np.zeros((20, 2))
    error[5:9, 1] = -20.0
    error[7, 0] = 30.0
    error[11, 0] = 6.0  # leaves once more
    error[15:, 0] = 9.0  # and never comes back after the second step
    assert settling_times(time, error, np.array([5.0, 15.0, 30.0]), 5.0).tolist()[:2] == [7.0, math.inf]
    assert math.isnan(settling_times(time, error, np.array([30.0]), 5.0)[0])
    assert settling_times(time, np.zeros((20, 2)), np.array([5.0]), 5.0).tolist() == [0.0]
    assert settling_times(time, np.full((20, 2), np.nan), np.array([5.0]), 5.0).tolist() == [math.inf]
    one_left = np.column_stack((np.where(time < 12.0, -20.0, 0.0), np.full(20, np.nan)))
    assert settling_times(time, one_left, np.array([5.0]), 5.0).tolist() == [7.0]


def test_coverage_counts_the_runs_whose_region_holds_the_truth() -> None:
    regions = [0.1, 0.5, 0.6, 0.9, 0.95, None]
    summary = summarise([run(seed, region=region) for seed, region in enumerate(regions)])
    assert (summary.sampled, summary.in_50, summary.in_90) == (5, 2, 4)


def test_the_ratio_to_the_bound_is_taken_run_by_run() -> None:
    errors_bounds = [(1.0, 0.5), (6.0, 2.0), (4.0, 4.0), (9.0, None), (None, 1.0)]
    summary = summarise([run(k, error_median_m=e, bound_median_m=b) for k, (e, b) in enumerate(errors_bounds)])
    assert summary.error_over_bound == 2.0
    assert summary.bound_median_m == 1.5


def test_flights_without_a_source_are_counted() -> None:
    found_nothing = run(0, nothing_found=True, excluded_bq=5e7, **NOTHING)
    summary = summarise([found_nothing, run(1, false_hypothesis=True), run(2, nothing_found=True, excluded_bq=7e7, **NOTHING)])
    assert (summary.nothing_found, summary.false_hypotheses, summary.excluded_median_bq) == (2, 1, 6e7)


def test_nine_tenths_of_the_errors_of_x0() -> None:
    summary = summarise([run(k, x0_error_m=float(k), x0_rms_m=5.0 + k) for k in range(11)])
    assert (summary.x0_error_p90_m, summary.x0_rms_median_m, summary.x0_rms_max_m) == (9.0, 10.0, 15.0)


@pytest.mark.parametrize(("hits", "of"), [(0, 20), (7, 20), (180, 200), (200, 200)])
def test_the_interval_of_a_share_leaves_so_much_beyond_each_end(hits: int, of: int) -> None:
    interval = share_interval(hits, of)
    assert interval is not None
    low, high = interval
    assert low <= hits / of <= high
    assert binom.sf(hits - 1, of, low) == pytest.approx(0.025 if hits else 1.0)
    assert binom.cdf(hits, of, high) == pytest.approx(0.025 if hits < of else 1.0)


def test_no_trial_has_no_interval() -> None:
    assert share_interval(0, 0) is None
