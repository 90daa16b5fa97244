"""A drone file with overrides from the environment: precedence, relative paths, and the source named in errors."""

from pathlib import Path

import pytest

from radron.agent.errors import ConfigError
from radron.agent.shell.overrides import load_drone

MISSION = """
name = "harbour"
drones = [{ id = "d1" }, { id = "d2", origin_m = [6.0, 0.0, 0.0] }]
area = { polygon_m = [[0, 0], [100, 0], [100, 100], [0, 100]] }
"""
DRONE = """
id = "d1"
mission = "missions/harbour.toml"
state = "state"

[mesh.endpoints]
d1 = "tcp/10.7.1.11:7447"

[vehicle]
address = "udpin://0.0.0.0:14540"
"""


@pytest.fixture
def drone_file(tmp_path: Path) -> Path:
    (tmp_path / "missions").mkdir()
    (tmp_path / "missions/harbour.toml").write_text(MISSION)
    path = tmp_path / "drone.toml"
    path.write_text(DRONE)
    return path


def error_of(path: Path, **environment: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_drone(path, environment)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_the_environment_stands_over_the_file(drone_file: Path) -> None:
    drone, mission = load_drone(
        drone_file,
        {
            "RADRON_ID": "d2",
            "RADRON_VEHICLE__ADDRESS": "udpin://0.0.0.0:14541",
            "RADRON_VEHICLE__CONNECT_TIMEOUT_S": "3",
            "RADRON_CAMERA_RPY_DEG": "[0, 0, 45.5]",
            "RADRON_MESH__ENDPOINTS__D2": "tcp/10.7.1.12:7447",
            "HOME": "/root",
            "RADRON_SIM_MESH": "tcp/10.7.1.11:7447",
            "RADRON_PKI_PASSPHRASE": "four quite ordinary words",
            "RADRON_IDENTITY": "pki/anna",
        },
    )
    assert drone.id == "d2"
    assert drone.vehicle.address == "udpin://0.0.0.0:14541"
    assert drone.vehicle.connect_timeout_s == 3.0
    assert drone.camera_rpy_deg == (0.0, 0.0, 45.5)
    assert drone.mesh.endpoints == {"d1": "tcp/10.7.1.11:7447", "d2": "tcp/10.7.1.12:7447"}
    assert mission.name == "harbour"


def test_relative_paths_are_from_the_drone_file(drone_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(drone_file.parent.parent)
    drone, _ = load_drone(Path(drone_file.parent.name) / drone_file.name, {"RADRON_RECORDER__FOLDER": "/var/flights"})
    assert drone.state == str(drone_file.parent / "state")
    assert drone.recorder.folder == "/var/flights"


def test_an_unknown_variable_is_named(drone_file: Path) -> None:
    text = error_of(drone_file, RADRON_VEHICLE__ADRESS="udpin://0.0.0.0:1")
    assert text.startswith("environment variable RADRON_VEHICLE__ADRESS: unknown key 'vehicle.adress'; did you mean 'address'?")


def test_a_wrong_value_is_blamed_on_its_variable(drone_file: Path) -> None:
    text = error_of(drone_file, RADRON_VEHICLE__CONNECT_TIMEOUT_S="-1", RADRON_ID="d2")
    assert text.startswith("environment variable RADRON_VEHICLE__CONNECT_TIMEOUT_S: vehicle.connect_timeout_s: ")


def test_a_wrong_value_of_the_file_is_blamed_on_the_file(drone_file: Path) -> None:
    drone_file.write_text(DRONE.replace("address =", "adress ="))
    assert error_of(drone_file, RADRON_ID="d2").startswith(f"{drone_file}: unknown key 'vehicle.adress'")


def test_what_is_no_section_has_no_keys(drone_file: Path) -> None:
    assert error_of(drone_file, RADRON_ID__NAME="x") == "environment variable RADRON_ID__NAME: 'id' is not a section"


def test_a_drone_needs_a_mission_that_names_it(drone_file: Path) -> None:
    assert "its drones are d1, d2" in error_of(drone_file, RADRON_ID="d3")
    drone_file.write_text(DRONE.replace('mission = "missions/harbour.toml"', ""))
    assert error_of(drone_file) == f"{drone_file}: the key 'mission' is missing: the path of the mission file"


def test_a_file_that_is_none(tmp_path: Path) -> None:
    assert error_of(tmp_path / "no.toml") == f"{tmp_path / 'no.toml'}: cannot be read: No such file or directory"


def test_a_ground_that_cannot_be_used_is_told_on_load(drone_file: Path) -> None:
    missions = drone_file.parent / "missions"
    (missions / "harbour.toml").write_text(f'{MISSION}ground = {{ grid = "hills.asc" }}\n')
    assert "hills.asc: cannot be read" in error_of(drone_file)
    (missions / "hills.asc").write_text("ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2\n3 4\n")
    assert "hills.asc: it does not cover the corner (100, 0)" in error_of(drone_file)
