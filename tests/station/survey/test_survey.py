"""Recorded surveys: parsing, statistics, lines, and their fold by a mission's estimator."""

from __future__ import annotations

import json
import lzma
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.loading import load_mission
from radron.agent.detector.channels import energies_of
from radron.agent.errors import ConfigError
from radron.sim.radiation.camera import SourceView
from radron.sim.radiation.crystal.emulated import Ordinary, OrdinaryTruth
from radron.sim.radiation.truth import GroundTruth
from radron.station.cli import app
from radron.station.survey.check import statistics
from radron.station.survey.entries import exposures, folded, places_m
from radron.station.survey.running import summary
from radron.station.survey.table import Survey, read_survey

ENERGY = (0.0, 12.0)
CHANNELS = 128
LEDNICE = Path(__file__).parents[4] / "shared" / "survey" / "lednice.csv.xz"
MISSION = """
name = "survey"
drones = [{ id = "d1", detector = "spectrum", response = "nai-2x2", origin_m = [3.0, 4.0, 0.0] }]
[datum]
latitude_deg = 50.0
longitude_deg = 14.0
[area]
polygon_m = [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]
[fusion]
estimator = "given"
given = { schedule = [[0.0, 20.0, 20.0]] }
"""


def made(records: int = 400, seed: int = 1, *, gain: float = 0.0, empty: slice = slice(0)) -> Survey:
    """A survey of a falling continuum with a line at 662 keV of 7 %, whose place rises by the share ``gain`` over the survey."""
    rng = np.random.default_rng(seed)
    counts = np.zeros((records, CHANNELS), int)
    for number in range(records):
        continuum = rng.exponential(250.0, rng.poisson(80))
        line = (1.0 + gain * number / records) * rng.normal(661.7, 0.07 * 661.7 / 2.355, rng.poisson(20))
        counts[number] = np.histogram(np.append(continuum, line), 12.0 * np.arange(CHANNELS + 1))[0]
    counts[empty] = 0
    time_s = np.arange(records, dtype=float)
    place = np.column_stack((0.1 * time_s, np.full(records, 7.0)))
    return Survey(time_s, place, False, np.full(records, 3.0), np.ones(records), counts, ())


def write(path: Path, survey: Survey) -> Path:
    header = ",".join(["time_s", "x_m", "y_m", "height_m", "note", *(f"ch{k}" for k in range(survey.counts.shape[1]))])
    rows = (
        ",".join(map(str, [at, x, y, h, "ok", *counts]))
        for at, (x, y), h, counts in zip(survey.time_s, survey.place, survey.height_m, survey.counts.tolist(), strict=True)
    )
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_file_is_read_as_written_plain_or_compressed(tmp_path: Path) -> None:
    survey = made(20)
    plain = write(tmp_path / "a.csv", survey)
    packed = tmp_path / "a.csv.xz"
    packed.write_bytes(lzma.compress(plain.read_bytes()))
    for path in (plain, packed):
        found = read_survey(path)
        assert np.array_equal(found.counts, survey.counts)
        assert np.array_equal(found.place, survey.place)
        assert found.live_s.tolist() == [1.0] * 20
        assert not found.dropped


def test_semicolons_and_decimal_commas_as_spreadsheets_write_them(tmp_path: Path) -> None:
    survey = made(20)
    path = write(tmp_path / "a.csv", survey)
    path.write_bytes(("\ufeff" + path.read_text().replace(",", ";").replace(".", ",").replace("\n", "\r\n")).encode())
    found = read_survey(path)
    assert np.array_equal(found.counts, survey.counts)
    assert np.array_equal(found.place, survey.place)


@pytest.mark.parametrize("content", [b"\xfd7zXZ\x00 not really", b"\x00\xff\xfe\x80", b""])
def test_files_that_are_no_text_are_refused_in_one_line(tmp_path: Path, content: bytes) -> None:
    for name in ("a.csv", "a.csv.xz"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ConfigError) as caught:
            read_survey(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_bad_rows_are_dropped_and_named(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", made(20))
    lines = path.read_text().splitlines()
    lines[3] = lines[3].replace("3.0,ok", "nan,ok")
    lines[5] = lines[5] + ",1"
    lines[7] = lines[7].replace(",ok,", ",ok,-1,", 1).rsplit(",", 1)[0]
    lines[9] = lines[2]
    lines[11] = "hello" + lines[11]
    path.write_text("\n".join(lines))
    found = read_survey(path)
    assert len(found) == 15
    assert [text.split(":")[0] for text in found.dropped] == ["line 4", "line 6", "line 8", "line 10", "line 12"]
    assert "time_s does not rise" in found.dropped[3]


@pytest.mark.parametrize(
    ("header", "text"),
    [
        ("a,x_m,y_m,height_m,ch0", "no column time_s or epoch_s; name it with --time"),
        ("time_s,x_m,height_m,ch0", "no columns of a place"),
        ("time_s,x_m,y_m,ch0", "no column height_m; name it with --height"),
        ("time_s,x_m,y_m,height_m,ch0,ch2", "name them ch0, ch1, ... without gaps"),
        ("time_s,x_m,y_m,height_m,ch0", "0 usable records"),
        ("", "no column time_s"),
    ],
)
def test_unusable_files_are_refused_in_one_line(tmp_path: Path, header: str, text: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(header + "\n")
    with pytest.raises(ConfigError) as caught:
        read_survey(path)
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_statistics_of_a_sound_survey() -> None:
    found = statistics(made(), energies_of(made(3).counts.shape[1], ENERGY), 0.07)
    assert found.rate_ps == pytest.approx(100.0, rel=0.03)
    assert found.poisson_index == pytest.approx(1.0, abs=0.15)  # of 400 records: 7 %
    assert found.slow_change < 0.03
    assert not found.empty
    assert [(line.nuclide, line.energy_kev) for line in found.lines] == [("Cs-137", pytest.approx(662.0, abs=8.0))]
    assert max(found.gain) - min(found.gain) < 0.01


def test_dead_records_and_drifting_gain_are_found() -> None:
    survey = made(gain=0.04, empty=slice(100, 110))
    found = statistics(survey, energies_of(survey.counts.shape[1], ENERGY), 0.07)
    assert found.empty == tuple(range(100, 110))
    assert found.gain[-1] - found.gain[0] == pytest.approx(0.03, abs=0.008)  # between the middles of first and last quarter
    assert found.poisson_index == pytest.approx(1.0, abs=0.15)


def test_repeated_records_show_in_the_poisson_index() -> None:
    survey = made()
    survey.counts[1::2] = survey.counts[::2]
    assert statistics(survey, energies_of(survey.counts.shape[1], ENERGY), 0.07).poisson_index < 0.7


def test_summary_names_repeated_records_but_not_the_chance_of_a_few() -> None:
    edges = energies_of(made(3).counts.shape[1], ENERGY)
    assert not any("Poisson index" in line and "smoothed" in line for line in summary(statistics(made(5), edges, 0.07), ()))
    repeated = made()
    repeated.counts[1::2] = repeated.counts[::2]
    assert any("smoothed" in line for line in summary(statistics(repeated, edges, 0.07), ()))


def mission_of(folder: Path):
    path = folder / "mission.toml"
    path.write_text(MISSION)
    return load_mission(path)


def test_exposures_have_the_counts_and_places_of_the_records(tmp_path: Path) -> None:
    mission, survey = mission_of(tmp_path), made(20)
    found = list(exposures(survey, mission, "d1", DetectorConfig(kind="spectrum", energy_kev=ENERGY)))
    assert len(found) == 20
    inside = survey.counts[:, 3:].sum()  # the table begins at 30 keV, in the middle of the third channel
    assert sum(one.counts.hits for one in found) == pytest.approx(inside + 0.5 * survey.counts[:, 2].sum(), abs=65)
    assert found[10].poses[0].position_m == pytest.approx((1.0 - 3.0, 7.0 - 4.0, 3.0))
    assert all(one.end_ns - one.stamp_ns == 1_000_000_000 for one in found)
    assert all(one.flaw() is None for one in found)


def test_longitudes_and_latitudes_are_placed_by_the_datum(tmp_path: Path) -> None:
    survey = made(3)
    corners = np.array([[14.0, 50.0], [14.0, 50.001], [14.001, 50.0]])
    earth = replace(survey, place=corners, on_earth=True)
    places = places_m(earth, mission_of(tmp_path))
    assert places[0] == pytest.approx([0.0, 0.0, 3.0], abs=1e-6)
    assert places[1, 1] == pytest.approx(111.2, abs=0.3)
    assert places[2, 0] == pytest.approx(71.7, abs=0.3)


def test_survey_is_folded_by_the_estimator_of_the_mission(tmp_path: Path) -> None:
    mission = mission_of(tmp_path)
    found = list(exposures(made(40), mission, "d1", DetectorConfig(kind="spectrum", energy_kev=ENERGY)))
    estimate = folded(mission, found)
    assert estimate.exposures == 40
    assert estimate.position_m == pytest.approx((20.0, 20.0, 0.0))


def test_command_writes_the_page_and_the_numbers(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", made(gain=0.04, empty=slice(100, 110)))
    mission_of(tmp_path)
    arguments = ["survey", str(path), "--out", str(tmp_path / "out"), "--energy", "0,12"]
    result = CliRunner().invoke(app, [*arguments, "--mission", str(tmp_path / "mission.toml")])
    assert result.exit_code == 0, result.output
    assert "10 empty records, of 101 to 110" in result.output
    assert "gain drifts by" in result.output
    assert "by given from 390 exposures" in result.output or "by given from 400 exposures" in result.output
    assert (tmp_path / "out" / "survey.png").read_bytes().startswith(b"\x89PNG")
    numbers = json.loads((tmp_path / "out" / "survey.json").read_text())
    assert numbers["survey"]["records"] == 400
    assert numbers["estimate"]["estimator"] == "given"


def test_command_writes_nothing_for_a_wrong_calibration(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", made(5))
    for energy in ("x", "0,12,-1", "1", "nan,12", "0,inf"):
        result = CliRunner().invoke(app, ["survey", str(path), "--out", str(tmp_path / "out"), "--energy", energy])
        assert result.exit_code != 0
        assert isinstance(result.exception, ConfigError)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_contaminated_ground_of_a_survey_is_mapped(tmp_path: Path) -> None:
    """A patch of 20 m and 200 kBq/m2, by the simulation's transport."""
    path = tmp_path / "mission.toml"
    soil = 'estimator = "field"\nground = "soil"\n'
    path.write_text(MISSION.replace('estimator = "given"\ngiven = { schedule = [[0.0, 20.0, 20.0]] }\n', soil))
    truth = Ordinary(OrdinaryTruth(detector="nai-2x2"), ["Cs-137"], np.random.default_rng(1), 0, GroundTruth())
    points = [(x, y) for x in np.arange(11.0, 30.0, 2.0) for y in np.arange(21.0, 40.0, 2.0)]
    flown = [(x, y if (x // 10) % 2 else 50.0 - y) for x in np.arange(5.0, 50.0, 10.0) for y in np.arange(1.0, 50.0, 2.0)]
    counts = []
    for x, y in flown:
        views = [SourceView((0, 0, -1), math.dist((x, y, 3.0), (*at, 0.0)), 200e3 * 4.0, camera_m=3.0) for at in points]
        counts.append(truth.expose(0, 10**9, views, 3.0).counts)
    time_s, number = np.arange(len(flown), dtype=float), len(flown)
    survey = Survey(time_s, np.array(flown), False, np.full(number, 3.0), np.ones(number), np.array(counts), ())
    arguments = ["survey", str(write(tmp_path / "a.csv", survey)), "--out", str(tmp_path / "out"), "--energy", "0,12"]
    result = CliRunner().invoke(app, [*arguments, "--mission", str(path)])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "ground.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "out" / "survey.json").read_text())["estimate"]["contamination"]
    _, low, high = found["total_bq"]  # wide: the background is known to 30 %
    assert low < 200e3 * 400.0 < high
    assert found["highest_bqm2"][1] < 200e3 < found["highest_bqm2"][2]
    x, y, _ = found["highest_m"]
    assert 10.0 < x < 30.0
    assert 20.0 < y < 40.0


@pytest.mark.skipif(not LEDNICE.exists(), reason="the recorded survey has no licence, and is no part of the repository")
def test_real_survey_of_a_vehicle() -> None:
    """SURO, Lednice: 24 empty records from the 1,281st on, K-40 and Bi-214, a gain that drifts by 2 %."""
    survey = read_survey(LEDNICE, "rec", "laser_alt_m")
    found = statistics(survey, energies_of(survey.counts.shape[1], (-17.4, 3.1025, 2.74e-5)), 0.08)
    assert found.empty == tuple(range(1280, 1304))
    assert {line.nuclide for line in found.lines} == {"K-40", "Bi-214"}
    assert found.poisson_index == pytest.approx(1.0, abs=0.1)
    assert found.slow_change == pytest.approx(0.14, abs=0.03)
