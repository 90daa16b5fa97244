import numpy as np
import pytest

from radron.agent.config.drone import DroneConfig
from radron.agent.errors import ConfigError
from radron.agent.terrain.buildings import Buildings, attenuation_per_m
from radron.agent.terrain.ground import Ground
from radron.sim.scenario import load_scenario, override
from radron.sim.world.cameras import Cameras
from radron.sim.world.sources import Source
from radron.sim.world.streams import streams
from radron.sim.world.walls import Walls, WallTruth


def crossed(wall: WallTruth, start: tuple[float, float, float], end: tuple[float, float, float]) -> float:
    return Walls([wall]).concrete_m(np.array(start), np.array(end))


NORTH = WallTruth(from_m=(10.0, 0.0), to_m=(10.0, 20.0), thickness_m=0.5, height_m=2.0)


def test_straight_and_slanting_through_a_wall():
    assert crossed(NORTH, (0.0, 5.0, 1.0), (20.0, 5.0, 1.0)) == pytest.approx(0.5)
    assert crossed(NORTH, (0.0, 5.0, 1.0), (10.0, 15.0, 1.0)) == pytest.approx(0.25 * 2**0.5)  # ends in its middle
    assert crossed(NORTH, (5.0, 0.0, 1.0), (20.0, 15.0, 1.0)) == pytest.approx(0.5 * 2**0.5)


def test_lines_beside_over_and_short_of_a_wall_pass_nothing():
    assert crossed(NORTH, (0.0, 25.0, 1.0), (20.0, 25.0, 1.0)) == 0.0
    assert crossed(NORTH, (0.0, 5.0, 3.0), (20.0, 5.0, 2.5)) == 0.0
    assert crossed(NORTH, (0.0, 5.0, 1.0), (9.0, 5.0, 1.0)) == 0.0
    assert crossed(NORTH, (12.0, 0.0, 1.0), (12.0, 20.0, 1.0)) == 0.0  # along its face


def test_a_line_leaves_through_the_top():
    """From the ground it rises as 3 in 12: 2 m after 8 m of way, in the middle of a wall that is 4 m thick there."""
    thick = WallTruth(from_m=(8.0, -5.0), to_m=(8.0, 5.0), thickness_m=4.0, height_m=2.0)
    assert crossed(thick, (0.0, 0.0, 0.0), (12.0, 0.0, 3.0)) == pytest.approx(2.0 * (12.0**2 + 3.0**2) ** 0.5 / 12.0)


def test_walls_turn_with_their_ends_and_add_up():
    rng = np.random.default_rng(1)
    for turn in rng.uniform(0.0, 6.3, 20):
        matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        ends = np.array([NORTH.from_m, NORTH.to_m]) @ matrix.T
        turned = WallTruth(from_m=tuple(ends[0]), to_m=tuple(ends[1]), thickness_m=0.5, height_m=2.0)
        start, end = np.array([3.0, 1.0, 0.0]), np.array([15.0, 9.0, 2.5])
        there, back = ((*(matrix @ point[:2]), point[2]) for point in (start, end))
        alone = crossed(NORTH, tuple(start), tuple(end))
        assert alone > 0.5
        assert crossed(turned, there, back) == pytest.approx(alone)
        assert Walls([turned, turned]).concrete_m(np.array(there), np.array(back)) == pytest.approx(2.0 * alone)


def test_a_wall_without_length_is_refused():
    with pytest.raises(ConfigError, match=r"walls: from_m and to_m are both \[1.0, 2.0\]"):
        override(load_scenario("paper-demo"), {"walls": [{"from_m": (1.0, 2.0), "to_m": (1.0, 2.0)}]})  # type: ignore[dict-item]


class _Standing:
    """A vehicle at rest 12 m east of a source at (50, 50)."""

    position_m = np.array([[62.0, 50.0, 1.0]])
    velocity_mps = np.zeros((1, 3))

    def quaternion(self, drone: int) -> tuple[float, float, float, float]:
        return (1.0, 0.0, 0.0, 0.0)


def test_a_camera_behind_a_wall_sees_what_the_concrete_lets_through_and_all_that_is_scattered():
    scenario = override(load_scenario("paper-static-swarm"), {"drones": 1, "camera.background_hits_per_s": 0.0})
    wall = {"walls": [{"from_m": (56.0, 45.0), "to_m": (56.0, 55.0), "thickness_m": 0.1}]}
    no_scatter = {"camera.scatter_near": 0.0, "camera.scatter_air": 0.0}

    def hits_per_s(values: dict[str, object]) -> float:
        cameras = Cameras(
            override(scenario, values),  # type: ignore[arg-type]
            ["Cs-137"], [DroneConfig(id="d1")], streams(0, 1)._replace(cameras=[np.random.default_rng(2)]), 0,
        )  # fmt: skip
        seconds = 300
        for second in range(seconds):
            cameras.expose(0, second * 10**9, (second + 1) * 10**9, _Standing(), [Source("Cs-137", 3e9, (50.0, 50.0, 0.0))])
        return len(cameras.read_out(0).hits) / seconds

    direct, behind = hits_per_s(no_scatter), hits_per_s(no_scatter | wall)
    assert behind / direct == pytest.approx(np.exp(-17.9 * 0.1), rel=0.12)  # three sigmas of the 1000 events behind the wall
    # A difference of 1700 events, to 8 % of one sigma.
    assert hits_per_s(wall) - behind == pytest.approx(hits_per_s({}) - direct, rel=0.25)


def test_the_map_of_walls_known_is_that_of_the_true_walls():
    """The drones' own cut of a line with the map's outlines against the truth's, from the file to the length of concrete."""
    scenario = load_scenario("walls-known")
    known = Buildings(scenario.mission.buildings, 1.0, Ground.from_config(scenario.mission))
    per_m = attenuation_per_m(scenario.mission.buildings.known[0], 1.0)
    rng = np.random.default_rng(3)
    heights = rng.uniform(0.5, 5.0, 300), np.zeros(300)
    start, end = (np.column_stack((rng.uniform(0.0, 100.0, (300, 2)), height_m)) for height_m in heights)
    truth = [Walls(scenario.walls).concrete_m(one, other) for one, other in zip(start, end, strict=True)]
    assert np.count_nonzero(truth) > 100
    assert known.depth(start, end - start) / per_m == pytest.approx(np.array(truth), abs=1e-4)
