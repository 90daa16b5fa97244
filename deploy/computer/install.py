"""Installation of the agent on an existing Debian or Ubuntu computer, for ``radron-deploy install``.

The services and scripts are the ones of the disk image.
"""

from __future__ import annotations

import hashlib
import io
import shlex
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path, PurePosixPath

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding

from radron.deploy.computer.host import MACHINES, Computer, asked, probe, script
from radron.deploy.digest import digest
from radron.deploy.fleet.config import FleetDrone
from radron.deploy.fleet.files import files_of
from radron.deploy.fleet.loading import Fleet
from radron.deploy.image.build import release_of
from radron.deploy.image.errors import ImageError
from radron.deploy.image.tools import run as run_here
from radron.deploy.image.wheels import Platform, make_own_wheel, make_wheels
from radron.deploy.pki.authority import PkiFolder
from radron.deploy.remote import Host, Progress, run, send
from radron.protocol.identity import REVOKED_FILE, IdentityError, Role

THERE = "/var/tmp/radron-install"
KEPT_NS = 7 * 86_400_000_000_000  # a certificate with a longer remaining validity is kept
# The image's files that an existing computer gets; the rest of the computer is its owner's.
SYSTEM_FILES = (
    "etc/systemd/system/radron-agent.service",
    "etc/systemd/system/radron-clock.path",
    "etc/systemd/system/radron-clock.service",
    "etc/systemd/system/radron-provision.service",
    "etc/sysusers.d/radron.conf",
    "etc/udev/rules.d/60-radron.rules",
    "usr/lib/radron/provision",
    "usr/lib/radron/bench",
)
_DROP_IN = "etc/systemd/system/radron-provision.service.d/installed.conf"
_FROM_FOLDER = "[Service]\nExecStart=\nExecStart=/usr/lib/radron/provision /etc/radron\n"
_NOT_ITS_OWN = ("network", "firewall.nft", "authorized_keys")  # of the drone's files


@dataclass(frozen=True, slots=True)
class Order:
    """An installation to be made: the agent of a source checkout, as one drone of a fleet.

    ``pki``: folder of the certificate authority. ``source``: the checkout. ``cache``: folder for Python packages. ``online``: the
    computer fetches the packages itself.
    """

    fleet: Fleet
    drone: FleetDrone
    pki: PkiFolder
    source: Path
    cache: Path
    online: bool = False


async def install(
    host: Host, order: Order, issue: Callable[[Path], None], now_ns: int, say: Callable[[str], None], progress: Progress
) -> None:
    """Install a drone's agent on a computer, or update it; a repetition is safe at any time.

    Args:
        host: the computer.
        order: the installation.
        issue: writes a new certificate and key of the drone into the given folder.
        now_ns: present time, nanoseconds UTC.
        say: called with each step.
        progress: called with the progress of the copy.

    Raises:
        RemoteError: the computer cannot become a drone, or is not reached.
        ImageError: a package cannot be fetched or built, such as a package without a wheel for this processor.
        IdentityError: the authority cannot issue the certificate.
    """
    computer = await probe(host)
    kind = MACHINES[computer.platform.machine]
    say(f"{host.name}: {computer.system}, {kind}, Python {computer.platform.python}")
    with tempfile.TemporaryDirectory(prefix="radron-install-") as name:  # mode 700: the drone's key is in it for a moment
        work = Path(name)
        wheels = make_packages(order, computer.platform, work)
        release = release_name(wheels, computer)
        own = drone_files(order, computer, issue, work, now_ns)
        if computer.release != release:
            say(f"{len(wheels)} packages, {sum(wheel.stat().st_size for wheel in wheels) / 1e6:.0f} MB")
            await _send_packages(host, wheels, release, work, progress)
        await run(host, f"mkdir -p -m 0700 {THERE}; tar -xf - -C {THERE}", scripts())
        command = f"sh {THERE}/install.sh {release} {shlex.quote(computer.python)} && rm -rf {THERE}"
        await run(host, command, own, lambda line: say(f"{host.name}: {line}"))


def make_packages(order: Order, platform: Platform, work: Path) -> list[Path]:
    """Make all Python packages (wheels) that a computer needs, including pip.

    If the computer fetches packages itself (``order.online``), only this project's wheel, pip and the list of pinned versions are
    made. ``work``: empty folder for the result.

    Raises:
        ImageError: a wheel cannot be fetched or built.
    """
    if not order.online:
        return collect(order.source, order.cache, platform)
    log = order.cache / "install.log"
    order.cache.mkdir(parents=True, exist_ok=True)
    run_here([sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", str(work / "pip"), "pip"], log)
    make_own_wheel(order.source, work, work / "pip", release_of(order.source).epoch, log)
    constraints = work / "pip/constraints.txt"
    constraints.write_bytes((order.source / "constraints.txt").read_bytes())
    return sorted((work / "pip").iterdir())


def collect(source: Path, cache: Path, platform: Platform) -> list[Path]:
    """Collect all Python packages (wheels) for a kind of computer, including pip, fetched or from the cache.

    Raises:
        ImageError: a wheel cannot be fetched or built; the text names the package.
    """
    cache.mkdir(parents=True, exist_ok=True)
    log = cache / "install.log"
    log.write_text("")
    try:
        return make_wheels(source, cache / "wheels", release_of(source).epoch, log, platform, ("pip",))
    except ImageError as error:
        raise ImageError(f"the packages for Python {platform.python} on {MACHINES[platform.machine]}: {error}") from None


def release_name(wheels: Iterable[Path], computer: Computer) -> str:
    """Return a name for the agent's Python environment: a hash over all wheels and the interpreter.

    Any difference changes the name.
    """
    content = "".join(f"{wheel.name} {digest(wheel)}\n" for wheel in sorted(wheels, key=lambda each: each.name))
    return hashlib.sha256(f"{content}{computer.platform.python} {computer.python}".encode()).hexdigest()[:16]


def drone_files(order: Order, computer: Computer, issue: Callable[[Path], None], work: Path, now_ns: int) -> bytes:
    """Return a drone's configuration files as a tar archive, with a new certificate unless the present one is kept.

    The files have the present date, by which the computer detects that its own clock is wrong.
    """
    made = {name: data for name, data in files_of(order.fleet, order.drone).items() if name.parts[0] not in _NOT_ITS_OWN}
    if not keeps_certificate(order, computer, now_ns):
        issue(work / "identity")
        made |= {PurePosixPath("identity") / file.name: file.read_bytes() for file in (work / "identity").iterdir()}
    elif (revoked := order.pki.folder / REVOKED_FILE).is_file():
        made[PurePosixPath(REVOKED_FILE)] = revoked.read_bytes()
    return _tar({str(name): (data, 0o600) for name, data in made.items()}, now_ns // 1_000_000_000)


def keeps_certificate(order: Order, computer: Computer, now_ns: int) -> bool:
    """Return whether the drone's present certificate can be kept.

    It must be a certificate of this drone by this authority, not revoked, and valid for longer than ``KEPT_NS``.
    """
    if computer.certificate is None or computer.authority is None:
        return False
    authority = order.pki.authority()
    try:
        if authority.certificate != x509.load_pem_x509_certificate(computer.authority):
            return False
        own = authority.verify(x509.load_pem_x509_certificate(computer.certificate).public_bytes(Encoding.DER))
    except (IdentityError, ValueError):
        return False
    revoked = any(one.serial == f"{own.serial:x}" and one.revoked_ns is not None for one in order.pki.issued())
    return (own.name, own.role) == (order.drone.id, Role.DRONE) and own.not_after_ns - now_ns > KEPT_NS and not revoked


def scripts() -> bytes:
    """Return the installer as a tar archive: ``install.sh``, and below ``system`` the services, scripts and rules.

    They are the files of the disk image, except that the drone's own files are in a folder instead of on a partition.
    """
    rootfs = files("radron.deploy.image").joinpath("contents", "rootfs")
    made = {name: (rootfs.joinpath(name).read_bytes(), 0o755 if "/lib/" in name else 0o644) for name in SYSTEM_FILES}
    made |= {_DROP_IN: (_FROM_FOLDER.encode(), 0o644)}
    return _tar({f"system/{name}": content for name, content in made.items()} | {"install.sh": (script("install.sh"), 0o700)})


async def uninstall(host: Host, purge: bool) -> str:
    """Remove the agent from a computer, and return the last line of the script's output.

    ``purge``: also remove flight records and state.

    Raises:
        RemoteError: the computer is not reached, in flight, or runs the image.
    """
    await asked(host)
    said = await run(host, f"sh -s {'purge' if purge else 'keep'}", script("uninstall.sh"))
    return said.strip().rpartition("\n")[2]


async def _send_packages(host: Host, wheels: list[Path], release: str, work: Path, progress: Progress) -> None:
    """Send the wheels as one archive.

    Its bytes depend on the wheels alone: an interrupted copy is completed, a complete copy is not repeated.
    """
    archive, place = work / "packages.tar", f"{THERE}/packages-{release}.tar"
    archive.write_bytes(_tar({f"wheels/{wheel.name}": (wheel.read_bytes(), 0o600) for wheel in wheels}))
    await run(host, f"mkdir -p -m 0700 {THERE}")
    await send(host, archive, place, progress)


def _tar(made: dict[str, tuple[bytes, int]], epoch: int = 0) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w") as archive:
        for name, (data, mode) in sorted(made.items()):
            entry = tarfile.TarInfo(name)
            entry.size, entry.mode, entry.mtime = len(data), mode, epoch
            archive.addfile(entry, io.BytesIO(data))
    return out.getvalue()
