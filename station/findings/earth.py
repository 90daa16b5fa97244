"""Results of a mission in geographic coordinates (WGS84): GeoJSON, KML, and the dose rate as GeoTIFF."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
import shapely
import tifffile
from numpy.typing import NDArray
from shapely.affinity import translate
from shapely.geometry import mapping
from shapely.geometry.base import BaseGeometry

from radron.agent.frames.geodesy import mission_from_geodetics
from radron.station.findings.facts import Findings, Located
from radron.station.findings.tables import utc
from radron.station.picture.dose import HEIGHT_M, expected_usvph
from radron.station.picture.frame import SourceFrame
from radron.station.picture.shapes import CORDON_USVPH, circle, cordon_radius_m, region

Feature = tuple[str, dict[str, object], str, list[Sequence[float]]]  # name, properties, kind of geometry, its places
_KINDS = {"Point": shapely.Point, "LineString": shapely.LineString, "Polygon": shapely.Polygon}
_MANY = {"LineString": shapely.MultiLineString, "Polygon": shapely.MultiPolygon}
_TURNS = {shift: shapely.box(-180.0 - shift, -90.0, 180.0 - shift, 90.0) for shift in (-360.0, 0.0, 360.0)}  # degrees

_KML = "http://www.opengis.net/kml/2.2"
_STYLES = {"source": "ff0000ff", "region": "ff0000ff", "cordon": "ff003ba3", "area": "ff111111", "track": "ffb27200"}


def geojson(findings: Findings) -> str:
    """Return search area, sources, their 90 % regions and cordons, and the drones' tracks as GeoJSON.

    Format: RFC 7946, longitude before latitude.
    """
    features = [
        {
            "type": "Feature",
            "properties": {"name": name, **properties},
            "geometry": mapping(shapely.orient_polygons(_geometry(findings, kind, places))),
        }
        for name, properties, kind, places in _features(findings)
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False) + "\n"


def kml(findings: Findings) -> str:
    """Return search area, sources, their 90 % regions and cordons, and the drones' tracks as KML 2.2."""
    ElementTree.register_namespace("", _KML)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = _child(root, "Document")
    _child(document, "name", findings.mission.name)
    for kind, colour in _STYLES.items():
        style = _child(document, "Style")
        style.set("id", kind)
        line = _child(style, "LineStyle")
        _child(line, "color", colour)
        _child(line, "width", "3")
        _child(_child(style, "PolyStyle"), "fill", "0")
    for name, properties, kind, places in _features(findings):
        mark = _child(document, "Placemark")
        _child(mark, "name", name)
        _child(mark, "description", "\n".join(f"{key}: {value}" for key, value in properties.items()))
        _child(mark, "styleUrl", f"#{name.split()[0]}")
        parts = shapely.get_parts(_geometry(findings, kind, places)).tolist()
        parent = mark if len(parts) == 1 else _child(mark, "MultiGeometry")
        for part in parts:
            shape = _child(parent, kind)
            line = _child(_child(shape, "outerBoundaryIs"), "LinearRing") if kind == "Polygon" else shape
            points = part.exterior.coords if kind == "Polygon" else part.coords
            _child(line, "coordinates", " ".join(f"{longitude:.8f},{latitude:.8f}" for longitude, latitude in points))
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def dose_geotiff(findings: Findings, located: Located, cells: int = 256) -> bytes | None:
    """Return a map of the dose rate at 1 m above the ground from all estimated sources, as GeoTIFF (EPSG:4326).

    Values are ambient dose equivalent rates in uSv/h (float32) over the search area and its fence, in ``cells`` by ``cells``
    cells. Across the antimeridian the longitudes continue beyond 180 degrees. Return None if no source has both a known activity
    and a known dose rate constant.
    """
    margin_m = findings.mission.area.fence_margin_m
    corners = np.array(findings.mission.area.polygon_m)
    low, high = corners.min(0) - margin_m, corners.max(0) + margin_m
    (west, south), (east, north) = _lonlat(findings, [low.tolist(), high.tolist()])
    step_lat, step_lon = (north - south) / cells, (east - west) / cells
    latitudes = north - step_lat * (np.arange(cells) + 0.5)  # the first row is the northernmost
    longitudes = west + step_lon * (np.arange(cells) + 0.5)
    grid = np.stack(np.broadcast_arrays(latitudes[:, None], longitudes[None, :], findings.datum.altitude_m), axis=-1)
    places = mission_from_geodetics(findings.datum, grid)[..., :2].reshape(-1, 2)
    rates = np.zeros(len(places))
    for source in located.sources:
        one = None if source.activity_bq is None else _rates_usvph(source, source.activity_bq, places)
        if one is None:
            return None
        rates += one
    keys = (1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326)  # geographic, cells are areas, EPSG:4326
    tags = [
        (33550, 12, 3, (step_lon, step_lat, 0.0), True),  # ModelPixelScale
        (33922, 12, 6, (0.0, 0.0, 0.0, west, north, 0.0), True),  # ModelTiepoint
        (34735, 3, len(keys), keys, True),  # GeoKeyDirectory
    ]
    written = io.BytesIO()
    about = f"dose rate (uSv/h) {HEIGHT_M:g} m above the ground; {findings.mission.name}; {utc(located.at_ms * 1_000_000)}"
    ascii_about = about.encode("ascii", "backslashreplace")  # TIFF 6.0 knows no other text
    image = rates.reshape(cells, cells).astype(np.float32)
    tifffile.imwrite(written, image, extratags=tags, description=ascii_about, metadata=None, software="radron")
    return written.getvalue()


def _features(findings: Findings) -> list[Feature]:
    area = [*findings.mission.area.polygon_m, findings.mission.area.polygon_m[0]]
    found: list[Feature] = [("area", {"mission": findings.mission.name}, "Polygon", list(area))]
    if findings.best is not None:
        at, alone = utc(findings.best.at_ms * 1_000_000), not findings.best.others
        for source in findings.best.sources:
            found += _source_features(source, at, "" if alone else f" {source.number}")
    for index, name in enumerate(findings.drones):
        track = [drone.place for frame in findings.frames if (drone := frame.drones[index]).place is not None]
        if len(track) > 1:
            found.append((f"track {name}", {"drone": name}, "LineString", [place for place in track if place is not None]))
    return found


def _source_features(source: SourceFrame, at: str, number: str) -> list[Feature]:
    """A source, its region and its cordon; ``number``: follows their names."""
    about: dict[str, object] = {
        "time_utc": at,
        "nuclide": source.nuclide,
        "activity_bq": source.activity_bq,
        "activity_sigma_bq": source.activity_sigma_bq,
        "rms_m": source.rms_m,
        "covariance_m2": list(source.covariance_m2),
        "dose_rate_at_1_m_usvph": source.dose_usvph,
    }
    found: list[Feature] = [
        (f"source{number}", about, "Point", [source.place[:2]]),
        (f"region{number}", {"time_utc": at, "probability": 0.9}, "Polygon", list(region(source))),
    ]
    radius_m = cordon_radius_m(source.nuclide, source.activity_bq)
    if radius_m is not None:
        level: dict[str, object] = {"dose_rate_usvph": CORDON_USVPH, "radius_m": radius_m}
        found.append((f"cordon{number}", level, "Polygon", list(circle(source.place, radius_m))))
    return found


def _rates_usvph(source: SourceFrame, activity_bq: float, places: NDArray[np.float64]) -> NDArray[np.float64] | None:
    return expected_usvph(source.nuclide, np.array([source.place[:2]]), np.array([activity_bq]), places)


def _geometry(findings: Findings, kind: str, places: list[Sequence[float]]) -> BaseGeometry:
    """Return the places on Earth (longitude, latitude), cut at the antimeridian (RFC 7946, 3.1.9)."""
    whole = _KINDS[kind]([(round(longitude, 8), round(latitude, 8)) for longitude, latitude in _lonlat(findings, places)])
    west, _, east, _ = whole.bounds
    if max(-west, east) <= 180.0:
        return whole
    parts = []
    for shift, turn in _TURNS.items():
        # The intersection of polygons is valid; clipping keeps the order of a line that crosses itself.
        cut = whole.intersection(turn) if kind == "Polygon" else shapely.clip_by_rect(whole, *turn.bounds)
        pieces = shapely.get_parts(cut).tolist()
        parts += [translate(piece, shift) for piece in pieces if piece.geom_type == kind and not piece.is_empty]
    return _MANY[kind](parts) if len(parts) > 1 else parts[0]


def _lonlat(findings: Findings, places: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """Return longitudes and latitudes (degrees); longitudes within half a turn of the datum's, without a jump."""
    middle = findings.datum.longitude_deg
    on_earth = map(findings.on_earth, places)
    return [((longitude - middle + 180.0) % 360.0 - 180.0 + middle, latitude) for latitude, longitude, _ in on_earth]


def _child(parent: ElementTree.Element, name: str, text: str = "") -> ElementTree.Element:
    made = ElementTree.SubElement(parent, f"{{{_KML}}}{name}")
    made.text = text or None
    return made
