"""The preflight finding on a sensor for relative observations."""

from __future__ import annotations

import asyncio
import socket
import time

import msgspec

from radron.agent.config.drone import DroneConfig, PeerMeshConfig, SightingsConfig, VehicleConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.preflight.check import Preflight
from radron.agent.vehicle.interface import Finding, SeenDrone
from support.live.agents import free_ports
from support.sensors.line_server import line_server

MISSION = MissionConfig(
    name="test",
    drones=(DroneInMission(id="d1"), DroneInMission(id="d2")),
    area=AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0))),
)


def drone(address: str | None) -> DroneConfig:
    return DroneConfig(
        id="d1",
        mesh=PeerMeshConfig(endpoints={"d1": f"tcp/127.0.0.1:{free_ports(1)[0]}"}, insecure=True),
        vehicle=VehicleConfig(address=f"udpin://127.0.0.1:{free_ports(1, socket.SOCK_DGRAM)[0]}"),
        sightings=SightingsConfig(address=address),
    )


def named(findings: list[Finding]) -> list[Finding]:
    return [finding for finding in findings if finding.name == "sightings"]


def test_it_is_ready_once_it_is_heard_and_says_whom_it_sees() -> None:
    async def course() -> list[Finding]:
        told: list[Finding] = []
        async with line_server() as server:
            check = Preflight(drone(server.address), MISSION)

            def show(findings: list[Finding]) -> None:
                told.extend(named(findings))
                if told[-1].verdict == "not yet":
                    server.send(b"\n")
                else:
                    seen = SeenDrone(stamp_ns=time.time_ns(), target="d2", range_m=5.0, range_sigma_m=0.3)
                    server.send(msgspec.json.encode(seen) + b"\n")

            running = asyncio.create_task(check.run(30.0, show))
            while not (told and "d2" in told[-1].text):
                assert not running.done()
                await asyncio.sleep(0.05)
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)
        return told

    told = asyncio.run(course())
    assert told[0].verdict == "not yet"
    assert told[-1] == Finding("sightings", "ok", "drones seen so far: d2")


def test_a_drone_without_one_misses_none_and_a_wrong_address_is_a_failure() -> None:
    assert named(Preflight(drone(None), MISSION).findings) == []

    async def course() -> list[Finding]:
        check = Preflight(drone("nowhere"), MISSION)
        await check.run(0.3, lambda findings: None)
        return named(check.findings)

    (found,) = asyncio.run(course())
    assert found.verdict == "failed"
    assert "nowhere" in found.text
