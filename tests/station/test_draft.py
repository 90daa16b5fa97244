"""A mission as a page edits it, checked as the drones check theirs."""

import tomllib

import msgspec
import pytest
from msgspec.structs import replace

from radron.agent.config.loading import convert, load_mission
from radron.agent.config.mission import AreaConfig, DroneInMission, GroundConfig, MissionConfig
from radron.station.draft import AREA, KEYS, LAUNCHES, Draft, drafted, editor, told

MISSION = MissionConfig(
    name="yard",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0), (0.0, 40.0))),
    drones=(DroneInMission(id="d1", origin_m=(10.0, 2.0, 0.5)), DroneInMission(id="d2", origin_m=(20.0, 2.0, 0.0))),
)


def draft(**values):
    """The mission unchanged, but for these; ``__`` for the dot in a key."""
    now = editor(MISSION)
    area, launches = values.pop("area", MISSION.area.polygon_m), values.pop("launches", now.launches)
    changed = {key.replace("__", "."): value for key, value in values.items()}
    return Draft(area=area, launches=launches, values={**{field.key: field.value for field in now.fields}, **changed})


def test_what_is_not_changed_stays_bit_for_bit():
    assert drafted(MISSION, draft()) == MISSION
    assert drafted(MISSION, draft()).mission_id == MISSION.mission_id


def test_the_changed_mission_is_a_mission_file_that_the_drones_load(tmp_path):
    corners = ((0.0, 0.0), (50.0, 5.0), (30.0, 50.0))
    changed = draft(area=corners, launches={"d1": (12.0, 3.0, 90.0)}, survey__height_m=5, survey__duration_s=600.0)
    mission = drafted(MISSION, changed)
    answer = told(mission, 7)
    assert (answer.number, answer.id, answer.flaws) == (7, mission.mission_id, ())
    assert min(x for x, _ in answer.fence) == pytest.approx(-30.0, abs=0.1)
    (tmp_path / "mission.toml").write_text(answer.file)
    loaded = load_mission(tmp_path / "mission.toml")
    assert loaded.mission_id == mission.mission_id
    assert loaded.area.polygon_m == corners
    assert (loaded.drones[0].origin_m, loaded.drones[0].yaw_deg) == ((12.0, 3.0, 0.5), 90.0)
    assert loaded.drones[1] == MISSION.drones[1]
    assert loaded.survey.height_m == 5.0


@pytest.mark.parametrize(
    ("changes", "field", "says"),
    [
        ({"survey__height_m": 100.0}, "survey.height_m", "outside area.floor_m .. area.ceiling_m (1.5 .. 60)"),
        ({"survey__height_m": None}, "survey.height_m", "a value is needed"),
        ({"survey__least_activity_bq": None}, "survey.least_activity_bq", "a value is needed"),  # TOML cannot say "none"
        ({"survey__then": "dive"}, "survey.then", "allowed: 'continue', 'return'"),
        ({"area__floor_m": -1.0}, "area.floor_m", "`float` >= 0.0"),
        ({"area__floor_m": 70.0}, "area.floor_m", "must be below area.ceiling_m"),
        ({"nuclide": "Zz-1"}, "nuclide", "it knows Cs-137"),
        ({"name": 3.0}, "name", "expected `str`"),
        ({"area": ((0.0, 0.0), (10.0, 10.0), (0.0, 10.0), (10.0, 0.0))}, AREA, "Self-intersection"),
        ({"area": ((0.0, 0.0), (10.0, 0.0))}, AREA, "length >= 3"),
        ({"launches": {"d1": (500.0, 0.0, 0.0)}}, LAUNCHES, "the launch place of d1 is"),
        ({"launches": {"d1": (21.0, 2.0, 0.0)}}, LAUNCHES, "d1 and d2 are launched 1.0 m apart"),
        ({"fusion__estimator": "mine"}, "", "unknown key 'fusion.estimator'"),
    ],
)
def test_what_is_wrong_is_told_beside_its_field(changes, field, says):
    (flaw,) = drafted(MISSION, draft(**changes))
    assert flaw.field == field
    assert says in flaw.text
    assert "\n" not in flaw.text


def test_each_field_has_its_own_flaw():
    flaws = drafted(MISSION, draft(survey__height_m=-1.0, limits__speed_mps=0.0, area=((0.0, 0.0),)))
    assert {flaw.field for flaw in flaws} == {"survey.height_m", "limits.speed_mps", AREA}


def test_the_form_offers_what_the_mission_file_allows():
    fields = {field.key: field for field in editor(MISSION).fields}
    assert tuple(fields) == KEYS
    assert fields["survey.then"].choices == ("return", "continue")
    assert fields["fusion.ground"].choices == ("none", "soil")
    assert (fields["survey.duration_s"].optional, fields["survey.height_m"].optional) == (True, False)
    assert fields["survey.height_m"].number
    assert not fields["name"].number


def test_an_elevation_grid_is_kept_and_stays_in_its_own_file():
    grid = b"ncols 2\nnrows 2\nxllcorner -100\nyllcorner -100\ncellsize 250\n1 1\n1 1\n"
    hilly = replace(MISSION, ground=GroundConfig(grid="hill.asc", grid_data=grid))
    changed = drafted(hilly, draft(survey__height_m=5.0))
    assert changed.ground == hilly.ground
    file = tomllib.loads(told(changed, 0).file)
    assert file["ground"]["grid"] == "hill.asc"
    assert "grid_data" not in file["ground"]


def test_a_draft_that_no_page_writes_is_refused():
    assert convert(msgspec.to_builtins(draft()), Draft, "draft") == draft()
    for wrong in (
        {"area": [[0.0, 0.0]] * 257},
        {"launches": {"D 1": [0.0, 0.0, 0.0]}},
        {"values": {"name": "x" * 201}},
        {"more": 1},
    ):
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert({**msgspec.to_builtins(draft()), **wrong}, Draft)
