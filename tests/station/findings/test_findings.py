"""The findings of a recorded flight, read back by programs that are not ours."""

import asyncio
import csv
import io
import math
import re
import shutil
import subprocess
import zipfile
from dataclasses import replace as changed
from xml.etree import ElementTree

import numpy as np
import pymap3d
import pyogrio
import pytest
import rasterio
import shapely
import SpecUtils
from msgspec.structs import replace

from radron.agent.frames.geodesy import mission_from_geodetic
from radron.agent.fusion.log import ObservationLog
from radron.agent.fusion.registry import estimator_named
from radron.agent.mission.worldmodel import WorldModel
from radron.protocol.codec import decode_from
from radron.protocol.entries import Cone, Entry, Exposure
from radron.protocol.identity import Role
from radron.protocol.messages import Status
from radron.protocol.spectrum import EDGES_KEV
from radron.station.findings.command import write_report
from radron.station.findings.earth import geojson
from radron.station.findings.facts import FindingsError, Source, gather
from radron.station.findings.html import report_html
from radron.station.findings.n42 import MEASUREMENT_NS, spectrum_of
from radron.station.findings.ondemand import reports
from radron.station.findings.seal import others, verify
from radron.station.findings.tables import utc
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from radron.station.picture.shapes import cordon_radius_m
from radron.station.replay import Records, play
from support.mesh.identities import identity, new_issuer
from support.page.served_page import served


@pytest.fixture(scope="module")
def operator(tmp_path_factory):
    """Of a swarm."""
    return identity(new_issuer(), tmp_path_factory.mktemp("pki"), "tablet", Role.OPERATOR)


@pytest.fixture(scope="module")
def findings(flights):
    """Of three drones that find the source and follow it for 5 s, on Earth."""
    shares = []
    found = gather(flights[:1], shares.append)
    assert shares[-1] == 1.0
    return found


@pytest.fixture(scope="module")
def folder(findings, operator, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "new"
    paths, _ = write_report(findings, folder, operator)
    names = [path.name for path in paths]
    assert sorted(names) == sorted(path.name for path in folder.iterdir())
    return folder


def located(findings, longitude, latitude):
    """A place on Earth in the mission frame, as programs for maps would have it."""
    return mission_from_geodetic(findings.datum, latitude, longitude, findings.datum.altitude_m)[:2]


def test_the_best_estimate_is_the_most_certain_one(findings):
    found = [frame.source.rms_m for frame in findings.frames if frame.source is not None]
    assert findings.best.source.rms_m == min(found)
    assert findings.last.at_ms >= findings.best.at_ms
    assert findings.mission.nuclide == findings.best.source.nuclide == "Cs-137"


def test_maps_read_the_geojson_and_the_kml_and_find_everything_in_its_place(findings, folder):
    source, activity = findings.best.source, findings.best.source.activity_bq
    for name in ("findings.geojson", "findings.kml"):
        _, _, shapes, columns = pyogrio.raw.read(folder / name, columns=["name", "Name"])
        by_name = dict(zip(columns[0].tolist(), shapely.from_wkb(shapes).tolist(), strict=True))
        assert {"area", "source", "region", "cordon", "track d1", "track d2", "track d3"} == set(by_name)
        x, y = located(findings, *by_name["source"].coords[0][:2])
        assert math.hypot(x - source.place[0], y - source.place[1]) < 0.01
        radii = [
            math.hypot(px - source.place[0], py - source.place[1])
            for px, py in (located(findings, *point[:2]) for point in by_name["cordon"].exterior.coords)
        ]
        assert radii == pytest.approx([math.sqrt(0.0909e-6 * activity / 10.0 - 1.0)] * len(radii), abs=0.02)
        corners = [located(findings, *point[:2]) for point in by_name["area"].exterior.coords]
        assert np.array(sorted(set(map(tuple, np.round(corners))))) == pytest.approx(
            np.array([[0.0, 0.0], [0.0, 50.0], [50.0, 0.0], [50.0, 50.0]])
        )


def test_maps_read_the_dose_raster(findings, folder):
    source = findings.best.source
    with rasterio.open(folder / "dose.tif") as raster:
        assert raster.crs.to_epsg() == 4326
        rates = raster.read(1)
        for row, column in ((10, 20), (128, 128), (200, 77)):
            x, y = located(findings, *raster.xy(row, column))
            squared = (x - source.place[0]) ** 2 + (y - source.place[1]) ** 2 + 1.0
            assert rates[row, column] == pytest.approx(0.0909e-6 * source.activity_bq / squared, rel=0.01)


def test_an_independent_reader_finds_the_spectra_in_the_n42(findings, folder):
    read = SpecUtils.SpecFile()
    read.loadFile(str(folder / "spectra.n42"), SpecUtils.ParserType.Auto)
    expected = {}
    for exposure, place in zip(findings.exposures, findings.places, strict=True):
        expected.setdefault((exposure.drone, exposure.stamp_ns // MEASUREMENT_NS), []).append((exposure, place))
    measurements = list(read.measurements())
    assert len(measurements) == len(expected)
    total = 0
    for measured in measurements:
        began = measured.startTime()
        key = measured.detectorName(), int(np.datetime64(began, "ns").astype(np.int64)) // MEASUREMENT_NS
        exposures = [exposure for exposure, _ in expected[key]]
        assert list(measured.gammaCounts()) == spectrum_of(exposures).tolist()
        assert measured.liveTime() == pytest.approx(sum(each.live_time_s for each in exposures), abs=1e-3)
        assert list(measured.channelEnergies())[:32] == pytest.approx(EDGES_KEV[:32], abs=0.01)
        x, y = located(findings, measured.longitude(), measured.latitude())
        assert math.dist((x, y), expected[key][0][1][:2]) < 0.05
        total += sum(measured.gammaCounts())
    assert total == sum(spectrum_of(findings.exposures)) > 1000


def test_the_tables_hold_every_second_and_every_cone(findings, folder):
    tracks = list(csv.DictReader(io.StringIO((folder / "tracks.csv").read_text())))
    assert len(tracks) == sum(drone.place is not None for frame in findings.frames for drone in frame.drones)
    x, y = located(findings, float(tracks[-1]["longitude_deg"]), float(tracks[-1]["latitude_deg"]))
    assert (x, y) == pytest.approx((float(tracks[-1]["x_m"]), float(tracks[-1]["y_m"])), abs=0.01)
    cones = list(csv.DictReader(io.StringIO((folder / "cones.csv").read_text())))
    assert len(cones) == sum(len(cone.readings) for cone in findings.cones) > 50
    first = findings.cones[0].readings[0]
    assert float(cones[0]["theta_deg"]) == pytest.approx(math.degrees(first.theta_rad))


def test_the_report_tells_what_the_log_tells(findings, folder):
    text = (folder / "report.html").read_text()
    source = findings.best.source
    latitude, longitude, _ = findings.on_earth(source.place)
    for told in (
        findings.digest,
        findings.mission.mission_id,
        f"{latitude:.7f}°, {longitude:.7f}°",
        f"{source.place[0]:.2f} m east, {source.place[1]:.2f} m north",
        f"{source.activity_bq:.3g} ± {source.activity_sigma_bq:.3g} Bq",
        f"{source.dose_usvph:.3g} µSv/h",
        f"{cordon_radius_m('Cs-137', source.activity_bq):.1f} m around the source",
        f"{findings.entries} entries, {len(findings.cones)} cones",
        "start by ",
    ):
        assert told in text
    assert not re.search(r"<script|https?://|\bon\w+=", text)  # one file, nothing fetched, nothing run


def test_names_with_markup_stay_text(findings, tmp_path):
    evil = replace(findings.mission, name="<script>alert(1)</script>")
    write_report(changed(findings, mission=evil), tmp_path)
    assert "<script>" not in (tmp_path / "report.html").read_text()
    assert "<script>" not in (tmp_path / "findings.kml").read_text()


def test_without_a_datum_there_is_nothing_on_earth(findings, tmp_path):
    nowhere = changed(findings, mission=replace(findings.mission, datum=None))
    assert sorted(path.name for path in write_report(nowhere, tmp_path)[0]) == [
        "SHA256SUMS",
        "cones.csv",
        "digest.txt",
        "report.html",
        "spectra.n42",
        "tracks.csv",
    ]
    with pytest.raises(FindingsError, match=r"no \[datum\]"):
        geojson(nowhere)


def row(text, name):
    """Text of a row of the report."""
    return re.search(rf"<th>{re.escape(name)}</th><td>(.*?)</td>", text)[1]


def hypothesis_of(flight, at_ms):
    """Result of the drones' own code for a drone's log at a time, without the station."""
    records = Records([flight])
    world, begun, until_ns = WorldModel(records.mission, (), estimator_named), False, None
    for heard in records.messages():
        until_ns = until_ns or at_ms * 10**6 + heard.at_ns % 10**6  # a frame of the station is a whole second after the first
        message = decode_from(heard.key, heard.payload)
        if heard.at_ns >= until_ns:
            break
        if isinstance(message, Entry):
            world.take(message, heard.payload, heard.at_ns)
        elif isinstance(message, Status) and message.started_ns is not None and not begun:
            world.start(message.started_ns)
            begun = True
    world.advance(until_ns)
    while world.pending:
        world.advance(until_ns)
    return world.fusion.hypothesis


def test_every_number_of_the_report_is_the_logs(findings, folder, flights):
    """Counted here from the messages in the record, and compared with the drone's own knowledge."""
    text = (folder / "report.html").read_text()
    log, entries = ObservationLog(findings.mission.mission_id, findings.drones), {}
    for heard in Records(flights[:1]).messages():
        message = decode_from(heard.key, heard.payload)
        if isinstance(message, Entry):
            entries[message.drone, message.boot, message.sequence] = message
            log.add(message, heard.payload)
    cones, exposures = ([one for one in entries.values() if isinstance(one, kind)] for kind in (Cone, Exposure))
    assert row(text, "Log") == f"{len(entries)} entries, {len(cones)} cones"
    assert row(text, "Digest of the log") == log.digest
    counted = sum(each.singles + each.coincidences for one in exposures for each in one.spectrum)
    n42 = ElementTree.parse(folder / "spectra.n42").getroot()
    channels = " ".join(found.text for found in n42.iter("{http://physics.nist.gov/N42/2011/N42}ChannelData"))
    assert sum(map(int, channels.split())) == counted
    live = [float(found.text[2:-1]) for found in n42.iter("{http://physics.nist.gov/N42/2011/N42}LiveTimeDuration")]
    assert sum(live) == pytest.approx(sum(one.live_time_s for one in exposures), abs=1e-6 * len(live))
    told = {(line["time_utc"], line["drone"]) for line in csv.DictReader(io.StringIO((folder / "cones.csv").read_text()))}
    assert told == {(utc(one.stamp_ns), one.drone) for one in cones}

    known = hypothesis_of(flights[0], findings.best.at_ms)
    x, y, z = known.position
    (xx, xy, _), (_, yy, _), (_, _, zz) = known.covariance
    place = f"{x:.2f} m east, {y:.2f} m north, {z:.2f} m up; 1 sigma {math.sqrt(xx + yy):.2f} m (RMS radius)"
    assert row(text, "Position, mission frame") == place
    assert row(text, "Covariance") == f"east {xx:.4f}, north {yy:.4f}, east-north {xy:.4f}, up {zz:.4f} m²"
    assert row(text, "Most certain estimate").endswith(f"from {known.cones} cones")
    activity, sigma = known.activity_bq, known.activity_sigma_bq
    assert row(text, "Activity") == f"Cs-137: {activity:.3g} ± {sigma:.3g} Bq (1 sigma), unshielded"
    assert row(text, "Dose rate at 1 m").startswith(f"{0.0909e-6 * activity:.3g} µSv/h")
    assert row(text, "Cordon").endswith(f"{math.sqrt(0.0909e-6 * activity / 10.0 - 1.0):.1f} m around the source")
    assert row(text, "Velocity") == f"{math.hypot(*known.velocity[:2]):.2f} m/s"
    datum = findings.datum
    on_earth = pymap3d.enu2geodetic(x, y, z, datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
    told_deg = [float(number) for number in re.findall(r"-?\d+\.\d+", row(text, "Position, WGS84"))]
    assert told_deg == pytest.approx(on_earth, abs=0.06)
    assert told_deg[:2] == pytest.approx(on_earth[:2], abs=1e-7)
    last = hypothesis_of(flights[0], findings.last.at_ms)
    sigma_m = math.sqrt(last.covariance[0, 0] + last.covariance[1, 1])
    end = f"({last.position[0]:.2f}, {last.position[1]:.2f}) m, 1 sigma {sigma_m:.2f} m"
    assert findings.last.at_ms == findings.best.at_ms or row(text, "At the end of the records").split(": ")[1].startswith(end)


def test_the_figures_of_the_report_show_what_is_known(findings, folder):
    text = (folder / "report.html").read_text()
    assert text.count("<svg") == 4
    assert f"Spectrum of all cameras ({sum(spectrum_of(findings.exposures))} single clusters" in text
    nothing = [replace(frame, source=None) for frame in findings.frames]
    bare = changed(findings, frames=tuple(nothing), best=None, last=None, exposures=(), places=())
    assert report_html(bare).count("<svg") == 2  # the map and the count rates
    exact = [replace(frame, source=frame.source and replace(frame.source, rms_m=0.0)) for frame in findings.frames]
    assert report_html(changed(findings, frames=tuple(exact))).count("<svg") == 3  # of a given source there is no uncertainty


def test_the_report_is_signed_and_openssl_verifies_it(findings, folder, operator):
    def openssl(*words):
        return subprocess.run(["openssl", *words], cwd=folder, capture_output=True, text=True, check=False)

    assert (
        subprocess.run(
            ["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder, capture_output=True, check=False
        ).returncode
        == 0
    )
    key = openssl("x509", "-in", "signer.pem", "-pubkey", "-noout").stdout
    (folder / "key.pub").write_text(key)
    try:
        check = ("pkeyutl", "-verify", "-pubin", "-inkey", "key.pub", "-rawin", "-in", "SHA256SUMS", "-sigfile", "SHA256SUMS.sig")
        assert openssl(*check).returncode == 0
        assert others(folder, verify(folder, operator.folder / "ca.pem")) == ["key.pub"]
    finally:
        (folder / "key.pub").unlink()
    seal = verify(folder, operator.folder / "ca.pem")
    assert (seal.signer.name, seal.signer.role) == ("tablet", Role.OPERATOR)
    assert f"log digest: {findings.digest}\nlog entries: {findings.entries}\n" in seal.digest
    assert {"report.html", "spectra.n42", "dose.tif", "digest.txt"} <= set(seal.files)


def append(file):
    file.write_bytes(file.read_bytes() + b"x")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda folder: append(folder / "report.html"), "report.html: was changed after tablet signed"),
        (lambda folder: (folder / "spectra.n42").unlink(), "spectra.n42: is missing"),
        (lambda folder: append(folder / "SHA256SUMS"), "SHA256SUMS: is not what tablet has signed"),
        (lambda folder: (folder / "SHA256SUMS.sig").unlink(), "the report is not signed"),
        (lambda folder: (folder / "signer.pem").write_text("x"), "signer.pem: is not a certificate"),
    ],
)
def test_a_report_that_was_changed_is_told(folder, operator, tmp_path, change, says):
    shutil.copytree(folder, tmp_path / "copy")
    change(tmp_path / "copy")
    with pytest.raises(FindingsError, match=says):
        verify(tmp_path / "copy", operator.folder / "ca.pem")


def test_the_signature_of_another_swarms_member_does_not_count(folder, tmp_path):
    stranger = identity(new_issuer(), tmp_path, "tablet", Role.OPERATOR)
    with pytest.raises(FindingsError, match=r"signer\.pem: (is not signed by this swarm's authority|was issued by another)"):
        verify(folder, stranger.folder / "ca.pem")


def test_the_page_gives_the_same_report(findings, flights, operator):
    records = Records(flights[:1])
    hub = Hub(Picture(records.mission, records.verifier), replay=True)
    asyncio.run(play(hub, records))
    with served(hub) as page:
        assert page.get(f"/report.zip?token={page.token}")[0] == 503
        hub.findings = reports(hub, operator, flights[:1], records)
        status, headers, body = page.get(f"/report.zip?token={page.token}")
        assert (status, headers["content-type"]) == (200, "application/zip")
        assert records.mission.mission_id in headers["content-disposition"]
        assert page.get("/report.zip", Host="evil.example")[0] == 403
    with zipfile.ZipFile(io.BytesIO(body)) as archive:
        assert {"report.html", "SHA256SUMS.sig"} <= set(archive.namelist())
        assert f"log digest: {findings.digest}" in archive.read("digest.txt").decode()


def test_beside_a_live_flight_the_commands_are_said_to_be_as_heard(findings):
    text = report_html(changed(findings, source=Source({"radron": "1"}, heard=True)))
    assert row(text, "As heard by").startswith("the station on the ground")
