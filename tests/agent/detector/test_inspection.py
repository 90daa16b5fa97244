"""``radron-agent inspect``: the contents of a camera file."""

import lzma
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from radron.agent.cli import app
from radron.agent.detector.files.calibration import Calibration, load_calibration
from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.inspection import MAX_CLUSTER_PIXELS, inspect_frame, inspect_hits
from radron.agent.errors import DetectorError

HEADER = "Index\tMatrix Index\tToA\tToT\tFToA\tOverflow"


def hits(path: Path) -> Path:
    """A hit of 16 pixels each ms for 2 s, in every part of the sensor; a noisy pixel, a saturated hit, lost data of 10 ms."""
    rows = [
        (256 * (4 * (k // 64 % 64) + j // 4) + 4 * (k % 64) + j % 4, 40_000 * k, 40, 0, 0) for k in range(2000) for j in range(16)
    ]
    rows += [(77, 40_000 * k + 9_000, 30, 0, 0) for k in range(2000)] + [
        (40_000, 1_009_000, 1022, 0, 0),
        (0x75, 400_000, 0, 0, 1),
    ]
    rows.sort(key=lambda row: row[1] + (10**9 if row[-1] else 0))
    path.write_text("\n".join([HEADER, *("\t".join(map(str, (k, *row))) for k, row in enumerate(rows))]) + "\n")
    return path


def test_hits_are_told_by_pixel_cluster_and_time(tmp_path: Path) -> None:
    found = inspect_hits(T3paReader(hits(tmp_path / "hits.t3pa")), Calibration.nominal())
    assert (found.hits, found.clusters, found.saturated_hits, found.lost_rows) == (34_001, 4001, 1, 1)
    assert found.duration_s == pytest.approx(1.999225, abs=1e-6)
    assert found.live_time_s == pytest.approx(1.989225, abs=1e-6)
    assert [(pixel.column, pixel.row) for pixel in found.noisy_pixels] == [(77, 0)]
    assert found.dead_pixels is None  # most pixels had no hit at all
    assert found.sizes[1] == 2001
    assert found.sizes[16] == 2000
    assert sum(found.sizes) == found.clusters
    assert len(found.sizes) == MAX_CLUSTER_PIXELS + 1
    assert sum(found.rate) == found.hits
    assert len(found.rate) * found.rate_bin_s == pytest.approx(2.0)


def frame(path: Path, tot: np.ndarray) -> Path:
    np.savetxt(path, tot, fmt="%d")
    path.with_name(path.name + ".dsc").write_text('A000000001\n"Acq time" ("Acquisition time [s]"):\ndouble[1]\n2,500000 \n')
    return path


def test_a_saturated_frame_gives_no_energy(tmp_path: Path) -> None:
    tot = np.zeros((256, 256), int)
    tot[10:12, 10:13] = 1022
    found = inspect_frame(frame(tmp_path / "a_ToT.txt", tot), Calibration.nominal())
    assert (found.hits, found.clusters, found.saturated_hits, sum(found.spectrum)) == (6, 1, 6, 0)
    assert (found.duration_s, found.delay_ns) == (2.5, None)
    tot[100, 100] = 100
    assert sum(inspect_frame(frame(tmp_path / "a_ToT.txt", tot), Calibration.nominal()).spectrum) == 1


def test_a_frame_of_times_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DetectorError, match=r"line 1: not whole numbers; name the frame of time over threshold \(ToT\)"):
        inspect_frame(frame(tmp_path / "a_ToA.txt", np.full((256, 256), -1)), Calibration.nominal())


def test_the_command_writes_a_picture_and_all_numbers(tmp_path: Path) -> None:
    png, json = tmp_path / "page.png", tmp_path / "page.json"
    arguments = ["inspect", str(hits(tmp_path / "hits.t3pa")), "--png", str(png), "--json", str(json)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "noisy pixels" in result.output
    assert png.read_bytes().startswith(b"\x89PNG")
    assert msgspec.json.decode(json.read_bytes())["hits"] == 34_001


def test_the_command_reads_a_frame(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["inspect", str(frame(tmp_path / "a_ToT.txt", np.eye(256, dtype=int) * 50))])
    assert result.exit_code == 0, result.output
    assert "frame of time over threshold" in result.output


CAMERA = Path(__file__).parents[4] / "shared" / "camera"  # files of real cameras, which are not part of the project


@pytest.mark.skipif(not CAMERA.is_dir(), reason="the files of real cameras are not there")
def test_the_frame_of_a_real_camera_is_read_and_its_saturated_pixels_have_no_energy(tmp_path: Path) -> None:
    for name in ("MiniPIX-J05-W0130.xml", "testImg1_ToT.txt"):
        (tmp_path / name).write_bytes(lzma.decompress((CAMERA / f"{name}.xz").read_bytes()))
    (tmp_path / "testImg1_ToT.txt.dsc").write_bytes((CAMERA / "testImg1_ToT.txt.dsc").read_bytes())
    calibration = load_calibration(tmp_path / "MiniPIX-J05-W0130.xml")
    found = inspect_frame(tmp_path / "testImg1_ToT.txt", calibration)
    assert (found.hits, found.saturated_hits, found.duration_s) == (1563, 1120, 1.0)
    assert sum(np.arange(len(found.spectrum)) * found.spectrum) * 2.0 < 10_000.0  # keV: a saturated pixel has 780 keV at least
