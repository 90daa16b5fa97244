"""The report's files against their formats: schemas of N42.42, KML and GeoJSON, and a GeoTIFF reader that is not ours."""

import json
from dataclasses import replace as changed
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
import rasterio
from lxml import etree
from msgspec.structs import replace

from radron.agent.config.mission import DatumConfig
from radron.agent.frames.geodesy import geodetic_from_mission
from radron.station.findings import command
from radron.station.findings.command import write_report
from radron.station.findings.facts import gather

SCHEMAS = Path(__file__).parent / "schemas"
NAME = 'Müller & <Söhne> "A", Übung Нр. 1'
ANTIMERIDIAN = DatumConfig(latitude_deg=-16.8, longitude_deg=179.9998, altitude_m=12.0)  # 21 m east of it
PARTS = {"report.html", "tracks.csv", "cones.csv", "spectra.n42", "findings.geojson", "findings.kml", "dose.tif"}


@pytest.fixture(scope="module")
def findings(flights):
    """A mission across the antimeridian, with a name beyond ASCII and numeric drone ids."""
    found = gather(flights[:1], lambda share: None)
    numbered = tuple(replace(drone, id=drone.id[1:]) for drone in found.mission.drones)
    mission = replace(found.mission, name=NAME, datum=ANTIMERIDIAN, drones=numbered)
    exposures = tuple(replace(exposure, drone=exposure.drone[1:]) for exposure in found.exposures)
    return changed(found, mission=mission, drones=tuple(drone.id for drone in numbered), exposures=exposures)


@pytest.fixture(scope="module")
def folder(findings, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    paths, flaws = write_report(findings, folder)
    assert flaws == findings.source.flaws
    assert {path.name for path in paths} == {*PARTS, "digest.txt", "SHA256SUMS"}
    return folder


def errors(schema, document):
    """Of an XML file against a schema, a line each."""
    validator = etree.XMLSchema(etree.parse(SCHEMAS / schema))
    validator.validate(etree.parse(document))
    return [f"{error.line}: {error.message}" for error in validator.error_log]


def test_the_n42_is_valid_with_numbers_as_drones(folder):
    assert errors("n42.xsd", folder / "spectra.n42") == []


def test_the_kml_is_valid_across_the_antimeridian(folder):
    assert errors("kml.xsd", folder / "findings.kml") == []


def test_the_geojson_is_valid_across_the_antimeridian(folder):
    document = json.loads((folder / "findings.geojson").read_text(encoding="utf-8"))
    jsonschema.validate(document, json.loads((SCHEMAS / "geojson.json").read_text(encoding="utf-8")))


def widths(places):
    """West-east extents (degrees) of lists of places."""
    return [max(x for x, _ in part) - min(x for x, _ in part) for part in places]


def test_nothing_runs_round_the_globe(folder):
    """The area is 50 m wide: 0.00047 degrees there."""
    document = json.loads((folder / "findings.geojson").read_text(encoding="utf-8"))
    shapes = {feature["properties"]["name"]: feature["geometry"] for feature in document["features"]}
    assert shapes["area"]["type"] == "MultiPolygon"
    rings = [part[0] for part in shapes["area"]["coordinates"]]
    assert sorted(widths(rings)) == pytest.approx([0.0002, 50.0 / 106_600.0 - 0.0002], rel=0.01)  # 21 m and 29 m
    kml = ElementTree.parse(folder / "findings.kml").getroot()
    parts = [
        [tuple(map(float, place.split(","))) for place in found.text.split()]
        for found in kml.iter("{http://www.opengis.net/kml/2.2}coordinates")
    ]
    assert max(widths(parts)) < 0.001
    area = sum(abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))) / 2.0 for ring in rings)
    assert area == pytest.approx(50.0 / 106_600.0 * 50.0 / 110_650.0, rel=0.01)


def test_the_dose_raster_spans_the_mission_across_the_antimeridian(findings, folder):
    source = findings.best.source
    latitude, longitude, _ = geodetic_from_mission(ANTIMERIDIAN, (*source.place[:2], 0.0))
    with rasterio.open(folder / "dose.tif") as raster:
        assert raster.bounds.right - raster.bounds.left == pytest.approx(110.0 / 106_600.0, rel=0.02)  # 50 m and twice 30 m
        rates = raster.read(1)
        row, column = np.unravel_index(rates.argmax(), rates.shape)
        x, y = raster.xy(row, column)
        assert (x, y) == pytest.approx((longitude % 360.0, latitude), abs=1e-5)  # a metre
        assert "\\xfc" in raster.tags()["TIFFTAG_IMAGEDESCRIPTION"]  # TIFF's texts are ASCII
        assert raster.tags()["TIFFTAG_IMAGEDESCRIPTION"].isascii()


@pytest.mark.parametrize("name", sorted(PARTS))
def test_a_part_that_fails_leaves_the_others(findings, tmp_path, monkeypatch, name):
    def fail(_):
        raise ValueError("no such luck")

    for parts in (command._FILES, command._ON_EARTH):
        if name in parts:
            monkeypatch.setitem(parts, name, fail)
    if name == "report.html":
        monkeypatch.setattr(command, "report_html", fail)
    paths, flaws = write_report(findings, tmp_path)
    assert {path.name for path in paths} == {*PARTS, "digest.txt", "SHA256SUMS"} - {name}
    assert flaws == (f"{name} could not be made: ValueError: no such luck",)
    if name != "report.html":
        assert f"Incomplete: {flaws[0]}" in (tmp_path / "report.html").read_text(encoding="utf-8")
