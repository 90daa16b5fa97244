"""The agent's report to its computer, and the report of the computer's updater through the agent."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from radron.agent.preflight.software import software_finding
from radron.agent.shell.selfreport import SelfReport, Updates
from radron.agent.update.records import Records, read_report
from radron.protocol.codec import decode
from radron.protocol.identity import load_identity
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Stage, Status
from radron.protocol.onboard import Needs, Outcome, Report, Trial
from support.computers.onboard import NEW, OLD, well
from support.live.agents import Agent, Vehicles, closing, operator_folder, station_endpoint, until, write_configs

FALLEN = Outcome(kind="fell back", slot="B", release=NEW, text="the update to 0.2.0 failed: slot A runs again", stamp_ns=1)
TRIAL = Trial(slot="B", release=NEW, before=OLD, needs=Needs(), begun_ns=1)


@pytest.fixture
def vehicles(tmp_path: Path) -> Iterator[Vehicles]:
    made = Vehicles(write_configs(tmp_path, 2), {})
    with closing(made):
        yield made


def test_a_report_is_written_once_a_second_and_removed_with_the_agent(tmp_path: Path) -> None:
    now_s = [100.0]
    report = SelfReport(tmp_path, clock_s=lambda: now_s[0])

    async def scene() -> None:
        task = asyncio.create_task(report.run(well))
        await asyncio.sleep(0)
        first = read_report(tmp_path / "report.json", 101.0)
        assert first is not None
        assert (first.uptime_s, first.autopilot, first.camera) == (100.0, True, False)  # the camera has not answered so far
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(scene())
    assert not (tmp_path / "report.json").exists()
    report.readout()
    asyncio.run(asyncio.wait_for(SelfReport(None).run(well), 5.0))  # without a service manager there is none


def test_a_failed_update_is_a_notice_and_one_on_trial_prevents_a_start(tmp_path: Path) -> None:
    updates, records = Updates(str(tmp_path)), Records(tmp_path)
    updates.look(Stage.PREFLIGHT)
    assert (updates.notice, updates.problem) == (None, None)
    records.tell(FALLEN)
    records.begin(TRIAL)
    updates.look(Stage.TRACK)  # in flight no disk is looked at
    assert (updates.notice, updates.problem) == (None, None)
    updates.look(Stage.LANDED)
    assert updates.notice == "software: the update to 0.2.0 failed: slot A runs again"
    assert updates.problem == "software: 0.2.0 (bbbbbbbbbbbb) is on trial in slot B: wait until it is confirmed"
    records.tell(msgspec.structs.replace(FALLEN, kind="good"))
    records.end()
    updates.look(Stage.PREFLIGHT)
    assert (updates.notice, updates.problem) == (None, None)


def test_the_preflight_check_tells_of_updates(tmp_path: Path) -> None:
    records = Records(tmp_path)

    def found() -> tuple[str, str]:
        finding = software_finding(str(tmp_path))
        assert finding is not None
        return finding.verdict, finding.text

    assert software_finding(None) is None
    assert found() == ("ok", "as flashed: no update so far")
    records.tell(FALLEN)
    assert found() == ("failed", FALLEN.text)
    records.begin(TRIAL)
    assert found() == ("not yet", "0.2.0 (bbbbbbbbbbbb) is on trial in slot B")


@pytest.mark.slow
def test_an_agent_reports_to_its_computer_and_tells_the_others_of_a_fallback(tmp_path: Path, vehicles: Vehicles) -> None:
    Records(tmp_path / "updates").tell(FALLEN)
    file = tmp_path / "run/report.json"
    file.parent.mkdir()
    d1 = Agent(tmp_path, "d1", RUNTIME_DIRECTORY=str(file.parent), RADRON_UPDATES="updates")
    with closing(d1):
        until(lambda: has_vehicle(file), 30.0, "a report")
        until(
            lambda: "COM_OF_LOSS_T" in read(file).parameters and read(file).px4, 30.0, "version and parameters of the autopilot"
        )
        report = read_report(file, time.monotonic())
        assert report is not None
        assert (report.stage, report.flies, report.alive) == (Stage.PREFLIGHT, False, ())
        notices = asyncio.run(first_status(tmp_path, lambda status: bool(status.notices)))
        assert any(text == f"software: {FALLEN.text}" for text in notices.notices)


def read(file: Path) -> Report:
    return msgspec.json.decode(file.read_bytes(), type=Report)


def has_vehicle(file: Path) -> bool:
    report = read_report(file, time.monotonic())
    return report is not None and report.autopilot


async def first_status(folder: Path, wanted: Callable[[Status], bool]) -> Status:
    found: asyncio.Future[Status] = asyncio.get_running_loop().create_future()

    def receive(key: str, payload: bytes) -> None:
        message = decode(payload)
        if isinstance(message, Status) and wanted(message) and not found.done():
            found.set_result(message)

    links = MeshConfig(connect=(station_endpoint(folder, "d1"),), identity=load_identity(operator_folder(folder)))
    mesh = await Mesh.open(links, "radron", None, receive=receive)
    try:
        async with asyncio.timeout(30.0):
            return await found
    finally:
        await mesh.close()
