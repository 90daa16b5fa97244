import math
from itertools import combinations
from pathlib import Path

import msgspec
import numpy as np
import pytest
from shapely import Point, Polygon

from radron.agent.config.mission import DetectionConfig
from radron.agent.errors import ConfigError
from radron.sim.scenario import load_scenario, override, shipped
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.source import source_path
from radron.sim.world.walls import Walls

NAMES = {
    "paper-static-solo", "paper-static-swarm", "paper-moving-solo", "paper-moving-swarm", "stabilization",
    "field-179MBq", "field-2GBq", "field-2GBq-moving", "demo", "paper-demo",
    "ideal-static-solo", "ideal-static-swarm", "ideal-moving-solo", "ideal-moving-swarm",
    "biased-static-solo", "biased-static-swarm", "biased-moving-solo", "biased-moving-swarm",
    "fast-2mps", "fast-3mps", "weak-179MBq", "empty", "empty-bright",
    "mismatch-gain", "mismatch-background", "mismatch-buildup", "mismatch-shadow", "mismatch-resolution", "mismatch-clocks",
    "mismatch-walls", "hilly", "many-ideal", "many-real", "many-contrast", "many-high", "many-soil",
    "walls-known", "walls-unknown", "mismatch-ground", "mismatch-buried", "mismatch-raised",
    "mismatch-drift", "mismatch-rain", "mismatch-camera",
    "field-uniform", "field-patch", "field-gradient", "field-streets", "field-hotspots", "field-mixed", "field-nothing",
    "soil-static-solo", "soil-static-swarm", "soil-moving-solo", "soil-moving-swarm",
    "soil-paper-static-swarm", "soil-paper-moving-swarm",
    "mixed-frames", "mixed-frames-moving", "mixed-frames-rough", "no-gnss", "no-gnss-moving", "gnss-lost-midway",
    "frame-jump", "frame-jump-unannounced", "lying-drone", "stop-and-go", "beyond-fence",
    "fault-kill", "fault-partition", "fault-lossy", "fault-mavlink-loss", "fault-kitchen-sink",
    "ordinary-static",
}  # fmt: skip


def test_all_shipped_scenarios_load():
    assert set(shipped()) == NAMES
    for name in shipped():
        assert load_scenario(name).name == name


@pytest.mark.parametrize("name", sorted(NAMES))
def test_the_drones_expect_soil_where_there_is_a_ground_and_only_there(name):
    scenario = load_scenario(name, with_grid=False)
    assert scenario.mission.fusion.ground == ("none" if scenario.ground is None else "soil")


def test_users_begin_over_soil_and_the_papers_data_have_no_ground():
    assert load_scenario("demo").ground is not None
    for name in NAMES:
        if name.startswith(("paper-", "ideal-")):
            assert load_scenario(name).ground is None


def test_solo_and_swarm_differ_in_the_number_of_drones():
    assert len(load_scenario("paper-static-solo").mission.drones) == 1
    assert len(load_scenario("paper-static-swarm").mission.drones) == 3


@pytest.mark.parametrize("kind", ["static-solo", "static-swarm", "moving-solo", "moving-swarm"])
def test_ideal_scenarios_are_the_papers_but_for_the_poses_the_smallest_cones_and_who_estimates(kind):
    paper, ideal = load_scenario(f"paper-{kind}"), load_scenario(f"ideal-{kind}")
    sizes = ("horizontal_m", "vertical_m", "velocity_mps", "climb_mps", "drift_m", "height_m", "yaw_deg", "tilt_deg")
    perfect = LocalizationTruth(**dict.fromkeys(sizes, 0))
    assert ideal.localization == perfect
    assert ideal.end.lost == "error"
    mission = override(paper, {"mission.fusion.estimator": "bayes", "mission.detection.minimum_pixels": 6}).mission
    assert mission.detection == DetectionConfig()
    same = {"name": ideal.name, "description": ideal.description, "localization": perfect, "end": ideal.end}
    assert ideal == msgspec.structs.replace(paper, mission=mission, **same)


@pytest.mark.parametrize(
    ("name", "bare"),
    [
        *((f"soil-{kind}", f"ideal-{kind}") for kind in ("static-solo", "static-swarm", "moving-solo", "moving-swarm")),
        *((f"soil-paper-{kind}", f"paper-{kind}") for kind in ("static-swarm", "moving-swarm")),
        ("many-soil", "many-real"),
        ("demo", "paper-demo"),
    ],
)
def test_a_twin_over_soil_differs_in_the_ground_alone(name, bare):
    twin, empty = load_scenario(name), load_scenario(bare)
    assert twin.ground is not None
    assert twin.ground.kinds == ("soil",)
    assert empty.ground is None
    mission = override(empty, {"mission.fusion.ground": "soil"}).mission
    assert mission.mission_id != empty.mission.mission_id
    body = msgspec.structs.replace(empty.camera, scatter_near=0.05, background_hits_per_s=0.3)
    same = {"name": twin.name, "description": twin.description}
    assert twin == msgspec.structs.replace(empty, mission=mission, camera=body, ground=twin.ground, **same)


def test_biased_scenarios_add_to_the_ideal_ones_what_nobody_on_board_knows():
    ideal, biased = load_scenario("ideal-moving-solo"), load_scenario("biased-moving-solo")
    assert (biased.localization.bias_m, biased.localization.bias_yaw_deg) == (1.0, 3.0)
    assert biased.mission == ideal.mission
    assert biased.source == ideal.source
    assert biased.camera != ideal.camera


@pytest.mark.parametrize(
    "name",
    [
        "mixed-frames", "mixed-frames-moving", "mixed-frames-rough", "no-gnss", "no-gnss-moving",
        "gnss-lost-midway", "frame-jump", "frame-jump-unannounced", "lying-drone",
    ],
)  # fmt: skip
def test_where_frames_are_estimated_truth_and_mission_fit_and_no_truth_is_told(name):
    """Each drone's kind at the start is the mission's, and its frame is off by no more than the mission allows for."""
    scenario = load_scenario(name)
    ideal = load_scenario("ideal-moving-swarm" if name.endswith("-moving") else "ideal-static-swarm")
    assert (scenario.source, scenario.camera, scenario.mission.area) == (ideal.source, ideal.camera, ideal.mission.area)
    for drone in scenario.mission.drones:
        truth = scenario.localization.vehicles[drone.id]
        assert truth.kind == drone.localization
        assert truth.origin_m <= drone.origin_sigma_m
        assert truth.yaw_deg <= drone.yaw_sigma_deg
        assert drone.yaw_deg == 0.0
    assert scenario.sightings is not None


@pytest.mark.parametrize("name", sorted(name for name in NAMES if name.startswith("mismatch-")))
def test_a_mismatch_is_the_ideal_swarm_but_for_one_thing_that_no_drone_knows(name):
    base, thing = {
        "mismatch-walls": ("ideal-static-swarm", "walls"),
        "mismatch-ground": ("soil-static-swarm", "ground"),
        "mismatch-buried": ("mismatch-ground", "ground"),
        "mismatch-raised": ("mismatch-ground", "source"),
        "mismatch-rain": ("soil-static-swarm", "ground"),
        "mismatch-camera": ("ideal-static-swarm", "cameras"),
        "mismatch-drift": ("ideal-static-swarm", "fault"),
    }.get(name, ("ideal-static-swarm", "camera"))
    ideal, mismatch = load_scenario(base), load_scenario(name)
    changed = {key for key in ideal.__struct_fields__ if getattr(mismatch, key) != getattr(ideal, key)}
    if name == "mismatch-drift":
        changed.remove("end")  # the drift takes longer than the ideal swarm's flight
    assert changed - {"name", "description"} == {thing}


def test_walls_stand_in_the_way():
    walls, rng = Walls(load_scenario("mismatch-walls").walls), np.random.default_rng(1)
    shares = []
    for x, y, turn in rng.uniform((0.0, 0.0, 0.0), (100.0, 100.0, 6.3), (1000, 3)):
        there = np.array([x + 12.0 * np.cos(turn), y + 12.0 * np.sin(turn), 3.0])
        shares.append(np.exp(-17.9 * walls.concrete_m(there, np.array([x, y, 0.0]))))
    assert np.mean(np.array(shares) < 0.5) == pytest.approx(0.2, abs=0.04)  # three sigmas


@pytest.mark.parametrize(("name", "speed_mps"), [("fast-2mps", 2.0), ("fast-3mps", 3.0)])
def test_a_fast_source_always_moves_at_its_speed(name, speed_mps):
    scenario = load_scenario(name)
    area = Polygon(scenario.mission.area.polygon_m)
    path = source_path(scenario.source, area, 100.0, np.random.default_rng(1))
    track = np.array([path(t) for t in np.arange(0.0, 100.0, 0.1)])
    np.testing.assert_allclose(np.hypot(*np.diff(track, axis=0).T) / 0.1, speed_mps, rtol=0.01)
    assert all(area.contains(Point(xy)) for xy in track)


def test_a_scenario_on_several_others_takes_what_the_later_ones_say(tmp_path):
    path = write(tmp_path, "")
    (tmp_path / "one.toml").write_text('base = "base"\n[source]\nactivity_bq = 2e9\nmotion = "circle"\n[radio]\nloss = 0.1')
    (tmp_path / "other.toml").write_text("[source]\nactivity_bq = 3e9\n[end]\nsearch_s = 5.0")
    Path(path).write_text('base = ["one", "other"]\n[end]\ntrack_s = 6.0')
    found = load_scenario(path)
    assert (found.source.activity_bq, found.source.motion, found.radio.loss) == (3e9, "circle", 0.1)
    assert (found.end.search_s, found.end.track_s) == (5.0, 6.0)


@pytest.mark.parametrize(
    ("base", "problem"),
    [
        ("3", "expected the name or path of another scenario"),
        ("[3]", "expected the name or path of another scenario"),
        ('"scenario"', "'scenario' leads back to this file"),
        ('["paper-base", "scenario"]', "'scenario' leads back to this file"),
        ('"nowhere"', "there is no 'nowhere.toml' in .*shipped scenarios: .*paper-base"),
        ('"../none/x.toml"', "there is no '../none/x.toml' in"),
        (f'"{"x" * 300}"', "there is no 'x"),
    ],
)
def test_a_base_that_is_none(tmp_path, base, problem):
    path = tmp_path / "scenario.toml"
    path.write_text(f"base = {base}")
    with pytest.raises(ConfigError, match=rf"scenario.toml: base: {problem}"):
        load_scenario(str(path))


def test_a_base_may_be_shipped_or_anywhere(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "near.toml").write_text('base = "paper-static-swarm"\nname = "near"\n[end]\ntrack_s = 60.0')
    path = tmp_path / "own.toml"
    path.write_text('base = "elsewhere/near.toml"\nname = "own"')
    scenario = load_scenario(str(path))
    assert (scenario.name, scenario.end.track_s, len(scenario.mission.drones)) == ("own", 60.0, 3)


def test_a_file_beside_comes_before_a_shipped_one(tmp_path):
    (tmp_path / "demo.toml").write_text('base = "paper-static-swarm"\nname = "mine"')
    path = tmp_path / "own.toml"
    path.write_text('base = "demo"')
    assert load_scenario(str(path)).name == "mine"


def test_unknown_name_lists_the_shipped_ones():
    with pytest.raises(ConfigError, match=r"unknown scenario 'nope'; shipped: beyond-fence, .*paper-static-swarm"):
        load_scenario("nope")


def write(tmp_path, text):
    (tmp_path / "base.toml").write_text("""
name = "base"
description = "d"
[mission]
name = "m"
drones = [{ id = "d1" }]
[mission.area]
polygon_m = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]
[source]
activity_bq = 1e9
""")
    path = tmp_path / "scenario.toml"
    path.write_text('base = "base"\n' + text)
    return str(path)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[source]\nactivity_bq = -1.0", r"scenario.toml: source.activity_bq: expected `float` > 0"),
        ('[source]\nnuclide = "Cs-173"', r"source.nuclide: unknown nuclide 'Cs-173'; known: .*Cs-137"),
        ('[mission]\nnuclide = "xx"', r"mission.nuclide: unknown nuclide 'xx'"),
        ("[mission.area]\npolygon_m = [[0.0,0.0],[9.0,9.0],[9.0,0.0],[0.0,9.0]]", r"polygon_m: Self-intersection"),
        ("[mission]\ndrones = []", r"mission.drones: expected `array` of length >= 1"),
        ('[mission]\ndrones = [{ id = "a" }, { id = "a" }]', r"the id 'a' is given twice"),
        ("[mission.surwey]\nheight_m = 3.0", r"unknown key 'mission.surwey'; did you mean 'survey'\?"),
        ("[mission.survey]\nheigth_m = 3.0", r"unknown key 'mission.survey.heigth_m'; did you mean 'height_m'\?"),
        ("[mission.survey]\nheight_m = 100.0", r"survey.height_m = 100 is outside area.floor_m .. area.ceiling_m"),
        (
            "[mission.survey]\nstrategy = 'map'\nlow_height_m = 0.5\nlane_spacing_m = 5.0",
            r"survey.low_height_m = 0.5 is outside area.floor_m .. area.ceiling_m",
        ),
        ('[mission.fusion]\nestimator = "kalman"', r"fusion.estimator"),
        ("[mission.fusion]\nestimator = 'given'", r"needs fusion.given.schedule"),
        ("this is no toml", r"not TOML"),
        ("[radio]\nloss = 1.0", r"radio.loss: expected `float` <= 0.9"),
        ("[radio]\nloss = nan", r"radio.loss: expected `float` >= 0.0"),
        ("[radio]\ndelay_s = -0.1", r"radio.delay_s: expected `float` >= 0.0"),
        ("[radio]\nrecovery_s = 0.0", r"radio.recovery_s: expected `float` > 0.0"),
        ("[localization]\nhorizontal_m = nan", r"localization.horizontal_m: expected `float` >= 0.0"),
        ("[localization]\ntilt_deg = -1.0", r"localization.tilt_deg: expected `float` >= 0.0"),
        ("[localization]\ncorrelation_s = 0.0", r"localization.correlation_s: expected `float` > 0.0"),
        ("[localization]\nvelocity_mps = inf", r"localization.velocity_mps: expected `float` <= 10.0"),
        ("[vehicle]\nposition_gain_ps = 0.0", r"vehicle.position_gain_ps: expected `float` > 0.0"),
        ("[vehicle]\nattitude_rate_ps = 0.0", r"vehicle.attitude_rate_ps: expected `float` > 0.0"),
        ("[vehicle]\ngust_correlation_s = 0.0", r"vehicle.gust_correlation_s: expected `float` > 0.0"),
        ("[vehicle]\ngust_mps2 = nan", r"vehicle.gust_mps2: expected `float` >= 0.0"),
        ("[vehicle]\nposition_gain_ps = 9.0", r"vehicle: with these gains the horizontal motion is unstable"),
        ("[source]\nactivity_bq = 1e18", r"source.activity_bq: expected `float` <= 10000000000000"),
        ("[source]\nspeed_mps = nan", r"source.speed_mps: expected `float` >= 0.0"),
        ("[source]\nstart_m = [nan, 0.0]", r"source.start_m\[0\]: expected `float` >= -100000.0"),
        ("[source]\nmotion = 'circle'\ncircle_radius_m = 0.0", r"motion = 'circle' needs source.circle_radius_m > 0"),
        ("[source]\nmotion = 'wander'", r"source.motion = 'wander' needs an area more than 6 m wide"),
        ("[mission.area]\npolygon_m = [[0.0,0.0],[99.0,99.0],[99.01,99.0]]", r"polygon_m is too thin to draw a place in it"),
        ("[start]\nscatter_m = inf", r"start.scatter_m: expected `float` <= 10000.0"),
        ("[start]\ncentre_m = [1e9, 0.0]", r"start.centre_m\[0\]: expected `float` <= 100000.0"),
        ("[end]\nsearch_s = 1e12", r"end.search_s: expected `float` <= 36000.0"),
        ("[mission.track]\nduration_s = 1e6", r"mission.track.duration_s: a simulated flight tracks for at most 36000 s"),
        ("walls = [{ from_m = [0.0, 0.0], to_m = [0.0, 0.0] }]", r"walls: from_m and to_m are both \[0.0, 0.0\]"),
        ("[camera]\nshadow = 1.0", r"camera.shadow: expected `float` < 1.0"),
        ("[response]\nlag_s = -1.0", r"response.lag_s: expected `float` >= 0.0"),
    ],
)
def test_bad_files_end_in_one_line_that_says_what_and_where(tmp_path, text, complaint):
    with pytest.raises(ConfigError, match=complaint) as caught:
        load_scenario(write(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_unreadable_file():
    with pytest.raises(ConfigError, match=r"nowhere.toml: cannot be read: No such file"):
        load_scenario("nowhere.toml")


def test_override():
    scenario = load_scenario("paper-static-swarm")
    changed = override(scenario, {"radius_m": "8", "speed_mps": 2.0, "drones": "5", "mission.fusion.paper.initial_cones": 7})
    assert changed.mission.encirclement.radius_m == 8.0
    assert changed.mission.survey.speed_mps == changed.mission.encirclement.speed_mps == 2.0
    assert [drone.id for drone in changed.mission.drones] == ["d1", "d2", "d3", "x1", "x2"]
    assert changed.mission.fusion.paper.initial_cones == 7
    assert changed.mission.mission_id != scenario.mission.mission_id
    assert len(override(scenario, {"drones": 1}).mission.drones) == 1


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"radus_m": 3}, "there is no 'radus_m'"),
        ({"radius_m": -3}, "mission.encirclement.radius_m: expected"),
        ({"radius_m": "wide"}, "mission.encirclement.radius_m"),
        ({"drones": 0}, "drones: expected a whole number from 1 to 64"),
        ({"drones": "nan"}, "drones: expected a whole number from 1 to 64"),
        ({"drones": "inf"}, "drones: expected a whole number from 1 to 64"),
        ({"drones": "1e400"}, "drones: expected a whole number from 1 to 64"),
        ({"drones": 2.5}, "drones: expected a whole number from 1 to 64"),
        ({"radius_m": "nan"}, "mission.encirclement.radius_m: expected"),
        ({"start.scatter_m": 2.0}, "scatter_m = 2 is too small for 3 drones 6 m apart; give at least 4.8, or 0"),
        ({"mission.limits.separation_m": 7.0}, "mission: drones: d1 and d2 are launched 6.0 m apart, which is less than"),
        ({"mission": 0}, "mission"),
    ],
)
def test_bad_override(values, complaint):
    with pytest.raises(ConfigError, match=complaint):
        override(load_scenario("paper-demo"), values)


def test_no_estimator_can_be_chosen_where_the_hypothesis_is_given():
    with pytest.raises(ConfigError, match="stabilization: its hypothesis is given"):
        override(load_scenario("stabilization"), {"mission.fusion.estimator": "paper"})


def test_a_large_swarm_starts_inside_the_fence_and_apart():
    mission = override(load_scenario("ideal-static-swarm"), {"drones": 64}).mission
    fence = Polygon(mission.area.polygon_m).buffer(mission.area.fence_margin_m)
    places = [drone.origin_m[:2] for drone in mission.drones]
    assert len(places) == 64
    assert all(fence.contains(Point(place)) for place in places)
    assert min(math.dist(one, other) for one, other in combinations(places, 2)) >= 5.0
    assert places[:5] == [(44.0, 2.0), (50.0, 2.0), (56.0, 2.0), (61.0, 2.0), (66.0, 2.0)]


def test_many_sources_may_be_configured_and_each_is_checked(tmp_path):
    file = tmp_path / "two.toml"
    two = 'base = "empty"\nname = "two"\n[[sources]]\nactivity_bq = 1e9\n[[sources]]\nactivity_bq = 1e9\nnuclide = "{}"\n'
    file.write_text(two.format("Co-60"))
    scenario = load_scenario(str(file))
    assert [source.nuclide for source in scenario.sources] == ["Cs-137", "Co-60"]
    assert scenario.source is None
    file.write_text(two.format("Co-61"))
    with pytest.raises(ConfigError, match=r"two.toml: sources\[1\].nuclide: unknown nuclide 'Co-61'; known: .*Co-60"):
        load_scenario(str(file))


def test_a_run_may_end_at_a_fixed_time_and_never_later_than_its_stages_allow():
    scenario = load_scenario("many-ideal")
    assert scenario.end.longest_s(scenario.mission) == 600.0
    late = override(scenario, {"end.after_s": 5000.0})
    assert late.end.longest_s(late.mission) == 600.0 + 600.0 + 300.0
