"""The files that a fleet file becomes on a drone: read again by the agent's own loader."""

from __future__ import annotations

import shutil
import subprocess
from base64 import b64encode
from pathlib import Path, PurePosixPath

import numpy as np
import pytest

from radron.agent.detector.files.calibration import load_calibration
from radron.agent.errors import ConfigError
from radron.agent.shell.overrides import load_drone
from radron.deploy.cli import main
from radron.deploy.fleet.files import files_of, write_files
from radron.deploy.fleet.loading import load_fleet
from support.computers.fleets import FLEET, KEY, MISSION, PIXELS, make_fleet


def texts(folder: Path, drone: str) -> dict[str, str]:
    fleet = load_fleet(make_fleet(folder))
    return {str(name): data.decode() for name, data in files_of(fleet, fleet.drone(drone)).items()}


def test_the_agent_reads_its_drone_file(tmp_path: Path) -> None:
    fleet = load_fleet(make_fleet(tmp_path))
    board = tmp_path / "board"
    write_files(board, files_of(fleet, fleet.drone("d1")))
    drone, mission = load_drone(board / "drone.toml", {})
    assert drone.id == "d1"
    assert mission.mission_id == fleet.mission.mission_id
    assert drone.mesh.endpoints == {"d1": "tls/10.7.1.11:7447", "d2": "tls/10.7.1.12:7447"}
    assert drone.mesh.identity == "/run/credentials/radron-agent.service"
    assert drone.mesh.others == ("anna",)
    assert drone.calibration == str(board / "calibration")
    assert (board / "calibration/t.txt").read_text() == PIXELS
    assert drone.state is not None
    assert drone.recorder.folder is not None
    assert all(place.startswith("/var/lib/radron/") for place in (drone.state, drone.recorder.folder))


def test_the_calibration_of_a_camera_may_be_the_file_of_its_maker(tmp_path: Path) -> None:
    path = make_fleet(tmp_path)
    constants = {
        name: b64encode(np.full(65536, value, "<f8").tobytes()).decode()
        for name, value in zip("abct", (1.6, 24.0, 60.0, 1.8), strict=True)
    }
    chip = "".join(f"<calib{name}>{text}</calib{name}>" for name, text in constants.items())
    (tmp_path / "camera.xml").write_text(f"<xml><chip>{chip}</chip></xml>")
    path.write_text(path.read_text().replace('"cameras/1"', '"camera.xml"'))
    fleet = load_fleet(path)
    write_files(tmp_path / "board", files_of(fleet, fleet.drone("d1")))
    drone, _ = load_drone(tmp_path / "board/drone.toml", {})
    assert drone.calibration is not None
    assert load_calibration(Path(drone.calibration)).bad_pixels == 0


def test_a_drone_reports_the_parameters_that_the_fleet_file_judges(tmp_path: Path) -> None:
    text = FLEET.replace("[vehicle]", '[px4]\nparameters = { SYS_HITL = 0 }\n\n[vehicle]\nparameters = ["MC_ROLL_P"]', 1)
    fleet = load_fleet(make_fleet(tmp_path, text))
    write_files(tmp_path / "board", files_of(fleet, fleet.drone("d1")))
    drone, _ = load_drone(tmp_path / "board/drone.toml", {})
    assert drone.vehicle.parameters == ("MC_ROLL_P", "SYS_HITL")
    with pytest.raises(ConfigError, match=r"fleet\.toml: a key of px4\.parameters: expected a name of PX4's, .* COM_OF_LOSS_T"):
        load_fleet(make_fleet(tmp_path, text.replace("SYS_HITL", "sys_hitl")))


def test_the_computers_own_files(tmp_path: Path) -> None:
    made = texts(tmp_path, "d2")
    assert made["hostname"] == "radron-d2\n"
    assert made["authorized_keys"] == f"{KEY}\n"
    assert "Name=enp*\n" in made["network/10-mesh.network"]
    assert "Address=10.7.1.12/24\nGateway=10.7.1.1\n" in made["network/10-mesh.network"]
    assert made["chrony/fleet.sources"].splitlines() == [
        "server 10.7.1.2 iburst prefer",
        "server 10.7.1.11 iburst minpoll 2 maxpoll 5",
    ]
    assert made["chrony/fleet.conf"] == "allow 10.7.1.0/24\n"
    assert "calibration/a.txt" not in made


def test_the_firewall_lets_in_the_autopilot_only_from_its_address(tmp_path: Path) -> None:
    assert "autopilot { 10.41.10.2 . 14540 }" in texts(tmp_path, "d2")["firewall.nft"]
    assert "autopilot" not in texts(tmp_path, "d1")["firewall.nft"]


@pytest.mark.skipif(shutil.which("nft") is None, reason="nft is not installed")
def test_the_firewall_is_what_nftables_understands(tmp_path: Path) -> None:
    rules = (Path(__file__).parents[3] / "deploy/image/contents/rootfs/etc/nftables.conf").read_text()
    file = tmp_path / "rules.nft"
    file.write_text(rules.replace('include "/run/radron/firewall*.nft"', texts(tmp_path, "d2")["firewall.nft"]))
    checked = subprocess.run(["nft", "--check", "--file", str(file)], capture_output=True, text=True, check=False)
    if "Operation not permitted" in checked.stderr:
        pytest.skip("nft checks rules as root only")
    assert checked.returncode == 0, checked.stderr


def test_an_elevation_grid_comes_along_and_must_lie_beside_the_mission(tmp_path: Path) -> None:
    grid = "ncols 3\nnrows 3\nxllcorner -100\nyllcorner -100\ncellsize 100\n0 0 0\n0 0 0\n0 0 0\n"
    (tmp_path / "hills.asc").write_text(grid)
    path = make_fleet(tmp_path, mission=MISSION + '\n[ground]\ngrid = "hills.asc"\n')
    fleet = load_fleet(path)
    assert files_of(fleet, fleet.drone("d1"))[PurePosixPath("mission/hills.asc")] == grid.encode()
    path = make_fleet(tmp_path, mission=MISSION + f'\n[ground]\ngrid = "../{tmp_path.name}/hills.asc"\n')
    with pytest.raises(ConfigError, match=r"give the bare name of a file in the mission file's folder"):
        load_fleet(path)


def test_a_map_of_buildings_comes_along_and_the_mission_on_board_is_the_same(tmp_path: Path) -> None:
    ring = "[[1, 1], [3, 1], [3, 2], [1, 1]]"
    (tmp_path / "town.geojson").write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"height_m": 3}, '
        f'"geometry": {{"type": "Polygon", "coordinates": [{ring}]}}}}]}}'
    )
    section = '\n[buildings]\nfile = "town.geojson"\ncrs = "mission"\n'
    fleet = load_fleet(make_fleet(tmp_path, mission=MISSION + section))
    assert len(fleet.mission.buildings.known) == 1
    write_files(tmp_path / "board", files_of(fleet, fleet.drone("d1")))
    assert load_drone(tmp_path / "board/drone.toml", {})[1].mission_id == fleet.mission.mission_id
    other = make_fleet(tmp_path, mission=MISSION + section.replace("town", f"../{tmp_path.name}/town"))
    with pytest.raises(ConfigError, match=r"buildings.file = .*: give the bare name of a file in the mission file's folder"):
        load_fleet(other)


def test_the_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    path = make_fleet(tmp_path)

    def run(*arguments: str) -> int | str | None:
        monkeypatch.setattr("sys.argv", ["radron-deploy", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code

    assert run("fleet", "check", str(path)) == 0
    assert "10.7.1.12" in capsys.readouterr().out
    assert run("fleet", "files", str(path), "--drone", "d1", "--out", str(tmp_path / "out")) == 0
    assert (tmp_path / "out/drone.toml").is_file()
    (tmp_path / "cameras/1/c.txt").write_text("1 2\n")
    assert run("fleet", "check", str(path)) == 2
    told = capsys.readouterr().err
    assert told == f"radron-deploy: {tmp_path}/cameras/1/c.txt: holds 1 x 2; 256 lines of 256 numbers are needed\n"
    path.write_text(FLEET.replace("subnet", "subnett"))
    assert run("fleet", "check", str(path)) == 2
    assert capsys.readouterr().err.startswith(f"radron-deploy: {path}: unknown key 'network.subnett'")
