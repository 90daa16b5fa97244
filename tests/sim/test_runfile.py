"""Files that survive being killed."""

from __future__ import annotations

from pathlib import Path

import pytest

from agent.errors import ConfigError
from sim.runfile import RunFile, make_folder, replacing, write_text


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


def test_a_file_is_written_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    write_text(path, "old")

    def fail_half_way() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half of the n")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail_half_way()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["map.png"]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="choose another --out"):
        make_folder(tmp_path / "file" / "out")
    with pytest.raises(ConfigError, match="choose another --out"):
        make_folder(tmp_path / "file")
