"""Tables of response of ordinary detectors: shipped ones, users' files, and their place in a mission."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radron.agent.config.loading import load_mission, mission_content, read_content, without_files
from radron.agent.config.responses import ResponseTable, read_table, shipped_content, shipped_tables
from radron.agent.config.section import content_of
from radron.agent.config.writing import as_toml
from radron.agent.detector.response import Response
from radron.agent.errors import ConfigError

MISSION = """
name = "yard"
drones = [{{ id = "d1" }}, {{ id = "d2", {keys} }}]
[area]
polygon_m = [[0.0, 0.0], [50.0, 0.0], [50.0, 50.0], [0.0, 50.0]]
[fusion]
estimator = "{estimator}"
given = {{ schedule = [[0.0, 20.0, 20.0]] }}
"""
SMALL: dict[str, Any] = {
    "format": "radron-response-1",
    "name": "test",
    "kind": "spectrum",
    "edges_kev": [30.0, 300.0, 1000.0],
    "fwhm_kev2": [0.0, 3.24, 0.0],
    "energies_kev": [100.0, 1000.0],
    "angles_deg": [0.0, 90.0],
    "peak_cm2": [[4.0, 2.0], [1.0, 0.5]],
    "rest_cm2": [[[1.0, 0.0], [1.0, 0.0]], [[2.0, 3.0], [2.0, 1.0]]],
}


def table_of(name: str) -> ResponseTable:
    return read_table(shipped_content(name), name)


def mission_file(folder: Path, keys: str, estimator: str = "given") -> Path:
    path = folder / "mission.toml"
    path.write_text(MISSION.format(keys=keys, estimator=estimator))
    return path


def refused(content: dict[str, Any]) -> str:
    with pytest.raises(ConfigError) as caught:
        read_table(json.dumps(content).encode(), "mine.json")
    assert "\n" not in str(caught.value)
    return str(caught.value)


# Effective areas at 662 keV in an isotropic flux, any and full energy, of an independent Monte Carlo (contamination study);
# tolerance: X rays of the crystal and coherent scattering are treated differently, and the mean over four angles.
@pytest.mark.parametrize(
    ("name", "anything", "peak"), [("csi-1cm3", 0.289, 0.078), ("czt-1cm3", 0.345, 0.086), ("nai-2x2", 16.8, 7.8)]
)
def test_effective_areas_at_662_kev(name: str, anything: float, peak: float) -> None:
    response = Response(table_of(name))
    cosines = np.linspace(0.01, 0.99, 50)
    angles = np.degrees(np.arccos(cosines))
    line = np.array([661.657])
    assert response.areas_cm2(line, angles)[0].sum(axis=1).mean() == pytest.approx(anything, rel=0.05)
    assert response.peak_cm2(line, angles).mean() == pytest.approx(peak, rel=0.05)


def test_geiger_tube_counts_as_the_maker_states() -> None:
    """SBM-20: 60 to 70 counts per microroentgen, of 2,820 photons of 662 keV per cm2: 0.021 to 0.025 cm2. The tube's transport is
    good to about 30 %."""
    table = table_of("gm-sbm20")
    area = Response(table).areas_cm2(np.array([661.657]), np.array([90.0, 45.0, 0.0]))
    assert table.kind == "counts"
    assert area.shape == (1, 3, 1)
    assert area.mean() == pytest.approx(0.022, rel=0.35)


def test_shipped_tables() -> None:
    assert shipped_tables() == ("csi-1cm3", "czt-1cm3", "gm-sbm20", "nai-2x2")
    for name in shipped_tables():
        assert table_of(name).name == name


def test_areas_between_energies_and_angles() -> None:
    response = Response(read_table(json.dumps(SMALL).encode(), "small"))
    areas = response.areas_cm2(np.array([100.0, np.sqrt(1e5)]), np.array([0.0, 45.0, 135.0, 180.0]))
    assert areas.shape == (2, 4, 2)
    assert areas[0, 0] == pytest.approx([5.0, 0.0], abs=1e-3)
    assert areas[0, 1] == pytest.approx(areas[0, 2])  # from above as from below
    assert areas[0, 0] == pytest.approx(areas[0, 3])
    # half way in the logarithm of the energy: the continuum is the mean, the peak (2.5 cm2) lies at the photon's own energy, 316
    # keV with a FWHM of 32 keV, so that 11 % of it are below 300 keV
    assert areas[1, 0].sum() == pytest.approx(1.5 + 1.5 + 2.5, rel=1e-3)
    assert areas[1, 0, 0] == pytest.approx(1.5 + 2.5 * 0.115, rel=0.02)


def test_bad_tables_are_refused_in_one_line() -> None:
    assert "docs/ordinary.md" in refused({**SMALL, "format": "x"})
    assert "peak" in refused({**SMALL, "peak": 1})
    assert "edges_kev: does not rise" in refused({**SMALL, "edges_kev": [30.0, 30.0, 1000.0]})
    assert "peak_cm2: give 2 rows" in refused({**SMALL, "peak_cm2": [[4.0, 2.0]]})
    assert "rest_cm2: give 2 rows (energies_kev) of 2 (angles_deg) with 2 values" in refused({**SMALL, "rest_cm2": []})
    assert "angles_deg: give 0" in refused({**SMALL, "angles_deg": [0.0, 80.0]})
    assert "has one" in refused({**SMALL, "kind": "counts"})
    assert "fwhm_kev2" in refused({**SMALL, "fwhm_kev2": [0.0, 0.0, 0.0]})
    assert "no table of response" in refused({**SMALL, "energies_kev": [-1.0, 2.0]})


def test_table_is_part_of_the_mission_and_of_its_id(tmp_path: Path) -> None:
    own = tmp_path / "mine.json"
    own.write_text(json.dumps(SMALL))
    path = mission_file(tmp_path, 'detector = "spectrum", response = "mine.json"')
    mission = load_mission(path)
    found = mission.table("d2")
    assert found is not None
    assert found.channels == 2
    assert mission.table("d1") is None
    again = read_content(mission_content(mission), mission.mission_id)
    assert again.table("d2") == found
    own.write_text(json.dumps({**SMALL, "peak_cm2": [[4.0, 2.0], [1.0, 0.6]]}))
    assert load_mission(path).mission_id != mission.mission_id
    path.write_text(as_toml(without_files(mission)))
    own.write_text(json.dumps(SMALL))
    assert load_mission(path).mission_id == mission.mission_id


def test_upload_without_its_table_is_refused(tmp_path: Path) -> None:
    mission = without_files(load_mission(mission_file(tmp_path, 'detector = "spectrum", response = "nai-2x2"')))
    with pytest.raises(ConfigError, match="'nai-2x2' was not read"):
        read_content(mission_content(mission), mission.mission_id)


@pytest.mark.parametrize(
    ("keys", "estimator", "text"),
    [
        (
            'detector = "spectrum", response = "nai-2x2"',
            "bayes",
            "estimator = 'bayes' needs a Compton camera on every drone, and d2",
        ),
        ('detector = "counts", response = "gm-sbm20"', "sources", "estimator = 'sources' needs a Compton camera"),
        ('detector = "spectrum"', "given", "needs response: csi-1cm3"),
        ('response = "nai-2x2"', "given", "response is of ordinary detectors"),
        ('detector = "counts", response = "nai-2x2"', "given", "is for 'spectrum'"),
        ('detector = "spectrum", response = "none.json"', "given", "neither a file in"),
        ('detector = "spectrum", response = "../x.json"', "given", "give the bare name"),
        ('detector = "geiger"', "given", "allowed: 'counts', 'minipix', 'spectrum'"),
    ],
)
def test_unusable_detectors_of_a_mission_are_refused(tmp_path: Path, keys: str, estimator: str, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_mission(mission_file(tmp_path, keys, estimator))
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_mission_without_ordinary_detectors_keeps_its_id(tmp_path: Path) -> None:
    """Its content has no key of detectors, as before there were any."""
    content = content_of(load_mission(mission_file(tmp_path, "yaw_deg = 0.0")))
    drones = content["drones"]
    assert isinstance(drones, list)
    assert "responses" not in content
    assert all(not {"detector", "response"} & set(drone) for drone in drones)
