import lzma
from base64 import b64encode
from pathlib import Path

import numpy as np
import pytest

from radron.agent.detector.files.calibration import Calibration, bad_pixels, load_calibration, load_flight_calibration
from radron.agent.errors import DetectorError


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
    write(tmp_path, a=slopes, b=10.0, c=0.0, t=0.0)
    calibration = load_calibration(tmp_path)
    energy = calibration.energy_kev(np.array([3 * 256 + 7, 7 * 256 + 3], np.uint16), np.array([110, 110], np.uint16))
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
        (lambda folder: write(folder, a=-1.0), r"65,536 of 65,536 pixels are masked or have no energy .*; at most 20% may"),
        (lambda folder: write(folder, c=np.where(np.arange(65536).reshape(256, 256) % 4 == 0, np.nan, 1.0)), r"16,384 of 65,536"),
    ],
)  # fmt: skip
def test_errors_name_the_file_and_the_place(tmp_path, spoil, expected):
    write(tmp_path)
    spoil(tmp_path)
    with pytest.raises(DetectorError, match=expected):
        load_calibration(tmp_path)


def test_a_missing_folder(tmp_path):
    with pytest.raises(DetectorError, match="no such file or folder"):
        load_calibration(tmp_path / "none")


def test_a_pixel_is_bad_whose_time_over_threshold_is_not_finite_and_rising():
    a, b, c, t = (np.array(values, float) for values in zip(
        (1.6, 24.0, 60.0, 1.8),  # as usual
        (1.6, 24.0, 0.0, 1.8),  # a straight line
        (1.6, 0.0, 0.0, 0.0),  # not calibrated
        (1.6, 24.0, -100.0, 1.8),  # rises from 9.7 keV on
        (1.6, 24.0, -110.0, 1.8),  # falls until 10.1 keV
        (0.0, 24.0, 60.0, 1.8),
        (1.6, np.inf, 60.0, 1.8),
        (1.6, 24.0, 60.0, 12.0),  # no energy below 12 keV
        strict=True,
    ))  # fmt: skip
    assert bad_pixels(a, b, c, t).tolist() == [False, False, True, False, True, True, True, True]


def test_the_hits_of_a_bad_pixel_have_no_energy_and_the_share_of_good_ones_is_known(tmp_path):
    write(tmp_path, c=np.where(np.arange(65536).reshape(256, 256) == 515, -1000.0, 1.0))
    calibration = load_calibration(tmp_path)
    energy = calibration.energy_kev(np.array([514, 515], np.uint16), np.array([100, 100], np.uint16))
    assert np.isfinite(energy).tolist() == [True, False]
    assert calibration.bad_pixels == 1
    assert calibration.good_share == 1.0 - 1.0 / 65536


def xml(path, thickness="2000", chips=1, bias="-500", **constants):
    """A configuration as Pixet writes it, with the same constants for every pixel and the first one masked."""
    values = {"a": 1.5, "b": 30.0, "c": 80.0, "t": 2.0, **constants}
    binary = {f"calib{name}": np.full(65536, value, "<f8").tobytes() for name, value in values.items()}
    binary["BinaryPixelCfg"] = bytes([0x41]) + bytes([0x54]) * 65535
    inner = "".join(f"<{name}>{b64encode(data).decode()}</{name}>" for name, data in binary.items())
    section = f"<SensorThickness>{thickness}</SensorThickness>{inner}"
    body = "".join(f"<J05-W013{k}>{section}</J05-W013{k}>" for k in range(chips))
    path.write_text(f"<?xml version='1.0' encoding='UTF-8'?><xml><Settings><Bias>{bias}</Bias></Settings>{body}</xml>")
    return path


def test_the_configuration_of_pixet_is_a_calibration(tmp_path):
    calibration = load_calibration(xml(tmp_path / "camera.xml"))
    write(tmp_path)
    index, tot = np.arange(1, 101, dtype=np.uint16), np.full(100, 77, np.uint16)
    np.testing.assert_allclose(calibration.energy_kev(index, tot), load_calibration(tmp_path).energy_kev(index, tot))
    assert calibration.bad_pixels == 1
    assert np.isnan(calibration.energy_kev(np.zeros(1, np.uint16), np.array([77], np.uint16)))[0]


@pytest.mark.parametrize(
    ("thickness", "bias", "drift_ns"), [("2000", "-450", 86.0), ("2000", "-300", 129.0), ("1000", "500", 19.35)]
)
def test_bias_and_thickness_of_a_configuration_give_the_drift_time(tmp_path, thickness, bias, drift_ns):
    """d^2 / (mobility x bias), with 1,034 cm2/(V s)."""
    assert load_calibration(xml(tmp_path / "camera.xml", thickness, bias=bias)).drift_ns == pytest.approx(drift_ns)


@pytest.mark.parametrize("bias", ["", "none", "0", "nan", "-20000"])
def test_a_configuration_without_a_usable_bias_is_refused(tmp_path, bias):
    with pytest.raises(DetectorError, match=r"Settings/Bias: .* is not a bias voltage of 4 to 1000 V"):
        load_calibration(xml(tmp_path / "camera.xml", bias=bias))


def test_a_sensor_of_another_thickness_is_read_but_does_not_fly(tmp_path):
    path = xml(tmp_path / "camera.xml", thickness="1000")
    assert load_calibration(path).thickness_mm == 1.0
    with pytest.raises(DetectorError, match="a sensor of 1 mm; the estimators know the response of 2 mm only"):
        load_flight_calibration(path)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("<xml><chip/></xml>", "no chip with a calibration"),
        ("<xml><chip><caliba>AAAA</caliba></chip></xml>", r"chip/caliba: holds 3 bytes, 524,288 are needed"),
        ("1 2 3", "neither a folder nor an XML file of Pixet"),
    ],
)
def test_other_files_are_no_configuration_of_pixet(tmp_path, content, expected):
    path = tmp_path / "camera.xml"
    path.write_text(content)
    with pytest.raises(DetectorError, match=expected):
        load_calibration(path)


def test_a_configuration_of_several_chips_is_refused(tmp_path):
    with pytest.raises(DetectorError, match="2 chips, and a camera has one"):
        load_calibration(xml(tmp_path / "camera.xml", chips=2))


CAMERA = Path(__file__).parents[5] / "shared" / "camera"  # files of real cameras, which are not part of the project


@pytest.mark.skipif(not CAMERA.is_dir(), reason="the files of real cameras are not there")
def test_the_configuration_of_a_real_camera_is_read(tmp_path):
    """45 pixels are masked; of 18 pixels without b, c and t one is not masked."""
    path = tmp_path / "camera.xml"
    path.write_bytes(lzma.decompress((CAMERA / "MiniPIX-J05-W0130.xml.xz").read_bytes()))
    calibration = load_calibration(path)
    assert (calibration.bad_pixels, calibration.thickness_mm, calibration.drift_ns) == (46, 1.0, pytest.approx(19.35))
    index = np.arange(65536, dtype=np.uint16)
    energy = calibration.energy_kev(index, np.full(65536, 200, np.uint16))
    assert np.nanmedian(energy) == pytest.approx((200 - 6.07) / 1.29, rel=0.02)
