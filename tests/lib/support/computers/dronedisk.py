"""The disk of one drone of a fleet, in QEMU's own network: the host is 10.0.2.2 there, the guest 10.0.2.15."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

import msgspec

from radron.deploy.image.layout import MIN_DISK_BYTES
from radron.deploy.remote import Host
from radron.protocol.onboard import Computer
from support.computers.fleets import FLEET, KEY, make_fleet
from support.computers.machine import Machine
from support.mesh.meshes import free_port

ROOT = Path(__file__).parents[4]
PASSPHRASE = "four quite ordinary words"
BOOT_S = 1200.0  # without hardware support, on a busy computer: the longest so far took 560 s, on an idle one 75 s


class Drone:
    """Files of a fleet of two, and the disk of d1. Its agent waits for an autopilot that never comes. ``changes``: differences
    in the fleet file.
    """

    def __init__(self, folder: Path, changes: Iterable[tuple[str, str]] = ()) -> None:
        self.folder, self.disk = folder, folder / "disk.img"
        self.mesh_port, self.ssh_port, self.autopilot_port = free_port(), free_port(), free_port()
        with self.disk.open("wb") as disk:
            disk.truncate(MIN_DISK_BYTES)
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / "id")], check=True)
        text = FLEET.replace(KEY, (folder / "id.pub").read_text().strip())
        for old, new in (
            ("10.7.1.0/24", "10.0.2.0/24"),
            ("10.7.1.11", "10.0.2.15"),
            ("10.7.1.12", "10.0.2.16"),
            ('gateway = "10.7.1.1"\nntp = ["10.7.1.2"]\n', ""),
            ('"enp*"', '"en*"'),
            ('"serial:///dev/ttyACM0:57600"', '"udpin://10.0.2.15:14540"\nsource = "10.0.2.2"'),
            ('"pypixet"\npixet_folder = "/var/lib/radron/pixet"', '"feed"\naddress = "10.0.2.2:5600"'),
            ('calibration = "cameras/1"\n', ""),  # the agent would find that it is none
            ('version = "0.1.0"\n', ""),
            *changes,
        ):
            assert old in text, old
            text = text.replace(old, new)
        self.fleet = make_fleet(folder, text)
        self.pki = folder / "pki"
        self.deploy("pki", "init", "--pki", str(self.pki))
        self.deploy("pki", "issue", "anna", "--role", "operator", "--pki", str(self.pki), "--out", str(folder / "anna"))
        self.deploy("pki", "issue", "builder", "--role", "release", "--pki", str(self.pki), "--out", str(folder / "builder"))

    @property
    def host(self) -> Host:
        """Address for the login."""
        return Host("d1", "127.0.0.1", "root", self.ssh_port, (f"IdentityFile={self.folder / 'id'}", *self._unknown))

    @property
    def _unknown(self) -> tuple[str, ...]:
        return ("StrictHostKeyChecking=no", "UserKnownHostsFile=/dev/null")

    def command(self, *arguments: str) -> list[str]:
        """``radron-deploy`` with these arguments."""
        return [sys.executable, "-m", "radron.deploy.cli", *arguments]

    @property
    def environment(self) -> dict[str, str]:
        """For it."""
        return {**os.environ, "RADRON_PKI_PASSPHRASE": PASSPHRASE}

    def deploy(self, *arguments: str) -> None:
        """Run it, as a user does."""
        subprocess.run(self.command(*arguments), check=True, env=self.environment, cwd=ROOT)

    def at_host(self, *arguments: str) -> list[str]:
        """``radron-deploy`` for this drone, over SSH."""
        options = [part for option in self.host.options for part in ("--ssh", option)]
        return self.command(arguments[0], f"root@127.0.0.1:{self.ssh_port}", *arguments[1:], *options)

    def flash(self, image: Path) -> None:
        """Make the disk that of d1."""
        fleet, erase = str(self.fleet), ("--erase", "disk.img")
        self.deploy(
            "image", "flash", str(image), str(self.disk), "--drone", "d1", "--fleet", fleet, "--pki", str(self.pki), *erase
        )

    def boot(
        self,
        folder: Path | None = None,
        drive: str | None = None,
        clock: str = "utc",
        state: Path | None = None,
        line: int | None = None,
    ) -> Machine:
        """Switch the computer on. ``folder``: for its serial log; ``drive``: another disk; ``state``: kept of a running one;
        ``line``: a port of the host for its USB serial adapter.
        """
        ports = {self.mesh_port: "tcp:7447", self.ssh_port: "tcp:22", self.autopilot_port: "udp:14540"}
        return Machine(folder or self.folder, drive or self.disk, ports, clock, state, line)

    def status(self, within_s: float = BOOT_S) -> Computer:
        """Output of ``radron-update status``; waits for the SSH server."""
        deadline_s = time.monotonic() + within_s
        while True:
            said = self.ssh("/opt/radron/bin/radron-update status")
            if said.startswith("{"):
                return msgspec.json.decode(said, type=Computer)
            assert time.monotonic() < deadline_s, said
            time.sleep(1.0)

    def push(self, *arguments: str) -> subprocess.Popen[str]:
        """``radron-deploy push`` in the background."""
        pipe = subprocess.PIPE
        command = self.at_host("push", *arguments)
        return subprocess.Popen(command, env=self.environment, cwd=ROOT, stdout=pipe, stderr=subprocess.STDOUT, text=True)

    def ssh(self, command: str) -> str:
        """Output of a command on board."""
        ran = subprocess.run(self.host.command(command), capture_output=True, text=True, check=False)
        return ran.stdout + ran.stderr
