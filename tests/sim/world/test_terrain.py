import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.sim.scenario import load_scenario
from radron.sim.world.cameras import Cameras
from radron.sim.world.elevation import surveyed
from radron.sim.world.frame import CameraMount
from radron.sim.world.sources import Sources
from radron.sim.world.streams import streams
from radron.sim.world.terrain import HillTruth, Terrain, TerrainTruth

HILL = TerrainTruth(height_m=2.0, slope=(0.1, 0.0), hills=(HillTruth(centre_m=(10.0, 20.0), height_m=8.0, width_m=5.0),))


def test_a_hill_stands_on_its_plane():
    terrain = Terrain(HILL)
    assert terrain.height_m(10.0, 20.0) == pytest.approx(2.0 + 1.0 + 8.0)
    assert terrain.height_m(15.0, 20.0) == pytest.approx(2.0 + 1.5 + 8.0 * np.exp(-0.5))  # at a standard deviation
    assert terrain.height_m(100.0, 20.0) == pytest.approx(12.0)
    x, y = np.array([10.0, 15.0]), np.array([20.0, 20.0])
    assert terrain.heights_m(x, y).tolist() == [terrain.height_m(10.0, 20.0), terrain.height_m(15.0, 20.0)]


def test_put_down_and_height_above_ground_fit_together():
    terrain = Terrain(HILL)
    places = np.array([[10.0, 20.0, 99.0], [0.0, 0.0, -3.0]])
    put_down = terrain.on_ground(places)
    assert put_down[:, :2].tolist() == places[:, :2].tolist()
    assert terrain.above_ground(put_down)[:, 2] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert terrain.above_ground(places)[0, 2] == pytest.approx(99.0 - 11.0)


def test_flat_ground_changes_nothing():
    terrain = Terrain(TerrainTruth())
    places = np.array([[1.0, 2.0, 3.0]])
    assert terrain.flat
    assert terrain.on_ground(places) is places
    assert terrain.above_ground(places) is places
    assert terrain.soil_m(places[0], np.array([9.0, 9.0, -9.0])) == 0.0


def test_a_line_of_sight_through_the_hill_passes_soil():
    terrain = Terrain(TerrainTruth(hills=(HillTruth(centre_m=(0.0, 0.0), height_m=8.0, width_m=5.0),)))
    through = terrain.soil_m(np.array([-30.0, 0.0, 1.0]), np.array([30.0, 0.0, 1.0]))
    wide = 2.0 * 5.0 * np.sqrt(2.0 * np.log(8.0))  # the part of the bell above 1 m
    assert through == pytest.approx(wide, abs=60.0 / 48.0)
    assert terrain.soil_m(np.array([-30.0, 0.0, 9.0]), np.array([30.0, 0.0, 9.0])) == 0.0


def test_the_source_is_seen_on_its_hill_and_not_through_another(monkeypatch):
    """The camera looks at a source on a hilltop that is free, and then at one behind the hill."""
    scenario = replace(load_scenario("paper-static-swarm"), terrain=HILL)
    seen = []
    view = CameraMount.view

    def watched(self, position, attitude, source, activity_bq):
        seen.append(source)
        return view(self, position, attitude, source, activity_bq)

    monkeypatch.setattr(CameraMount, "view", watched)

    def hits(start_m):
        lying = replace(scenario, source=replace(scenario.source, start_m=start_m))
        sources = Sources(lying, 1.0, streams(1, 1))
        random = streams(0, 1)._replace(cameras=[np.random.default_rng(1)])
        cameras = Cameras(lying, sources.nuclides, [DroneConfig(id="d1")], random, 0)
        for k in range(100):
            cameras.expose(0, k * 100_000_000, (k + 1) * 100_000_000, Hovering(), sources.at(0.0))
        return len(cameras.read_out(0).hits)

    free, hidden = hits((10.0, 20.0)), hits((20.0, 20.0))
    assert seen[0] == pytest.approx((10.0, 20.0, 11.0))
    assert seen[-1] == pytest.approx((20.0, 20.0, Terrain(HILL).height_m(20.0, 20.0)))
    assert hidden < 0.5 * free  # behind some 8 m of soil there is nothing left but the background


class Hovering:
    """West of the hill, at half of its height."""

    position_m = np.array([[0.0, 20.0, 6.0]])
    velocity_mps = np.zeros((1, 3))

    def quaternion(self, drone):
        return (1.0, 0.0, 0.0, 0.0)


def test_a_survey_of_the_ground_is_an_ascii_grid_with_its_north_on_top():
    terrain = Terrain(HILL)
    lines = surveyed(terrain, (0.0, 0.0, 20.0, 30.0), 10.0, 0.0, 1).splitlines()
    assert lines[:5] == ["ncols 3", "nrows 4", "xllcenter 0", "yllcenter 0", "cellsize 10"]
    rows = [[float(value) for value in line.split()] for line in lines[6:]]
    assert np.shape(rows) == (4, 3)
    assert rows[1][1] == pytest.approx(11.0)  # (10, 20): the hilltop
    assert rows[3][0] == pytest.approx(terrain.height_m(0.0, 0.0), abs=0.05)


def test_a_survey_is_as_wrong_as_it_is_said_to_be():
    terrain = Terrain(TerrainTruth())
    text = surveyed(terrain, (0.0, 0.0, 300.0, 300.0), 5.0, 0.2, 1)
    heights = np.loadtxt(text.splitlines()[6:])
    assert heights.std() == pytest.approx(0.2, rel=0.05)  # 3700 draws: 1.2 % is one sigma
    assert text == surveyed(terrain, (0.0, 0.0, 300.0, 300.0), 5.0, 0.2, 1)
