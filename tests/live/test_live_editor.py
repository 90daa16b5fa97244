"""A mission drawn on the page of a real station, and given to real agents with emulated vehicles on the ground."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from radron.agent.config.loading import load_mission
from radron.agent.flight.audit import audit
from radron.agent.flight.reader import RecordedFlight
from support.live.agents import Agent, Vehicles, closing, operator_folder, station_endpoint, write_configs
from support.live.agents import until as until_true
from support.page.browser import browsing, needs_browser, until


@contextmanager
def station(folder: Path) -> Iterator[str]:
    """``radron-station serve`` with the operator's certificate; its address."""
    tool, said = str(Path(sys.executable).parent / "radron-station"), folder / "station.log"
    links = ("--connect", station_endpoint(folder), "--identity", str(operator_folder(folder)), "--port", "0")
    with said.open("wb") as log:
        process = subprocess.Popen([tool, "serve", str(folder / "mission.toml"), *links], stdout=log, stderr=log)
    try:
        until_true(lambda: "radron-station: http" in said.read_text(), 60.0, said.read_text())
        yield re.findall(r"http://\S+", said.read_text())[0]
    finally:
        process.terminate()
        process.wait(10.0)


@needs_browser
@pytest.mark.slow
def test_real_agents_take_the_mission_that_was_drawn_and_its_upload_is_in_the_audit(tmp_path: Path) -> None:
    with closing(Vehicles(write_configs(tmp_path, 2))):
        old = load_mission(tmp_path / "mission.toml")
        agents = Agent(tmp_path, "d1"), Agent(tmp_path, "d2")
        with closing(*agents), station(tmp_path) as address, browsing(address) as page:
            ready = "() => radron.frame?.drones.every((one) => one.alive && one.stage === 'preflight' && one.place)"
            until(page, ready, 120.0)
            page.locator("#edit").click()
            page.locator("[aria-label='Corner 3: metres north']").fill("47.5")
            page.locator("[id='field-survey.height_m']").fill("4")
            until(page, "() => document.getElementById('draft').textContent.includes('new mission')")
            page.locator("#upload").click()
            page.locator("#confirm-yes").click()
            until(page, f"() => radron.mission.id !== '{old.mission_id}'", 120.0)
            new = page.evaluate("() => radron.mission.id")
            answers = page.locator("#answers").inner_text()
            assert {"d1: takes it over", "d2: takes it over", f"all drones have the mission {new}"} <= set(answers.split("\n"))
            until(page, "() => radron.frame?.drones.every((one) => one.alive && one.stage && !one.other_mission)", 60.0)
            with page.expect_download() as file:
                until(page, "() => !document.getElementById('download-mission').disabled")
                page.locator("#download-mission").click()
            mission = load_mission(Path(file.value.path()))
            assert (mission.mission_id, mission.survey.height_m) == (new, 4.0)
            assert mission.area.polygon_m[2][1] == 47.5
    flights = [RecordedFlight(path, whole=False) for path in sorted(tmp_path.glob("records/*.mcap"))]
    uploads = [(one.action, one.result) for flight in flights for one in audit(flight)]
    assert (f"upload {new}", "taken over") in uploads
