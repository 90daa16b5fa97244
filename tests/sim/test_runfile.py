"""Files that stay intact when the process is killed."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from radron.agent.errors import ConfigError, OutputError
from radron.sim.runfile import RunFile, make_folder


def test_lines_come_back_to_the_last_bit(tmp_path: Path) -> None:
    lines = [{"a": 0.1 + 0.2, "b": None, "c": "x\ny"}, {"a": 1e-300, "b": 2, "c": "é"}]
    runs = RunFile(tmp_path / "runs.jsonl")
    for line in lines:
        runs.append(line)
    assert RunFile(tmp_path / "runs.jsonl").lines == lines
    assert (tmp_path / "runs.jsonl").read_text().count("\n") == 2


@pytest.mark.parametrize("cut", [1, 5, 9])
def test_a_torn_last_line_is_cut_off(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "runs.jsonl"
    path.write_text('{"a":1}\n{"a":23}\n'[:-cut])
    runs = RunFile(path)
    assert runs.lines == [{"a": 1}]
    runs.append({"a": 5})
    assert RunFile(path).lines == [{"a": 1}, {"a": 5}]


def test_a_damaged_line_within_is_named(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    path.write_text('{"a":1}\n{"a":\n{"a":3}\n')
    with pytest.raises(ConfigError, match=r"runs\.jsonl:2: not a run"):
        RunFile(path)


def test_sorting_replaces_the_file(tmp_path: Path) -> None:
    runs = RunFile(tmp_path / "runs.jsonl")
    for seed in (2, 0, 1):
        runs.append({"seed": seed})
    runs.sort(lambda line: line["seed"])
    assert RunFile(tmp_path / "runs.jsonl").lines == [{"seed": 0}, {"seed": 1}, {"seed": 2}]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="choose another --out"):
        make_folder(tmp_path / "file" / "out")
    with pytest.raises(ConfigError, match="choose another --out"):
        make_folder(tmp_path / "file")


def test_a_full_disk_is_told_and_the_file_can_be_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "runs.jsonl"
    runs = RunFile(path)
    runs.append({"a": 1})

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match=r"runs\.jsonl: cannot be written: No space left on device"):
        runs.append({"a": 2})
    assert RunFile(path).lines[0] == {"a": 1}


def test_a_folder_in_the_files_place_is_told(tmp_path: Path) -> None:
    (tmp_path / "runs.jsonl").mkdir()
    with pytest.raises(OutputError, match="is a folder"):
        RunFile(tmp_path / "runs.jsonl")
