"""Statistics of many flights. Pure: lists of results in, numbers out.

Definitions that the paper leaves open:

- **Time to x0**: a run without x0 counts as longer than any other in the median, which is None where more than half of the runs
  had none; the maximum is over the runs with x0, and ``found`` is their number.
- **Tracking time**: over all runs; a run without tracking has 0 s.
- **Estimation error**: every run gives the median (mean) of its horizontal error over all its tracking samples; ours is the
  median (mean) of these over the runs. Lost runs are included; runs without tracking have no error.
- **Coverage**: with one sample per run, half-way through the tracking, the share of runs whose truth lies in the 50 % (90 %)
  region of the posterior; for a calibrated estimator that is half (nine tenths) of the runs.
- **Bound**: each run has its own, for its trajectories (``radron.sim.scoring.bound``); the ratio is the median over the runs of
  each run's error over its bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct
from scipy.stats import beta, binom

from radron.sim.geometry import Array
from radron.sim.result import RunResult


class Summary(Struct, frozen=True, kw_only=True):
    """Statistics of a group of simulated flights. Times in s, errors in m; None where no flight gives the number."""

    runs: int
    found: int  # declared x0
    lost: int
    time_to_x0_median_s: float | None
    time_to_x0_low_s: float | None  # 95 % interval of the median; high is None beyond the runs that declared x0
    time_to_x0_high_s: float | None
    time_to_x0_max_s: float | None
    x0_error_median_m: float | None
    tracking_time_mean_s: float | None
    tracking_time_max_s: float | None
    error_median_m: float | None
    error_low_m: float | None
    error_high_m: float | None
    error_mean_m: float | None
    error_p90_m: float | None  # median over the runs of their 90th percentiles
    nees_median: float | None
    min_separation_m: float | None
    fence_breaches: int
    realtime_factor_median: float | None
    x0_error_p90_m: float | None
    x0_rms_median_m: float | None
    x0_rms_max_m: float | None
    error_relative_median_m: float | None
    bound_median_m: float | None
    bound_relative_median_m: float | None
    error_over_bound: float | None
    sampled: int  # runs with a region; in_50, in_90: of these, the truths in the 50 % and 90 % region
    in_50: int
    in_90: int
    nothing_found: int
    excluded_median_bq: float | None
    false_hypotheses: int


def summarise(results: Sequence[RunResult]) -> Summary:
    """Compute the statistics of a group of simulated flights; the module's docstring defines the numbers."""
    times = [math.inf if result.time_to_x0_s is None else result.time_to_x0_s for result in results]
    tracking = [result.tracking_time_s for result in results]
    errors = _known(result.error_median_m for result in results)
    time_low, time_high = median_interval(times)
    error_low, error_high = median_interval(errors)
    x0_errors = _known(result.x0_error_m for result in results)
    x0_rms = _known(result.x0_rms_m for result in results)
    regions = _known(result.region for result in results)
    return Summary(
        runs=len(results),
        found=sum(math.isfinite(time) for time in times),
        lost=sum(result.lost for result in results),
        time_to_x0_median_s=median(times),
        time_to_x0_low_s=time_low,
        time_to_x0_high_s=time_high,
        time_to_x0_max_s=max((time for time in times if math.isfinite(time)), default=None),
        x0_error_median_m=median(x0_errors),
        tracking_time_mean_s=mean(tracking),
        tracking_time_max_s=max(tracking, default=None),
        error_median_m=median(errors),
        error_low_m=error_low,
        error_high_m=error_high,
        error_mean_m=mean(_known(result.error_mean_m for result in results)),
        error_p90_m=median(_known(result.error_p90_m for result in results)),
        nees_median=median(_known(result.nees_mean for result in results)),
        min_separation_m=min(_known(result.min_separation_m for result in results), default=None),
        fence_breaches=sum(result.fence_breaches for result in results),
        realtime_factor_median=median([result.realtime_factor for result in results]),
        x0_error_p90_m=float(np.quantile(x0_errors, 0.9)) if x0_errors else None,
        x0_rms_median_m=median(x0_rms),
        x0_rms_max_m=max(x0_rms, default=None),
        error_relative_median_m=median(_known(result.error_relative_median_m for result in results)),
        bound_median_m=median(_known(result.bound_median_m for result in results)),
        bound_relative_median_m=median(_known(result.bound_relative_median_m for result in results)),
        error_over_bound=median(_known(error_over_bound(result) for result in results)),
        sampled=len(regions),
        in_50=sum(region <= 0.5 for region in regions),
        in_90=sum(region <= 0.9 for region in regions),
        nothing_found=sum(result.nothing_found for result in results),
        excluded_median_bq=median(_known(result.excluded_bq for result in results)),
        false_hypotheses=sum(result.false_hypothesis for result in results),
    )


def error_over_bound(result: RunResult) -> float | None:
    """Return the ratio of a flight's median error to its theoretical bound; None without an error or a bound."""
    if result.error_median_m is None or not result.bound_median_m:
        return None
    return result.error_median_m / result.bound_median_m


def share_interval(hits: int, of: int, level: float = 0.95) -> tuple[float, float] | None:
    """Return the confidence interval of a probability from ``hits`` in ``of`` trials (Clopper and Pearson, exact).

    Return None without a trial.
    """
    if of == 0:
        return None
    tail = (1.0 - level) / 2.0
    low = float(beta.ppf(tail, hits, of - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, of - hits)) if hits < of else 1.0
    return low, high


def median(values: Sequence[float]) -> float | None:
    """Return the median; infinite values count as the largest. None without values, or if the median is infinite."""
    ordered = sorted(values)
    if not ordered:
        return None
    middle = len(ordered) // 2
    value = ordered[middle] if len(ordered) % 2 else (ordered[middle - 1] + ordered[middle]) / 2.0
    return _finite(value)


def mean(values: Sequence[float]) -> float | None:
    """Return the mean, exactly rounded, so that it does not depend on the order; None without values."""
    return math.fsum(values) / len(values) if values else None


def median_interval(values: Sequence[float], level: float = 0.95) -> tuple[float | None, float | None]:
    """Return the confidence interval of the median from order statistics (binomial; no assumption about the distribution).

    The k-th smallest and k-th largest value enclose the median with probability 1 - 2 P(Binomial(n, 1/2) < k); k is the
    largest with a probability of at least ``level``. An infinite end is None; both are None with too few values.
    """
    ordered = sorted(values)
    count = len(ordered)
    k = int(binom.ppf((1.0 - level) / 2.0, count, 0.5)) if count else 0
    if k < 1:
        return None, None
    return _finite(ordered[k - 1]), _finite(ordered[count - k])


def ecdf(values: Iterable[float | None]) -> tuple[Array, Array]:
    """Return the empirical distribution of a number over many flights, for a plot.

    The result is the sorted values (M,) and, for each, the share (M,) of *all* flights at or below it. A value of None counts as
    never reached.
    """
    everything = list(values)
    known = np.sort(np.array(_known(everything), dtype=np.float64))
    return known, np.arange(1, known.size + 1) / max(len(everything), 1)


def hypothesis_steps(time_s: Array, hypothesis_m: Array, at_least_m: float) -> Array:
    """Return the times (J,) at which a source estimate jumped horizontally by ``at_least_m`` or more between two samples.

    time_s: (T,); hypothesis_m: (T, 3), NaN without an estimate.
    """
    jump = np.linalg.norm(np.diff(hypothesis_m[:, :2], axis=0), axis=1)
    return np.asarray(time_s[1:][jump >= at_least_m], dtype=np.float64)


def settling_times(time_s: Array, error: Array, steps_s: Array, within: float) -> Array:
    """Return how long after each step a group of N errors takes to settle: no |error| is above ``within`` until the next step.

    time_s: (T,) s; error: (T, N), NaN for an absent member; rows without any member count as not settled. steps_s: (J,) s.
    Returns (J,) s, infinite if the end of the interval is not settled, NaN if no sample follows the step.
    """
    outside = np.any(np.abs(error) > within, axis=1) | np.all(np.isnan(error), axis=1)
    ends = np.append(steps_s[1:], np.inf)
    settled = np.full(len(steps_s), np.nan)
    for index, (start, end) in enumerate(zip(steps_s, ends, strict=True)):
        inside = np.flatnonzero((time_s >= start) & (time_s < end))
        if inside.size == 0:
            continue
        late = inside[outside[inside]]
        if late.size == 0:
            settled[index] = 0.0
        else:
            settled[index] = np.inf if late[-1] == inside[-1] else time_s[late[-1] + 1] - start
    return settled


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
