"""A flight test with sessions that fail."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from radron.sim.px4test import session
from radron.sim.px4test.rows import Row, table

FAILED, PASSED = Row("the mission", ("the failsafe of d1 took over",)), Row("the mission", figures={"least distance m": 5.0})


def fly(monkeypatch: pytest.MonkeyPatch, folder: Path, attempts: int, outcomes: list[Row]) -> tuple[session.Report, list[Path]]:
    folders: list[Path] = []

    async def flown(_session: object, _px4: None, _seed: int, place: Path, _truths: set[str]) -> list[Row]:
        folders.append(place)
        return [outcomes[len(folders) - 1]]

    monkeypatch.setattr(session, "_fly", flown)
    return asyncio.run(session.fly_all(None, 1, ["missions"], folder, attempts)), folders


def test_a_session_that_failed_is_flown_again_only_where_asked_for_and_the_report_says_so(monkeypatch, tmp_path):
    report, folders = fly(monkeypatch, tmp_path, 2, [FAILED, PASSED])
    assert report.passed
    assert folders == [tmp_path / "missions", tmp_path / "missions-2"]
    assert report.repeated == (FAILED,)
    lines = table(report)
    assert lines[1].startswith("AGAIN   the mission")
    assert lines[2].strip() == "the failsafe of d1 took over"
    assert lines[3].startswith("passed  the mission")
    report, folders = fly(monkeypatch, tmp_path, 1, [FAILED])
    assert not report.passed
    assert report.repeated == ()


def test_a_session_that_fails_each_time_has_failed(monkeypatch, tmp_path):
    report, folders = fly(monkeypatch, tmp_path, 2, [FAILED, FAILED])
    assert not report.passed
    assert len(folders) == 2
    assert report.rows == (FAILED,)


def test_a_session_that_passes_is_flown_once(monkeypatch, tmp_path):
    report, folders = fly(monkeypatch, tmp_path, 2, [PASSED])
    assert report.passed
    assert len(folders) == 1
    assert report.repeated == ()
