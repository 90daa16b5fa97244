"""Fleet files: the values taken over, and a single line for each error."""

from __future__ import annotations

from pathlib import Path

import pytest

from radron.agent.errors import ConfigError
from radron.deploy.fleet.loading import load_fleet
from support.computers.fleets import FLEET, KEY, MISSION, make_fleet


def test_a_drone_has_the_shared_keys_and_its_own(tmp_path: Path) -> None:
    fleet = load_fleet(make_fleet(tmp_path))
    first, second = fleet.config.drones
    assert first.vehicle.address == "serial:///dev/ttyACM0:57600"
    assert second.vehicle.address == "udpin://10.41.10.1:14540"
    assert [drone.vehicle.position_sigma_m for drone in (first, second)] == [0.3, 0.3]
    assert [drone.detector.driver for drone in (first, second)] == ["pypixet", "pypixet"]
    assert first.camera_rpy_deg == (90.0, 0.0, 90.0)
    assert second.camera_rpy_deg == (90.0, 0.0, 0.0)
    assert fleet.mission.name == "yard"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("subnet =", "subnett =", r"fleet.toml: unknown key 'network.subnett'; did you mean 'subnet'\?"),
        ("position_sigma_m = 0.3", "position_sigma_m = -1", r"fleet.toml: vehicle.position_sigma_m: expected `float` >= 0.0"),
        ('"10.7.1.12"', '"10.7.1.11"', r"fleet.toml: drones: d1 and d2 have the same address 10.7.1.11"),
        ('"10.7.1.12"', '"10.7.2.12"', r"d2: address 10.7.2.12 is no host's address in network.subnet = 10.7.1.0/24"),
        ('"10.7.1.12"', '"10.7.1.255"', r"d2: address 10.7.1.255 is no host's address"),
        ('"10.7.1.12"', '"10.7.1"', r"drones: d2: address: '10.7.1' is no IPv4 address"),
        ('"10.7.1.0/24"', '"10.7.1.5/24"', r"network.subnet: .*it is like \"10.7.1.0/24\""),
        ('gateway = "10.7.1.1"', 'gateway = "10.7.1.11"', r"network.gateway: 10.7.1.11 is the address of a drone"),
        ('id = "d2"', 'id = "d1"', r"fleet.toml: drones: 'd1' is there twice"),
        ('id = "d2"', 'id = "d4"', r"mission.toml: drones: 'd4' is missing; the fleet and its mission must have the same"),
        ('"cameras/1"', '"cameras/7"', r"drones: d1: calibration: .*cameras/7 lacks a.txt, b.txt, c.txt, t.txt"),
        ('source = "10.41.10.2"', "", r"drones: d2: vehicle: an autopilot on the network needs its port and its own address"),
        ("10.41.10.1:14540", "10.41.10.1:0", r"drones: d2: vehicle: an autopilot on the network needs its port"),
        ("10.41.10.1:14540", "10.41.10.1:99999", r"drones: d2: vehicle: an autopilot on the network needs its port"),
        (KEY, "ssh-ed25519 AAAA nobody", r"ssh_keys: key 1: 'ssh-ed25519 AAAA nobody' is no public SSH key"),
        (KEY, "-----BEGIN OPENSSH PRIVATE KEY-----", r"ssh_keys: key 1: is a private key; give the public one"),
        (f'["{KEY}"]', "[]", r"ssh_keys: expected `array` of length >= 1"),
        ('"mission.toml"', '"other.toml"', r"other.toml: cannot be read: No such file"),
    ],
)
def test_an_error_is_one_line_that_says_where_and_what(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in FLEET
    path = make_fleet(tmp_path, FLEET.replace(old, new, 1))
    with pytest.raises(ConfigError, match=message) as caught:
        load_fleet(path)
    assert "\n" not in str(caught.value)


def test_a_drone_of_the_mission_that_the_fleet_lacks_is_named(tmp_path: Path) -> None:
    drone = '{ id = "d2", origin_m = [16, 2, 0] }'
    mission = MISSION.replace(drone, f"{drone}, {drone.replace('d2', 'd3').replace('16', '22')}")
    with pytest.raises(ConfigError, match=r"fleet.toml: drones: 'd3' is missing"):
        load_fleet(make_fleet(tmp_path, mission=mission))


def test_an_unknown_drone_is_answered_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"there is no drone 'd9'; its drones are d1, d2"):
        load_fleet(make_fleet(tmp_path)).drone("d9")
