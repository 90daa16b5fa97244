"""A swarm over hills, in lockstep: its height above the ground, and whether it finds a source on it."""

import numpy as np
import pytest

from radron.protocol.messages import Stage
from radron.protocol.stages import CIRCLING
from radron.sim.lockstep.flight import fly
from radron.sim.scenario import load_scenario, override
from radron.sim.world.terrain import Terrain

GUIDED = (Stage.SURVEY, *CIRCLING)


@pytest.fixture(scope="module")
def flight():
    return fly(override(load_scenario("hilly"), {"end.track_s": 30.0}), seed=1)


@pytest.mark.slow
def test_the_source_is_found_on_its_slope(flight):
    result = flight.result
    assert not result.lost
    assert result.error_median_m is not None
    assert result.error_median_m < 0.5
    assert flight.trace.source_m[-1, 2] > 1.0  # off the mission frame's zero


@pytest.mark.slow
def test_the_swarm_keeps_its_height_above_the_ground(flight):
    trace, terrain = flight.trace, Terrain(load_scenario("hilly").terrain)
    guided = np.isin(trace.stage, GUIDED)
    places = trace.position_m[guided]
    above = terrain.above_ground(places)[:, 2]
    assert np.ptp(terrain.heights_m(places[:, 0], places[:, 1])) > 3.0  # there were hills
    assert above.min() > 1.5  # the floor
    assert np.median(above) == pytest.approx(2.4, abs=0.4)  # near a source that is known well: by the orbit
    assert above.max() < 6.0
    assert flight.result.fence_breaches == 0
    assert flight.result.min_separation_m > 3.0
