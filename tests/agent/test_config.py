"""Mission and drone files: errors in one line, with the file, the key and the allowed values."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import inspect
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.config.loading import convert, load_mission, load_toml
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.config.section import Section, content_of
from radron.agent.errors import ConfigError, RadronError

MISSION = """
name = "harbour"

[[drones]]
id = "uav1"

[[drones]]
id = "uav2"
origin_m = [5.0, 0.0, 0.0]

[area]
polygon_m = [[0, 0], [100, 0], [100, 100], [0, 100]]

[encirclement]
radius_m = 10
"""


@pytest.fixture
def mission_file(tmp_path: Path) -> Path:
    path = tmp_path / "mission.toml"
    path.write_text(MISSION)
    return path


def error_of(path: Path, old: str, new: str) -> str:
    assert old in MISSION
    path.write_text(MISSION.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_mission(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text.removeprefix(f"{path}: ")


def test_a_mission_is_read_with_its_defaults(mission_file: Path) -> None:
    mission = load_mission(mission_file)
    assert [drone.id for drone in mission.drones] == ["uav1", "uav2"]
    assert mission.encirclement.radius_m == 10.0
    assert mission.limits.separation_m == 3.0
    assert mission.area.polygon_m[2] == (100.0, 100.0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("radius_m", "radius", ["unknown key 'encirclement.radius'", "did you mean 'radius_m'?", "allowed: law, radius_m"]),
        ("[area]", "[arena]", ["unknown key 'arena'", "did you mean 'area'?"]),
        ("origin_m", "origin", ["unknown key 'drones[1].origin'", "did you mean 'origin_m'?"]),
        ('name = "harbour"', 'name = "har\\nbour"', ["name: give one line of at most 200 letters"]),
        ('name = "harbour"', f'name = "{"x" * 201}"', ["name: give one line of at most 200 letters"]),
        ('name = "harbour"', "", ["the key 'name' is missing"]),
        ('id = "uav1"', "", ["the key 'drones[0].id' is missing"]),
        ("radius_m = 10", "radius_m = -1", ["encirclement.radius_m", "> 0"]),
        ("radius_m = 10", "radius_m = nan", ["encirclement.radius_m", "> 0"]),
        ("radius_m = 10", "radius_m = inf", ["encirclement.radius_m", "<= 1000000"]),
        ("radius_m = 10", 'radius_m = "10"', ["encirclement.radius_m", "got `str`"]),
        ("radius_m = 10", 'law = "loose"', ["encirclement.law", "'loose'", "allowed: 'paper', 'smooth'"]),
        ("radius_m = 10", "height_m = 99", ["encirclement.height_m = 99", "1.5 .. 60"]),
        ("radius_m = 10", "radius_m = 1e-9", ["encirclement.radius_m = 1e-09 is outside 1 .. 1000"]),
        ("radius_m = 10", "nearest_m = 1e-9", ["encirclement.nearest_m = 1e-09 is outside 1 .. 1000"]),
        ("radius_m = 10", "[limits]\nseparation_m = 1e-9", ["limits.separation_m = 1e-09 is outside 1 .. 100"]),
        ("radius_m = 10", "[limits]\nspeed_mps = 1e-9", ["limits.speed_mps = 1e-09 is outside 0.1 .. 50"]),
        ("[area]", "[area]\nfence_margin_m = 1e5", ["area.fence_margin_m = 100000 is outside 0 .. 1000"]),
        ('"uav2"', '"uav1"', ["the id 'uav1' is given twice"]),
        ('"uav2"', '"UAV 2"', ["drones[1].id", "a-z, 0-9 and '-'"]),
        ('"uav2"', '"station"', ["drones[1].id", "not 'station'"]),
        (
            "[[0, 0], [100, 0], [100, 100], [0, 100]]",
            "[[0, 0], [100, 100], [100, 0], [0, 100]]",
            ["area.polygon_m", "Self-intersection"],
        ),
        ("[[0, 0], [100, 0], [100, 100], [0, 100]]", "[[0, 0], [100, 100]]", ["area.polygon_m", ">= 3"]),
        ("[[0, 0], [100, 0], [100, 100], [0, 100]]", "[[0, 0], [1, 1], [2, 2]]", ["area.polygon_m", "simple polygon"]),
        ("[100, 0]", "[100, nan]", ["area.polygon_m[1][1]"]),
        ("[area]", "[area]\nfloor_m = 70", ["area.floor_m must be below area.ceiling_m"]),
        ("[encirclement]", '[fusion]\nestimator = "given"\n[encirclement]', ["needs fusion.given.schedule"]),
        (
            'name = "harbour"',
            'name = "harbour"\nsource_height_m = [0, 20]',
            ["source_height_m: only fusion.estimator = 'sources'"],
        ),
        ('name = "harbour"', 'name = "harbour"\nfusion.estimator = "sources"\nsource_height_m = [9, 2]', ["9 is not below 2"]),
        ('name = "harbour"', 'name = "harbour"\nnuclide = "auto"', ["nuclide: 'auto' is more than one", "name one nuclide"]),
        ("[area]", '[ground]\ngrid = "\\n"\n[area]', ["ground.grid"]),
        ("[area]", '[buildings]\nfile = "a\\u0000b"\n[area]', ["buildings.file"]),
        ('name = "harbour"', 'name = "harbour"\nnuclide = ["Cs137"]', ["nuclide[0]: expected a nuclide, such as Cs-137"]),
        ("name =", "name", ["not TOML", "line 2"]),
    ],
)
def test_what_is_wrong_is_said(mission_file: Path, old: str, new: str, expected: list[str]) -> None:
    text = error_of(mission_file, old, new)
    for part in expected:
        assert part in text


@pytest.mark.parametrize(
    ("keys", "nuclide", "text"),
    [
        ("", "Cs-137", "Cs-137"),
        ('nuclide = "Co-60"', "Co-60", "Co-60"),
        ('nuclide = ["Co-60"]', ("Co-60",), "Co-60"),
        ('fusion.estimator = "sources"', "auto", "auto"),
        ('fusion.estimator = "sources"\nnuclide = ["Cs-137", "Co-60"]', ("Cs-137", "Co-60"), "Cs-137, Co-60"),
    ],
)
def test_the_nuclide_is_named_or_one_of_several_or_any(mission_file: Path, keys: str, nuclide: object, text: str) -> None:
    mission_file.write_text(mission_file.read_text().replace("name =", f"{keys}\nname =", 1))
    mission = load_mission(mission_file)
    assert (mission.nuclide, mission.nuclide_text) == (nuclide, text)
    assert mission.one_nuclide == (text if text in ("Cs-137", "Co-60") else None)
    assert replace(mission, nuclide="").nuclide == ("auto" if keys.startswith("fusion") else "Cs-137")


def test_no_drones(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_text('name = "m"\ndrones = []\n[area]\npolygon_m = [[0, 0], [1, 0], [0, 1]]')
    with pytest.raises(ConfigError, match=r"drones: .*length >= 1"):
        load_mission(path)


def test_an_area_of_more_lanes_than_can_be_planned_in_flight(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    mission = 'name = "m"\ndrones = [{ id = "d1" }]\n[survey]\nlane_spacing_m = 10\n[area]\npolygon_m = [%s]'
    path.write_text(mission % "[0, 0], [1e5, 0], [1e5, 1e5], [0, 1e5]")
    with pytest.raises(ConfigError, match=r"is 100000 m wide; with survey\.lane_spacing_m = 10 that makes more than 300 lanes"):
        load_mission(path)
    for corridor in ("[0, 0], [1e4, 1e4], [9e3, 1e4]", "[0, 0], [3e3, 0], [3e3, 3e3], [0, 3e3]"):
        path.write_text(mission % corridor)
        load_mission(path)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.toml: cannot be read: No such file"):
        load_mission(tmp_path / "nowhere.toml")
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load_mission(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\x7fELF\xd0\xff")
    with pytest.raises(ConfigError, match="not TOML"):
        load_mission(tmp_path / "binary.toml")
    for content, reason in ((f"a = {'9' * 5000}", "5000 digits"), (f"a = {'[' * 5000}", "nested too deeply")):
        (tmp_path / "much.toml").write_text(content)
        with pytest.raises(ConfigError, match=f"not TOML: .*{reason}"):
            load_mission(tmp_path / "much.toml")
    assert issubclass(ConfigError, RadronError)


def test_a_drone_file(tmp_path: Path) -> None:
    path = tmp_path / "drone.toml"
    path.write_text('id = "uav1"\ncamera_rpy_deg = [90, 0, 0]')
    assert load_toml(path, DroneConfig) == DroneConfig(id="uav1", camera_rpy_deg=(90.0, 0.0, 0.0))
    path.write_text('id = "uav1"\ncamera_rpy_deg = [nan, 0, 0]')
    with pytest.raises(ConfigError, match=r"camera_rpy_deg\[0\]"):
        load_toml(path, DroneConfig)


def test_the_mission_id_changes_with_anything_in_it(mission_file: Path) -> None:
    mission = load_mission(mission_file)
    seen = {mission.mission_id}
    for section in ("area", "survey", "encirclement", "limits", "detection", "fusion", "track"):
        part = getattr(mission, section)
        for field in msgspec.structs.fields(part):
            value = getattr(part, field.name)
            if isinstance(value, float):
                changed = msgspec.structs.replace(part, **{field.name: value + 0.125})
                seen.add(msgspec.structs.replace(mission, **{section: changed}).mission_id)
    seen.add(msgspec.structs.replace(mission, drones=mission.drones[::-1]).mission_id)
    assert len(seen) > 25
    assert all(len(name) == 16 and set(name) <= set("0123456789abcdef") for name in seen)
    assert load_mission(mission_file).mission_id == mission.mission_id


def numbers(kind: inspect.Type, where: str) -> list[tuple[str, Any]]:
    match kind:
        case inspect.StructType(fields=fields):
            return [found for field in fields for found in numbers(field.type, f"{where}.{field.name}")]
        case inspect.TupleType(item_types=items) | inspect.UnionType(types=items):
            return [found for number, item in enumerate(items) for found in numbers(item, f"{where}[{number}]")]
        case inspect.VarTupleType(item_type=item):
            return numbers(item, f"{where}[]")
        case inspect.FloatType() | inspect.IntType():
            return [(where, kind)]
    return []


@pytest.mark.parametrize("config", [MissionConfig, DroneConfig])
def test_every_number_has_bounds(config: type) -> None:
    found = numbers(inspect.type_info(config), config.__name__)
    assert found
    for where, kind in found:
        assert kind.ge is not None or kind.gt is not None, where
        assert kind.le is not None or kind.lt is not None, where


def test_convert_names_the_place() -> None:
    with pytest.raises(ConfigError, match=r"^here: the file: expected `object`, got `array`$"):
        convert([], MissionConfig, "here")


def test_nobody_is_launched_outside_the_fence() -> None:
    area = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0)), fence_margin_m=10.0)
    mission = MissionConfig(
        name="test", area=area, drones=(DroneInMission(id="d1"), DroneInMission(id="d2", origin_m=(75.0, 20.0, 0.0)))
    )
    with pytest.raises(ConfigError, match=r"m.toml: drones: the launch place of d2 is 15.0 m outside the fence; move it"):
        mission.check("m.toml")


@pytest.mark.parametrize("name", ["/etc/hostname", "../hills.asc", "maps/hills.asc", "..", "."])
def test_a_mission_reads_no_file_outside_its_folder(tmp_path: Path, name: str) -> None:
    drones, area = "drones = [{ id = 'd1' }]", "[area]\npolygon_m = [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0]]"
    for key in ("ground.grid", "buildings.file"):
        (tmp_path / "mission.toml").write_text(f"name = 'x'\n{drones}\n{key} = {name!r}\n{area}\n")
        with pytest.raises(ConfigError, match=rf"{key} = '{name}': give the bare name of a file in the mission file's folder"):
            load_mission(tmp_path / "mission.toml")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_a_byte_order_mark_is_no_part_of_a_file(mission_file: Path, encoding: str) -> None:
    expected = load_mission(mission_file).mission_id
    mission_file.write_bytes(mission_file.read_text(encoding="utf-8").encode(encoding))
    assert load_mission(mission_file).mission_id == expected


RECORDED = Path(__file__).parent / "flight" / "records" / "mission-protocol-2.json"


def test_a_mission_recorded_before_keys_were_added_keeps_its_id_and_its_ground() -> None:
    """Else its flight records would not open, and an uploaded mission would be refused after an update."""
    mission = msgspec.json.decode(RECORDED.read_bytes(), type=MissionConfig)
    assert mission.mission_id == "4529477d7d7c5337"
    assert mission.fusion.ground == "none"
    over_soil = replace(mission, fusion=replace(mission.fusion, ground="soil"))
    assert over_soil.mission_id != mission.mission_id
    assert msgspec.json.decode(msgspec.json.encode(over_soil), type=MissionConfig) == over_soil
    survey = replace(mission.survey, lane_spacing_m=11.0)
    assert replace(mission, survey=survey).mission_id != mission.mission_id


class Part(Section, frozen=True, kw_only=True):
    old: float = 1.0
    new: tuple[float, ...] = ()
    later = frozenset({"new"})


class Whole(Section, frozen=True, kw_only=True):
    parts: tuple[Part, ...] = ()
    part: Part | None = None
    added: Part = Part()
    later = frozenset({"added"})


def test_later_keys_are_part_of_the_content_only_where_they_are_used() -> None:
    assert content_of(Whole(parts=(Part(), Part(old=2.0)), part=Part(new=(3.0,)))) == {
        "parts": [{"old": 1.0}, {"old": 2.0}],
        "part": {"old": 1.0, "new": [3.0]},
    }
    assert content_of(Whole(added=Part(old=5.0))) == {"parts": [], "part": None, "added": {"old": 5.0}}


def test_the_keys_that_are_later_exist() -> None:
    def check(kind: inspect.Type) -> None:
        if isinstance(kind, inspect.StructType):
            assert issubclass(kind.cls, Section)
            assert kind.cls.later <= {field.name for field in kind.fields}
            for field in kind.fields:
                check(field.type)
        elif isinstance(kind, inspect.UnionType):
            for part in kind.types:
                check(part)
        elif isinstance(kind, inspect.VarTupleType):
            check(kind.item_type)

    check(inspect.type_info(MissionConfig))
