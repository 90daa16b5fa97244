"""Common rules of all commands: one line for an error, on any terminal, with or without a home directory."""

import io
import os
import sys
from pathlib import Path

import pytest

from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.errors import ConfigError, OutputError
from radron.agent.flight.reader import RecordedFlight
from radron.agent.inputs import read_text
from radron.agent.outputs import cache_folder, check_output
from radron.agent.terminal import run_command


def ascii_terminal(monkeypatch):
    """Standard output and error of a terminal that knows ASCII only, as with PYTHONIOENCODING=ascii."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="ascii", write_through=True) for _ in range(2)]
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    return streams


def test_letters_that_the_terminal_lacks_are_escaped(monkeypatch):
    out, err = ascii_terminal(monkeypatch)

    def command():
        print("5 µSv/h at Große Straße")
        raise ConfigError("Übung.toml: cannot be read")

    with pytest.raises(SystemExit) as ended:
        run_command("radron-agent", command)
    assert ended.value.code == 2
    assert out.buffer.getvalue() == b"5 \\xb5Sv/h at Gro\\xdfe Stra\\xdfe\n"
    assert err.buffer.getvalue() == b"radron-agent: \\xdcbung.toml: cannot be read\n"


def test_a_file_name_that_is_no_text_is_escaped(monkeypatch):
    out, _ = ascii_terminal(monkeypatch)
    run_command("radron-agent", lambda: print(os.fsdecode(b"caf\xe9.mcap")))
    assert out.buffer.getvalue() == b"caf\\udce9.mcap\n"


def test_an_error_of_the_disk_is_one_line(capsys):
    with pytest.raises(SystemExit) as ended:
        run_command("radron-sim", lambda: Path("/nowhere/at/all").read_bytes())
    assert ended.value.code == 2
    assert capsys.readouterr().err == "radron-sim: /nowhere/at/all: No such file or directory\n"


def test_without_a_home_directory_the_cache_is_a_folder_of_this_user(monkeypatch):
    def nowhere():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nowhere)
    assert cache_folder().name == f"radron-{os.getuid()}"
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/cache")
    assert cache_folder() == Path("/var/cache/radron")


def test_standard_output_as_a_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match=r"^-: standard output is not supported; give the name of a file$"):
        check_output(Path("-"))
    assert list(tmp_path.iterdir()) == []


def test_a_pipe_is_refused_where_a_file_is_read_twice(tmp_path):
    """Without opening it: that would wait for its writer for ever."""
    os.mkfifo(tmp_path / "pipe")
    for read in (RecordedFlight, T3paReader):
        with pytest.raises(ConfigError, match="pipe: is a pipe or a device, which can be read only once; save it to a file"):
            read(tmp_path / "pipe")
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


def test_text_of_another_encoding_is_told_without_the_file(tmp_path):
    (tmp_path / "latin.toml").write_bytes(b"name = 'M\xfcller'" + b"x" * 100_000)
    with pytest.raises(ValueError, match=r"^not UTF-8: invalid start byte at byte 9$"):
        read_text(tmp_path / "latin.toml")
