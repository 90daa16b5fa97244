"""Flights among several sources in a small area, by the estimator without given number and nuclides."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.sim import api
from radron.sim.world.sourcetruth import SourceTruth

SIDE_M = 44.0
STRONG = SourceTruth(activity_bq=2e9, start_m=(12.0, 20.0))
WEAK = SourceTruth(activity_bq=2e8, nuclide="Cs-137", start_m=(32.0, 20.0))
OUTSIDE = SourceTruth(activity_bq=1e8, nuclide="Co-60", start_m=(100.0, 20.0))


def flown(sources, seconds, name="many-ideal", **settings):
    """Three drones; sources of 0.1 GBq are searched for."""
    changes = {"mission.survey.least_activity_bq": 1e8, "end.after_s": seconds, **settings}
    scenario = api.load(name, changes)
    square = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
    mission = replace(scenario.mission, area=replace(scenario.mission.area, polygon_m=square))
    return api.fly(replace(scenario, mission=mission, random_sources=None, sources=sources), seed=1, estimator="sources")


def away_m(trace, source, since_s, until_s):
    """(samples, 3) horizontal distances of the drones from a source."""
    times = (trace.time_s >= since_s) & (trace.time_s < until_s)
    return np.hypot(*np.moveaxis(trace.position_m[times, :, :2] - source.start_m, -1, 0))


@pytest.mark.slow
def test_a_weak_source_beside_a_strong_one_is_found_and_the_named_one_circled_until_nothing_is_left_to_search():
    """2 GBq and 0.2 GBq, 20 m apart, and a third source, not announced, 56 m outside the area.

    Each is circled, what more may hide is searched for, and then the policy decides.
    """
    seconds = 240.0  # with looks whether one of them moves; the last of the search ends about 220 s after the start
    flight = flown((STRONG, replace(WEAK, nuclide="Co-60"), OUTSIDE), seconds, **{"mission.track.policy": "Co-60"})
    trace, result = flight.trace, flight.result
    found_s = min(estimate.time_s for estimate in trace.estimates if len(estimate.sources) == 2)
    assert (result.sources_found, result.false_sources, result.nuclides_right) == (2, 0, 2)
    stages = trace.swarm_stage
    assert {"survey", "track"} <= set(stages[trace.time_s > found_s])
    assert stages[-1] == "track"
    assert len(trace.left_m) == 0
    assert 0.0 < max(result.excluded_nuclides_bq.values()) == result.excluded_bq
    assert np.median(away_m(trace, WEAK, trace.time_s[-1] - 10.0, np.inf)) < 13.0


@pytest.mark.slow
def test_a_search_where_nothing_is_ends_when_everything_is_excluded():
    flight = flown((), 150.0)
    assert flight.result.nothing_found
    assert set(flight.trace.stage[-1]) <= {"return", "landing", "landed"}
    assert flight.result.excluded_bq < 2e8
    assert flight.result.sources_found == 0


@pytest.mark.slow
def test_a_source_above_the_ground_is_circled_at_two_heights():
    """3.6 m high, of a nuclide without cones: its mirror image below the lower circle is 1 m high."""
    high = SourceTruth(activity_bq=1e9, nuclide="Co-57", start_m=(20.0, 24.0), height_m=3.6)
    flight = flown((high,), 100.0, **{"mission.source_height_m": [0.0, 20.0]})
    trace, result = flight.trace, flight.result
    circling = (away_m(trace, high, 0.0, np.inf) < 9.0) & (trace.stage == "track")
    heights = trace.position_m[..., 2][circling]
    assert np.quantile(heights, 0.1) < 2.8
    assert 5.5 < heights.max() < 6.6
    assert (result.sources_found, result.false_sources) == (1, 0)
    assert result.height_error_median_m < 0.4
    assert result.min_separation_m > 3.0


@pytest.mark.slow
def test_over_soil_number_nuclides_and_activities_are_right():
    """Most counted photons are scattered by soil: without their spectra both sources were reported with unknown nuclides."""
    cobalt = SourceTruth(activity_bq=1e9, nuclide="Co-60", start_m=(32.0, 14.0))
    result = flown((SourceTruth(activity_bq=3e9, start_m=(12.0, 30.0)), cobalt), 110.0, "many-soil").result
    assert (result.sources_found, result.false_sources, result.nuclides_right) == (2, 0, 2)
    assert result.activity_error_median < 0.1
