"""The operator's page beside a live flight, in a real browser."""

from __future__ import annotations

import re
import zipfile
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from radron.station.findings.facts import BY_DRONES
from radron.station.findings.seal import verify
from support.live.run import PATIENCE_S, LiveRun, live_run, stretched
from support.page.browser import browsing, needs_browser, until

PICTURES = Path("results/page")


def opened(run: LiveRun, folder: Path) -> str:
    """The address of the page, once it is served; its token is in no file that others can read."""
    run.until(lambda: "the operator's page" in run.said, 120.0)
    address = re.findall(r"http://localhost:\d+/\?token=\S+", run.said)[0]
    run.until(lambda: "radron-station" in (folder / "page.log").read_text(), 30.0)
    assert address.split("token=")[1] not in (folder / "page.log").read_text()
    return address


@needs_browser
@pytest.mark.slow
def test_the_page_shows_the_flight_stops_it_and_marks_a_drone_that_is_gone_within_two_seconds(tmp_path: Path) -> None:
    options = ("--seed", "1", "--set", "mission.track.duration_s=90", "--page")
    with live_run(tmp_path, "paper-demo", *options) as run:
        address = opened(run, tmp_path)
        with browsing(address) as page:
            until(page, "() => radron.frame?.drones.every((drone) => drone.alive && drone.place)", 120.0)
            until(page, "() => radron.frame.source !== null", 120.0)
            until(page, "() => radron.frame.drones.every((drone) => drone.stage === 'track')", 60.0)
            assert "links encrypted" in page.locator("#link").inner_text()
            until(page, "() => radron.frame.source?.rms_m < 1.2 && radron.rows.length > 45", 60.0)
            PICTURES.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=PICTURES / "live.png")
            page.locator("#edit").click()
            until(page, "() => document.getElementById('draft').textContent.includes('d1, d2, d3 fly')", 20.0)
            assert page.locator("#upload").is_disabled()
            page.locator("#close-editor").click()
            page.locator("#command-land").click()
            page.locator("#confirm button[value=no]").click()
            page.keyboard.press("h")
            until(page, "() => radron.frame.drones.every((drone) => drone.stage === 'hold')", PATIENCE_S)
            until(page, "() => radron.frame.drones.every((drone) => drone.speed_mps < 0.5)", PATIENCE_S)
            assert "hold: d1 hold, d2 hold, d3 hold" in page.locator("#told").inner_text()
            with page.expect_download() as report:
                page.locator("#report").click()
            with zipfile.ZipFile(report.value.path()) as archive:
                archive.extractall(tmp_path / "report")
            assert verify(tmp_path / "report", tmp_path / "page" / "ca.pem").signer.name == "page"
            told = (tmp_path / "report" / "report.html").read_text()
            commands = re.findall(r"<td>(d\d): (\w+) by (\w+) \(operator \w+, serial [^)]*\): (\w+)", told)
            assert re.findall(rf"<td>(d\d): start by operator \({BY_DRONES}\): obeyed", told) == [
                "d1",
                "d2",
                "d3",
            ]  # not the page's
            assert [one for one in commands if one[1] == "hold"] == [(f"d{each}", "hold", "page", "obeyed") for each in (1, 2, 3)]
            assert "land:" not in page.locator("#events").inner_text()
            page.locator("#time").focus()
            page.keyboard.press("Home")
            until(page, "() => radron.frame.at_ms === Number(document.getElementById('time').min)", PATIENCE_S)
            known = page.evaluate("() => radron.rows.length")
            until(page, f"() => radron.rows.length > {known}", PATIENCE_S)  # the flight goes on
            assert page.evaluate("() => radron.frame.at_ms === Number(document.getElementById('time').min)")
            assert "LOOKING BACK" in page.locator("#link").inner_text()
            page.locator("#present").click()
            until(page, "() => radron.frame.at_ms > Number(document.getElementById('time').max) - 2000", PATIENCE_S)
            page.locator("#to-d2").uncheck()
            page.locator("#command-resume").click()
            until(page, "() => radron.frame.drones.map((drone) => drone.stage).join() === 'track,hold,track'", PATIENCE_S)
            gone = [one for one in run.processes() if any("agents/d2/" in word for word in one.cmdline())]
            for process in gone:  # agent and watchdog: one may end with the other
                with suppress(psutil.NoSuchProcess):
                    process.kill()
            until(page, "() => document.getElementById('drone-d2').classList.contains('stale')", stretched(2.0))
            assert not page.evaluate("() => document.getElementById('drone-d1').classList.contains('stale')")
