import numpy as np
import pytest

from agent.detector.calibration import Calibration, load_calibration
from agent.errors import DetectorError


def write(folder, **matrices):
    for name, values in {"a": 1.5, "b": 30.0, "c": 80.0, "t": 2.0, **matrices}.items():
        matrix = np.broadcast_to(values, (256, 256)) if np.ndim(values) == 0 else values
        np.savetxt(folder / f"{name}.txt", matrix, fmt="%.6g")


def test_energy_is_the_inverse_of_the_time_over_threshold(tmp_path):
    rng = np.random.default_rng(3)
    matrices = {name: rng.uniform(*span, (256, 256)) for name, span in
                {"a": (1.0, 2.0), "b": (10.0, 40.0), "c": (0.0, 200.0), "t": (0.5, 3.0)}.items()}  # fmt: skip
    write(tmp_path, **matrices)
    calibration = load_calibration(tmp_path)
    index = rng.integers(0, 65536, 1000).astype(np.uint16)
    tot = rng.integers(1, 1023, 1000).astype(np.uint16)
    energy = calibration.energy_kev(index, tot)
    a, b, c, t = (matrices[name].ravel()[index] for name in "abct")
    assert (energy > t).all()
    np.testing.assert_allclose(a * energy + b - c / (energy - t), tot, atol=0.02)  # the files hold six digits


def test_lines_of_the_files_are_rows_of_the_matrix(tmp_path):
    slopes = np.full((256, 256), 2.0)
    slopes[3, 7] = 1.0
    write(tmp_path, a=slopes, b=0.0, c=0.0, t=0.0)
    calibration = load_calibration(tmp_path)
    energy = calibration.energy_kev(np.array([3 * 256 + 7, 7 * 256 + 3], np.uint16), np.array([100, 100], np.uint16))
    np.testing.assert_allclose(energy, [100.0, 50.0])


def test_the_nominal_calibration_is_usable():
    energy = Calibration.nominal().energy_kev(np.zeros(3, np.uint16), np.array([20, 100, 1000], np.uint16))
    assert (np.diff(energy) > 0).all()
    assert energy[0] > 0


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda folder: (folder / "c.txt").unlink(), r"c\.txt: cannot be read: No such file"),
        (lambda folder: (folder / "b.txt").write_text("1 2\n3 4\n"), r"b\.txt: holds 2 x 2; 256 lines of 256 numbers"),
        (lambda folder: (folder / "b.txt").write_text(""), r"b\.txt: holds nothing"),
        (lambda folder: (folder / "t.txt").write_text("pixel\n"), r"t\.txt: not a matrix of numbers"),
        (lambda folder: (folder / "t.txt").write_bytes(b"\xff\xfe\x00"), r"t\.txt: not a matrix of numbers"),
        (lambda folder: write(folder, a=-1.0), r"a\.txt: line 1, column 1: a must be above 0"),
        (lambda folder: write(folder, c=np.where(np.arange(65536).reshape(256, 256) == 515, np.nan, 1.0)),
         r"c\.txt: line 3, column 4: every value must be a finite number"),
    ],
)  # fmt: skip
def test_errors_name_the_file_and_the_place(tmp_path, spoil, expected):
    write(tmp_path)
    spoil(tmp_path)
    with pytest.raises(DetectorError, match=expected):
        load_calibration(tmp_path)


def test_a_missing_folder(tmp_path):
    with pytest.raises(DetectorError, match="no such folder"):
        load_calibration(tmp_path / "none")
