"""`make image-test`: a flashed computer with an autopilot, a camera and another drone passes its preflight check."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from radron.agent.doctor.report import Report
from radron.deploy.computer.doctor import BENCH, report_in
from radron.deploy.remote import RemoteError
from support.computers.cutbench import IN_MESH
from support.computers.dronedisk import BOOT_S, Drone
from support.computers.machine import Machine, lacking
from support.computers.timeserver import time_server
from support.live.agents import Agent, Vehicles, closing, free_ports
from support.px4.serial_line import SerialLine
from support.sensors.bench_camera import bench_camera

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
]
HOST = "10.0.2.2"  # in QEMU's network; the other drone is there
WAIT_S = 300.0


@contextmanager
def surroundings(drone: Drone, camera: int, line: SerialLine) -> Iterator[None]:
    """The vehicle of d1, its camera, and d2 with its own vehicle, as a process of the host."""
    vehicle, mesh = free_ports(2)
    drone.deploy("pki", "issue", "d2", "--role", "drone", "--pki", str(drone.pki), "--out", str(drone.folder / "d2"))
    (drone.folder / "d2.toml").write_text(f"""
id = "d2"
mission = "mission.toml"
mesh = {{ identity = "d2", endpoints = {{ d1 = "tls/127.0.0.1:{drone.mesh_port}", d2 = "tls/127.0.0.1:{mesh}" }} }}
vehicle = {{ address = "udpin://127.0.0.1:{vehicle}" }}
detector = {{ driver = "feed", address = "127.0.0.1:{camera}" }}
""")
    vehicles = Vehicles([line.vehicle_port, vehicle], parameters={"COM_OF_LOSS_T": 5.0})
    with closing(line, vehicles, Agent(drone.folder, "d2")), bench_camera(camera):
        yield


def examined(drone: Drone, *options: str) -> Report:
    """By its own doctor."""
    return report_in(drone.ssh(f"{BENCH} doctor --json --wait {WAIT_S:g} {' '.join(options)}"), RemoteError)


def test_a_drone_that_has_everything_passes_its_preflight_check(image: Path, tmp_path: Path, machines: list[Machine]) -> None:
    line, (camera,) = SerialLine(), free_ports(1)
    changes = (
        ('"udpin://10.0.2.15:14540"\nsource = "10.0.2.2"', '"serial:///dev/ttyUSB0:921600"'),
        ("10.0.2.2:5600", f"{HOST}:{camera}"),
        ("10.0.2.16", HOST),
    )
    drone = Drone(tmp_path, changes)
    drone.flash(image)
    with surroundings(drone, camera, line), time_server() as time_port:
        machines.append(drone.boot(line=line.port))
        machines[-1].wait_for(IN_MESH, BOOT_S)
        # As the other drone's chrony, on a port that needs no root.
        told = drone.ssh(f"chronyc delete {HOST} && chronyc add server {HOST} port {time_port} iburst minpoll 2 maxpoll 3")
        assert told.count("200 OK") == 2, told

        report = examined(drone, "--write")
        found = {check.name: check for check in report.checks}
        bad = [check for check in report.checks if check.verdict != "ok" and check.name != "time to boot"]  # it is emulated
        assert bad == []
        assert [(each.name, each.before, each.taken) for each in report.written] == [("COM_OF_LOSS_T", 5.0, True)]
        assert "serial:///dev/ttyUSB0:921600, PX4 1.17.0" in found["autopilot"].text
        assert {"ready to arm", "launch place", "parameters"} <= found.keys()
        assert found["camera"].text.startswith("sees background: ")
        assert found["chrony"].text.endswith(f" from {HOST}")
        assert found["certificate"].text.startswith("d1, drone, until ")
        assert found["mesh"].text == "tls/10.0.2.15:7447, encrypted"
        assert found["d2"].text.startswith("preflight, the same mission")
        assert found["reach d2"].text.startswith(f"{HOST}: ")

        passed = drone.ssh(f"{BENCH} preflight --wait {WAIT_S:g}; echo code $?")  # the parameters are right now
        assert passed.endswith("code 0\n"), passed
    assert "usermod" not in machines[-1].text
