"""docker-compose.yml as it stands: what each service may do; addresses, ports and names fit together. Needs no engine."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from radron.agent.shell.overrides import load_drone
from radron.sim.scenario import load_scenario, override

ROOT = Path(__file__).resolve().parents[2]
AGENTS = {f"agent-{i}": i for i in range(1, 11)}


def defaults(text: str) -> str:
    """The text with each ``${NAME:-default}`` replaced by its default."""
    return re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", text)


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return dict(yaml.safe_load(defaults((ROOT / "docker-compose.yml").read_text())))


@pytest.fixture(scope="module")
def services(document: dict[str, Any]) -> dict[str, Any]:
    return dict(document["services"])


def environment_file(name: str) -> dict[str, str]:
    lines = (ROOT / "deploy/compose" / name).read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


@pytest.mark.parametrize("name", ["sim", *AGENTS])
def test_what_flies_has_few_rights(services: dict[str, Any], name: str) -> None:
    service = services[name]
    assert service["user"] == "1000:1000"
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "cap_add" not in service
    assert service["security_opt"] == ["no-new-privileges"]


@pytest.mark.parametrize(("name", "number"), AGENTS.items())
def test_an_agent_is_configured_as_its_addresses_say(services: dict[str, Any], tmp_path: Path, name: str, number: int) -> None:
    service = services[name]
    ids = [drone.id for drone in override(load_scenario("paper-demo"), {"drones": 10}).mission.drones]
    members = "".join(f'[[drones]]\nid = "{drone}"\norigin_m = [{6 * place}, 0, 0]\n' for place, drone in enumerate(ids))
    (tmp_path / "mission.toml").write_text(f'name = "ten"\n{members}[area]\npolygon_m = [[0, 0], [60, 0], [60, 9]]\n')
    environment = {key: str(value) for key, value in service["environment"].items()}
    drone, _ = load_drone(ROOT / "deploy/compose/drone.toml", {**environment, "RADRON_MISSION": str(tmp_path / "mission.toml")})

    assert drone.id == ids[number - 1]
    assert drone.mesh.endpoints[drone.id] == f"tls/{service['networks']['mesh']['ipv4_address']}:7447"
    # The simulation's conventions: it sends vehicle i's MAVLink to the i-th host, and serves camera i at port 5600 + i, i from 0.
    assert service["networks"]["vehicle"]["ipv4_address"] == f"10.7.2.{10 + number}"
    assert drone.vehicle.address == f"udpin://{service['networks']['vehicle']['ipv4_address']}:14540"
    assert drone.mesh.identity == f"/results/agents/{drone.id}/identity"
    assert drone.detector.address == f"{services['sim']['networks']['vehicle']['ipv4_address']}:{5599 + number}"


def test_no_two_services_share_an_address(services: dict[str, Any]) -> None:
    addresses = [network["ipv4_address"] for service in services.values() for network in service.get("networks", {}).values()]
    assert len(addresses) == len(set(addresses))


def test_an_agent_knows_of_its_localisation_what_the_scenario_says(services: dict[str, Any], tmp_path: Path) -> None:
    scenario = load_scenario(services["sim"]["environment"]["SCENARIO"])
    (tmp_path / "mission.toml").write_text(
        'name = "one"\ndrones = [{ id = "d1" }]\n[area]\npolygon_m = [[0, 0], [9, 0], [9, 9]]\n'
    )
    drone, _ = load_drone(ROOT / "deploy/compose/drone.toml", {"RADRON_MISSION": str(tmp_path / "mission.toml")})
    assert drone.vehicle.response == scenario.response
    assert drone.vehicle.position_sigma_m == scenario.localization.horizontal_m
    assert drone.vehicle.yaw_sigma_deg == scenario.localization.yaw_deg
    assert scenario.camera.calibration_spread == 0.0  # the drone file names no calibration


@pytest.mark.parametrize(("file", "drones"), [(None, 3), ("six.env", 6), ("ten.env", 10)])
def test_a_profile_starts_as_many_agents_as_fly(services: dict[str, Any], file: str | None, drones: int) -> None:
    chosen = environment_file(file) if file else {"DRONES": services["sim"]["environment"]["DRONES"]}
    profiles = set(chosen.get("COMPOSE_PROFILES", "").split(","))
    started = [name for name in AGENTS if not services[name].get("profiles") or profiles & set(services[name]["profiles"])]
    assert int(chosen["DRONES"]) == len(started) == drones


def test_each_agent_of_the_real_autopilots_has_one(services: dict[str, Any]) -> None:
    pilots = [
        name
        for name, service in services.items()
        if service.get("profiles") == environment_file("px4.env")["COMPOSE_PROFILES"].split(",")
    ]
    assert pilots == ["px4-1", "px4-2", "px4-3"]
    for number, name in enumerate(pilots, start=1):
        given = services[name]["environment"]
        assert given["INSTANCE"] == number - 1  # MAVLink system id less one
        assert given["AGENT"] == services[f"agent-{number}"]["networks"]["vehicle"]["ipv4_address"]
        assert given["GROUND_STATION"] == services["sim"]["networks"]["vehicle"]["ipv4_address"]
