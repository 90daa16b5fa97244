import csv
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from radron.agent.cli import main
from radron.agent.detector.analysis import CSV_COLUMNS, find_peak


@pytest.fixture
def measurement(tmp_path, make_compton_event, make_hits, blob):
    """A file of coincidences from a source at 53 degrees and of full-energy events."""
    rng = np.random.default_rng(5)
    blobs, time = [], 1000.0
    for _ in range(400):
        blobs += make_compton_event(rng, (0.8, 0.0, 0.6), time) or [
            blob(time, (*rng.uniform(-6, 6, 2), 1.0), rng.normal(661.66, 10.0), 15)
        ]
        time += 50_000.0
    return write(tmp_path / "measured.t3pa", make_hits(blobs))


def write(path, hits):
    toa = -(-hits.tick // 16)
    with path.open("w") as file:
        file.write("Index\tMatrix Index\tToA\tToT\tFToA\tOverflow\n")
        for number, row in enumerate(zip(hits.index, toa, hits.tot, 16 * toa - hits.tick, strict=True)):
            file.write("\t".join(map(str, (number, *row, 0))) + "\n")
    return path


@pytest.fixture
def run(monkeypatch, capsys):
    """The command in this process: exit code, output, error output."""

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["radron-agent", "cones", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return SimpleNamespace(returncode=ended.value.code or 0, stdout=said.out, stderr=said.err)

    return run


def test_a_file_becomes_a_table_of_cones(measurement, run):
    out = measurement.with_name("cones.csv")
    done = run(measurement, "--csv", out, "--nuclide", "Cs-137")
    assert done.returncode == 0, done.stderr
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == CSV_COLUMNS
    assert len(rows) > 50
    assert f"{len(rows)} cones" in done.stdout
    assert "661.66 keV" in done.stdout
    assert "noisy" not in done.stdout
    for row in rows:
        axis = [float(row[f"axis_{name}"]) for name in "xyz"]
        assert np.linalg.norm(axis) == pytest.approx(1.0, abs=1e-4)
        assert float(row["energy_1_kev"]) + float(row["energy_2_kev"]) == pytest.approx(661.66, abs=0.1)
        assert float(row["probability_1"]) + float(row["probability_2"]) == pytest.approx(1.0, abs=1e-4)
    polar = float(done.stdout.split("single far source")[1].split("deg")[0].strip(" │|"))
    assert polar == pytest.approx(np.rad2deg(np.arccos(0.6)), abs=3.0)
    stamps = [int(row["stamp_ns"]) for row in rows]
    assert stamps == sorted(stamps)


def test_hits_of_a_noisy_pixel_are_left_out_and_told_of(tmp_path, make_hits, blob, run):
    """Two of three hits are in the same place, 20 a second."""
    blobs = [blob(k * 5e7, (1.0, 1.0, 0.0) if k % 3 else (0.1 * (k % 60) - 3.0, -2.0, 0.0), 100.0, 1) for k in range(1, 200)]
    done = run(write(tmp_path / "noisy.t3pa", make_hits(blobs)), "--csv", tmp_path / "cones.csv", "--nuclide", "Cs-137")
    assert done.returncode == 0, done.stderr
    noisy = int(done.stdout.split("of noisy pixels")[1].split()[1])
    assert 100 < noisy < 133


def test_the_nuclide_is_taken_from_the_spectrum(measurement, run):
    named, found = measurement.with_name("named.csv"), measurement.with_name("found.csv")
    assert run(measurement, "--csv", named, "--nuclide", "Cs-137").returncode == 0
    done = run(measurement, "--csv", found, "--nuclide", "auto")
    assert done.returncode == 0, done.stderr
    assert "measured.t3pa, Cs-137" in done.stdout
    assert found.read_bytes() == named.read_bytes()


def test_a_nuclide_that_the_spectrum_contradicts_is_said(measurement, run):
    done = run(measurement, "--csv", measurement.with_name("cones.csv"), "--nuclide", "I-131")
    assert done.returncode == 0, done.stderr
    assert "Cs-137, not I-131" in done.stdout


def test_where_no_nuclide_stands_out_one_must_be_named(tmp_path, make_hits, blob, run):
    rng = np.random.default_rng(6)
    blobs = [blob(50_000.0 * n, (*rng.uniform(-6, 6, 2), 1.0), rng.uniform(60.0, 900.0), 15) for n in range(1, 200)]
    done = run(write(tmp_path / "flat.t3pa", make_hits(blobs)), "--csv", tmp_path / "cones.csv", "--nuclide", "auto")
    assert done.returncode == 2
    assert "no nuclide stands out among" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "cones.csv").exists()


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda path: (path, "--nuclide", "Cs137"), "nuclide 'Cs137' is not known; known: "),
        (lambda path: (path.with_name("none.t3pa"),), "none.t3pa: cannot be read: No such file"),
        (lambda path: (path, "--calibration", path.parent), "a.txt: cannot be read: No such file"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(measurement, change, expected, run):
    out = measurement.with_name("cones.csv")
    done = run(*change(measurement), "--csv", out)
    assert done.returncode == 2
    assert expected in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert [path.name for path in measurement.parent.iterdir()] == [measurement.name]


def test_a_csv_that_cannot_be_written(measurement, run):
    done = run(measurement, "--csv", measurement.parent / "none" / "cones.csv")
    assert done.returncode == 2
    assert "none does not exist; create it first" in done.stderr


def test_the_recording_is_never_overwritten(measurement, run):
    before = measurement.read_bytes()
    link = measurement.with_name("link.csv")
    link.hardlink_to(measurement)
    for out in (measurement, link):
        done = run(measurement, "--csv", out)
        assert done.returncode == 2
        assert "is the input" in done.stderr
    assert measurement.read_bytes() == before


def test_an_interrupted_recording_is_used_and_told(measurement, run):
    done = run(cut(measurement), "--csv", measurement.with_name("cones.csv"))
    assert done.returncode == 0
    assert "ends in the middle of a row, which was left out" in done.stderr
    assert measurement.with_name("cones.csv").exists()


def cut(path):
    path.write_bytes(path.read_bytes()[:-4])
    return path


def test_a_peak_is_found_over_a_slope():
    rng = np.random.default_rng(2)
    energies = np.concatenate((rng.normal(640.0, 12.0, 3000), rng.uniform(0.0, 900.0, 3000)))
    spectrum = np.bincount((energies / 2.0).astype(int), minlength=1000)
    peak = find_peak(spectrum, (661.66,))
    assert peak is not None
    assert peak.centre_kev == pytest.approx(640.0, abs=2.0)
    assert peak.fwhm_kev == pytest.approx(2.355 * 12.0, rel=0.15)
    assert find_peak(np.zeros(1000, np.int64), (661.66,)) is None
