"""The files that a live flight's agents get."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from agent.config import DroneConfig, load_mission, load_toml
from sim.runfolder import Ports, RunFolder, drone_config, free_ports, live_mission
from sim.scenario import load_scenario, override, shipped


@pytest.mark.parametrize("name", shipped())
def test_a_mission_file_is_the_same_mission(name: str, tmp_path: Path) -> None:
    mission = live_mission(load_scenario(name), seed=3)
    files = RunFolder(tmp_path, agents_here=True)
    files.write_mission(mission)
    assert load_mission(files.mission_file).mission_id == mission.mission_id


def test_a_drone_file_says_what_the_flight_needs(tmp_path: Path) -> None:
    files = RunFolder(tmp_path, agents_here=True)
    mesh = {"d1": "tcp/127.0.0.1:1", "d2": "tcp/127.0.0.1:2"}
    config = drone_config(load_scenario("demo"), "d2", calibrated=True, ports=Ports(14541, 5601), mesh=mesh)
    files.write_drone(config)
    assert load_toml(files.drone_file("d2"), DroneConfig) == config
    assert (files.drone_file("d2").parent / str(config.mission)).resolve() == files.mission_file.resolve()
    assert (config.vehicle.address, config.detector.address) == ("udpin://127.0.0.1:14541", "127.0.0.1:5601")


def test_frames_begin_where_the_drones_are_launched() -> None:
    scattered = override(load_scenario("demo"), {"start.scatter_m": 20.0})
    one, other = live_mission(scattered, seed=1), live_mission(scattered, seed=2)
    assert one.mission_id != other.mission_id
    assert one == live_mission(scattered, seed=1)
    assert [drone.id for drone in one.drones] == ["d1", "d2", "d3"]
    assert live_mission(load_scenario("demo"), seed=1).mission_id == load_scenario("demo").mission.mission_id


def test_an_old_flight_leaves_nothing_to_new_agents_but_others_agents_keep_theirs(tmp_path: Path) -> None:
    left = tmp_path / "agents" / "d1" / "state" / "d1.json"
    left.parent.mkdir(parents=True)
    left.touch()
    RunFolder(tmp_path, agents_here=False)
    assert left.exists()
    RunFolder(tmp_path, agents_here=True)
    assert not left.exists()


def test_ports_are_free_and_differ() -> None:
    ports = free_ports(20, socket.SOCK_STREAM)
    assert len(set(ports)) == 20
    for port in ports:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
