"""The page for everybody: axe-core's rules of WCAG 2.2 A and AA, large touch targets, the keyboard; and without any network."""

from pathlib import Path

import pymap3d
import pytest
from axe_playwright_python.sync_playwright import Axe
from msgspec.structs import replace

from radron.agent.config.mission import DatumConfig
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from radron.station.background import background
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from support.flights.one_pilot import MISSION
from support.page.browser import browsing, needs_browser, until
from support.page.map_tiles import corner_of, write_mbtiles
from support.page.served_page import served

pytestmark = [needs_browser, pytest.mark.slow]
PICTURES = Path("results/page")
RULES = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]}
HERE = DatumConfig(latitude_deg=47.4, longitude_deg=8.5, altitude_m=488.0)
YARD = """{"type": "FeatureCollection", "features": [
 {"type": "Feature", "properties": {"name": "hall"},
  "geometry": {"type": "Polygon", "coordinates": [[[8.5001, 47.4001], [8.5005, 47.4001], [8.5005, 47.4003], [8.5001, 47.4001]]]}},
 {"type": "Feature", "properties": {"name": "road"},
  "geometry": {"type": "LineString", "coordinates": [[8.4990, 47.3999], [8.5012, 47.4002]]}}]}"""
TOUCHED = """() => [...document.querySelectorAll("button, select, input, summary, a.button, .leaflet-bar a")]
  .filter((each) => each.checkVisibility()).map((each) => [each.closest("label") ?? each, each])
  .filter(([area]) => Math.min(area.getBoundingClientRect().height, area.getBoundingClientRect().width) < 44)
  .map(([, each]) => `${each.tagName} ${each.id} ${each.textContent}`)"""


@pytest.fixture
def hub(tmp_path):
    """An operator's, of a swarm on Earth that reports a problem, with a layer and tiles."""
    mission = replace(MISSION, datum=HERE)
    (tmp_path / "yard.geojson").write_text(YARD)
    tiles = write_mbtiles(tmp_path / "yard.mbtiles", HERE.latitude_deg, HERE.longitude_deg, range(17, 20))
    hub = Hub(Picture(mission, None), replay=False)
    hub.background = background(mission, [tmp_path / "yard.geojson"], tiles)
    given = []
    hub.command = lambda action, drones, age_s: given.append((str(action), drones)) or ""
    hub.upload, hub.given = lambda mission, age_s: given.append(mission) or "", given
    told = {"mission": mission.mission_id, "boot": "0" * 16, "stage": Stage.PREFLIGHT, "problems": ("no camera",)}
    status = Status(stamp_ns=10**9, drone="d1", **told)
    hub.picture.receive(key_of(mission.swarm, status), encode(status), 10**9)
    return hub


def shown(serving, page):
    serving.call(serving.hub.show, 10**9)
    until(page, "() => radron.frames > 0 && radron.link?.isAlive")


def violations(page):
    result = Axe().run(page, options=RULES).response
    assert len(result["passes"]) > 8  # behind an open dialog the page does not count
    found = result["violations"]
    return [f"{one['id']}: {node['html'][:160]}" for one in found for node in one["nodes"]]


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (820, 1180)])
def test_axe_finds_nothing_on_the_page_and_in_the_editor(hub, width, height):
    PICTURES.mkdir(parents=True, exist_ok=True)
    with served(hub) as serving, browsing(serving.address, width, height) as page:
        shown(serving, page)
        assert violations(page) == []
        assert page.evaluate(TOUCHED) == []
        page.locator("#edit").click()
        until(page, "() => document.getElementById('draft').textContent.includes('No change')")
        assert violations(page) == []
        assert page.evaluate(TOUCHED) == []
        assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
        page.screenshot(path=PICTURES / f"editor-{width}.png")
        page.locator("#command-start").click()
        assert violations(page) == []


def test_hold_and_return_by_the_keyboard_alone(hub):
    with served(hub) as serving, browsing(serving.address) as page:
        shown(serving, page)
        page.keyboard.press("h")
        page.keyboard.press("R")
        page.locator("#edit").press("Enter")
        page.locator("[id='field-name']").press("r")  # typed, no command
        until(page, "() => document.getElementById('draft').textContent.includes('new mission')")
        page.locator("#command-land").press("Enter")
        page.locator("#confirm-yes").press("Enter")
        while len(hub.given) < 3:
            page.wait_for_timeout(10)
        assert hub.given == [("hold", ()), ("return", ()), ("land", ())]


def test_tiles_and_layers_lie_where_they_belong_without_any_network(hub):
    with served(hub) as serving, browsing(serving.address) as page:
        shown(serving, page)
        images = "[...document.querySelectorAll('.leaflet-tiles-pane img')]"
        until(page, f"() => {images}.filter((each) => each.naturalWidth === 256).length > 3")
        until(page, "() => radron.map.layers.own.getLayers().length === 2")
        bounds = """() => [...radron.map.background.shown].map(([name, image]) => [name, image.getBounds().getNorthWest()])
          .map(([name, corner]) => [name, corner.lng, corner.lat])"""
        placed = page.evaluate(bounds)
        assert len(placed) >= 4
        for name, x, y in placed:
            latitude, longitude = corner_of(*map(int, name.split("/")))
            east, north, _ = pymap3d.geodetic2enu(latitude, longitude, 488.0, 47.4, 8.5, 488.0)
            assert (x, y) == pytest.approx((east, north), abs=0.1)  # within some 300 m
        assert "© Survey" in page.locator(".control").inner_text()
        page.screenshot(path=PICTURES / "background.png")
        page.locator("#layer-tiles").uncheck()
        assert page.locator(".leaflet-tiles-pane img").count() == 0
