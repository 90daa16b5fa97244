"""What ``radron-sim live`` refuses before it starts any process."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import sim.cli


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
        (["demo", "--json", "/no/such/folder/out.json"], "the folder /no/such/folder does not exist"),
    ],
)
def test_what_cannot_be_flown_is_one_line(
    options: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["radron-sim", "live", *options, "--out", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as end:
        sim.cli.main()
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert text in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
