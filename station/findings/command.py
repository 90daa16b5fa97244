"""``radron-station report``: all files of the findings, in a folder or zipped."""

from __future__ import annotations

import io
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

from agent.outputs import replacing
from protocol.identity import Identity
from station.findings.earth import dose_geotiff, geojson, kml
from station.findings.facts import Findings, FindingsError
from station.findings.html import report_html
from station.findings.n42 import n42
from station.findings.seal import DIGEST, digest_of, sealed
from station.findings.tables import cones_csv, tracks_csv


def write_report(findings: Findings, folder: Path, identity: Identity | None = None) -> list[Path]:
    """Write all files into a folder; those on Earth only where the mission has a datum. ``identity``: whose signature they get.

    Raises:
        FindingsError: the records hold no message of any drone.
        OSError: the folder cannot be written.
    """
    files = _sealed(findings, identity)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        with replacing(folder / name) as path:
            path.write_bytes(data)
    return [folder / name for name in files]


def zipped(findings: Findings, identity: Identity | None) -> bytes:
    """The same files as a ZIP archive. Raises FindingsError as ``write_report``."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as written:
        for name, data in _sealed(findings, identity).items():
            written.writestr(name, data)
    return archive.getvalue()


def _sealed(findings: Findings, identity: Identity | None) -> dict[str, bytes]:
    if not findings.frames:
        raise FindingsError("the records hold no second of a flight")
    files = dict(_files(findings))
    files.update(sealed(files, identity))
    return files


def _files(findings: Findings) -> Iterator[tuple[str, bytes]]:
    yield DIGEST, digest_of(findings, time.time_ns())
    yield "report.html", report_html(findings).encode()
    yield "tracks.csv", tracks_csv(findings).encode()
    yield "cones.csv", cones_csv(findings).encode()
    yield "spectra.n42", n42(findings).encode()
    if findings.mission.datum is None:
        return
    yield "findings.geojson", geojson(findings).encode()
    yield "findings.kml", kml(findings).encode()
    dose = dose_geotiff(findings, findings.best) if findings.best is not None else None
    if dose is not None:
        yield "dose.tif", dose
