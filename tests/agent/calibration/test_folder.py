"""A flight can load a calibration from its folder, and the history grows."""

from pathlib import Path

import numpy as np
import pytest

from radron.agent.calibration.command import closing
from radron.agent.calibration.depth import Drift
from radron.agent.calibration.folder import check_folder, corrected
from radron.agent.calibration.gain import Gain
from radron.agent.calibration.orientation import Orientation
from radron.agent.calibration.page import verdict
from radron.agent.calibration.result import Background, Result, goals, judge_pixels
from radron.agent.detector.files.calibration import Calibration, load_calibration, load_flight_calibration, write_calibration
from radron.agent.errors import DetectorError, OutputError


def result_of(**changes):
    values = {
        "stamp": "20260101T000000Z", "nuclide": "Cs-137", "activity_bq": 1e7, "distance_m": 0.5, "facings": (), "live_s": 1500.0,
        "events": 90_000, "gain": Gain(1.05, 0.004, 6000.0), "blocks": (Gain(1.05, 0.01, 400.0),) * 16,
        "drift": Drift(90.0, 3.0, 2000), "walk_ns": (1.0, 0.1), "orientation": None, "noisy_pixels": (7,),
        "dead_pixels": (9, 300), "background": Background(1.5, 0.07, 300.0),
    }  # fmt: skip
    return Result(**(values | changes))


def test_what_is_written_reads_true_energies_without_the_bad_pixels(tmp_path):
    blocks = tuple(Gain(0.9 + 0.01 * k, 0.01, 400.0) for k in range(16))
    write_calibration(tmp_path, corrected(Calibration.nominal(), result_of(blocks=blocks)))
    found = load_flight_calibration(tmp_path)
    assert found.bad_pixels == 3
    assert found.drift_ns == pytest.approx(90.0)
    index = np.array([7, 9, 300, 0, 255, 65535], np.uint16)
    tot = np.round(1.6 * 200.0 + 24.0 - 60.0 / (200.0 - 1.8)) + np.zeros(6)
    seen = found.energy_kev(index, tot.astype(np.uint16))
    assert np.isnan(seen[:3]).all()
    np.testing.assert_allclose(seen[3:] * (0.9, 0.93, 1.05), 200.0, rtol=0.01)


def test_a_drift_time_that_is_none_is_refused(tmp_path):
    write_calibration(tmp_path, Calibration.nominal())
    assert load_calibration(tmp_path).drift_ns == pytest.approx(86.0)
    (tmp_path / "drift.txt").write_text("soon\n")
    with pytest.raises(DetectorError, match=r"drift\.txt: not a drift time"):
        load_calibration(tmp_path)


def test_the_verdict_names_what_is_missing():
    missed = [goal.name for goal in goals(result_of(gain=Gain(1.05, 0.02, 90.0), dead_pixels=None)) if not goal.reached]
    assert missed == ["gain", "orientation", "pixels"]
    assert verdict(result_of(background=None)) == "not usable: orientation, background"


def test_pixels_are_judged_by_their_hits():
    pixels = np.random.default_rng(1).poisson(12.0, 65536)
    pixels[[5, 70]] = 0
    pixels[900] = 5000
    noisy, dead = judge_pixels(pixels)
    assert noisy == (900,)
    assert {5, 70} <= set(dead)
    assert len(dead) <= 6  # of healthy ones 0.4 are expected
    assert judge_pixels(np.random.default_rng(1).poisson(2.0, 65536))[1] is None


def test_a_folder_that_cannot_be_written_is_refused_before_the_measurement(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written to"):
        check_folder(tmp_path / "file" / "below")
    check_folder(tmp_path / "new")
    assert list((tmp_path / "new").iterdir()) == []


def test_a_block_without_a_live_pixel_needs_no_gain_of_its_own():
    index = np.arange(65536)
    dead = tuple(index[(index // 256 < 64) & (index % 256 >= 192)].tolist())  # the first row's last block
    blocks = tuple(None if block == 3 else Gain(1.05, 0.01, 400.0) for block in range(16))
    missed = [goal.name for goal in goals(result_of(blocks=blocks, dead_pixels=dead)) if not goal.reached]
    assert "gain by block" not in missed
    missed = [goal.name for goal in goals(result_of(blocks=blocks, dead_pixels=dead[1:])) if not goal.reached]
    assert "gain by block" in missed


def test_the_missions_background_is_that_of_a_sensor_without_bad_pixels():
    """Over the live time that a flight gives its counts, which is shorter by the share of the masked pixels."""
    dead = tuple(range(13107))
    found = result_of(dead_pixels=dead, noisy_pixels=(7, 60000), background=Background(1.2, 0.06, 300.0))
    share = corrected(Calibration.nominal(), found).good_share
    assert found.background_per_s == pytest.approx(1.2 / share)
    assert result_of(background=None).background_per_s is None


def test_the_command_closes_with_the_lines_of_both_files():
    found = result_of(
        dead_pixels=(), noisy_pixels=(), orientation=Orientation((90.0, 0.5, 97.6), (0.0, 7.6, 0.0), (0.4,) * 3, (600,) * 3)
    )
    assert closing(found, Path("cameras/H09/20260101T000000Z")).splitlines() == [
        "in the drone file:",
        "camera_rpy_deg = [90.0, 0.5, 97.6]",
        'calibration = "cameras/H09/20260101T000000Z"',
        "in the mission file, where it is flown here:",
        "[fusion.bayes]",
        "background_per_s = 1.50",
    ]
