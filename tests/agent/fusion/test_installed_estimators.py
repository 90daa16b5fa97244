"""An estimator of another package: found by its entry point, wherever a mission is read."""

import sys

import pytest

from radron.agent.errors import ConfigError
from radron.agent.fusion.registry import check_estimator, estimator_named
from radron.agent.shell.overrides import load_drone
from radron.sim.scenario import load_scenario, override

MODULE = """
from types import SimpleNamespace

def make(mission):
    names = ("reads", "grid_s", "hold_s", "initial", "step", "work", "hypothesis", "outlook")
    return SimpleNamespace(name="other", **dict.fromkeys(names))

def broken(mission):
    raise KeyError("nothing there")

def no_estimator(mission):
    return SimpleNamespace(name="hollow")
"""
POINTS = """[radron.estimators]
other = other_estimators:make
broken = other_estimators:broken
hollow = other_estimators:no_estimator
missing = no_such_module:make
paper = other_estimators:broken
"""
MISSION = """
name = "yard"
drones = [{ id = "d1" }]
fusion = { estimator = "NAME" }
area = { polygon_m = [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]] }
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package as the installer leaves it: a module, and its entry points beside it."""
    (tmp_path / "other_estimators.py").write_text(MODULE)
    info = tmp_path / "other_estimators-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: other-estimators\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield
    sys.modules.pop("other_estimators", None)


@pytest.mark.usefixtures("installed")
def test_an_installed_estimator_is_made_by_its_name(kit):
    assert estimator_named("other", kit.mission_of()).name == "other"


@pytest.mark.usefixtures("installed")
def test_no_package_can_take_the_name_of_an_own_estimator(kit):
    assert estimator_named("paper", kit.mission_of()).name == "paper"


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("broken", "other_estimators:broken cannot be used: KeyError: 'nothing there'"),
        ("missing", "no_such_module:make cannot be used: ModuleNotFoundError"),
        ("hollow", "makes no estimator: it lacks reads, grid_s, hold_s, initial"),
    ],
)
def test_what_is_wrong_with_an_installed_estimator_is_told(kit, name, what):
    with pytest.raises(ConfigError, match=what):
        estimator_named(name, kit.mission_of())


@pytest.mark.usefixtures("installed")
def test_an_unknown_name_is_answered_with_those_that_are_installed():
    known = "known: paper, paper-geometric, bayes, sources, field, given, broken, hollow, missing, other"
    with pytest.raises(ConfigError, match=f"^yard: unknown estimator 'ohter'; {known}"):
        check_estimator("ohter", "yard")


@pytest.mark.usefixtures("installed")
def test_missions_and_scenarios_are_checked_when_they_are_read(tmp_path):
    drone = tmp_path / "drone.toml"
    drone.write_text('id = "d1"\nmission = "mission.toml"\n')
    (tmp_path / "mission.toml").write_text(MISSION.replace("NAME", "other"))
    assert load_drone(drone, {})[1].fusion.estimator == "other"
    (tmp_path / "mission.toml").write_text(MISSION.replace("NAME", "another"))
    with pytest.raises(ConfigError, match=r"mission.toml: fusion.estimator: unknown estimator 'another'; known: paper,"):
        load_drone(drone, {})
    demo = load_scenario("paper-demo")
    assert override(demo, {"mission.fusion.estimator": "other"}).mission.fusion.estimator == "other"
    with pytest.raises(ConfigError, match=r"mission.fusion.estimator: unknown estimator 'another'"):
        override(demo, {"mission.fusion.estimator": "another"})
