"""The mission in force: the uploaded one is kept whole or not at all, and used after a restart."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.estimators import FusionConfig
from radron.agent.config.loading import load_mission, mission_content
from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.mission.uploads import Origin
from radron.agent.shell.missionstore import keep, mission_in_force, mission_path
from support.flights.one_pilot import MISSION, START_NS

NEW = replace(MISSION, name="new")
ORIGIN = Origin(station="anna", taken_ns=START_NS, instead_of=MISSION.mission_id)


@pytest.fixture
def drone(tmp_path: Path) -> DroneConfig:
    return DroneConfig(id="d1", state=str(tmp_path / "state"))


def kept(mission: MissionConfig, drone: DroneConfig, mission_id: str = "") -> None:
    keep(mission_content(mission), mission_id or mission.mission_id, drone, "radron", ORIGIN)


def test_without_an_upload_the_mission_files_counts(drone: DroneConfig) -> None:
    assert mission_in_force(drone, MISSION) == mission_in_force(DroneConfig(id="d1"), MISSION)
    assert mission_in_force(drone, MISSION).mission is MISSION


def test_an_uploaded_mission_is_used_after_a_restart_and_says_where_it_is_from(drone: DroneConfig) -> None:
    kept(NEW, drone)
    force = mission_in_force(drone, MISSION)
    assert (force.mission, force.origin, force.fault) == (NEW, ORIGIN, None)
    assert force.notice == "its mission was uploaded by anna, 2027-01-15 08:00 UTC"


def test_a_second_upload_replaces_the_first(drone: DroneConfig) -> None:
    kept(NEW, drone)
    newer = replace(MISSION, name="newer")
    kept(newer, drone)
    assert mission_in_force(drone, MISSION).mission == newer


def test_a_mission_file_changed_by_hand_counts_again(drone: DroneConfig) -> None:
    kept(NEW, drone)
    edited = replace(MISSION, name="edited")
    force = mission_in_force(drone, edited)
    assert force.mission is edited
    assert force.notice == f"its mission file was changed: it counts, not the mission {NEW.mission_id} uploaded before"


UNFIT = {
    "another swarm": (replace(MISSION, swarm="other"), "is for the swarm 'other', and this is 'radron'"),
    "not its drone": (replace(MISSION, drones=(DroneInMission(id="d2"),)), "drone 'd1' is not in mission"),
    "estimator": (replace(MISSION, fusion=FusionConfig(estimator="oracle")), "fusion.estimator"),
    "nuclide": (replace(MISSION, nuclide="Xx-1"), "Xx-1"),
    "launch places": (
        replace(MISSION, drones=(DroneInMission(id="d1"), DroneInMission(id="d2", origin_m=(1.0, 0.0, 0.0)))),
        "d1 and d2 are launched 1.0 m apart",
    ),
    "height": (replace(MISSION, survey=replace(MISSION.survey, height_m=500.0)), "survey.height_m = 500 is outside"),
}


@pytest.mark.parametrize("what", UNFIT)
def test_a_mission_that_this_drone_cannot_fly_is_refused_in_one_line_and_the_old_one_stays(drone: DroneConfig, what: str) -> None:
    kept(NEW, drone)
    unfit, reason = UNFIT[what]
    with pytest.raises(ConfigError) as caught:
        kept(unfit, drone)
    assert reason in str(caught.value)
    assert "\n" not in str(caught.value)
    assert mission_in_force(drone, MISSION).mission == NEW


@pytest.mark.parametrize(
    "content", [b"", b"\x00", b"\x93\x01\x02\x03", mission_content(NEW)[:-1], mission_content(NEW) + b"\x00"]
)
def test_what_is_no_whole_mission_is_refused(drone: DroneConfig, content: bytes) -> None:
    with pytest.raises(ConfigError, match=f"mission {NEW.mission_id}: .*; give all the same version of radron"):
        keep(content, NEW.mission_id, drone, "radron", ORIGIN)
    assert mission_in_force(drone, MISSION).mission is MISSION


def test_a_mission_under_the_id_of_another_one_is_refused(drone: DroneConfig) -> None:
    with pytest.raises(ConfigError, match=f"is read as {NEW.mission_id} here"):
        kept(NEW, drone, "0" * 16)


def test_without_a_folder_nothing_can_be_kept() -> None:
    with pytest.raises(ConfigError, match=r"no folder to keep it: give one in the drone file \(state = \"state\"\)"):
        kept(NEW, DroneConfig(id="d1"))


def test_a_damaged_file_prevents_a_start_and_is_told(drone: DroneConfig) -> None:
    kept(NEW, drone)
    path = mission_path(drone)
    assert path is not None
    intact = path.read_bytes()
    for damaged in (intact[:-30], intact.replace(b'"new"', b'"mew"'), b""):
        path.write_bytes(damaged)
        force = mission_in_force(drone, MISSION)
        assert force.mission is MISSION
        assert force.fault is not None
        assert force.fault.startswith(f"the uploaded mission in {path} cannot be used (")
    path.write_bytes(intact)
    assert mission_in_force(drone, MISSION).fault is None


def test_a_mission_brings_its_elevation_grid(drone: DroneConfig, tmp_path: Path) -> None:
    (tmp_path / "hills.asc").write_text("ncols 2\nnrows 2\nxllcorner -90\nyllcorner -90\ncellsize 100\n1 2\n3 4\n")
    (tmp_path / "mission.toml").write_text(
        'name = "hills"\ndrones = [{ id = "d1" }]\narea = { polygon_m = [[0, 0], [50, 0], [50, 50], [0, 50]] }\n'
        'ground = { grid = "hills.asc" }\n'
    )
    mission = load_mission(tmp_path / "mission.toml")
    kept(mission, drone)
    (tmp_path / "hills.asc").unlink()
    assert mission_in_force(drone, MISSION).mission == mission
