import re
from pathlib import Path

import numpy as np
import pytest

from radron.agent.detector.files.calibration import load_calibration
from radron.agent.detector.files.t3pa import T3paReader
from radron.sim.cli import main
from radron.sim.radiation import beam
from radron.sim.radiation.events import Events
from radron.sim.radiation.hits import MAX_SLICE_PHOTONS
from radron.sim.radiation.surroundings import Lines
from radron.sim.radiation.timepix3 import Response


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr("sys.argv", ["radron-sim", "hits", *arguments])
    with pytest.raises(SystemExit) as end:
        main()
    if end.value.code:
        raise end.value


def test_a_file_of_the_expected_rate(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.t3pa"
    run(monkeypatch, "--seconds", "20", "--seed", "3", str(out))
    tick = np.sort(np.concatenate([piece.hits.tick for piece in T3paReader(out)]))
    assert tick[0] >= 0
    assert tick[-1] < 20e9 * 16 / 25
    events = 1 + np.count_nonzero(np.diff(tick) > 200)
    # 19.9 direct photons/s at 12 m (reference), x 1.29 for scatter, 1.5 background
    assert events == pytest.approx(20.0 * (19.9 * 1.29 + 1.5), rel=0.15)
    assert re.search(r"3e\+09 Bq at 12 m: 20\.\d direct and 5\.\d+ scattered", capsys.readouterr().out)
    assert [path.name for path in tmp_path.iterdir()] == ["x.t3pa"]


def test_the_same_seed_gives_the_same_file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run(monkeypatch, "--seconds", "3", "--nuclide", "Co-60", "--angle", "90", str(tmp_path / name))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_calibration_comes_with_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    run(monkeypatch, "--seconds", "1", "--calibration", str(tmp_path / "cal"), str(tmp_path / "x.t3pa"))
    load_calibration(tmp_path / "cal")
    assert np.loadtxt(tmp_path / "cal" / "a.txt").std() > 0.01


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--activity", "-1"], "--activity = -1 Bq is out of range"),
        (["--activity", "nan"], "--activity = nan Bq is out of range"),
        (["--nuclide", "Cs137"], "known are Am-241"),
        (["--distance", "0"], "--distance = 0 m is out of range"),
        (["--seconds", "-5"], "--seconds = -5 s is out of range"),
        (["--angle", "1e9"], "--angle"),
        (["--activity", "1e12", "--distance", "1"], "7.8e+07 photons would interact in the sensor; at most 1e+06 are simulated"),
    ],
)
def test_bad_input_ends_in_one_line_and_writes_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], text: str
) -> None:
    with pytest.raises(SystemExit) as end:
        run(monkeypatch, *arguments, "--calibration", str(tmp_path / "cal"), str(tmp_path / "x.t3pa"))
    assert end.value.code == 2
    message = capsys.readouterr().err
    assert text in message
    assert message.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_bright_recording_is_simulated_in_slices_of_bounded_size(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """1e15 Bq at 12 m: 1.7 million photons in the usual slice; their pixels alone take 600 MB."""
    counts: list[int] = []
    simulated = beam.simulate

    def counting(lines: Lines, interactions: int, *arguments: Response | np.random.Generator, **options: object) -> Events:
        counts.append(interactions)
        return simulated(lines, interactions, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("radron.sim.radiation.beam.simulate", counting)
    run(monkeypatch, "--activity", "1e15", "--seconds", "0.005", str(tmp_path / "x.t3pa"))
    assert max(counts[1:]) <= MAX_SLICE_PHOTONS
    assert sum(counts[1:]) == pytest.approx(8.7e6 * 0.005, rel=0.02)
    rows = len(np.loadtxt(tmp_path / "x.t3pa", skiprows=1))
    assert rows == pytest.approx(2.35e6 * 0.005, rel=0.01)  # the readout's bandwidth


def test_a_missing_folder_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        run(monkeypatch, str(tmp_path / "no" / "x.t3pa"))
    assert "create it first" in capsys.readouterr().err
