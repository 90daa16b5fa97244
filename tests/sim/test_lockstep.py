"""Whole missions in one process: they end well, and the same seed gives the same flight."""

import msgspec
import numpy as np
import pytest

from protocol.messages import Stage
from sim.lockstep import fly
from sim.recorder import spacing_error_deg
from sim.scenario import load_scenario, override

WALL = {"wall_s": 0.0, "realtime_factor": 0.0}


@pytest.fixture(scope="module")
def demo():
    return fly(load_scenario("demo"), seed=3, listen=("paper-geometric",))


def test_the_demo_finds_the_source_and_comes_home(demo):
    result, trace = demo.result, demo.trace
    assert result.time_to_x0_s is not None
    assert result.time_to_x0_s < 60.0
    assert result.error_median_m is not None
    assert result.error_median_m < 4.0
    assert not result.lost
    assert result.fence_breaches == 0
    assert result.min_separation_m is not None
    assert result.min_separation_m > 3.0
    assert set(trace.stage[-1]) <= {Stage.LANDING, Stage.LANDED}
    home = np.array([[19.0, 2.0], [25.0, 2.0], [31.0, 2.0]])
    assert np.hypot(*(trace.position_m[-1, :, :2] - home).T).max() < 1.0


def test_stages_come_in_order(demo):
    order = [Stage.TAKEOFF, Stage.SURVEY, Stage.TRACK, Stage.RETURN, Stage.LANDING]
    for drone in range(3):
        stages = [stage for stage in demo.trace.stage[:, drone] if stage != Stage.REACQUIRE]
        firsts = [stages.index(stage) for stage in order]
        assert firsts == sorted(firsts)


def test_all_drones_hold_the_same_hypothesis(demo):
    hypothesis = demo.trace.hypothesis_m
    spread = np.abs(hypothesis - hypothesis[:, :1]).max(axis=(1, 2))
    known = ~np.isnan(spread)
    assert known.sum() > 200
    assert np.median(spread[known]) == 0.0  # bit for bit, but for the moments when a cone is still on its way


def test_listeners_hear_the_same_cones(demo):
    listened = demo.listened["paper-geometric"]
    assert listened.cones == demo.result.cones
    assert listened.time_to_x0_s == demo.result.time_to_x0_s
    assert listened.error_median_m != demo.result.error_median_m


def test_listening_does_not_touch_the_flight(demo):
    alone = fly(load_scenario("demo"), seed=3)
    assert msgspec.structs.replace(alone.result, **WALL) == msgspec.structs.replace(demo.result, **WALL)
    np.testing.assert_array_equal(alone.trace.position_m, demo.trace.position_m)


def test_another_seed_is_another_flight(demo):
    short = override(load_scenario("demo"), {"mission.track.duration_s": 5.0})
    assert fly(short, seed=4).result.hits != demo.result.hits


def test_a_single_drone_flies_too():
    result = fly(override(load_scenario("demo"), {"drones": 1, "mission.track.duration_s": 20.0}), seed=1).result
    assert result.min_separation_m is None
    assert result.time_to_x0_s is not None


def test_without_a_source_nothing_is_found_and_the_search_ends():
    scenario = override(load_scenario("demo"), {"source.activity_bq": 1.0, "end.search_s": 40.0})
    result = fly(scenario, seed=1).result
    assert result.time_to_x0_s is None
    assert result.x0_error_m is None
    assert result.error_median_m is None
    assert 40.0 < result.sim_s < 60.0
    assert result.hits > 0  # the background


def test_local_frames_do_not_matter():
    """Drones that call other directions east and other places zero find the same source."""
    scenario = override(load_scenario("demo"), {"mission.track.duration_s": 20.0})
    turned = tuple(
        msgspec.structs.replace(drone, yaw_deg=yaw)
        for drone, yaw in zip(scenario.mission.drones, (40.0, -170.0, 95.0), strict=True)
    )
    scenario = msgspec.structs.replace(scenario, mission=msgspec.structs.replace(scenario.mission, drones=turned))
    result = fly(scenario, seed=3).result
    assert result.error_median_m is not None
    assert result.error_median_m < 4.0
    assert result.fence_breaches == 0
    assert result.min_separation_m is not None
    assert result.min_separation_m > 3.0


def test_a_miscalibrated_detector_still_finds_it():
    scenario = load_scenario("demo")
    camera = msgspec.structs.replace(scenario.camera, calibration_spread=0.05)
    scenario = override(msgspec.structs.replace(scenario, camera=camera), {"mission.track.duration_s": 20.0})
    result = fly(scenario, seed=2).result
    assert result.time_to_x0_s is not None


def test_spacing_error():
    angle = np.radians([10.0, 130.0, 260.0])
    position = 12.0 * np.stack((np.cos(angle), np.sin(angle)), axis=1)
    np.testing.assert_allclose(spacing_error_deg(position, np.zeros(2)), [0.0, 10.0, -10.0], atol=1e-9)
