"""A real SSH server on loopback in a folder of its own, for tests of actions over SSH."""

from __future__ import annotations

import getpass
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from radron.deploy.remote import Host
from support.mesh.meshes import free_port

SSHD = shutil.which("sshd", path=os.environ.get("PATH", os.defpath) + ":/usr/sbin")
LACKING = None if SSHD and shutil.which("ssh") else "no SSH server on this computer: `apt-get install openssh-server`"


@contextmanager
def ssh_server(folder: Path) -> Iterator[Host]:
    """A server that lets this user in with the key ``folder/id``; its settings do not touch the user's own."""
    assert SSHD is not None
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("host", "id"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)], check=True)
    shutil.copyfile(folder / "id.pub", folder / "authorized_keys")
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # folder of the privilege separation
    port = free_port()
    settings = {
        "ListenAddress": f"127.0.0.1:{port}",
        "HostKey": folder / "host",
        "AuthorizedKeysFile": folder / "authorized_keys",
        "PidFile": folder / "pid",
        "StrictModes": "no",
        "PermitRootLogin": "yes",
        "PasswordAuthentication": "no",
        "KbdInteractiveAuthentication": "no",
        "UsePAM": "no",
        "MaxStartups": "50",
    }
    (folder / "sshd_config").write_text("".join(f"{key} {value}\n" for key, value in settings.items()))
    with (folder / "sshd.log").open("wb") as log:
        server = subprocess.Popen([SSHD, "-D", "-e", "-f", str(folder / "sshd_config")], stdout=log, stderr=log)
    try:
        _await_port(port, server, folder)
        options = (f"IdentityFile={folder / 'id'}", "IdentitiesOnly=yes", f"UserKnownHostsFile={folder / 'known_hosts'}")
        yield Host("d1", "127.0.0.1", getpass.getuser(), port, options)
    finally:
        server.terminate()
        server.wait()


def _await_port(port: int, server: subprocess.Popen[bytes], folder: Path) -> None:
    deadline_s = time.monotonic() + 20.0
    while time.monotonic() < deadline_s and server.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.02)
    raise RuntimeError((folder / "sshd.log").read_text())
