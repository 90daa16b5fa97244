"""A simulated camera over ground."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from typer.testing import CliRunner

from radron.agent.config.drone import DroneConfig
from radron.agent.errors import ConfigError
from radron.sim.cli import app
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.ground.field import natural_flux, rain_flux
from radron.sim.radiation.ground.shares import hits_per_s, isotropic_mm2
from radron.sim.radiation.truth import CameraTruth, GroundTruth, RainTruth
from radron.sim.scenario import load_scenario, parse_scenario
from radron.sim.world.cameras import Cameras
from radron.sim.world.sources import Source
from radron.sim.world.streams import streams

QUIET = CameraTruth(background_hits_per_s=0.0, scatter_near=0.0, scatter_air=0.0)
BESIDE = SourceView((0.0, -0.6, 0.8), 5.0, 3e8, camera_m=3.0)  # 3 m up, 4 m away, in front of the sensor
SECONDS = 20
TICKS = 400  # 625 ns


def events_per_s(camera: Camera, views: list[SourceView], start_s: int = 0) -> float:
    """Events, separated by gaps in time: their pixels are within 200 ns."""
    hits = camera.expose(start_s * 10**9, (start_s + SECONDS) * 10**9, views, 3.0).hits
    return (1 + np.count_nonzero(np.diff(np.sort(hits.tick)) > TICKS)) / SECONDS if len(hits) else 0.0


def test_soil_adds_more_hits_than_come_straight_from_the_source() -> None:
    bare = events_per_s(Camera(QUIET, "Cs-137", np.random.default_rng(1), 0), [BESIDE])
    over = events_per_s(Camera(QUIET, "Cs-137", np.random.default_rng(1), 0, GroundTruth(natural=0.0)), [BESIDE])
    assert 2.0 < over / bare - 1.0 < 3.6  # 2.5 as a mean over all directions; a camera that faces them counts more soft photons


def test_without_a_source_the_ground_is_the_background() -> None:
    rate = events_per_s(Camera(QUIET, "Cs-137", np.random.default_rng(2), 0, GroundTruth(kinds=("concrete",))), [])
    assert rate == pytest.approx(hits_per_s("concrete", 3.0), rel=0.15)
    assert events_per_s(Camera(QUIET, "Cs-137", np.random.default_rng(2), 0, GroundTruth(kinds=("water",))), []) == 0.0
    assert natural_flux("soil", 3.0).sum() > 0.0


@pytest.mark.slow
def test_rain_is_a_step_that_decays() -> None:
    """After half an hour a half of it, and none on a camera over no ground."""
    rain = RainTruth(at_s=100.0, factor=3.0)
    camera = Camera(QUIET, "Cs-137", np.random.default_rng(5), 0, GroundTruth(rain=rain))
    added = rain_flux("soil", 3.0) @ isotropic_mm2() * 1e-6  # 1/s, as much kerma as of dry soil
    dry = hits_per_s("soil", 3.0)
    assert 0.4 * dry < added < 0.6 * dry  # its photons are harder: no soil scatters them on their way
    rates = [events_per_s(camera, [], start_s) for start_s in (0, 100, 1900)]
    assert rates == pytest.approx([dry, dry + 2.0 * added, dry + added], rel=0.2)  # of 90 events and more: 3 sigma


def test_rain_over_water_is_what_a_camera_counts() -> None:
    ground = GroundTruth(kinds=("water",), rain=RainTruth(factor=3.0))
    assert events_per_s(Camera(QUIET, "Cs-137", np.random.default_rng(5), 0, ground), []) > 2.0


def test_concrete_between_stops_what_comes_from_the_sources_side() -> None:
    walled = replace(BESIDE, concrete_m=0.3)
    clear, behind = (
        events_per_s(Camera(QUIET, "Cs-137", np.random.default_rng(3), 0, GroundTruth(natural=0.0)), [view])
        for view in (BESIDE, walled)
    )
    assert behind < 0.2 * clear


def test_the_kind_is_drawn_from_the_seed() -> None:
    truth = GroundTruth(kinds=("soil", "sand", "asphalt"))
    drawn = [truth.drawn(streams(seed, 1).ground).kind for seed in range(20)]
    assert set(drawn) == {"soil", "sand", "asphalt"}
    assert drawn == [truth.drawn(streams(seed, 1).ground).kind for seed in range(20)]


def test_a_source_in_the_ground_is_seen_through_it() -> None:
    scenario = load_scenario("soil-static-swarm")
    buried = replace(scenario, ground=GroundTruth(depth_m=0.05))
    cameras = Cameras(buried, ["Cs-137"], [DroneConfig(id="d1")], streams(1, 1), 0)

    class Hovering:
        position_m = np.array([[4.0, 0.0, 3.0]])
        velocity_mps = np.zeros((1, 3))

        def quaternion(self, drone: int) -> tuple[float, float, float, float]:
            return 1.0, 0.0, 0.0, 0.0

    view = cameras._view(0, Hovering(), Source("Cs-137", 1e9, (0.0, 0.0, 0.0)))
    assert view.concrete_m == pytest.approx(0.05 * 5.0 / 3.0 * 1.5 / 2.3)
    assert (view.camera_m, view.source_m) == (3.0, 0.0)


def test_scenarios_without_ground_have_none_and_an_unknown_kind_is_refused() -> None:
    assert load_scenario("ideal-static-swarm").ground is None
    assert load_scenario("paper-static-swarm").ground is None
    document = msgspec.to_builtins(load_scenario("soil-static-swarm"))
    document["ground"]["kinds"] = ["lava"]
    with pytest.raises(ConfigError, match="ground"):
        parse_scenario(document, "here")


def test_the_command_refuses_an_unknown_ground() -> None:
    result = CliRunner().invoke(app, ["ground", "--on", "lava"])
    assert isinstance(result.exception, ConfigError)
    assert "soil" in str(result.exception)
