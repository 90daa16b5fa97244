"""The files that a live flight's agents get."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from radron.agent.config.drone import DroneConfig, PeerMeshConfig, VehicleConfig, VisionConfig
from radron.agent.config.loading import load_mission, load_toml
from radron.agent.vehicle.demands import demands_of
from radron.agent.vehicle.rules import rules_of
from radron.sim.live.crew import Guidance, crew_parameters
from radron.sim.live.runfolder import Ports, RunFolder, drone_config, free_ports, live_mission
from radron.sim.scenario import load_scenario, override, shipped
from radron.sim.vehicle.px4.parameters import DEFAULTS


@pytest.mark.parametrize("name", shipped())
def test_a_mission_file_is_the_same_mission(name: str, tmp_path: Path) -> None:
    mission = live_mission(load_scenario(name), seed=3)
    files = RunFolder(tmp_path, agents_here=True)
    files.write_mission(mission)
    assert load_mission(files.mission_file).mission_id == mission.mission_id


def test_a_drone_file_says_what_the_flight_needs(tmp_path: Path) -> None:
    files = RunFolder(tmp_path, agents_here=True)
    mesh = {"d1": "tls/127.0.0.1:1", "d2": "tls/127.0.0.1:2"}
    config = drone_config(
        load_scenario("paper-demo"), "d2", calibrated=True, ports=Ports(14541, 5601), mesh=PeerMeshConfig(endpoints=mesh)
    )
    files.write_drone(config)
    assert load_toml(files.drone_file("d2"), DroneConfig) == config
    assert (files.drone_file("d2").parent / str(config.mission)).resolve() == files.mission_file.resolve()
    assert (config.vehicle.address, config.detector.address) == ("udpin://127.0.0.1:14541", "127.0.0.1:5601")


def test_a_drone_file_says_how_the_vehicle_is_guided(tmp_path: Path) -> None:
    files = RunFolder(tmp_path, agents_here=True)
    scenario, ports = load_scenario("mixed-frames"), Ports(14541, 5601, 5701, 5801)
    by_slam = drone_config(
        scenario, "d3", calibrated=False, ports=ports, mesh=PeerMeshConfig(endpoints={"d3": "tls/127.0.0.1:1"})
    )
    files.write_drone(by_slam)
    assert load_toml(files.drone_file("d3"), DroneConfig) == by_slam
    assert not by_slam.vehicle.gnss
    assert by_slam.vehicle.vision == VisionConfig(address="127.0.0.1:5701")
    assert by_slam.sightings.address == "127.0.0.1:5801"
    by_satellites = drone_config(scenario, "d1", calibrated=False, ports=ports._replace(vision=0), mesh=PeerMeshConfig())
    assert (by_satellites.vehicle.gnss, by_satellites.vehicle.vision) == (True, None)


@pytest.mark.parametrize(
    ("name", "drone", "guidance"),
    [
        ("demo", "d1", Guidance(gnss=True, vision=False)),
        ("mixed-frames", "d2", Guidance(gnss=True, vision=False)),
        ("mixed-frames", "d3", Guidance(gnss=False, vision=True)),
        ("gnss-lost-midway", "d1", Guidance(gnss=True, vision=True)),
    ],
)
def test_a_crew_sets_what_the_agent_asks_for(name: str, drone: str, guidance: Guidance) -> None:
    scenario = load_scenario(name)
    assert Guidance.of(scenario.localization.vehicles.get(drone)) == guidance
    values = DEFAULTS | crew_parameters(scenario.mission, (10.0, 2.0, 0.0), guidance)
    vision = VisionConfig(address="127.0.0.1:1") if guidance.vision else None
    vehicle = VehicleConfig(gnss=guidance.gnss, vision=vision)
    demands = demands_of(scenario.mission, DroneConfig(id=drone, vehicle=vehicle), sets=False)
    for rule in rules_of(demands):
        assert rule.check(values[rule.name], demands) is None, rule.name


def test_frames_begin_where_the_drones_are_launched() -> None:
    scattered = override(load_scenario("paper-demo"), {"start.scatter_m": 20.0})
    one, other = live_mission(scattered, seed=1), live_mission(scattered, seed=2)
    assert one.mission_id != other.mission_id
    assert one == live_mission(scattered, seed=1)
    assert [drone.id for drone in one.drones] == ["d1", "d2", "d3"]
    assert live_mission(load_scenario("paper-demo"), seed=1).mission_id == load_scenario("paper-demo").mission.mission_id


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
