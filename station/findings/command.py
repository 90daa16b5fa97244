"""The report on a mission with all its files, as ``radron-station report`` writes it: in a folder or zipped."""

from __future__ import annotations

import io
import time
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from radron.agent.outputs import replacing
from radron.protocol.identity import Identity
from radron.station.findings.earth import dose_geotiff, geojson, kml
from radron.station.findings.facts import Findings, FindingsError
from radron.station.findings.html import report_html
from radron.station.findings.n42 import n42
from radron.station.findings.seal import DIGEST, digest_of, sealed
from radron.station.findings.tables import cones_csv, tracks_csv

MAX_FLAW = 300  # characters of a flaw


def write_report(findings: Findings, folder: Path, identity: Identity | None = None) -> tuple[list[Path], tuple[str, ...]]:
    """Write all files of the report on a mission into a folder.

    Files with geographic coordinates are only written for a mission with a datum (place on Earth). ``identity``: certificate and
    key with which the files are signed; None: unsigned.

    Returns:
        The files, and the flaws: records with a missing part, and files that could not be made.

    Raises:
        FindingsError: the records hold no message of any drone.
        OSError: the folder cannot be written.
    """
    files, flaws = _sealed(findings, identity)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        with replacing(folder / name) as path:
            path.write_bytes(data)
    return [folder / name for name in files], flaws


def zipped(findings: Findings, identity: Identity | None) -> bytes:
    """Return all files of the report on a mission as a ZIP archive; flaws are named in its report.html.

    Raises:
        FindingsError: the records hold no message of any drone.
    """
    files, _ = _sealed(findings, identity)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as written:
        for name, data in files.items():
            written.writestr(name, data)
    return archive.getvalue()


def _sealed(findings: Findings, identity: Identity | None) -> tuple[dict[str, bytes], tuple[str, ...]]:
    if not findings.frames:
        raise FindingsError("the records hold no second of a flight")
    files, flaws = _parts(findings)
    files.update(sealed(files, identity))
    return files, flaws


def _parts(findings: Findings) -> tuple[dict[str, bytes], tuple[str, ...]]:
    """Return the files by name, and the flaws; report.html comes last, so that it names the missing files."""
    files = {DIGEST: digest_of(findings, time.time_ns())}
    flaws = list(findings.source.flaws)
    for name, make in (*_FILES.items(), *(_ON_EARTH.items() if findings.mission.datum is not None else ())):
        _add(files, flaws, name, make, findings)
    _add(files, flaws, "report.html", report_html, replace(findings, source=replace(findings.source, flaws=tuple(flaws))))
    return files, tuple(flaws)


def _add(files: dict[str, bytes], flaws: list[str], name: str, make: _Maker, findings: Findings) -> None:
    """Make one file, or note the reason of its failure as a flaw: the other files of the report must not be lost with it."""
    try:
        made = make(findings)
        if made is not None:
            files[name] = made if isinstance(made, bytes) else made.encode()
    except Exception as error:
        flaws.append(f"{name} could not be made: {type(error).__name__}: {error}"[:MAX_FLAW])


def _dose(findings: Findings) -> bytes | None:
    return dose_geotiff(findings, findings.best) if findings.best is not None else None


_Maker = Callable[[Findings], str | bytes | None]
_FILES: dict[str, _Maker] = {"tracks.csv": tracks_csv, "cones.csv": cones_csv, "spectra.n42": n42}
_ON_EARTH: dict[str, _Maker] = {"findings.geojson": geojson, "findings.kml": kml, "dose.tif": _dose}
