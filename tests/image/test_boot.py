"""`make image-test`: builds the image, makes a disk of it for one drone of a fleet, and boots that in a virtual computer."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import time
from pathlib import Path

import pytest

from radron.deploy.image.compare import unpack_root
from radron.deploy.image.layout import MIN_DISK_BYTES, ROOT_A
from radron.protocol.identity import load_identity
from radron.protocol.mesh.session import Mesh, MeshConfig
from support.computers.dronedisk import BOOT_S, Drone
from support.computers.machine import Machine, lacking
from support.px4.time_source import telling

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
]


async def alive_in(drone: Drone, within_s: float) -> frozenset[str]:
    """Drones that an operator sees in the mesh."""
    links = MeshConfig(connect=(f"tls/127.0.0.1:{drone.mesh_port}",), identity=load_identity(drone.folder / "anna"))
    mesh = await Mesh.open(links, "radron", None, receive=lambda key, payload: None)
    try:
        deadline_s = time.monotonic() + within_s
        while not mesh.alive and time.monotonic() < deadline_s:
            await asyncio.sleep(0.1)
        return frozenset(mesh.alive)
    finally:
        await mesh.close()


def test_a_flashed_disk_becomes_a_drone_that_waits_for_its_autopilot(image: Path, drone: Drone, machines: list[Machine]) -> None:
    drone.flash(image)
    machines.append(drone.boot())
    begun_s = time.monotonic()
    machines[-1].wait_for(r"radron: booting slot A, attempt 1", BOOT_S)
    machines[-1].wait_for(r"radron-provision: this is radron-d1, radron ", BOOT_S)
    machines[-1].wait_for(r'"event": "mesh is up"', BOOT_S)
    print(f"in the mesh {time.monotonic() - begun_s:.0f} s after switching on")
    assert asyncio.run(alive_in(drone, 60.0)) == {"d1"}
    machines[-1].wait_for(r"radron-agent: waiting: no autopilot on udpin://10\.0\.2\.15:14540", BOOT_S)

    status = drone.ssh("systemctl show radron-agent --property=ActiveState,StatusText,NRestarts")
    assert "ActiveState=activating\n" in status
    assert "NRestarts=0\n" in status
    assert "StatusText=waiting: no autopilot on udpin://10.0.2.15:14540" in status
    assert drone.ssh("systemctl --failed --no-legend --plain") == ""
    assert drone.ssh("systemd-analyze security --threshold=30 radron-agent > /dev/null && echo rated") == "rated\n"
    assert "Using hardware watchdog" in drone.ssh("journalctl -b -o cat _PID=1")
    assert "policy drop" in drone.ssh("nft list chain inet radron input")
    assert "10.0.2.16" in drone.ssh("chronyc -n sources")
    assert drone.ssh("findmnt --noheadings --output FSTYPE,OPTIONS /").split()[0] == "squashfs"
    assert "other" not in drone.ssh("touch /etc/other 2>/dev/null && ls /etc/other")
    host_key = drone.ssh("cat /var/lib/ssh/ssh_host_ed25519_key.pub")
    machine_id = drone.ssh("cat /etc/machine-id")

    machines.pop().power_off()
    (drone.folder / "serial.log").unlink()
    machines.append(drone.boot())
    machines[-1].wait_for(r"radron: booting slot A, attempt 1", BOOT_S)
    machines[-1].wait_for(r"radron-agent: waiting: no autopilot", BOOT_S)
    assert drone.ssh("cat /var/lib/ssh/ssh_host_ed25519_key.pub") == host_key
    assert drone.ssh("cat /etc/machine-id") == machine_id == "a1b2c3d400004000800000000000d002\n"


def test_a_dead_clock_is_set_by_the_autopilots(image: Path, drone: Drone, machines: list[Machine]) -> None:
    drone.flash(image)
    machines.append(drone.boot(clock="2021-03-04T05:06:07"))
    machines[-1].wait_for(
        r"radron-agent: waiting: clock: .* not valid before .*; the autopilot on udpin://10\.0\.2\.15:14540 tells no time yet",
        BOOT_S,
    )
    assert drone.ssh("chronyc -c tracking").strip().endswith(",Not synchronised")  # hence no other drone would follow it
    with telling(drone.autopilot_port, time.time_ns, period_s=1.0):
        machines[-1].wait_for(r"radron-clock: the clock showed 20\d\d-.*; set to the autopilot's, 20", BOOT_S)
        machines[-1].wait_for(r'"event": "mesh is up"', BOOT_S)
    asked_ns, shown = time.time_ns(), drone.ssh("date +%s%N; chronyc -c tracking; systemctl --failed --no-legend --plain")
    assert asked_ns - 3_000_000_000 < int(shown.split()[0]) < time.time_ns() + 3_000_000_000
    assert shown.strip().endswith(",Normal")  # others may follow it now; and nothing has failed


def test_a_disk_without_a_drones_configuration_says_so(image: Path, drone: Drone, machines: list[Machine]) -> None:
    shutil.copyfile(image, drone.disk)
    with drone.disk.open("r+b") as disk:
        disk.truncate(MIN_DISK_BYTES)
    machines.append(drone.boot())
    machines[-1].wait_for(
        r"radron-provision: there is no drone.toml on the partition 'config': this computer is no drone yet", BOOT_S
    )


def test_there_are_no_secrets_in_the_image(image: Path, tmp_path: Path) -> None:
    unpack_root(image, ROOT_A, tmp_path / "root")
    key = re.compile(rb"-----BEGIN [A-Z ]*PRIVATE KEY-----\s+[A-Za-z0-9+/=]{40}")
    files = [path for path in (tmp_path / "root").rglob("*") if path.is_file() and not path.is_symlink()]
    assert len(files) > 10_000
    found = [path for path in files if key.search(path.read_bytes())]
    assert [path for path in found if not path.name.startswith("libgnutls.so")] == []  # with the keys of its self-tests
    assert [path for path in files if path.name.startswith("ssh_host_")] == []
    shadow = (tmp_path / "root/etc/shadow").read_text().splitlines()
    assert {line.split(":")[1] for line in shadow} <= {"*", "!", "!*", "!!"}
    assert not (tmp_path / "root/etc/machine-id").read_bytes()
