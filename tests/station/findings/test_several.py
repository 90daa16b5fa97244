"""Findings with several sources: the report, the map data and the dose raster have all of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from msgspec.structs import replace as replace_struct

from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.station.findings.earth import dose_geotiff, geojson, kml
from radron.station.findings.facts import Findings, Located, Source
from radron.station.findings.html import report_html
from radron.station.picture.dose import rate_usvph
from radron.station.picture.frame import Frame, SourceFrame

MISSION = MissionConfig(
    name="two", drones=(DroneInMission(id="d1"),), datum=DatumConfig(latitude_deg=50.0, longitude_deg=14.0),
    area=AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))),
)  # fmt: skip


def source(x: float, y: float, nuclide: str, activity_bq: float, cones: int, number: int = 1) -> SourceFrame:
    return SourceFrame(
        place=(x, y, 0.0),
        covariance_m2=(0.01, 0.0, 0.0, 0.01, 0.0, 0.0),
        rms_m=0.14,
        region=(0.2, 0.2, 0.0),
        velocity_mps=(0.0, 0.0),
        cones=cones,
        nuclide=nuclide,
        activity_bq=activity_bq,
        activity_sigma_bq=0.1 * activity_bq,
        dose_usvph=rate_usvph(nuclide, activity_bq),
        number=number,
    )


ONE, OTHER = source(20.0, 30.0, "Cs-137", 3e9, 120), source(80.0, 60.0, "Co-60", 5e8, 7, number=2)
BOTH = Located(60_000, ONE, (OTHER,))


@pytest.fixture
def findings() -> Findings:
    frames = (Frame(at_ms=0, drones=()), Frame(at_ms=60_000, drones=(), source=ONE, others=(OTHER,)))
    return Findings(MISSION, (), frames, BOTH, BOTH, None, "", None, (), (), (), "0" * 32, 9, Source({"radron": "1"}))


def named(findings: Findings) -> dict[str, dict[str, dict[str, object]]]:
    """The features of the GeoJSON by name."""
    return {each["properties"]["name"]: each for each in json.loads(geojson(findings))["features"]}


def test_the_report_has_the_rows_of_each_source(findings: Findings) -> None:
    text = report_html(findings)
    assert "2 sources" in text
    first, second = text.index("Source 1"), text.index("Source 2")
    assert first < text.index("Cs-137: 3e+09 ± 3e+08 Bq") < second < text.index("Co-60: 5e+08 ± 5e+07 Bq")
    assert text.count("Dose rate at 1 m") == 2
    nameless = replace_struct(
        OTHER, nuclide="unknown, lines at 136, 265 keV", activity_bq=None, activity_sigma_bq=None, dose_usvph=None
    )
    assert "unknown, lines at 136, 265 keV" in report_html(replace(findings, best=Located(60_000, ONE, (nameless,))))
    alone = report_html(replace(findings, best=Located(60_000, ONE), last=BOTH))
    assert "from 120 cones" in alone
    assert "Source 1" not in alone


def test_the_map_data_have_each_source_with_region_and_cordon(findings: Findings) -> None:
    features = named(findings)
    assert {"source 1", "region 1", "cordon 1", "source 2", "region 2", "cordon 2"} < set(features)
    assert features["source 2"]["properties"]["nuclide"] == "Co-60"
    assert "source" in {
        each["properties"]["name"] for each in json.loads(geojson(replace(findings, best=Located(0, ONE))))["features"]
    }
    assert "#source</styleUrl>" in kml(findings)


def test_the_dose_raster_adds_up_all_sources(findings: Findings, tmp_path) -> None:
    def rates(located: Located) -> np.ndarray:
        (tmp_path / "dose.tif").write_bytes(dose_geotiff(findings, located, 64) or b"")
        with rasterio.open(tmp_path / "dose.tif") as raster:
            return raster.read(1)

    apart = rates(Located(0, ONE)) + rates(Located(0, OTHER))
    assert rates(BOTH) == pytest.approx(apart, rel=1e-5)
    unknown = replace(BOTH, others=(source(1.0, 1.0, "Xx-1", 1e9, 1),))
    assert dose_geotiff(findings, unknown, 8) is None
