"""Refusals of ``radron-sim live`` before it starts any process."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import radron.sim.cli
from radron.sim.live.command import _beside


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["nonsense"], "unknown scenario 'nonsense'"),
        (["demo", "--set", "mission.nothing=1"], "there is no 'mission.nothing' in this scenario"),
        (["demo", "--estimator", "nonsense"], "mission.fusion.estimator"),
        (["demo", "--external"], "--agent-hosts: 0 given for 3 drones"),
        (["demo", "--external", "--agent-hosts", "a,b"], "--agent-hosts: 2 given for 3 drones"),
        (["demo", "--drones", "2", "--external", "--agent-hosts", "a,b"], "--external needs --mesh"),
        (["demo", "--vehicles", "mavlink"], "--vehicles mavlink: needs --external"),
        (["demo", "--ground-station", "14550"], "--ground-station 14550: give host and UDP port"),
        (["demo", "--ground-station", "localhost:99999"], "--ground-station localhost:99999: give host and UDP port"),
        (["demo", "--json", "/no/such/folder/out.json"], "the folder /no/such/folder does not exist"),
    ],
)
def test_what_cannot_be_flown_is_one_line(
    options: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["radron-sim", "live", *options, "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as end:
        radron.sim.cli.main()
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert text in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_the_command_that_opens_the_flight_is_told_as_it_must_be_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path / "elsewhere"))
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "radron-sim")])
    assert _beside("radron-station") == "radron-station"  # not installed: the plain name says what to install
    (tmp_path / "radron-station").touch(mode=0o755)
    assert _beside("radron-station") == str(tmp_path / "radron-station")
    monkeypatch.setenv("PATH", str(tmp_path))
    assert _beside("radron-station") == "radron-station"
