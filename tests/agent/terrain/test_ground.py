"""The ground from planes and grids of every kind, against heights computed independently."""

import base64
import sys
from io import BytesIO

import msgspec
import numpy as np
import pytest
import rasterio
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from radron.agent.config.loading import load_mission
from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, GroundConfig, MissionConfig
from radron.agent.errors import ConfigError
from radron.agent.frames.transform import Transform
from radron.agent.terrain.ground import Ground
from support.flights.geodetic import geodetics_from_mission

AREA = AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0)), fence_margin_m=10.0)
DATUM = DatumConfig(latitude_deg=50.1, longitude_deg=14.5, altitude_m=230.0)
ZONE_33_M = (464240.924111, 5549868.957358)  # the datum in EPSG:32633, by pyproj 3.7.2


def mission(ground, datum=None, area=AREA):
    return MissionConfig(name="test", drones=(DroneInMission(id="d1"),), area=area, ground=ground, datum=datum)


def ascii_grid(heights, west=-20.0, south=-20.0, cell=10.0, corner="center", nodata=-9999.0):
    rows = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in np.asarray(heights, dtype=float))
    size = f"ncols {len(heights[0])}\nnrows {len(heights)}"
    head = f"{size}\nxll{corner} {west:.12g}\nyll{corner} {south:.12g}\ncellsize {cell:.12g}\n"
    return f"{head}NODATA_value {nodata:g}\n{rows}\n".encode()


def slanting(columns=11, rows=9, west=-20.0, south=-20.0, cell=10.0):
    """Heights 2 + 0.1 x - 0.05 y at the nodes, north on top: bilinear gets them back exactly."""
    x = west + cell * np.arange(columns)
    y = south + cell * np.arange(rows)[::-1]
    return 2.0 + 0.1 * x[None, :] - 0.05 * y[:, None]


def grid(data, **more):
    return GroundConfig(grid="hills", grid_data=data, **more)


FLOAT32_MIN = float(np.finfo(np.float32).min)  # of ArcGIS and QGIS


def written_by_gdal(heights, dtype=np.float32, nodata=None, unit="", scale=1.0, offset=0.0, crs=None):
    """A GeoTIFF as programs that use GDAL write it: of 10 m from (-20, 60), in the mission frame or around the datum."""
    west, north = (-25.0, 65.0) if crs is None else (ZONE_33_M[0] - 25.0, ZONE_33_M[1] + 65.0)
    heights = np.asarray(heights, dtype=dtype)
    size = {"height": heights.shape[0], "width": heights.shape[1], "count": 1, "dtype": dtype}
    with rasterio.MemoryFile() as file:
        place = rasterio.transform.from_origin(west, north, 10.0, 10.0)
        with file.open(driver="GTiff", nodata=nodata, crs=crs, transform=place, **size) as raster:
            raster.write(heights, 1)
            raster.units, raster.scales, raster.offsets = (unit,), (scale,), (offset,)
        return bytes(file.getbuffer())


def geotiff(heights, scale, tie, keys, dtype=np.float32, nodata=None, **more):
    """A GeoTIFF: ``scale`` of a pixel, ``tie``: coordinates of the first pixel's corner, ``keys``: GeoKeys by number."""
    directory = [1, 1, 0, len(keys)] + [number for key, value in sorted(keys.items()) for number in (key, 0, 1, value)]
    tags = [
        (33550, 12, 3, (*scale, 0.0), True),
        (33922, 12, 6, (0.0, 0.0, 0.0, *tie, 0.0), True),
        (34735, 3, len(directory), directory, True),
    ]
    if nodata is not None:
        tags.append((42113, 2, 0, f"{nodata:g}", True))
    file = BytesIO()
    tifffile.imwrite(file, np.asarray(heights, dtype=dtype), extratags=tags, **{"photometric": "minisblack", **more})
    return file.getvalue()


def test_flat_ground_is_at_zero():
    ground = Ground.from_config(mission(GroundConfig()))
    assert ground.level
    assert ground.height_m(12.0, -7.0) == 0.0
    assert ground.slope(1.0, 2.0) == (0.0, 0.0)


def test_a_plane_rises_as_it_says():
    ground = Ground.from_config(mission(GroundConfig(height_m=1.5, slope=(0.1, -0.2))))
    assert not ground.level
    assert ground.height_m(10.0, 5.0) == pytest.approx(1.5)
    assert ground.heights_m(np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])) == pytest.approx([1.5, 2.5, -0.5])
    assert ground.slope(3.0, 4.0) == (0.1, -0.2)


@given(st.floats(-20.0, 80.0), st.floats(-20.0, 60.0))
def test_between_the_nodes_the_heights_go_evenly(x, y):
    ground = Ground.from_config(mission(grid(ascii_grid(slanting()))))
    assert ground.height_m(x, y) == pytest.approx(2.0 + 0.1 * x - 0.05 * y, abs=1e-7)


def test_a_grid_by_its_corner_lies_half_a_cell_further():
    by_corner = Ground.from_config(mission(grid(ascii_grid(slanting(), west=-25.0, south=-25.0, corner="corner"))))
    assert by_corner.height_m(7.0, 11.0) == pytest.approx(2.0 + 0.7 - 0.55, abs=1e-7)


def test_outside_it_goes_on_as_at_the_edge():
    ground = Ground.from_config(mission(grid(ascii_grid(slanting()))))
    at_edge = ground.height_m(80.0, 30.0)
    assert ground.height_m(500.0, 30.0) == pytest.approx(at_edge)
    assert ground.slope(500.0, 30.0) == pytest.approx((0.0, -0.05), abs=1e-7)
    assert ground.height_m(500.0, 500.0) == pytest.approx(ground.height_m(80.0, 60.0))


def test_slopes_are_those_of_the_heights():
    heights = np.random.default_rng(4).uniform(0.0, 5.0, (9, 11))
    ground = Ground.from_config(mission(grid(ascii_grid(heights))))
    for x, y in ((13.0, 22.0), (41.0, 38.0), (-7.0, 4.0)):
        east, north = ground.slope(x, y)
        assert east == pytest.approx((ground.height_m(x + 0.1, y) - ground.height_m(x - 0.1, y)) / 0.2, abs=1e-6)
        assert north == pytest.approx((ground.height_m(x, y + 0.1) - ground.height_m(x, y - 0.1)) / 0.2, abs=1e-6)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("dtype", [np.float32, np.int16])
def test_a_geotiff_in_utm_lies_where_the_datum_says(compression, dtype):
    """A ramp along the zone's eastings: the mission's east is turned against it by the meridian's convergence, 0.38 degrees."""
    east, north = ZONE_33_M
    heights = 230.0 + np.tile(np.arange(30.0), (30, 1))  # 1 m for each cell of 5 m
    data = geotiff(
        heights, (5.0, 5.0), (east - 52.5, north + 97.5), {1024: 1, 1025: 1, 3072: 32633}, dtype, compression=compression
    )
    ground = Ground.from_config(mission(grid(data), DATUM))
    assert ground.height_m(0.0, 0.0) == pytest.approx(10.0, abs=1e-4)
    assert ground.height_m(50.0, 0.0) == pytest.approx(20.0, abs=0.01)  # scale 0.9996, and the convergence
    turn = np.radians(0.5) * np.sin(np.radians(50.1))  # the datum is half a degree west of the zone's meridian
    slope = ground.slope(20.0, 20.0)
    assert slope == pytest.approx((0.2 * np.cos(turn), 0.2 * np.sin(turn)), abs=2e-4)


def test_a_geotiff_in_degrees_and_above_the_sea():
    """The geoid of 45 m there: heights above the sea of 190 m are the datum's 230 m and 5 m more."""
    nodes = geodetics_from_mission(DATUM, np.array([[-30.0, 70.0, 0.0], [90.0, -30.0, 0.0]]))
    (top, left, _), (bottom, right, _) = nodes.tolist()
    scale = ((right - left) / 20.0, (top - bottom) / 20.0)
    heights = 190.0 + np.zeros((20, 20))
    heights[10:] = 195.0  # the southern half: y < 20 m
    data = geotiff(heights, scale, (left, top), {1024: 2, 1025: 1, 2048: 4326})
    ground = Ground.from_config(mission(grid(data, geoid_m=45.0), DATUM))
    assert ground.height_m(30.0, 35.0) == pytest.approx(5.0, abs=1e-3)
    assert ground.height_m(30.0, 5.0) == pytest.approx(10.0, abs=1e-3)
    assert ground.height_m(30.0, 20.0) == pytest.approx(7.5, abs=0.02)  # between the two rows


def test_an_ascii_grid_may_be_georeferenced_by_the_mission():
    east, north = ZONE_33_M
    heights = 230.0 + np.tile(np.arange(30.0), (30, 1))
    data = ascii_grid(heights, west=east - 50.0, south=north - 50.0, cell=5.0)
    ground = Ground.from_config(mission(grid(data, grid_crs="EPSG:32633"), DATUM))
    assert ground.height_m(0.0, 0.0) == pytest.approx(10.0, abs=1e-4)


def test_a_pixel_that_is_a_point_is_not_shifted():
    heights = slanting()
    for raster_type, shift in ((1, 5.0), (2, 0.0)):
        data = geotiff(heights, (10.0, 10.0), (-20.0 - shift, 60.0 + shift), {1025: raster_type})
        assert Ground.from_config(mission(grid(data))).height_m(7.0, 11.0) == pytest.approx(2.15, abs=1e-5)


def test_a_geotiff_says_which_value_is_a_hole():
    heights = broken(0, 0, -32768.0)
    data = geotiff(heights, (10.0, 10.0), (-25.0, 65.0), {1025: 1}, np.int16, nodata=-32768.0)
    assert Ground.from_config(mission(grid(data))).height_m(-20.0, 60.0) > -10.0
    heights = broken(4, 5, -32768.0)
    data = geotiff(heights, (10.0, 10.0), (-25.0, 65.0), {1025: 1}, np.int16, nodata=-32768.0)
    with pytest.raises(ConfigError, match="1 holes"):
        Ground.from_config(mission(grid(data)))


def test_holes_beside_the_area_are_filled_from_the_nearest():
    heights = slanting()
    heights[0, 0] = -9999.0  # (-20, 60)
    ground = Ground.from_config(mission(grid(ascii_grid(heights))))
    assert ground.height_m(-20.0, 60.0) in (heights[0, 1], heights[1, 0])


@pytest.mark.parametrize("declared", [True, False])
@pytest.mark.parametrize("void", [FLOAT32_MIN, -3.4e38, -32768.0, -9999.0, np.nan])
def test_voids_beside_the_area_change_nothing_in_it(void, declared):
    """In UTM they used to bend the grid: its nodes were placed by their heights."""
    heights = slanting()  # with a height of exactly 0, which tifffile takes for missing where the least float32 is
    whole = written_by_gdal(heights, crs="EPSG:32633")
    heights[0, 0] = void
    data = written_by_gdal(heights, nodata=void if declared else None, crs="EPSG:32633")
    found, expected = (Ground.from_config(mission(grid(one, geoid_m=230.0), DATUM)) for one in (data, whole))
    places = np.array([[0.0, 0.0], [30.0, 20.0], [60.0, 40.0]])
    assert found.heights_m(places) == pytest.approx(expected.heights_m(places))
    assert found.slopes(places) == pytest.approx(expected.slopes(places))


@pytest.mark.parametrize(
    ("more", "stored"),
    [
        ({"unit": "ft"}, lambda height: height / 0.3048),
        ({"unit": "US survey foot"}, lambda height: height * 3937.0 / 1200.0),
        ({"unit": "m"}, lambda height: height),
        ({"scale": 0.1, "offset": 100.0, "dtype": np.int16}, lambda height: np.round((height - 100.0) / 0.1)),
        ({"scale": 0.1, "unit": "foot"}, lambda height: height / 0.03048),
    ],
)
def test_heights_are_metres_whatever_their_unit_scale_and_offset(more, stored):
    ground = Ground.from_config(mission(grid(written_by_gdal(stored(slanting()), **more))))
    assert ground.height_m(7.0, 11.0) == pytest.approx(2.0 + 0.7 - 0.55, abs=1e-4)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_a_grid(encoding):
    data = ascii_grid(slanting()).decode().encode(encoding)
    assert Ground.from_config(mission(grid(data))).height_m(7.0, 11.0) == pytest.approx(2.15, abs=1e-7)


@pytest.mark.parametrize(
    "data", [ascii_grid(slanting()).replace(b" 4.5", b" 4,5"), ascii_grid(slanting()) + b"\xff", b"9" * 10**6]
)
def test_an_error_about_a_grid_is_short(data):
    with pytest.raises(ConfigError) as caught:
        Ground.from_config(mission(grid(data)))
    assert len(str(caught.value)) < 400


def broken(rows, columns, value):
    heights = slanting()
    heights[rows, columns] = value
    return heights


@pytest.mark.parametrize(
    ("ground", "says"),
    [
        (GroundConfig(grid="hills.asc"), "not read"),
        (grid(b"no heights here"), "not an ESRI ASCII grid"),
        (grid(b""), "not an ESRI ASCII grid"),
        (grid(ascii_grid(slanting())[:-40]), "not an ESRI ASCII grid"),
        (grid(b"II*\0damaged"), "cannot be read"),
        (grid(geotiff(slanting(), (10.0, 10.0), (-25.0, 65.0), {1025: 1})[:300]), "cannot be read"),
        (grid(geotiff(np.zeros((9, 11, 3)), (10.0, 10.0), (-25.0, 65.0), {1025: 1}, np.uint8, photometric="rgb")), "one band"),
        (grid(geotiff(slanting(), (10.0, 10.0), (-25.0, 65.0), {1025: 1, 3072: 32633})), "needs the mission's datum"),
        (grid(geotiff(slanting(), (10.0, 10.0), (-25.0, 65.0), {1025: 1, 3076: 9002})), "not the metre"),
        (grid(ascii_grid(slanting(), west=500.0)), "does not cover area.polygon_m"),
        (grid(ascii_grid(slanting(), west=-60.0)), "does not cover the corner"),
        (grid(ascii_grid(broken(4, 5, -9999.0))), "1 holes in the area, one at \\(30.0, 20.0\\)"),
        (grid(ascii_grid(broken(4, 5, np.nan))), "1 holes in the area"),
        (grid(ascii_grid([[1.0]])), "at least two"),
        (grid(ascii_grid(slanting()).replace(b"ncols 11", b"ncols inf")), "not an ESRI ASCII grid"),
        (grid(ascii_grid(slanting(), west=float("nan"))), "west = nan"),
        (grid(ascii_grid(slanting(), cell=float("inf"))), "cellsize = inf"),
        (grid(ascii_grid(broken(4, 5, -9999.0), nodata=-7777.0)), "1 holes in the area, one at \\(30.0, 20.0\\)"),
        (grid(written_by_gdal(broken(4, 5, FLOAT32_MIN))), "1 holes in the area"),
        (grid(written_by_gdal(broken(4, 5, -32768.0), np.int16)), "1 holes in the area"),
        (grid(ascii_grid(slanting() * 100.0 + 60.0)), "steps by 100 m between neighbouring nodes at"),
        (grid(ascii_grid(broken(4, 5, -77.0))), "steps by 82 m between neighbouring nodes at .*declare its voids"),
        (grid(written_by_gdal(slanting(), unit="fathom")), "the unit of its heights, fathom, is not supported"),
    ],
)  # fmt: skip
def test_a_grid_that_cannot_be_used_is_an_error_that_says_why(ground, says):
    with pytest.raises(ConfigError, match=says):
        Ground.from_config(mission(ground))


def test_a_projection_that_is_not_known_is_an_error():
    data = geotiff(slanting(), (10.0, 10.0), (-25.0, 65.0), {1024: 1, 1025: 1, 3072: 5514})
    with pytest.raises(ConfigError, match="EPSG:5514 is not supported"):
        Ground.from_config(mission(grid(data), DATUM))


def test_utm_without_pyproj_is_one_line_that_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    with pytest.raises(ConfigError, match=r"EPSG:32633: pyproj is not installed: pip install 'radron\[geo\]'"):
        Ground.from_config(mission(grid(ascii_grid(slanting()), grid_crs="EPSG:32633"), DATUM))


MISSION = """
name = "hills"
drones = [{ id = "d1" }]
[area]
polygon_m = [[0.0, 0.0], [60.0, 0.0], [60.0, 40.0], [0.0, 40.0]]
[ground]
grid = "hills.asc"
"""


def test_the_grid_comes_with_the_mission_and_belongs_to_its_id(tmp_path):
    file, hills = tmp_path / "mission.toml", tmp_path / "hills.asc"
    file.write_text(MISSION)
    hills.write_bytes(ascii_grid(slanting()))
    loaded = load_mission(file)
    assert Ground.from_config(loaded).height_m(30.0, 20.0) == pytest.approx(4.0, abs=1e-7)
    hills.write_bytes(ascii_grid(slanting() + 0.001))
    assert load_mission(file).mission_id != loaded.mission_id


def test_a_mission_that_is_passed_on_brings_its_grid_along(tmp_path):
    """As a record's header, or a file that a launcher writes: there is no second file then."""
    whole = mission(grid(ascii_grid(slanting())))
    again = msgspec.json.decode(msgspec.json.encode(whole), type=MissionConfig)
    assert again.mission_id == whole.mission_id
    assert Ground.from_config(again).height_m(30.0, 20.0) == pytest.approx(4.0, abs=1e-7)
    file = tmp_path / "mission.toml"
    data = base64.b64encode(ascii_grid(slanting())).decode()
    file.write_text(f'{MISSION}grid_data = "{data}"\n')
    assert Ground.from_config(load_mission(file)).height_m(30.0, 20.0) == pytest.approx(4.0, abs=1e-7)


def test_a_grid_that_is_missing_or_too_large_is_an_error(tmp_path):
    file = tmp_path / "mission.toml"
    file.write_text(MISSION)
    with pytest.raises(ConfigError, match=r"hills.asc: cannot be read"):
        load_mission(file)
    (tmp_path / "hills.asc").write_bytes(b" " * 2_000_001)
    with pytest.raises(ConfigError, match="more than 2 MB"):
        load_mission(file)


def test_around_a_vehicle_the_ground_is_as_its_rangefinder_has_it_and_rises_as_the_model():
    """The model is 3 m too high here, and the local frame lies turned by a quarter and 100 m up."""
    ground = Ground.from_config(mission(grid(ascii_grid(slanting() + 3.0))))
    mission_from_local = Transform(np.pi / 2, (30.0, 10.0, 100.0))
    below_m = -98.0
    around = ground.around(mission_from_local, (4.0, -6.0), below_m)
    # Local x is north and local y west: 2 m on along x the ground falls by 0.1 m, 3 m along y by 0.3 m.
    assert around(np.array([[4.0, -6.0], [6.0, -6.0], [4.0, -3.0]])) == pytest.approx([-98.0, -98.1, -98.3], abs=1e-6)


def test_around_a_vehicle_whose_frame_is_not_known_the_ground_is_even():
    ground = Ground.from_config(mission(grid(ascii_grid(slanting()))))
    assert ground.around(None, (4.0, -6.0), 1.5)(np.array([[4.0, -6.0], [60.0, 0.0]])).tolist() == [1.5, 1.5]
