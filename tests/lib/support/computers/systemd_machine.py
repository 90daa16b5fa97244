"""A computer with systemd and an SSH server, for tests of installations: this computer's own root file system, or a second
(COMPUTER_ROOT=FOLDER: another release of Debian or Ubuntu, with systemd), below an overlay, in namespaces of its own.
Its files vanish with the machine. The network is this computer's.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from radron.deploy.remote import Host
from support.computers.sshserver import LACKING as NO_SSH
from support.computers.sshserver import SSHD
from support.live.agents import until
from support.mesh.meshes import free_port

_ROOT = Path(os.environ.get("COMPUTER_ROOT", "/")).resolve()
_SYSTEMD = _ROOT / "lib/systemd/systemd"
_SCRIPT = """
set -eu
mount --make-rprivate /
cd "$1"
mount -t overlay overlay -o "lowerdir=$2,upperdir=$1/upper,workdir=$1/work" root
cd root
mount -t proc proc proc
mount -t sysfs sysfs sys
mount -t tmpfs tmpfs dev
mkdir dev/pts dev/shm
mount -t devpts -o newinstance,ptmxmode=666 devpts dev/pts
ln -s pts/ptmx dev/ptmx
ln -s /proc/self/fd dev/fd
for name in null zero full random urandom tty; do touch dev/$name; mount --bind /dev/$name dev/$name; done
mount -t tmpfs -o mode=755 tmpfs run
for name in tmp var/tmp; do mount -t tmpfs tmpfs $name; done
mount -t cgroup2 cgroup2 sys/fs/cgroup
mount --make-rshared . # by which units get their credentials
exec env -i container=test PATH=/usr/sbin:/usr/bin:/sbin:/bin chroot . /lib/systemd/systemd --unit=test.target
"""
_TARGET = "[Unit]\nRequires=basic.target dbus.service\nAfter=basic.target\nWants=test-ssh.service\nAllowIsolate=yes\n"
# Devices, clock and network are this computer's: what would set them, or listen there, does not start.
_WITHOUT = (
    "systemd-udevd.service",
    "systemd-udev-trigger.service",
    "systemd-timesyncd.service",
    "systemd-resolved.service",
    "chrony.service",
    "ssh.socket",
)


def lacking() -> str | None:
    """Why there can be no such computer here."""
    if NO_SSH is not None:
        return NO_SSH
    if os.geteuid() != 0:
        return "a computer with systemd needs root, for its namespaces"
    missing = [name for name in ("unshare", "chroot", "systemctl") if shutil.which(name) is None]
    if missing or not _SYSTEMD.exists():
        return f"no {_SYSTEMD} on this computer"
    tried = subprocess.run(["unshare", "-m", "-p", "-f", "-u", "-i", "-C", "true"], capture_output=True, check=False)
    return None if tried.returncode == 0 else "namespaces cannot be made here"


@contextmanager
def systemd_machine(folder: Path) -> Iterator[Host]:
    """Boot one; its root file system is ``folder/root``, visible to this machine alone; its writes are in ``folder/upper``."""
    for name in ("upper", "work", "root", "upper/etc/systemd/system", "upper/root/.ssh"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    port, upper = free_port(), folder / "upper"
    for name in ("host", "id"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)], check=True)
    for name in ("host", "id.pub"):
        shutil.copy(folder / name, upper / "root" / name)
    settings = ("-o", f"ListenAddress=127.0.0.1:{port}", "-o", "HostKey=/root/host", "-o", "AuthorizedKeysFile=/root/id.pub")
    settings += ("-o", "StrictModes=no", "-o", "UsePAM=no", "-o", "PermitRootLogin=yes", "-o", "MaxStartups=50")
    service = f"[Service]\nExecStartPre=/bin/mkdir -p /run/sshd\nExecStart={SSHD} -D -f /dev/null {' '.join(settings)}\n"
    units = upper / "etc/systemd/system"
    (units / "test-ssh.service").write_text(service)
    (units / "test.target").write_text(_TARGET)
    for unit in _WITHOUT:
        (units / unit).symlink_to("/dev/null")
    (upper / "etc/machine-id").write_text("")
    command = ["unshare", "-m", "-p", "-f", "-u", "-i", "-C", "--kill-child", "sh", "-c", _SCRIPT, "sh", str(folder), str(_ROOT)]
    with (folder / "machine.log").open("wb") as log:
        machine = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
    options = (f"IdentityFile={folder / 'id'}", "IdentitiesOnly=yes", f"UserKnownHostsFile={folder / 'known_hosts'}")
    host = Host("nuc", "127.0.0.1", "root", port, options)
    try:
        until(lambda: _booted(host, machine, folder), 60.0, "a computer with systemd")
        yield host
    finally:
        machine.kill()
        machine.wait()


def _booted(host: Host, machine: subprocess.Popen[bytes], folder: Path) -> bool:
    assert machine.poll() is None, (folder / "machine.log").read_text()
    asked = subprocess.run(host.command("systemctl is-active test.target"), capture_output=True, text=True, check=False)
    return asked.stdout.strip() == "active"
