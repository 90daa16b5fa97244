"""`radron-deploy install` on a computer with systemd and SSH: installed, examined, installed again, and removed."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from radron.agent.shell import foldworker
from radron.deploy.remote import Host
from support.computers.fleets import KEY
from support.computers.systemd_machine import lacking, systemd_machine
from support.live.agents import Vehicles, closing, free_ports, until
from support.sensors.bench_camera import bench_camera

pytestmark = [pytest.mark.long, pytest.mark.skipif(lacking() is not None, reason=str(lacking()))]
SOURCE = Path(__file__).parents[3]
DEPLOY = str(Path(sys.executable).parent / "radron-deploy")
MISSION = """
name = "yard"
drones = [{ id = "d1", origin_m = [5, 5, 0] }, { id = "d2", origin_m = [16, 2, 0] }]
area = { polygon_m = [[0, 0], [50, 0], [50, 50], [0, 50]] }
fusion = { estimator = "sources" }
"""


def fleet(mesh: int, vehicle: int, camera: int) -> str:
    """The fleet file, with the ports of this test."""
    return f"""
mission = "mission.toml"
ssh_keys = ["{KEY}"]
network = {{ subnet = "127.0.0.0/8", port = {mesh} }}
vehicle = {{ address = "udpin://127.0.0.1:{vehicle}" }}
detector = {{ driver = "feed", address = "127.0.0.1:{camera}" }}
drones = [{{ id = "d1", address = "127.0.0.11" }}, {{ id = "d2", address = "127.0.0.12" }}]
"""


_CHRONY = "/etc/chrony"
_OTHERS = "server 127.0.0.12 iburst minpoll 2 maxpoll 5"
_ESTIMATOR = f"""
for process in $(pgrep --full '[ ]{foldworker.__name__}'); do
    limit=$(sed -n 's/^Max data size *\\([0-9a-z]*\\) .*/\\1/p' /proc/$process/limits)
    echo $(ps -o ni= -p $process) $limit $(cat /proc/$process/oom_score_adj)
done
"""


@dataclass
class Bench:
    """A computer to install on, and the laptop's folder."""

    folder: Path
    host: Host
    vehicle_port: int
    camera_port: int

    def deploy(self, what: str, *options: str) -> subprocess.CompletedProcess[str]:
        """A command of radron-deploy for that computer."""
        ssh = [part for option in self.host.options for part in ("--ssh", option)]
        command = [DEPLOY, what, f"{self.host.address}:{self.host.port}", *options, *ssh]
        environment = {**os.environ, "RADRON_PKI_PASSPHRASE": "four words are enough", "COLUMNS": "250"}
        return subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=self.folder, env=environment, timeout=1500.0
        )

    def install(self, *options: str) -> subprocess.CompletedProcess[str]:
        """As the technician does it."""
        return self.deploy("install", "--fleet", "fleet.toml", "--drone", "d1", "--source", str(SOURCE), *options)

    def there(self, command: str) -> str:
        """Output of a command there."""
        return subprocess.run(self.host.command(command), capture_output=True, text=True, check=False).stdout.strip()

    def shown(self, name: str) -> str:
        """A property of the agent's unit."""
        return self.there(f"systemctl show --property={name} --value radron-agent")

    def niceness(self) -> int:
        """That of the agent's supervisor."""
        return int(self.there(f"ps -o ni= -p {self.shown('MainPID')}"))

    def estimator(self) -> list[tuple[int, str, str]]:
        """The process of the estimator: niceness, most memory, score for the kernel that ends processes when memory runs out."""
        return [
            (int(niceness), limit, score)
            for niceness, limit, score in (line.split() for line in self.there(_ESTIMATOR).splitlines())
        ]

    def status(self) -> str:
        """The agent's messages to the service manager."""
        return self.shown("StatusText")


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    mesh, vehicle, camera = free_ports(3)
    (tmp_path / "fleet.toml").write_text(fleet(mesh, vehicle, camera))
    (tmp_path / "mission.toml").write_text(MISSION)
    environment = {**os.environ, "RADRON_PKI_PASSPHRASE": "four words are enough"}
    subprocess.run([DEPLOY, "pki", "init"], check=True, cwd=tmp_path, env=environment, capture_output=True)
    with systemd_machine(tmp_path / "nuc") as host:
        yield Bench(tmp_path, host, vehicle, camera)


def test_from_an_empty_computer_to_a_drone_and_back(bench: Bench) -> None:
    assert bench.there("ls -d /opt/radron*") == ""
    bench.there(f"mkdir -p {_CHRONY}/conf.d {_CHRONY}/sources.d")  # as where chrony is installed
    first = bench.install()
    assert first.returncode == 0, first.stderr
    assert "is d1 now" in first.stdout
    assert re.search(r"the agent runs: waiting: .*udpin://127.0.0.1", first.stderr), first.stderr
    assert bench.there("systemctl is-enabled radron-agent") == "enabled"
    assert bench.shown("NRestarts") == "0"  # waits, without restarts
    assert "radron-agent: waiting: " in bench.there("journalctl --output=cat --unit=radron-agent")
    assert bench.there("stat -c %U:%a /etc/radron/identity/key.pem") == "root:600"
    assert bench.there("ls -d /var/tmp/radron*") == ""

    with closing(Vehicles([bench.vehicle_port], parameters={"COM_OF_LOSS_T": 5.0})), bench_camera(bench.camera_port):
        until(lambda: bench.status() == "preflight", 120.0, "an agent that is ready")
        until(lambda: bench.estimator() == [(bench.niceness() + 5, "1500000000", "900")], 60.0, "an estimator that goes behind")
        assert bench.shown("NRestarts") == "0"
        assert bench.shown("OOMPolicy") == "continue"
        examined = bench.deploy("doctor", "--wait", "60", "--write")
        # The agent was stopped meanwhile, and runs again, as the autopilot's only client.
        until(lambda: bench.status() == "preflight", 120.0, "the agent again")
        shown = bench.deploy("status")
    assert shown.returncode == 0, shown.stderr
    assert "30 days left" in shown.stdout
    assert "PX4 1.17.0" in examined.stdout, examined.stderr
    assert "COM_OF_LOSS_T: 5 before, " in examined.stdout + examined.stderr
    assert "sees background: " in examined.stdout
    assert "d1, drone, until " in examined.stdout
    bad = examined.stdout.rstrip().splitlines()[-1].partition(": ")[2].split(", ")
    assert set(bad) <= {"chrony", "d2", "reach d2"}  # there is no d2; chrony and ping are not everywhere

    assert bench.there(f"cat {_CHRONY}/*/radron.*") == "allow 127.0.0.0/8\nlocal stratum 10 orphan\n" + _OTHERS
    bench.there("touch -d 2100-01-01 /etc/radron/hostname; systemctl restart radron-provision")  # a dead clock
    assert bench.there(f"cat {_CHRONY}/*/radron.*") == "allow 127.0.0.0/8\n" + _OTHERS

    before = bench.there("readlink -f /opt/radron; sha256sum /etc/radron/identity/*; stat -c %i /opt/radron/complete")
    (bench.folder / "mission.toml").write_text(MISSION.replace('"yard"', '"meadow"'))
    again = bench.install()
    assert again.returncode == 0, again.stderr
    assert " MB" not in again.stderr  # the packages are there
    assert bench.there("readlink -f /opt/radron; sha256sum /etc/radron/identity/*; stat -c %i /opt/radron/complete") == before
    assert "meadow" in bench.there("cat /run/radron/agent/mission/mission.toml")

    removed = bench.deploy("uninstall")
    assert "stays in /var/lib/radron" in removed.stdout, removed.stderr
    left = "find /opt /etc /usr/lib /run -maxdepth 4 -name '*radron*' -not -path '/run/systemd/*'; ls -A /run/credstore"
    assert bench.there(left) == ""
    assert bench.there("systemctl is-active radron-agent") == "inactive"
    assert bench.there("ls /var/lib/radron/state") != ""
    purged = bench.deploy("uninstall", "--purge")
    assert purged.returncode == 0, purged.stderr
    assert bench.there("ls -d /var/lib/radron; getent passwd radron") == ""


def test_what_is_not_ours_is_not_touched(bench: Bench) -> None:
    bench.there("mkdir /opt/radron && touch /opt/radron/mine")
    told = bench.install()
    assert told.returncode == 2
    assert told.stderr.splitlines()[-1].endswith("/opt/radron is there, and not from `radron-deploy install`: move it away")
    assert bench.there("ls /opt/radron /etc/radron") == "/opt/radron:\nmine"
