"""Root file system of the onboard computer: Debian's packages, our files (``contents/``), and the agent.

The agent is in a Python environment of its own.
"""

from __future__ import annotations

import io
import tarfile
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from pathlib import Path

from radron.deploy.image.tools import run

SUITE = "bookworm"
MIRROR, SECURITY = "http://deb.debian.org/debian", "http://deb.debian.org/debian-security"
SNAPSHOT = "http://snapshot.debian.org/archive"
# LZO: GRUB reads it, and unpacking is several times faster than with the other compressions that GRUB reads.
COMPRESSION = ("-comp", "lzo", "-Xalgorithm", "lzo1x_1_15", "-b", "256K")
_CONTENTS = Path(str(files("radron.deploy.image"))) / "contents"
_NOT_INSTALLED = ("doc", "man", "info", "locale", "bash-completion", "lintian", "i18n/locales")
_ENABLED = [
    "systemd-networkd",
    "nftables",
    "chrony",
    "ssh",
    "radron-provision",
    "radron-agent",
    "radron-clock.path",
    "radron-settle",
    "radron-console@tty1",
    "radron-console@ttyS0",
]


@dataclass(frozen=True, slots=True)
class Release:
    """Release of the onboard system.

    ``version``: of radron. ``commit``: of its source. ``epoch``: date of all files, seconds since 1970.
    """

    version: str
    commit: str
    epoch: int

    @property
    def build(self) -> str:
        """Date and commit of the source, which distinguish two releases of one version."""
        return f"{datetime.fromtimestamp(self.epoch, UTC):%Y%m%dT%H%M%SZ}-{self.commit}"


def sources(snapshot: str | None) -> list[str]:
    """Return the lines that tell apt from which Debian archive to install.

    ``snapshot``: time of the archive, such as 20261101T000000Z; None: its present state.
    """
    main, security, options = MIRROR, SECURITY, ""
    if snapshot is not None:
        main, security = f"{SNAPSHOT}/debian/{snapshot}", f"{SNAPSHOT}/debian-security/{snapshot}"
        options = "[check-valid-until=no] "
    return [
        f"deb {options}{main} {SUITE} main",
        f"deb {options}{main} {SUITE}-updates main",
        f"deb {options}{security} {SUITE}-security main",
    ]


def packages() -> list[str]:
    """Return the names of the Debian packages on board, from ``contents/packages.txt``."""
    lines = (_CONTENTS / "packages.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def make_rootfs(
    out: Path, work: Path, release: Release, wheels: Sequence[Path], snapshot: str | None, cache: Path, log: Path
) -> None:
    """Make the root file system of the onboard computer, as a squashfs (compressed, read-only file system).

    It takes one to three minutes and needs the network.

    Args:
        out: the file to make.
        work: folder for intermediate files.
        release: version, commit and date.
        wheels: Python packages of the agent.
        snapshot: time of Debian's archive; None: its present state.
        cache: folder that keeps Debian's packages for the next build.
        log: file to which the output of the programs is appended.

    Raises:
        ImageError: a program failed, mostly because Debian's archive is not reached.
    """
    overlay, archive = work / "overlay.tar", work / "rootfs.tar"
    with tarfile.open(overlay, "w") as tar:
        add_contents(tar, release)
        for wheel in wheels:
            _add(tar, f"tmp/wheels/{wheel.name}", wheel.read_bytes(), release.epoch)
    debs = cache / "debs"
    debs.mkdir(parents=True, exist_ok=True)
    enable = " ".join(_ENABLED)
    command = ["mmdebstrap", "--variant=essential", "--architectures=amd64", f"--include={','.join(packages())}"]
    command += [f"--dpkgopt=path-exclude=/usr/share/{folder}/*" for folder in _NOT_INSTALLED]
    command += [
        '--aptopt=Acquire::Retries "5"',
        # Debian's packages are kept for the next build.
        "--skip=essential/unlink",
        '--setup-hook=mkdir -p "$1/var/cache/apt/archives"',
        f"--setup-hook=sync-in {debs} /var/cache/apt/archives",
        f"--customize-hook=sync-out /var/cache/apt/archives {debs}",
        f"--essential-hook=copy-in {_CONTENTS}/rootfs/etc/initramfs-tools /etc",  # before the kernel, which makes the initrd
        f"--customize-hook=tar-in {overlay} /",
        '--customize-hook=chroot "$1" sh /tmp/finish.sh',
        f'--customize-hook=systemctl --root="$1" --quiet enable {enable}',
        "--format=tar",
        SUITE,
        str(archive),
    ]
    dates = {"SOURCE_DATE_EPOCH": str(release.epoch)}
    run([*command, *sources(snapshot)], log, dates)
    out.unlink(missing_ok=True)
    run(["mksquashfs", "-", str(out), "-tar", "-root-mode", "0755", "-no-progress", *COMPRESSION], log, dates, stdin=archive)
    archive.unlink()


def add_contents(tar: tarfile.TarFile, release: Release) -> None:
    """Add our files (``contents/rootfs``) to a tar archive, with owners, modes and dates that do not depend on the checkout."""
    folder = _CONTENTS / "rootfs"
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            _add(tar, str(path.relative_to(folder)), path.read_bytes(), release.epoch, bool(path.stat().st_mode & 0o100))
    for script in (_CONTENTS / "finish.sh", _CONTENTS.parents[1] / "docker/prune.sh"):
        _add(tar, f"tmp/{script.name}", script.read_bytes(), release.epoch)
    lines = (
        ("PRETTY_NAME", f"radron {release.version} ({release.commit})"),
        ("IMAGE_ID", "radron-nuc"),
        ("IMAGE_VERSION", release.version),
        ("BUILD_ID", release.build),
    )
    text = "".join(f'{key}="{value}"\n' for key, value in lines)
    _add(tar, "usr/share/radron/release", text.encode(), release.epoch)


def _add(tar: tarfile.TarFile, name: str, data: bytes, epoch: int, executable: bool = False) -> None:
    entry = tarfile.TarInfo(name)
    entry.size, entry.mtime, entry.mode = len(data), epoch, 0o755 if executable else 0o644
    tar.addfile(entry, io.BytesIO(data))
