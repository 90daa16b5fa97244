"""A mission edited on the page in a real browser, and given to drones over a real mesh."""

from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from radron.agent.config.loading import load_mission, read_content
from radron.protocol.mesh.session import MeshConfig
from radron.protocol.messages import Stage
from radron.station.hub import Hub
from radron.station.live import follow
from radron.station.picture.picture import Picture
from support.flights.one_pilot import MISSION
from support.mesh.mission_receivers import Drone
from support.page.browser import browsing, needs_browser, until
from support.page.served_page import served

pytestmark = [needs_browser, pytest.mark.slow]
PICTURES = Path("results/page")


def station(*drones):
    """A hub, and its work among these drones."""
    hub = Hub(Picture(MISSION, None), replay=False)

    async def work():
        async with AsyncExitStack() as stack:
            dial = ()
            for drone in drones:
                await stack.enter_async_context(drone.running(dial))
                dial += (drone.endpoint,)
            await follow(hub, MeshConfig(connect=dial))

    return hub, work


def opened(page):
    """The editor, as soon as all drones are heard."""
    until(page, "() => radron.frame?.drones.every((drone) => drone.alive && drone.stage === 'preflight')")
    page.locator("#edit").click()
    draft(page, MISSION.mission_id)


def draft(page, says):
    until(page, f"() => document.getElementById('draft').textContent.includes('{says}')")


def dragged(page, mark, dx, dy):
    """Drag a mark on the map by pixels."""
    box = mark.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + dx, y + dy, steps=4)
    page.mouse.up()


def test_a_mission_is_drawn_checked_downloaded_and_uploaded(tmp_path):
    d1, d2 = Drone("d1"), Drone("d2")
    hub, work = station(d1, d2)
    with served(hub, work=work) as serving, browsing(serving.address) as page:
        opened(page)
        corners = len(MISSION.area.polygon_m)
        assert page.locator(".handle.corner").count() == corners
        assert min(page.locator(".handle").first.bounding_box()[side] for side in ("width", "height")) >= 44
        dragged(page, page.locator(".handle.corner").nth(2), -40, 30)
        page.locator(".handle.between").nth(0).click()
        dragged(page, page.locator(".handle.launch").nth(0), 0, -12)
        dragged(page, page.locator(".handle.fence"), 0, 40)
        draft(page, "new mission")
        assert page.locator(".handle.corner").count() == corners + 1
        height = page.locator("[id='field-survey.height_m']")
        height.fill("400")
        draft(page, "Cannot be flown: 1 to mend")
        assert "survey.height_m = 400 is outside" in page.locator("[id='flaw-survey.height_m']").inner_text()
        assert height.get_attribute("aria-invalid") == "true"
        assert page.locator("#upload").is_disabled()
        page.locator("[id='flaw-survey.height_m']").scroll_into_view_if_needed()
        PICTURES.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=PICTURES / "editor.png")
        height.fill("4")
        draft(page, "new mission")
        assert page.locator("[id='flaw-survey.height_m']").inner_text() == ""
        with page.expect_download() as download:
            page.locator("#download-mission").click()
        download.value.save_as(tmp_path / "mission.toml")
        mission = load_mission(tmp_path / "mission.toml")
        assert mission.mission_id in page.locator("#draft").inner_text()
        assert len(mission.area.polygon_m) == corners + 1
        assert mission.area.polygon_m[3] != MISSION.area.polygon_m[2]
        assert mission.drones[0].origin_m[1] > MISSION.drones[0].origin_m[1]
        assert mission.survey.height_m == 4.0
        assert mission.area.fence_margin_m > MISSION.area.fence_margin_m
        lowest = min(y for _, y in mission.area.polygon_m) - mission.area.fence_margin_m
        assert (
            page.evaluate("() => Math.min(...radron.map.fence.getLatLngs()[0].map(({ lat }) => lat))") > lowest
        )  # until it is uploaded
        page.locator("#upload").click()
        page.locator("#confirm-yes").click()
        until(page, f"() => radron.mission.id === '{mission.mission_id}'")
        answers = page.locator("#answers").inner_text()
        assert {"d1: takes it over", "d1: has it", "d2: has it", f"all drones have the mission {mission.mission_id}"} <= set(
            answers.split("\n")
        )
        draft(page, f"No change: mission {mission.mission_id}")
        assert read_content(d1.content, mission.mission_id) == mission
        assert f"upload: to d1, d2, mission {mission.mission_id}" in page.locator("#events").inner_text()
        until(page, "() => radron.frame.drones.every((drone) => drone.alive && !drone.other_mission)")
        page.screenshot(path=PICTURES / "uploaded.png")


def test_a_refusal_is_shown_and_a_corner_is_removed_by_the_keyboard():
    hub, work = station(Drone("d1"), Drone("d2", refuses="its mission has begun (survey)"))
    with served(hub, work=work) as serving, browsing(serving.address) as page:
        opened(page)
        page.locator("#add-corner").press("Enter")
        page.locator("[aria-label='Corner 1: metres north']").fill("-7.5")
        draft(page, "new mission")
        page.locator("#remove-1").press("Enter")
        assert page.locator(".corners").first.locator("li").count() == len(MISSION.area.polygon_m)
        draft(page, "new mission")
        page.locator("#upload").click()
        page.locator("#confirm-yes").click()
        until(page, "() => document.getElementById('answers').textContent.includes('not taken by d2')")
        assert "d2: refused: its mission has begun (survey)" in page.locator("#answers").inner_text()
        until(page, "() => document.getElementById('drone-d2').textContent.includes('has another mission than the one shown')")


def test_in_flight_there_is_no_upload():
    d1, d2 = Drone("d1"), Drone("d2")
    d2.stage = Stage.SURVEY
    hub, work = station(d1, d2)
    with served(hub, work=work) as serving, browsing(serving.address) as page:
        until(page, "() => radron.frame?.drones.some((drone) => drone.stage === 'survey')")
        page.locator("#edit").click()
        draft(page, "d2 fly: a mission is uploaded on the ground only")
        assert page.locator("#upload").is_disabled()
