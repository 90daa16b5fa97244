"""Vector layers and tiles under the map: read, placed, and refused in one line."""

import json
import sqlite3

import msgspec
import pymap3d
import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DatumConfig
from radron.agent.errors import ConfigError
from radron.station.background import Background, BackgroundError, FolderTiles, MbTiles, background
from radron.station.hub import Hub
from radron.station.picture.frame import TileLevels
from radron.station.picture.picture import Picture
from support.flights.one_pilot import MISSION
from support.page.map_tiles import colour, png, tile_of, write_folder, write_mbtiles
from support.page.served_page import served

HERE = DatumConfig(latitude_deg=47.4, longitude_deg=8.5, altitude_m=488.0)
ON_EARTH = replace(MISSION, datum=HERE)
Z = 18


def geojson(tmp_path, document):
    path = tmp_path / "own.geojson"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def feature(kind, coordinates, **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def test_a_layer_lies_where_an_independent_geodesy_puts_it(tmp_path):
    ring = [[8.5, 47.4], [8.503, 47.4], [8.503, 47.402], [8.5, 47.4]]
    hole = [[8.501, 47.4002], [8.502, 47.4002], [8.502, 47.4008], [8.501, 47.4002]]
    features = [
        feature("Polygon", [ring, hole], name="hall"),
        feature("MultiLineString", [[[8.49, 47.39], [8.51, 47.41]], [[8.5, 47.4], [8.5, 47.5]]]),
        feature("Point", [8.5, 47.401, 3.0], name=7),
        {"type": "Feature", "properties": None, "geometry": None},
    ]
    path = geojson(tmp_path, {"type": "FeatureCollection", "features": features})
    shapes = msgspec.json.decode(background(ON_EARTH, [path], None).layer)
    assert [(kind, name, len(places)) for kind, name, places in shapes] == [
        ("area", "hall", 4), ("line", "hall", 4), ("line", "", 2), ("line", "", 2), ("point", "7", 1)
    ]  # fmt: skip
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())  # as some programs on Windows begin a file
    assert msgspec.json.decode(background(ON_EARTH, [path], None).layer) == shapes
    for (longitude, latitude), (x, y) in zip(ring, shapes[0][2], strict=True):
        east, north, _ = pymap3d.geodetic2enu(latitude, longitude, 488.0, 47.4, 8.5, 488.0)
        assert (x, y) == pytest.approx((east, north), abs=0.006)


@pytest.mark.parametrize(
    ("document", "says"),
    [
        ("{", "is not GeoJSON"),
        (feature("Point", [47.4, 8.5]), "latitude and longitude are swapped"),
        (feature("Point", [11.5, 48.1]), "nothing in it is nearer than 3 degrees to the mission's datum"),
        ("[" * 100_000, "is not GeoJSON"),
        ([], "is not GeoJSON"),
        ({"type": "FeatureCollection", "features": [3]}, "is not GeoJSON"),
        (feature("Polygon", [[[1, 2]]]), "feature 1: its geometry is not GeoJSON"),
        (feature("LineString", [[0, 0], [460000, 5250000]]), "coordinates that are no degrees"),
        (
            feature("Point", [0, 0]) | {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}},
            "not in WGS84",
        ),
    ],
)
def test_what_is_no_layer_is_told(tmp_path, document, says):
    with pytest.raises(ConfigError, match=rf"^--layer: .*own\.geojson: .*{says}"):
        background(ON_EARTH, [geojson(tmp_path, document)], None)


def test_nothing_is_placed_without_a_datum(tmp_path):
    assert background(MISSION, [], None) == Background()
    with pytest.raises(BackgroundError, match=r"the mission has no \[datum\]"):
        background(MISSION, [geojson(tmp_path, feature("Point", [8.5, 47.4]))], None)
    with pytest.raises(BackgroundError, match="there is no such file or folder"):
        background(ON_EARTH, [], tmp_path / "none.mbtiles")


def test_a_folder_and_a_file_give_the_same_tiles(tmp_path):
    place = (HERE.latitude_deg, HERE.longitude_deg)
    folder = FolderTiles(write_folder(tmp_path / "tiles", *place, range(16, 19)))
    file = MbTiles(write_mbtiles(tmp_path / "yard.mbtiles", *place, range(16, 19)))
    assert folder.levels == TileLevels(16, 18, "")
    assert file.levels == TileLevels(16, 18, "© Survey")
    x, y = tile_of(*place, Z)
    for there in ((Z, x, y), (Z, x + 1, y), (Z, x, y + 2)):
        assert folder.tile(*there) == file.tile(*there) == (png(*colour(*there)), "image/png")
    for nowhere in ((Z, x + 9, y), (3, 1, 1), (99, 0, 0), (Z, 2**Z, 0), (Z, -1, 0)):
        assert folder.tile(*nowhere) is file.tile(*nowhere) is None


def test_what_holds_no_images_is_told(tmp_path):
    vectors = write_mbtiles(tmp_path / "vectors.mbtiles", 47.4, 8.5, range(3, 4), kind="pbf")
    (tmp_path / "text.mbtiles").write_text("text")
    (tmp_path / "empty").mkdir()
    for name, says in (
        ("vectors.mbtiles", "format 'pbf'"),
        ("text.mbtiles", "is not an MBTiles file"),
        ("empty", "holds no tiles"),
    ):
        with pytest.raises(BackgroundError, match=says):
            background(ON_EARTH, [], tmp_path / name)
    assert vectors.exists()


def test_a_file_of_tiles_with_other_types_in_it_shows_nothing_and_takes_no_memory(tmp_path):
    """SQLite's columns hold anything: an integer as a tile was as many bytes of memory."""

    def made(name, *rows):
        with sqlite3.connect(tmp_path / name) as file:
            file.execute("CREATE TABLE metadata (name, value)")
            file.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
            file.execute("INSERT INTO metadata VALUES ('format', 'png')")
            file.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
        return MbTiles(tmp_path / name)

    tiles = made("odd.mbtiles", (1, 0, 0, None), (1, 1, 0, 10**12), (1, 0, 1, b"image"))
    assert [tiles.tile(1, *place) for place in ((0, 1), (1, 1), (0, 0))] == [None, None, (b"image", "image/png")]
    for name, level in (("text.mbtiles", "x"), ("below.mbtiles", -1), ("beyond.mbtiles", 25)):
        with pytest.raises(BackgroundError, match="its zoom levels are"):
            made(name, (level, 0, 0, b"image"))


def test_tiles_and_layers_are_served_to_those_who_are_let_in_and_nothing_beside_them(tmp_path):
    hub = Hub(Picture(ON_EARTH, None), replay=False)
    place = (HERE.latitude_deg, HERE.longitude_deg)
    (tmp_path / "18").mkdir()
    (tmp_path / "18" / "secret.png").write_text("x")
    layer = geojson(tmp_path, feature("Point", [8.5, 47.4]))
    hub.background = background(ON_EARTH, [layer], write_folder(tmp_path / "tiles", *place, range(Z, Z + 1)))
    x, y = tile_of(*place, Z)
    with served(hub) as page:
        status, headers, body = page.get(f"/tiles/{Z}/{x}/{y}?token={page.token}")
        assert (status, headers["content-type"], body) == (200, "image/png", png(*colour(Z, x, y)))
        assert page.get(f"/tiles/{Z}/{x}/{y}", Host="evil.example")[0] == page.get("/layer.json", Host="evil.example")[0] == 403
        assert page.get(f"/tiles/{Z}/0/0?token={page.token}")[1]["content-type"] == "image/svg+xml"
        assert json.loads(page.get(f"/layer.json?token={page.token}")[2])[0][0] == "point"
        for path in (
            "/tiles/18/../secret",
            "/tiles/-1/0/0",
            "/tiles/18/..%2f..%2f18/secret",
            f"/tiles/{10**400}/0/0",
            "/tiles/18/x/0",
        ):
            _, headers, body = page.get(f"/tiles/{path}?token={page.token}")
            assert (headers["content-type"], body[:4]) == ("image/svg+xml", b"<svg")
