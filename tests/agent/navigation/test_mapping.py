"""Survey for a map of contaminated ground: wide lanes, low lanes over hot blocks, and the end."""

import pytest
from msgspec.structs import replace
from shapely import LineString, Polygon, box

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.errors import ConfigError
from radron.agent.frames.graph import FrameGraph
from radron.agent.navigation.mapping import Block, MapSurvey, blocks_of, hot_blocks, map_conclusion, uncertainty
from radron.agent.navigation.surveying import CoverageLog
from radron.protocol import contamination as told
from radron.protocol.contamination import Contamination, Finding, Range
from radron.protocol.entries import Coverage

SURVEY = SurveyConfig(strategy="map", height_m=5.0, low_height_m=3.0, lane_spacing_m=5.0, speed_mps=5.0)
SQUARE = ((0.0, 0.0), (40.0, 0.0), (40.0, 40.0), (0.0, 40.0))
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=SQUARE),
    survey=SURVEY,
    drones=(DroneInMission(id="a"), DroneInMission(id="b", origin_m=(40.0, 0.0, 0.0))),
)
STEP_S = 0.2
HOT = Block((10.0, 20.0), 10.0, 1e6, 0.8e6, 1.2e6)
BLOCKS = (HOT, Block((0.0, 0.0), 10.0, 0.4e6, 0.2e6, 0.6e6), Block((30.0, 0.0), 10.0, 0.6e6, 0.0, 1.3e6))


class Swarm:
    """Drones that follow exactly, hear each other at once, and have the same map."""

    def __init__(self, blocks: tuple[Block, ...], mission: MissionConfig = MISSION) -> None:
        frames = FrameGraph.from_launch_layout(mission)
        self.surveys = {name: MapSurvey(mission, name, frames, lambda: blocks) for name in ("a", "b")}
        self.tracks: dict[str, list[tuple[float, float, float]]] = {"a": [(0.0, 0.0, 5.0)], "b": [(40.0, 0.0, 5.0)]}
        self._logs = {name: CoverageLog(survey.swath_m) for name, survey in self.surveys.items()}
        self._steps = 0

    def fly(self, seconds: float, active: tuple[str, ...] = ("a", "b")) -> None:
        for _ in range(round(seconds / STEP_S)):
            self._steps += 1
            for name in active:
                survey, track = self.surveys[name], self.tracks[name]
                positions, _ = survey.reference(active, track[-1][:2], 5, STEP_S)
                track.append((float(positions[1, 0]), float(positions[1, 1]), survey.height_m))
                if self._logs[name].swath_m != survey.swath_m:
                    self._logs[name] = CoverageLog(survey.swath_m)
                self._publish(name, (track[-1][0] - MISSION.member(name).origin_m[0], track[-1][1]))

    def _publish(self, name: str, local: tuple[float, float]) -> None:
        told = self._logs[name].add(round(self._steps * STEP_S * 1e9), 0, local)
        if told is None:
            return
        stamp_ns, epoch, path = told
        entry = Coverage(
            stamp_ns=stamp_ns,
            drone=name,
            mission=MISSION.mission_id,
            boot="0" * 16,
            sequence=self._steps,
            epoch=epoch,
            path_m=path,
            swath_m=self._logs[name].swath_m,
        )
        for survey in self.surveys.values():
            survey.take(entry)

    def seen(self, height_m: float, width_m: float) -> Polygon:
        tracks = [[point[:2] for point in track if point[2] == height_m] for track in self.tracks.values()]
        lines = [LineString(track).buffer(0.5 * width_m) for track in tracks if len(track) > 1]
        return lines[0].union(lines[1]) if len(lines) == 2 else lines[0]


def test_all_lanes_and_then_low_ones_over_the_hot_block() -> None:
    swarm = Swarm(BLOCKS)
    swarm.fly(60.0)
    assert box(0.0, 0.0, 40.0, 40.0).difference(swarm.seen(5.0, 5.0)).area < 0.03 * 1600.0
    assert all(survey.is_complete for survey in swarm.surveys.values())
    low = swarm.seen(3.0, 3.0)
    hot = box(10.0, 20.0, 20.0, 30.0)
    assert hot.difference(low).area < 0.05 * 100.0
    ways = [point for track in swarm.tracks.values() for point in track if point[2] == 3.0]
    assert sum(hot.buffer(2.0).contains(LineString([point[:2], hot.centroid.coords[0]])) for point in ways) > 0.3 * len(ways)


def test_the_survivor_takes_over_the_lanes_of_a_dead_drone() -> None:
    swarm = Swarm(())
    swarm.fly(12.0)
    swarm.fly(70.0, active=("a",))
    assert box(0.0, 0.0, 40.0, 40.0).difference(swarm.seen(5.0, 5.0)).area < 0.03 * 1600.0
    assert swarm.surveys["a"].is_complete
    assert swarm.surveys["a"].height_m == 5.0  # no hot block, no low lanes


def test_hot_blocks_are_above_half_of_the_highest_and_certain() -> None:
    assert hot_blocks(BLOCKS) == [HOT]
    assert uncertainty(BLOCKS) == pytest.approx(0.2)
    assert hot_blocks(()) == []
    assert uncertainty((replace(HOT, low=0.0),)) is None


def test_blocks_of_a_map_lie_from_west_to_east_and_then_north() -> None:
    found = Contamination(
        nuclide="Cs-137",
        finding=Finding.AREA,
        evidences={},
        total_bq=Range(1.0, 0.0, 2.0),
        least_bqm2=1.0,
        corner_m=(-5.0, 10.0),
        block_m=10.0,
        across=2,
        unit_bqm2=1e3,
        blocks=tuple(told.Block(k, 0, 2 * k) for k in range(4)),
        highest_bqm2=Range(1.0, 0.0, 2.0),
        highest_m=(0.0, 0.0, 0.0),
        dose_svph=Range(1.0, 0.0, 2.0),
        dose_m=(0.0, 0.0, 0.0),
    )
    assert blocks_of(found)[3] == Block((5.0, 20.0), 10.0, 3e3, 0.0, 6e3)
    assert blocks_of(found)[1].corner_m == (5.0, 10.0)


@pytest.mark.parametrize(
    ("keys", "searched_s", "complete", "ends"),
    [
        ({}, 100.0, False, False),
        ({}, 100.0, True, True),
        ({"duration_s": 540.0}, 100.0, True, False),
        ({"duration_s": 540.0}, 540.0, False, True),
        ({"block_uncertainty": 0.25}, 100.0, False, False),
        ({"block_uncertainty": 0.25}, 100.0, True, True),
        ({"block_uncertainty": 0.15}, 100.0, True, False),
        ({"block_uncertainty": 0.15, "duration_s": 540.0}, 540.0, True, True),
    ],
)
def test_end(keys: dict[str, float], searched_s: float, complete: bool, ends: bool) -> None:
    assert bool(map_conclusion(replace(SURVEY, **keys), searched_s, complete, lambda: BLOCKS)) == ends


@pytest.mark.parametrize(
    ("survey", "says"),
    [
        (replace(SURVEY, lane_spacing_m=11.0), "survey.lane_spacing_m = 11 leaves gaps"),
        (replace(SURVEY, low_height_m=5.0), "survey.low_height_m = 5 is not below"),
        (replace(SURVEY, strategy="lanes"), "need survey.strategy = 'map'"),
        (replace(SURVEY, block_uncertainty=0.2), "survey.block_uncertainty needs survey.duration_s"),
    ],
)
def test_refused(survey: SurveyConfig, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        replace(MISSION, survey=survey).check("here")


def test_time_for_a_hectare() -> None:
    """Three drones at 5 m/s in lanes of 5 m: 100 m x 100 m / (3 x 5 m x 5 m/s) = 133 s, and the turns."""
    drones = tuple(DroneInMission(id=name, origin_m=(x, 2.0, 0.0)) for name, x in (("a", 44.0), ("b", 50.0), ("c", 56.0)))
    area = AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0)))
    mission = replace(MISSION, area=area, drones=drones, survey=replace(SURVEY, low_height_m=None))
    frames = FrameGraph.from_launch_layout(mission)
    names = [drone.id for drone in drones]
    for drone in drones:
        survey = MapSurvey(mission, drone.id, frames, tuple)
        seen = [drone.origin_m[:2]]
        while box(0.0, 0.0, 100.0, 100.0).intersection(LineString([*seen, seen[-1]]).buffer(2.5)).area < 0.99 * 100.0**2 / 3.0:
            for _ in range(10):
                positions, _ = survey.reference(names, seen[-1], 5, STEP_S)
                seen.append((float(positions[1, 0]), float(positions[1, 1])))
            assert len(seen) * STEP_S < 165.0
