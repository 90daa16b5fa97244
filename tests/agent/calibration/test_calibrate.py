"""Calibrations of simulated cameras; their truth shares no code with the fits."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from radron.agent.calibration.folder import corrected
from radron.agent.calibration.plan import Source
from radron.agent.calibration.result import evaluate
from radron.agent.cli import app
from radron.agent.detector.files.calibration import Calibration
from radron.sim.radiation.t3pa import T3paWriter
from support.sensors.calibrated_camera import ACTIVITY_BQ, DISTANCE_M, FACINGS, RPY_DEG, BenchCamera

SOURCE = Source("Cs-137", ACTIVITY_BQ, DISTANCE_M)


def pulls(seed):
    """Errors over their stated sigmas: gain, 16 blocks, drift time, three angles."""
    camera = BenchCamera.draw(seed)
    found = evaluate(camera.collected(130.0), SOURCE, FACINGS, RPY_DEG, None, "20260101T000000Z")
    blocks = [(block.value - gain) / block.sigma for block, gain in zip(found.blocks, camera.gains, strict=True)]
    turned = np.array(found.orientation.turned_deg) - np.rad2deg(camera.turned_rad)
    return {
        "gain": [(found.gain.value - camera.gains.mean()) / found.gain.sigma],
        "blocks": blocks,
        "drift": [(found.drift.drift_ns - camera.drift_ns) / found.drift.sigma_ns],
        "orientation": (turned / found.orientation.sigma_deg).tolist(),
    }


@pytest.mark.slow
def test_a_camera_of_unknown_gain_drift_time_and_orientation_is_found():
    """Within 3 stated sigmas; blocks within 4, as there are 16."""
    found = pulls(3)
    for name, limit in (("gain", 3.0), ("blocks", 4.0), ("drift", 3.0), ("orientation", 3.0)):
        assert max(map(abs, found[name])) < limit, (name, found[name])


@pytest.mark.slow
def test_a_calibrated_camera_needs_no_other_calibration():
    camera = BenchCamera.draw(3)
    collection = camera.collected(60.0)
    found = evaluate(collection, SOURCE, FACINGS, RPY_DEG, None, "20260101T000000Z")
    calibration = corrected(Calibration.nominal(), found)
    again = evaluate(
        camera.collected(60.0, calibration), SOURCE, FACINGS, found.orientation.camera_rpy_deg, None, "20260101T010000Z"
    )
    assert abs(found.gain.value - 1.0) > 0.02
    assert again.gain.value == pytest.approx(1.0, abs=0.005)
    assert np.std([block.value for block in again.blocks]) < 0.5 * np.std([block.value for block in found.blocks])
    assert np.abs(again.orientation.turned_deg).max() < 0.5
    assert calibration.drift_ns == pytest.approx(camera.drift_ns, rel=0.1)


@pytest.mark.long
def test_stated_sigmas_cover_the_truth():
    """Of 40 cameras, 95 % of all values are to be within 2 sigma; chance leaves less than 85 % of 40 in one of 300 cases."""
    found = [pulls(seed) for seed in range(40)]
    for name in found[0]:
        within = np.mean([abs(pull) <= 2.0 for one in found for pull in one[name]])
        assert within >= 0.85, (name, within)


@pytest.fixture
def recordings(tmp_path):
    camera = BenchCamera.draw(5)
    files = []
    for place, facing in enumerate(FACINGS):
        files.append(tmp_path / f"{place}.t3pa")
        with files[-1].open("w") as file:
            writer = T3paWriter(file)
            for readout in camera.readouts(place, facing, 12.0):
                writer.write(readout)
    return files


@pytest.mark.slow
def test_the_command_says_what_is_missing_and_keeps_the_record(tmp_path, recordings):
    (tmp_path / "drone.toml").write_text('id = "d1"\n')
    places = [f"{facing.bearing_deg:g},{facing.elevation_deg:g}" for facing in FACINGS]
    facings = [text for place, file in zip(places, recordings, strict=True) for text in ("--facing", f"{place}={file}")]
    command = ["calibrate", "--config", str(tmp_path / "drone.toml"), "--activity", "1e7", "--distance", "0.5"]
    command += ["--out", str(tmp_path / "H07"), "--background", str(recordings[0]), *facings]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 1, done.output
    assert "not usable: " in done.output
    (own,) = [path for path in (tmp_path / "H07").iterdir() if path.is_dir()]
    report = json.loads((own / "result.json").read_text())
    missed = {goal["name"] for goal in report["goals"] if not goal["reached"]}
    assert {"gain by block", "orientation", "pixels"} <= missed
    assert {path.name for path in own.iterdir()} >= {"a.txt", "b.txt", "c.txt", "t.txt", "drift.txt", "result.json"}
    with (tmp_path / "H07" / "history.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["stamp"] == own.name
    assert row["verdict"].startswith("not usable")
