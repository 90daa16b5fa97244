from pathlib import Path

import numpy as np
import pytest

from radron.agent.detector.files.calibration import Calibration, load_calibration
from radron.agent.detector.readout import Readout
from radron.sim.radiation.calibration import MAX_TOT, PixelCalibration
from radron.sim.radiation.electronics import FLIP_COLUMN, FLIP_ROW, SWAP, Electronics
from radron.sim.radiation.timepix3 import ENERGY_STEP_KEV, PIXEL
from radron.sim.radiation.truth import CameraTruth

SECOND = 1_000_000_000


def read(
    camera: Electronics, pixels: list[tuple[int, int, int, float]], tick: int = 1000, symmetry: int = 0, end_ns: int = SECOND
) -> Readout:
    """Read out one event of (column, row, tick, energy in keV)."""
    table = np.array([(*place, round(energy / ENERGY_STEP_KEV)) for *place, energy in pixels], PIXEL)
    one = np.zeros(1, np.int64)
    return camera.read_out(0, end_ns, table, np.array([0, len(table)]), one, one + symmetry, one + tick)


@pytest.fixture
def camera() -> Electronics:
    return Electronics(CameraTruth(), np.random.default_rng(1), 0)


def test_energy_survives_tot_within_half_a_count_and_half_a_step(camera: Electronics) -> None:
    energies = np.array([4.1, 10.0, 60.0, 300.0, 600.0])
    hits = read(camera, [(k, 9, 0, energy) for k, energy in enumerate(energies)]).hits
    order = np.argsort(hits.index)
    seen = Calibration.nominal().energy_kev(hits.index[order], hits.tot[order])
    assert np.abs(seen - energies).max() < 0.5 / 1.6 + 0.5 * ENERGY_STEP_KEV


def test_tot_saturates(camera: Electronics) -> None:
    assert read(camera, [(3, 3, 0, 1000.0)]).hits.tot.tolist() == [MAX_TOT]


@pytest.mark.parametrize(
    ("symmetry", "column", "row"),
    [(0, 10, 20), (FLIP_COLUMN, 245, 20), (FLIP_ROW, 10, 235), (SWAP, 20, 10), (SWAP | FLIP_COLUMN | FLIP_ROW, 235, 245)],
)
def test_symmetries(camera: Electronics, symmetry: int, column: int, row: int) -> None:
    assert read(camera, [(10, 20, 0, 50.0)], symmetry=symmetry).hits.index.tolist() == [256 * row + column]


def test_hits_come_when_their_pulses_are_over(camera: Electronics) -> None:
    hits = read(camera, [(1, 1, 0, 400.0), (2, 1, 5, 20.0), (3, 1, 9, 60.0)]).hits
    assert hits.index.tolist() == [258, 259, 257]
    assert hits.tick.tolist() == [1005, 1009, 1000]


def test_a_busy_pixel_sees_nothing_until_its_dead_time_is_over(camera: Electronics) -> None:
    pulse = int(read(camera, [(7, 7, 0, 100.0)]).hits.tot[0])
    free = 1000 + 16 * pulse + 304  # 475 ns
    assert len(read(camera, [(7, 7, 0, 100.0)], tick=free - 1).hits) == 0
    assert len(read(camera, [(8, 7, 0, 100.0)], tick=free - 1).hits) == 1
    assert len(read(camera, [(7, 7, 0, 100.0)], tick=free).hits) == 1


def test_beyond_the_bandwidth_hits_are_lost_and_the_live_time_ends() -> None:
    camera = Electronics(CameraTruth(max_hits_per_s=1000.0), np.random.default_rng(1), 0)
    readout = read(camera, [(k, 0, k, 30.0) for k in range(200)], end_ns=SECOND // 10)
    assert (len(readout.hits), readout.lost_hits) == (100, 100)
    assert readout.live_time_s == pytest.approx(0.05)


def test_ticks_of_a_stretch() -> None:
    camera = Electronics(CameraTruth(), np.random.default_rng(1), 1000)
    assert camera.ticks(1000, 1000 + 25) == (0, 16)
    assert camera.ticks(1001, 1002) == (1, 2)


def test_calibration_files_are_what_the_agent_reads(tmp_path: Path) -> None:
    truth = CameraTruth(calibration_spread=0.05)
    camera = Electronics(truth, np.random.default_rng(2), 0)
    camera.calibration.write(tmp_path)
    known = load_calibration(tmp_path)
    assert np.std(np.loadtxt(tmp_path / "a.txt")) == pytest.approx(0.05 * 1.6, rel=0.05)
    energies = np.linspace(15.0, 500.0, 200)  # below the counter's end in every pixel
    hits = read(camera, [(k, k, 0, energy) for k, energy in enumerate(energies)]).hits
    order = np.argsort(hits.index)
    seen = known.energy_kev(hits.index[order], hits.tot[order])
    assert np.abs(seen - energies).max() < 0.6
    wrong = Calibration.nominal().energy_kev(hits.index[order], hits.tot[order])
    assert np.abs(wrong / energies - 1.0).mean() > 0.02


def test_calibration_error_is_not_in_the_files() -> None:
    drawn = PixelCalibration.draw(CameraTruth(calibration_error=0.03), np.random.default_rng(3))
    assert np.ptp(drawn.a) == 0.0
    assert np.std(drawn.true_a / drawn.a) == pytest.approx(0.03, rel=0.05)
