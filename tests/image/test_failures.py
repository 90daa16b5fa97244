"""`make image-test`: what else can befall a drone's computer: an agent or a kernel that hangs, a full data partition, no config
partition.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from radron.agent.shell.heartbeat import SILENT_START_S
from radron.deploy.image.layout import CONFIG
from support.computers.cutbench import IN_MESH, PROVISIONED, SETTLED, Bench, Push
from support.computers.dronedisk import BOOT_S, Drone
from support.computers.machine import Machine, lacking

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif("IMAGE_TEST" not in os.environ, reason="builds and boots a disk image: `make image-test` runs it"),
    pytest.mark.skipif(lacking() is not None, reason=lacking() or ""),
]
NO_AUTOPILOT = r"radron-agent: waiting: no autopilot"
# All available memory, also the part reserved for root.
FILL = "f=/var/lib/radron/full; fallocate -l $(df --output=avail --block-size=1 /var | tail -n 1) $f; cat /dev/zero >> $f"

BOOT_ID = "cat /proc/sys/kernel/random/boot_id"
PANIC = "echo c > /proc/sysrq-trigger"
# Nothing else gets a processor, so that systemd no longer tells the hardware watchdog that it lives.
HANG = "echo -1 > /proc/sys/kernel/sched_rt_runtime_us; for i in 1 2 3 4; do chrt -f 99 sh -c 'while :; do :; done' & done; wait"


@pytest.mark.parametrize("failure", [PANIC, HANG], ids=["panic", "hang"])
def test_a_computer_that_panics_or_hangs_starts_again_by_itself(
    image: Path, drone: Drone, machines: list[Machine], failure: str
) -> None:
    drone.flash(image)
    machines.append(drone.boot())
    machines[-1].wait_for(NO_AUTOPILOT, BOOT_S)
    machines[-1].wait_for(SETTLED, BOOT_S)
    before = drone.ssh(BOOT_ID)
    drone.ssh(f'systemd-run --quiet --no-block sh -c "sleep 2; {failure}"')
    machines[-1].wait_for(rf"(?s)(?:{IN_MESH}).*(?:{IN_MESH})", BOOT_S)
    now = drone.status()
    assert (now.slot, now.attempts, now.outcome) == ("A", 0, None)
    assert drone.ssh(BOOT_ID) not in ("", before)


def test_an_agent_that_hangs_before_the_flight_is_started_again(bench: Bench) -> None:
    run = bench.run("in service")
    assert bench.drone.ssh("pkill -STOP -f '^[^ ]+ -m radron.agent /' && echo stopped") == "stopped\n"
    run.machine.wait_for(rf"radron-agent: no heartbeat for {SILENT_START_S:g} s: killed", SILENT_START_S + BOOT_S)
    run.machine.wait_for(IN_MESH, BOOT_S)
    run.machine.wait_for(NO_AUTOPILOT, BOOT_S)
    assert "NRestarts=1\n" in bench.drone.ssh("systemctl show radron-agent --property=NRestarts")
    assert "booting slot" not in run.machine.text
    now = bench.drone.status()
    assert (now.slot, now.attempts, now.outcome) == ("A", 0, None)


def test_a_full_data_partition_stops_an_update_but_not_the_computer(bench: Bench) -> None:
    run = bench.run("in service")
    assert "No space left on device" in bench.drone.ssh(f"{FILL}; sync; systemctl reboot")
    assert run.decides(PROVISIONED) == "A"
    run.machine.wait_for(IN_MESH, BOOT_S)
    run.machine.wait_for(NO_AUTOPILOT, BOOT_S)
    now = bench.drone.status()
    assert (now.slot, now.attempts, now.disk_free_mb) == ("A", 0, 0)
    assert bench.drone.ssh("systemctl --failed --no-legend --plain") == ""
    with Push(bench.drone, bench.bundle) as push:
        push.wait_for("its disk is full: 0 MB free")
        assert push.ended() == 1
    bench.drone.ssh("rm /var/lib/radron/full")
    assert bench.drone.status().disk_free_mb > 200


def test_without_its_config_partition_it_says_that_it_is_no_drone_and_with_it_it_is_one_again(fresh: Bench) -> None:
    fresh.close()
    folder = fresh.drone.folder
    disk = folder / "changed.img"
    subprocess.run(["cp", "--sparse=always", str(fresh.drone.disk), str(disk)], check=True)
    change_partitions(disk, f"--delete={CONFIG.number}")
    without = fresh.drone.boot(new_folder(folder / "without"), str(disk))
    try:
        without.wait_for(r"radron: booting slot A, attempt 1", BOOT_S)
        without.wait_for(r"radron-provision: there is no drone.toml on the partition 'config': this computer is no drone", BOOT_S)
        without.wait_for(SETTLED, BOOT_S)
    finally:
        without.power_off()
    number, first, last = CONFIG.number, CONFIG.start // 512, (CONFIG.start + CONFIG.size) // 512 - 1
    change_partitions(disk, f"--new={number}:{first}:{last}", f"--change-name={number}:{CONFIG.name}")
    again = fresh.drone.boot(new_folder(folder / "again"), str(disk))
    try:
        again.wait_for(PROVISIONED, BOOT_S)
        again.wait_for(IN_MESH, BOOT_S)
        assert fresh.drone.status().slot == "A"
    finally:
        again.power_off()
        disk.unlink()


def change_partitions(disk: Path, *changes: str) -> None:
    """With sgdisk."""
    subprocess.run(["/usr/sbin/sgdisk", *changes, str(disk)], check=True, capture_output=True)


def new_folder(folder: Path) -> Path:
    """Make it."""
    folder.mkdir()
    return folder
