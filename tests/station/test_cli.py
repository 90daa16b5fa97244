"""Refusals of the commands for Foxglove and TAK, in one line and before anything is begun."""

import importlib.util
import json
import os
import subprocess
import sys

import pytest
from websockets.sync.client import connect

import radron.station.cli

MISSION = """
name = "m"
[area]
polygon_m = [[0.0, 0.0], [60.0, 0.0], [60.0, 40.0]]
[[drones]]
id = "d1"
"""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a command that is refused, and return its message."""
    (tmp_path / "mission.toml").write_text(MISSION)
    monkeypatch.chdir(tmp_path)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "1")  # else the command sets them for the tests that follow, too

    def run(*words):
        monkeypatch.setattr("sys.argv", ["radron-station", *words])
        with pytest.raises(SystemExit) as end:
            radron.station.cli.main()
        said = capsys.readouterr().err
        assert (end.value.code, said.count("\n")) == (2, 1)
        return said

    return run


SERVE = ("serve", "mission.toml", "--connect", "tcp/127.0.0.1:9", "--insecure", "--port", "0")


def test_tak_needs_a_place_on_earth(run):
    assert "--tak: the mission has no [datum]" in run(*SERVE, "--tak", "udp://239.2.3.1:6969")


@pytest.mark.parametrize(("option", "value", "library"), [("foxglove", "out.json", "foxglove"), ("tak", "udp://a:1", "pytak")])
def test_a_library_that_is_not_installed_is_named(run, monkeypatch, option, value, library, tmp_path):
    known = importlib.util.find_spec
    monkeypatch.setattr("radron.agent.extras.find_spec", lambda name: None if name == library else known(name))
    assert f"--{option}: {library} is not installed: pip install 'radron[{option}]'" in run(*SERVE, f"--{option}", value)
    assert not (tmp_path / "out.json").exists()


def test_nothing_is_written_of_what_is_no_flight(run, tmp_path):
    (tmp_path / "broken.mcap").write_bytes(b"nothing")
    assert "broken.mcap" in run("export", "broken.mcap", "--foxglove", "out.mcap")
    assert not list(tmp_path.glob("out*"))


def test_a_page_that_is_not_served_writes_no_layout(run, tmp_path):
    said = run(*SERVE, "--foxglove", "layout.json", "--host", "192.0.2.1")
    assert "give --tls-certificate and --tls-key" in said
    assert not (tmp_path / "layout.json").exists()


@pytest.mark.slow
def test_foxglove_connects_to_the_address_that_is_printed(tmp_path):
    (tmp_path / "mission.toml").write_text(MISSION)
    command = [sys.executable, "-m", "radron.station", *SERVE, "--foxglove", "layout.json"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        try:
            lines = [process.stdout.readline() for _ in range(2)]
            address = lines[1].removeprefix("radron-station: for Foxglove: ").strip()
            with connect(address, subprotocols=["foxglove.sdk.v1"]) as socket:
                assert json.loads(socket.recv(timeout=10.0)) == {
                    "op": "serverInfo",
                    "name": "m",
                    "capabilities": [],
                    "metadata": {},
                }
                topics = [channel["topic"] for channel in json.loads(socket.recv(timeout=10.0))["channels"]]
        finally:
            process.terminate()
    layout = json.loads((tmp_path / "layout.json").read_text())
    assert set(layout["configById"]["3D!scene"]["topics"]) <= set(topics)
    assert "map!earth" not in layout["configById"]  # this mission's frame has no place on Earth


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("3", "3")])
def test_the_fold_computes_in_one_thread_unless_told_otherwise(run, monkeypatch, given, used):
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, given or "")
        if given is None:
            monkeypatch.delenv(name)
    run(*SERVE, "--tak", "udp://239.2.3.1:6969")
    assert {os.environ[name] for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")} == {used}
