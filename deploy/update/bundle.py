"""Build of update bundles for ``radron-deploy bundle build``.

A bundle is a signed file with the root file system of an image. On board, RAUC (the updater) installs it into the disk partition
that is not in use.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import msgspec
from cryptography import x509
from cryptography.x509.oid import NameOID

from radron.deploy.digest import digest
from radron.deploy.image.build import read_manifest
from radron.deploy.image.flash import check_image
from radron.deploy.image.layout import MIB, ROOT_A
from radron.deploy.image.tools import need, run
from radron.deploy.update.errors import UpdateError
from radron.protocol.identity import AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE, Role
from radron.protocol.onboard import COMPATIBLE, Release

_MAGIC = b"hsqs"


class BundleManifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Description of an update bundle (signed file with a release), in ``BUNDLE.json`` beside it.

    It allows checks before the bundle is copied; on board, the bundle's own signed description is used.
    """

    release: Release
    sha256: str
    size: int


def build_bundle(image: Path, signer: Path, out: Path, say: Callable[[str], None]) -> BundleManifest:
    """Make an update bundle (signed file with a release for onboard computers) from a disk image.

    ``signer``: folder with a certificate for releases and its key. ``out``: the bundle. ``say``: called with each step.

    Raises:
        UpdateError: no certificate for releases.
        ImageError: not an image, or a program is missing or failed.
    """
    need("rauc", "mksquashfs")
    check_image(image)
    made = read_manifest(image)
    certificate, key = signer / CERTIFICATE_FILE, signer / KEY_FILE
    _check_signer(signer)
    release = Release(version=made.version, build=made.build)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".bundle-") as name:
        content, bundle, log = Path(name) / "content", Path(name) / "bundle.raucb", Path(name) / "log"
        content.mkdir()
        say("root file system ...")
        extract_root(image, content / "root.squashfs")
        say("bundle ...")
        write_bundle(content, release, certificate, key, bundle, log)
        manifest = BundleManifest(release=release, sha256=digest(bundle), size=bundle.stat().st_size)
        os.replace(bundle, out)
    manifest_file(out).write_bytes(msgspec.json.format(msgspec.json.encode(manifest), indent=1))
    return manifest


def write_bundle(content: Path, release: Release, certificate: Path, key: Path, out: Path, log: Path) -> None:
    """Sign a root file system as an update bundle, and verify that drones would accept the signature.

    ``content``: folder with the file ``root.squashfs``. ``out``: the bundle.

    Raises:
        ImageError: RAUC (the updater) refuses.
    """
    text = (
        f"[update]\ncompatible={COMPATIBLE}\nversion={release.version}\nbuild={release.build}\n\n"
        "[bundle]\nformat=verity\n\n[image.rootfs]\nfilename=root.squashfs\n"
    )
    (content / "manifest.raucm").write_text(text)
    run(["rauc", f"--cert={certificate}", f"--key={key}", "bundle", str(content), str(out)], log)
    settings = out.with_suffix(".conf")
    settings.write_text(
        f"[system]\ncompatible={COMPATIBLE}\nbootloader=noop\n\n"
        f"[keyring]\npath={certificate.parent.resolve() / AUTHORITY_FILE}\ncheck-purpose=codesign\n"
    )
    run(["rauc", f"--conf={settings}", "info", str(out)], log)


def _check_signer(signer: Path) -> None:
    """Check that a folder holds a certificate for bundles that drones accept.

    Raises:
        UpdateError: no such certificate.
    """
    issue = "make one with `radron-deploy pki issue NAME --role release`"
    if not all((signer / name).is_file() for name in (AUTHORITY_FILE, CERTIFICATE_FILE, KEY_FILE)):
        raise UpdateError(f"{signer}: holds no certificate for releases; {issue}")
    try:
        found = x509.load_pem_x509_certificate((signer / CERTIFICATE_FILE).read_bytes())
    except ValueError:
        raise UpdateError(f"{signer / CERTIFICATE_FILE}: is not a certificate; {issue}") from None
    roles = [unit.value for unit in found.subject.get_attributes_for_oid(NameOID.ORGANIZATIONAL_UNIT_NAME)]
    if roles != [Role.RELEASE]:
        raise UpdateError(
            f"{signer}: is a certificate with the role {', '.join(map(str, roles)) or 'none'}, not release; {issue}"
        )
    if found.not_valid_after_utc < datetime.now(UTC):
        raise UpdateError(f"{signer}: its certificate expired at {found.not_valid_after_utc:%Y-%m-%d %H:%M} UTC; {issue}")


def extract_root(image: Path, out: Path) -> None:
    """Copy the root file system out of a disk image, with the size from the file system's own header.

    Raises:
        UpdateError: no root file system in the image.
    """
    with image.open("rb") as source, out.open("wb") as target:
        source.seek(ROOT_A.start)
        head = source.read(48)
        size = int.from_bytes(head[40:48], "little")  # bytes_used of the squashfs superblock
        if not head.startswith(_MAGIC) or not 0 < size <= ROOT_A.size:
            raise UpdateError(f"{image}: holds no root file system; build it anew")
        left = -(-size // 4096) * 4096
        source.seek(ROOT_A.start)
        while left > 0 and (block := source.read(min(left, MIB))):
            target.write(block)
            left -= len(block)


def manifest_file(bundle: Path) -> Path:
    """Return the path of the file that describes an update bundle."""
    return bundle.with_name(bundle.name + ".json")


def read_bundle_manifest(bundle: Path) -> BundleManifest:
    """Read the description of an update bundle, and check that the bundle is complete.

    Raises:
        UpdateError: the description is not beside the bundle, or the bundle is truncated.
    """
    file = manifest_file(bundle)
    try:
        manifest = msgspec.json.decode(file.read_bytes(), type=BundleManifest)
        size = bundle.stat().st_size
    except OSError as error:
        raise UpdateError(
            f"{error.filename}: cannot be read ({error.strerror}): a bundle and its .json belong together"
        ) from None
    except msgspec.DecodeError as error:
        raise UpdateError(f"{file}: is not the description of a bundle: {error}") from None
    if size != manifest.size:
        raise UpdateError(f"{bundle}: is not all of the bundle that {file.name} describes; copy it again")
    return manifest
