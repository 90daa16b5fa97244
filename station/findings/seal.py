"""The signature of a report: the checksums of its files, among them the log's digest, signed by a member of the swarm (Ed25519).

The checksums have the format of ``sha256sum``, the signature is of the checksums' file as written: both can be verified without
radron. Everything else that members sign begins with other words (``radron.protocol.signing``): no signature counts for another
purpose.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509 import load_der_x509_certificate, load_pem_x509_certificate

from radron.protocol.errors import ProtocolError
from radron.protocol.identity import Authority, Identity, Peer, utc
from radron.station.findings.facts import Findings, FindingsError

DIGEST, SUMS, SIGNATURE, SIGNER = "digest.txt", "SHA256SUMS", "SHA256SUMS.sig", "signer.pem"
_LINE = re.compile(r"([0-9a-f]{64})  ([A-Za-z0-9_.-]+)")
_WRITTEN = "%Y-%m-%dT%H:%M:%SZ"


@dataclass(frozen=True, slots=True)
class Sealed:
    """A signed report on a mission whose files are unchanged since the signature.

    ``signer``: the member of the swarm that has signed. ``digest``: the signed lines about the mission and its log.
    """

    signer: Peer
    files: tuple[str, ...]
    digest: str


def digest_of(findings: Findings, now_ns: int) -> bytes:
    """Return the lines about a mission and its log that a report's signature covers.

    They name the mission, the hash and the size of the log, and the time of writing.
    """
    mission = findings.mission
    lines = {
        "mission": mission.mission_id,
        "name": " ".join(mission.name.split()),
        "log digest": findings.digest,
        "log entries": str(findings.entries),
        "written": f"{utc(now_ns):{_WRITTEN}}",
    }
    return "".join(f"{name}: {text}\n" for name, text in lines.items()).encode()


def sealed(files: Mapping[str, bytes], identity: Identity | None) -> Iterator[tuple[str, bytes]]:
    """Yield the file with the checksums of a report's files and, with an ``identity``, its signature and certificate."""
    sums = "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for name, data in sorted(files.items())).encode()
    yield SUMS, sums
    if identity is not None:
        yield SIGNATURE, identity.sign(sums)
        yield SIGNER, load_der_x509_certificate(identity.own.der).public_bytes(Encoding.PEM)


def verify(folder: Path, authority_file: Path) -> Sealed:
    """Check that the files of a report are unchanged since a member of the swarm signed them.

    ``authority_file``: certificate of the swarm's authority.

    Raises:
        FindingsError: changed or not signed; one line names the difference.
        OSError: a file cannot be read.
    """
    try:
        authority = Authority.read(authority_file.read_bytes())
    except ProtocolError as error:
        raise FindingsError(f"{authority_file}: {error}") from None
    for name in (SUMS, SIGNATURE, SIGNER):
        if not (folder / name).is_file():
            raise FindingsError(f"{folder / name}: there is no such file: the report is not signed")
    try:
        certificate = load_pem_x509_certificate((folder / SIGNER).read_bytes())
        signer = authority.verify(certificate.public_bytes(Encoding.DER))
    except ProtocolError as error:
        raise FindingsError(f"{folder / SIGNER}: {error}") from None
    except ValueError:
        raise FindingsError(f"{folder / SIGNER}: is not a certificate") from None
    sums = (folder / SUMS).read_bytes()
    if not signer.verified((folder / SIGNATURE).read_bytes(), sums):
        raise FindingsError(f"{folder / SUMS}: is not what {signer.name} has signed")
    named = _sums(folder, sums)
    for name, expected in named.items():
        if _sum_of(folder / name) != expected:
            raise FindingsError(f"{folder / name}: was changed after {signer.name} signed the report")
    return Sealed(signer, tuple(named), (folder / DIGEST).read_text(encoding="utf-8"))


def others(folder: Path, seal: Sealed) -> list[str]:
    """Return the names of files in a report's folder that the signature does not cover."""
    known = {*seal.files, SUMS, SIGNATURE, SIGNER}
    return sorted(path.name for path in folder.iterdir() if path.name not in known)


def _sums(folder: Path, sums: bytes) -> dict[str, str]:
    """Return the checksums by file. Raises FindingsError."""
    found = [_LINE.fullmatch(line) for line in sums.decode("ascii", "replace").splitlines()]
    named = {match[2]: match[1] for match in found if match is not None}
    if None in found or DIGEST not in named:
        raise FindingsError(f"{folder / SUMS}: is not the list of a report's files")
    return named


def _sum_of(path: Path) -> str:
    if not path.is_file():
        raise FindingsError(f"{path}: is missing")
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
