"""Known walls and buildings: their files, and what they take off on a line of sight."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon

from radron.agent.config.buildings import BuildingConfig, BuildingsConfig
from radron.agent.config.loading import load_mission
from radron.agent.config.mission import GroundConfig
from radron.agent.errors import ConfigError
from radron.agent.terrain.buildings import Buildings, attenuation_per_m
from radron.agent.terrain.ground import Ground

FLAT = Ground(GroundConfig())
AIR_PER_M = 0.00929  # of 662 keV
L_SHAPED = ((0.0, 0.0), (0.0, 10.0), (4.0, 10.0), (4.0, 4.0), (10.0, 4.0), (10.0, 0.0))  # clockwise
WALL = ((20.0, -5.0), (20.2, -5.0), (20.2, 5.0), (20.0, 5.0))


def buildings(*known: BuildingConfig) -> Buildings:
    return Buildings(BuildingsConfig(known=known), AIR_PER_M, FLAT)


def test_on_level_ways_the_depth_is_the_length_inside_each_outline() -> None:
    known = [
        BuildingConfig(footprint_m=L_SHAPED, height_m=5.0, attenuation_per_m=0.3),
        BuildingConfig(footprint_m=WALL, height_m=5.0, attenuation_per_m=2.0),
    ]
    rng = np.random.default_rng(1)
    start, end = (np.column_stack((rng.uniform(-5.0, 25.0, (200, 2)), np.full(200, 1.0))) for _ in range(2))
    expected = [
        sum(one.attenuation_per_m * Polygon(one.footprint_m).intersection(LineString((a[:2], b[:2]))).length for one in known)
        for a, b in zip(start, end, strict=True)
    ]
    assert np.count_nonzero(expected) > 50
    town, way = buildings(*known), end - start
    assert town.depth(start, way) == pytest.approx(np.array(expected), abs=1e-9)
    alone = [
        float(town.depth(start[k : k + 1], way[k : k + 1])[0]) for k in range(len(start))
    ]  # most are near one building or none
    assert alone == pytest.approx(expected, abs=1e-9)


def test_ways_in_portions_have_the_same_depths(monkeypatch: pytest.MonkeyPatch) -> None:
    town = buildings(*(BuildingConfig(footprint_m=one, height_m=5.0, attenuation_per_m=0.3) for one in (L_SHAPED, WALL)))
    rng = np.random.default_rng(2)
    start, end = (np.column_stack((rng.uniform(-5.0, 25.0, (100, 2)), rng.uniform(0.0, 6.0, 100))) for _ in range(2))
    way = end - start
    at_once = town.depth(start, way)
    assert np.count_nonzero(at_once) > 20
    monkeypatch.setattr("radron.agent.terrain.buildings._PORTION", 7)
    assert town.depth(start, way).tobytes() == at_once.tobytes()
    assert town.depth(start[:0], way[:0]).shape == (0,)


def test_a_line_that_passes_the_roof_is_inside_only_below_it() -> None:
    wall = buildings(BuildingConfig(footprint_m=WALL, height_m=2.0, attenuation_per_m=1.0))

    def length_m(height_m: float) -> float:
        """Of a camera at x = 10.1 that looks at the ground at x = 30.1, 10 m behind the wall's middle."""
        return float(wall.depth(np.array([[10.1, 0.0, height_m]]), np.array([[20.0, 0.0, -height_m]]))[0])

    assert length_m(3.0) == pytest.approx(0.2 * np.hypot(1.0, 3.0 / 20.0))
    assert length_m(4.0) == pytest.approx(0.1 * np.hypot(1.0, 4.0 / 20.0))  # through the roof in the middle
    assert length_m(5.0) == 0.0
    above = wall.depth(np.array([[20.1, 0.0, 9.0]]), np.array([[0.0, 0.0, -9.0]]))  # straight down, into the wall
    assert above == pytest.approx([2.0])


def test_what_begins_or_ends_inside_counts_from_there_and_what_is_beyond_does_not() -> None:
    wall = buildings(BuildingConfig(footprint_m=WALL, height_m=2.0, attenuation_per_m=1.0))
    start = np.array([[20.05, 0.0, 1.0], [10.0, 0.0, 1.0], [10.0, 0.0, 1.0], [30.0, 0.0, 1.0]])
    way = np.array([[5.0, 0.0, 0.0], [10.05, 0.0, 0.0], [9.9, 0.0, 0.0], [9.0, 0.0, 0.0]])
    assert wall.depth(start, way) == pytest.approx([0.15, 0.05, 0.0, 0.0])
    assert wall
    assert not buildings()


def test_materials_have_the_attenuation_of_the_tables() -> None:
    """NIST, 662 keV: 0.0789 cm2/g of ordinary concrete, 0.0738 of iron."""
    concrete = BuildingConfig(footprint_m=WALL, height_m=2.0, material="concrete")
    steel = BuildingConfig(footprint_m=WALL, height_m=2.0, material="steel")
    assert attenuation_per_m(concrete, AIR_PER_M) == pytest.approx(7.89 * 2.3, rel=0.01)
    assert attenuation_per_m(steel, AIR_PER_M) == pytest.approx(7.38 * 7.85, rel=0.01)
    given = BuildingConfig(footprint_m=WALL, height_m=2.0, attenuation_per_m=0.5)
    assert attenuation_per_m(given, AIR_PER_M) == 0.5


MISSION = """
name = "town"
drones = [{ id = "d1" }]
[area]
polygon_m = [[0, 0], [100, 0], [100, 100], [0, 100]]
"""


HERE = "[datum]\nlatitude_deg = 50\nlongitude_deg = 14"
RING = [[0, 0], [9, 0], [9, 9], [0, 0]]
HOLE = [[2, 1], [3, 1], [3, 2], [2, 1]]


def feature(coordinates: object = None, kind: str = "Polygon", **properties: object) -> dict[str, object]:
    ring = [[10.0, 10.0], [14.0, 10.0], [14.0, 12.0], [10.0, 12.0], [10.0, 10.0]]
    geometry = {"type": kind, "coordinates": [ring] if coordinates is None else coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": {"height_m": 3.0, **properties}}


def written(folder: Path, features: list[dict[str, object]], section: str) -> Path:
    (folder / "town.geojson").write_text(json.dumps({"type": "FeatureCollection", "name": "x", "features": features}))
    (folder / "mission.toml").write_text(f'{MISSION}[buildings]\nfile = "town.geojson"\n{section}')
    return folder / "mission.toml"


def test_a_mission_has_the_buildings_of_its_file(tmp_path: Path) -> None:
    file = written(tmp_path, [feature(material="brick", name="shed"), feature(attenuation_per_m=0.4)], 'crs = "mission"')
    mission = load_mission(file)
    shed, hall = mission.buildings.known
    assert mission.buildings.file is None
    assert shed.footprint_m == ((10.0, 10.0), (14.0, 10.0), (14.0, 12.0), (10.0, 12.0))
    assert (shed.material, shed.height_m, hall.attenuation_per_m) == ("brick", 3.0, 0.4)
    other = load_mission(written(tmp_path, [feature(material="wood")], 'crs = "mission"'))
    assert other.mission_id != mission.mission_id


def test_longitudes_and_latitudes_are_placed_by_the_datum(tmp_path: Path) -> None:
    ring = [[14.0, 50.0], [14.001, 50.0], [14.001, 50.0005], [14.0, 50.0]]
    mission = load_mission(written(tmp_path, [feature([ring])], "[datum]\nlatitude_deg = 50.0\nlongitude_deg = 14.0\n"))
    corners = np.array(mission.buildings.known[0].footprint_m)
    assert corners == pytest.approx(np.array([[0.0, 0.0], [71.7, 0.0], [71.7, 55.6]]), abs=0.1)
    assert shapely.Polygon(corners).is_valid


@pytest.mark.parametrize(
    ("features", "section", "message"),
    [
        ([feature([[[0, 0], [4, 4], [4, 0], [0, 4], [0, 0]]])], 'crs = "mission"', "feature 1: footprint_m: Self-intersection"),
        ([feature(), feature(attenuation_per_m=-1.0)], 'crs = "mission"', r"feature 2: Expected `float` >= 0.0 - at `\$.atten"),
        ([feature(material="gold")], 'crs = "mission"', r"feature 1: Invalid enum value 'gold' .* material \(concrete, brick"),
        ([feature(height_m=0.0)], 'crs = "mission"', r"feature 1: Expected `float` > 0.0 - at `\$.height_m`"),
        ([feature(kind="Point", coordinates=[1, 2])], 'crs = "mission"', "feature 1: is a Point; a building or wall is"),
        ([feature([[[0, 0], [4, 0]]])], 'crs = "mission"', "feature 1: its geometry is not GeoJSON"),
        ([feature([[[0, 0], [9, 0], [9, 9]]])], 'crs = "mission"', "feature 1: its geometry is not GeoJSON .* closed"),
        ([feature([RING, HOLE])], 'crs = "mission"', "feature 1: 2 rings; give an outline"),
        ([feature([[[0, 0], [2e5, 0], [9, 9], [0, 0]]])], 'crs = "mission"', "feature 1: Expected `float` <= 100000.0"),
        ([feature()], "", "longitudes and latitudes need the mission's datum"),
        ([feature([[[1900, 0], [4, 0], [4, 9], [1900, 0]]])], HERE, "coordinates that are no degrees"),
        ([feature([[[50, 14], [50.1, 14], [50.1, 14.1], [50, 14]]])], HERE, "latitude and longitude are swapped"),
        ([feature([[[24, 50], [24.1, 50], [24.1, 50.1], [24, 50]]])], HERE, "nothing in it is nearer than 10 degrees"),
    ],
)  # fmt: skip
def test_a_map_that_cannot_be_is_refused_in_one_line(
    tmp_path: Path, features: list[dict[str, object]], section: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        load_mission(written(tmp_path, features, section))
    assert str(caught.value).startswith("buildings.file: ")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_missing_or_no_geojson_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path, [], 'crs = "mission"')
    (tmp_path / "town.geojson").write_text('{"type": "Topology"}')
    with pytest.raises(ConfigError, match="its geometry is not GeoJSON"):
        load_mission(file)
    (tmp_path / "town.geojson").unlink()
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load_mission(file)


def test_buildings_in_the_mission_file_itself_are_checked_as_well(tmp_path: Path) -> None:
    file = tmp_path / "mission.toml"
    file.write_text(f"{MISSION}[[buildings.known]]\nheight_m = 2.0\nfootprint_m = [[0, 0], [4, 4], [4, 0], [0, 4]]\n")
    with pytest.raises(ConfigError, match=r"mission.toml: buildings.known\[0\]: footprint_m: Self-intersection"):
        load_mission(file)


def on_earth(content: bytes, folder: Path) -> tuple[BuildingConfig, ...]:
    """The buildings of a file, in a mission at 50 degrees north and 14 east."""
    file = written(folder, [], HERE)
    (folder / "town.geojson").write_bytes(content)
    return load_mission(file).buildings.known


def test_what_programs_for_maps_write_is_read(tmp_path: Path) -> None:
    """Several parts, no place, a single feature, empty properties, and a byte order mark."""
    near, far = ([[[14.0 + x, 50.0], [14.001 + x, 50.0], [14.001 + x, 50.0005], [14.0 + x, 50.0]]] for x in (0.0, 0.002))
    plain = feature(near)
    (expected,) = on_earth(json.dumps({"type": "FeatureCollection", "features": [plain]}).encode(), tmp_path)
    multi = feature([near, far], kind="MultiPolygon")
    nowhere = plain | {"geometry": None}
    unset = feature(near, material=None, attenuation_per_m=None, name=None)
    collection = json.dumps({"type": "FeatureCollection", "features": [multi, nowhere, unset]}).encode()
    first, second, third = on_earth(collection, tmp_path)
    assert first == third == expected
    assert second.footprint_m[0] == pytest.approx((143.4, 0.0), abs=0.1)
    for content in (json.dumps(plain).encode(), b"\xef\xbb\xbf" + json.dumps(plain).encode(), json.dumps(plain).encode("utf-16")):
        assert on_earth(content, tmp_path) == (expected,)


def test_one_building_on_the_antimeridian_is_one_place(tmp_path: Path) -> None:
    """Written from 179.9999 to -179.9999 degrees in two parts, as RFC 7946 has it."""
    parts = [
        [[[179.9999, 50.0], [180.0, 50.0], [180.0, 50.0001], [179.9999, 50.0]]],
        [[[-180.0, 50.0], [-179.9999, 50.0], [-180.0, 50.0001], [-180.0, 50.0]]],
    ]
    file = written(tmp_path, [feature(parts, kind="MultiPolygon")], "[datum]\nlatitude_deg = 50\nlongitude_deg = -179.9999")
    west, east = load_mission(file).buildings.known
    assert west.footprint_m[1] == pytest.approx(east.footprint_m[0])
