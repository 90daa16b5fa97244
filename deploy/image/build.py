"""Build of a bootable disk image for onboard computers from a source checkout, for ``radron-deploy image build``.

A list of the contents is written beside the image.
"""

from __future__ import annotations

import os
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from radron.deploy.digest import digest
from radron.deploy.image.bootloader import make_esp
from radron.deploy.image.disk import make_disk
from radron.deploy.image.errors import ImageError
from radron.deploy.image.fat import make_fat
from radron.deploy.image.layout import CONFIG, ESP, MIB, ROOT_A
from radron.deploy.image.rootfs import Release, make_rootfs
from radron.deploy.image.tools import need, run
from radron.deploy.image.wheels import make_wheels

PROGRAMS = ("mmdebstrap", "mksquashfs", "unsquashfs", "grub-mkimage", "sgdisk", "mkfs.vfat", "mcopy", "git")


class Manifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """List of the contents of a disk image, in the file ``IMAGE.json`` beside it.

    ``version``, ``commit``: release of radron in the image. ``epoch``: date of all files, seconds since 1970. ``sha256``: hash of
    the image. ``packages``: versions of Debian's packages, by name. ``wheels``: SHA-256 of the Python packages, by file name.
    """

    version: str
    commit: str
    epoch: int
    sha256: str
    packages: dict[str, str]
    wheels: dict[str, str]

    @property
    def build(self) -> str:
        """Date and commit of the source, which distinguish two releases of one version."""
        return Release(self.version, self.commit, self.epoch).build


def release_of(source: Path) -> Release:
    """Return the release of a source checkout: version, commit and date.

    The date is the date of the newest commit, or SOURCE_DATE_EPOCH.

    Raises:
        ImageError: the folder is no checkout of radron.
    """
    project = source / "pyproject.toml"
    if not project.is_file() or not (source / "agent").is_dir():
        raise ImageError(f"{source}: is no checkout of radron; give its folder with --source")
    version = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["version"]
    commit = run(["git", "-C", str(source), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]).strip()
    stated = os.environ.get("SOURCE_DATE_EPOCH")
    epoch = stated or run(["git", "-C", str(source), "log", "-1", "--format=%ct"]).strip()
    return Release(version, commit, int(epoch))


def build_image(out: Path, source: Path, cache: Path, snapshot: str | None, say: Callable[[str], None]) -> Manifest:
    """Build the disk image ``out`` and the list of its contents; the image gets its name only when complete.

    Args:
        out: the image.
        source: the checkout.
        cache: folder for Python packages, the log and intermediate files; about 2 GB.
        snapshot: time of Debian's archive; None: its present state.
        say: called with each step and its duration.

    Raises:
        ImageError: a program is missing, or failed.
    """
    need(*PROGRAMS)
    release = release_of(source)
    cache.mkdir(parents=True, exist_ok=True)
    log = cache / "build.log"
    log.write_text("")
    with tempfile.TemporaryDirectory(dir=cache, prefix="build-") as name:
        work = Path(name)
        with _step(say, "the agent's packages"):
            wheels = make_wheels(source, cache / "wheels", release.epoch, log)
        root = work / "root.squashfs"
        with _step(say, "root file system, one to three minutes"):
            make_rootfs(root, work, release, wheels, snapshot, cache, log)
        with _step(say, "disk"):
            esp, config, disk = work / "esp.fat", work / "config.fat", work / "disk.img"
            make_esp(esp, work, release.epoch)
            (work / "config").mkdir()
            make_fat(config, CONFIG.size, "config", work / "config", release.epoch)
            make_disk(disk, {ESP: esp, CONFIG: config, ROOT_A: root})
            listed = run(["unsquashfs", "-cat", str(root), "usr/share/radron/packages"])
            manifest = Manifest(
                version=release.version,
                commit=release.commit,
                epoch=release.epoch,
                sha256=digest(disk),
                packages=dict(line.split() for line in listed.splitlines()),
                wheels={wheel.name: digest(wheel) for wheel in wheels},
            )
        say(f"    root file system: {root.stat().st_size / MIB:.0f} MiB of the {ROOT_A.size // MIB} MiB of a slot")
        out.parent.mkdir(parents=True, exist_ok=True)
        run(["cp", "--sparse=always", str(disk), f"{out}.part"])
        os.replace(f"{out}.part", out)
        manifest_file(out).write_bytes(msgspec.json.format(msgspec.json.encode(manifest), indent=1))
    return manifest


def manifest_file(image: Path) -> Path:
    """Return the path of the file that lists the contents of an image."""
    return image.with_name(image.name + ".json")


def read_manifest(image: Path) -> Manifest:
    """Read the file that lists the contents of an image.

    Raises:
        ImageError: the file is not beside the image, or cannot be read.
    """
    file = manifest_file(image)
    try:
        return msgspec.json.decode(file.read_bytes(), type=Manifest)
    except OSError as error:
        raise ImageError(f"{file}: cannot be read ({error.strerror}): copy it together with the image") from None
    except msgspec.DecodeError as error:
        raise ImageError(f"{file}: is not the list of an image's contents: {error}") from None


@contextmanager
def _step(say: Callable[[str], None], what: str) -> Iterator[None]:
    say(f"{what} ...")
    begun_s = time.monotonic()
    yield
    say(f"    done in {time.monotonic() - begun_s:.0f} s")
