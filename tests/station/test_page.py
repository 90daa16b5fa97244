"""The page in a real browser, with a recorded flight."""

import asyncio
import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from radron.station.findings.facts import FindingsError
from radron.station.hub import Hub
from radron.station.outbox import GAVE_WAY, LET_GO
from radron.station.picture.picture import Picture
from radron.station.replay import Records, play
from support.flights.recorded_flights import MISSION, fly_recorded
from support.page.browser import browsing, needs_browser, until, visiting
from support.page.served_page import served

pytestmark = [needs_browser, pytest.mark.slow]
PICTURES = Path("results/page")
# The contrast of each text with the background that is nearest above it (WCAG 2.2, 1.4.3), where that is below 4.5.
TOO_FAINT = """() => {
  const luminance = (text) => {
    const [r, g, b] = text.match(/[\\d.]+/g).map(Number).slice(0, 3).map((v) => v / 255)
      .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const opaque = (element) => {
    for (let each = element; each; each = each.parentElement) {
      const fill = getComputedStyle(each).backgroundColor;
      if (!/, 0\\)$/.test(fill)) return fill;
    }
    return "rgb(255, 255, 255)";
  };
  const shown = [...document.querySelectorAll("body *")].filter((each) =>
    [...each.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim()) && each.checkVisibility());
  const contrast = (each) => {
    const [one, other] = [luminance(getComputedStyle(each).color), luminance(opaque(each))];
    return (Math.max(one, other) + 0.05) / (Math.min(one, other) + 0.05);
  };
  return shown.filter((each) => contrast(each) < 4.5).map((each) => `${each.tagName} ${each.textContent} ${contrast(each)}`);
}"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A hub with a flight of three drones that find the source and follow it for 8 s."""
    records = Records(fly_recorded(tmp_path_factory.mktemp("flights"), mission__track__duration_s=8.0)[:1])
    hub = Hub(Picture(records.mission, records.verifier), replay=True)
    asyncio.run(play(hub, records))
    return hub


def test_a_recorded_flight_is_shown_with_its_source_and_any_time_of_it(recorded):
    with served(recorded) as station, browsing(station.address) as page:
        until(page, "() => radron.at > 0 && radron.at === Number(document.getElementById('time').max)")
        until(page, "() => document.querySelector('#source .what')?.textContent.startsWith('Cs-137')")
        assert page.locator("#drones li").count() == 3
        assert page.locator(".leaflet-rasters-pane canvas").count() == 2  # possible source positions, and the dose rate
        assert "source found" in page.locator("#events").inner_text()
        assert page.locator("#drones canvas.spectrum").count() == 3
        assert page.evaluate(TOO_FAINT) == []
        assert page.locator("#commands").is_hidden()  # a record takes no commands
        PICTURES.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=PICTURES / "record.png")
        page.locator("#time").focus()
        page.keyboard.press("Home")
        until(page, "() => radron.frame.at_ms === Number(document.getElementById('time').min)")
        assert "No source found yet" in page.locator("#source").inner_text()
        page.locator("#play").click()
        until(page, "() => radron.frame.source !== null")
        until(page, "() => !radron.playing")
        seconds = page.evaluate("() => Math.round((radron.rows.at(-1)[0] - radron.rows[0][0]) / 1000)")
        assert page.locator("#at").inner_text() == f"{seconds // 60}:{seconds % 60:02}"


def test_the_cordon_follows_its_level(recorded):
    with served(recorded) as station, browsing(station.address) as page:
        until(page, "() => radron.share === 1 && radron.map.cordon.getLayers().length > 0")
        radius = """() => {
          const [x, y] = radron.frame.source.place;
          const line = radron.map.cordon.getLayers().find((layer) => layer.getLatLngs);
          const points = line.getLatLngs().flat();
          return points.map((point) => Math.hypot(point.lng - x, point.lat - y)).reduce((a, b) => a + b) / points.length;
        }"""
        activity = page.evaluate("() => radron.frame.source.activity_bq")
        for level in ("10", "40"):
            page.locator("#cordon").fill(level)
            page.locator("#cordon").press("Enter")
            expected = (0.0909e-6 * activity / float(level) - 1.0) ** 0.5
            assert page.evaluate(radius) == pytest.approx(expected, rel=0.1)
            assert page.locator(".leaflet-tooltip.cordon").inner_text() == f"{level} µSv/h"
            far = re.fullmatch(r"at most (\d+) m from the source", page.locator(".control p").first.inner_text())
            assert float(far[1]) == pytest.approx(expected, abs=2.0)
        for level, says in (("1000000", "nowhere: at most"), ("0.01", "reaches beyond the fence")):
            page.locator("#cordon").fill(level)
            page.locator("#cordon").press("Enter")
            assert page.locator(".control p").first.inner_text().startswith(says)


def test_a_report_that_cannot_be_made_is_told():
    async def refused():
        raise FindingsError("the records hold no second of a flight")

    hub = Hub(Picture(MISSION, None), replay=False)
    hub.findings = refused
    with served(hub) as station, visiting(station.address) as page:
        page.locator("#report").click()
        says = "No report: the records hold no second of a flight"
        until(page, f"() => document.getElementById('report-told').textContent === '{says}'")


# Colours on the canvas of moving objects, at the first drone and at the source, and the number of its pixels drawn.
COLOURS = """() => {
  const { canvas, map } = radron.map.sketch;
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  const [drawn, shown] = [canvas, map.getContainer()].map((one) => one.getBoundingClientRect());
  const at = ([x, y]) => {
    const point = map.latLngToContainerPoint([y, x]).add([shown.x - drawn.x, shown.y - drawn.y]).round();
    return [...pixels.slice(4 * (point.y * canvas.width + point.x)).slice(0, 4)];
  };
  const { source, drones } = radron.frame;
  return [at(drones[0].place), at(source.place), pixels.filter((value, place) => place % 4 === 3 && value).length];
}"""


def test_drones_and_source_are_drawn_where_they_are_and_parts_can_be_hidden(recorded):
    with served(recorded) as station, browsing(station.address) as page:
        until(page, "() => radron.share === 1 && radron.frame?.source && radron.at === radron.frame.at_ms")
        drone, source, much = page.evaluate(COLOURS)
        assert drone == [0x00, 0x72, 0xB2, 255]
        assert source == [0xF0, 0xE4, 0x42, 255]
        for part in ("cones", "trails"):
            before = much
            page.locator(f"#layer-{part}").uncheck()
            until(page, "() => !radron.map.sketch.asked")
            much = page.evaluate(COLOURS)[2]
            assert much < before
            page.locator(f"#layer-{part}").check()
            until(page, "() => !radron.map.sketch.asked")
            assert page.evaluate(COLOURS)[2] == before
            much = before
        page.evaluate("() => radron.map.map._rawPanBy(L.point(60, -30))")  # as while it is dragged: the canvas moves with the map
        assert page.evaluate(COLOURS)[:2] == [drone, source]
        page.evaluate("() => radron.map.map.panBy([-100, 40], { animate: false })")
        until(page, "() => !radron.map.sketch.asked")
        assert page.evaluate(COLOURS)[:2] == [drone, source]


def test_markup_in_names_and_texts_is_text():
    evil = "<img src=x onerror=\"document.title='taken'\">"
    mission = MissionConfig(
        name=evil,
        area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))),
        drones=(DroneInMission(id="d1"),),
    )
    status = Status(stamp_ns=10**9, drone="d1", mission=mission.mission_id, boot="0" * 16, stage=Stage.HOLD, problems=(evil,))
    hub = Hub(Picture(mission, None), replay=False)
    hub.picture.receive(key_of(mission.swarm, status), encode(replace(status, finding=evil)), 10**9)
    with served(hub) as station, browsing(station.address) as page:
        station.call(hub.show, 10**9)
        until(page, "() => radron.frames > 0")
        assert page.locator("#mission").inner_text().startswith("<img")
        assert evil in page.locator("#drones").inner_text()
        assert page.locator("#mission img, #drones img, #events img, #source img").count() == 0
        assert page.title() == f"radron · {evil}"


def test_a_station_that_is_gone_is_told_and_found_again(recorded):
    with served(recorded) as station:
        port = station.port
        with browsing(station.address) as page:
            until(page, "() => radron.frames > 0")
            station.call(lambda: [each.leave(LET_GO) for each in recorded._pages])
            until(page, "() => document.getElementById('link').textContent.includes('NO LINK')")
            assert page.locator("#lost").inner_text().startswith("NO LINK TO THE STATION: what you see is old")
            until(page, "() => document.getElementById('link').textContent === 'record'")
        assert port == station.port


def test_a_page_that_has_given_way_says_so_and_stays_away(recorded):
    """Else the page would displace another page, which would reconnect in its turn."""
    with served(recorded) as station, browsing(station.address) as page:
        until(page, "() => radron.frames > 0 && radron.link?.isAlive")
        station.call(lambda: [each.leave(GAVE_WAY) for each in recorded._pages])
        until(page, "() => document.getElementById('lost').textContent.includes('GIVEN WAY TO A NEWER ONE')")
        page.wait_for_timeout(1500)  # as long as another page waits before it connects again, and longer
        assert recorded.pages == 0


def test_an_address_without_its_token_says_what_to_open(recorded):
    with served(recorded) as station, visiting(station.address.split("?")[0]) as page:
        until(page, "() => document.getElementById('lost').textContent.includes('open the address that it has printed')")
        assert page.locator("#drones li").count() == 0


# Elements that must be in view without scrolling, and the ones out of view.
OUT_OF_VIEW = """() => ["map", "time", "command-hold", "command-return", "present"].filter((id) => {
  const part = document.getElementById(id);
  const { left, top, right, bottom, width, height } = part.getBoundingClientRect();
  const found = document.elementFromPoint(left + width / 2, top + height / 2);
  return left < 0 || top < 0 || right > innerWidth || bottom > innerHeight || !width || !part.contains(found);
})"""


@pytest.mark.parametrize(("width", "height"), [(390, 844), (768, 1024), (1024, 768), (1400, 900)])
def test_map_slider_hold_and_return_are_in_view_on_a_telephone_and_a_tablet(recorded, width, height):
    """The slider was five screens below the map."""
    recorded.command = lambda action, drones, age_s: ""
    try:
        with served(recorded) as station, browsing(station.address, width, height) as page:
            until(page, "() => radron.frames > 0 && radron.share === 1")
            assert page.evaluate(OUT_OF_VIEW) == []
            page.locator("#command-hold").click()
            until(page, "() => document.getElementById('told').textContent.includes('given to the station')")
            page.evaluate("() => { document.querySelector('aside').scrollTop = 1e6; scrollTo(0, 1e6); }")
            assert page.evaluate(OUT_OF_VIEW) == []
            assert page.evaluate("() => document.documentElement.scrollHeight <= innerHeight")
            assert page.locator("#map").bounding_box()["height"] >= 0.3 * height
            area = page.evaluate("() => radron.map.map.getBounds().contains(radron.map.area.getBounds())")
            assert area  # though rows of buttons came after the map was first drawn
            PICTURES.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=PICTURES / f"page-{width}.png")
    finally:
        recorded.command = None


# Names of marks in a row, one upon the other, and at the map's edge: pixels that each name hides of others, by labels.js.
HIDDEN = """async (marks) => {
  const { Labels } = await import("./labels.js");
  const names = new Labels().place(marks.map(([x, y], place) => [`d${place}`, x, y, 30]), 8, [400, 300]);
  const bodies = marks.map(([x, y]) => [x - 8, y - 8, x + 8, y + 8]);
  const shared = (a, b, low, high) => Math.max(0, Math.min(a[high], b[high]) - Math.max(a[low], b[low]));
  return names.map((name, one) => {
    const others = [...names, ...bodies].filter((_, other) => other % marks.length !== one);
    const hidden = others.reduce((sum, other) => sum + shared(name, other, 0, 2) * shared(name, other, 1, 3), 0);
    return hidden + (name[0] < 0 || name[1] < 0 || name[2] > 400 || name[3] > 300);
  });
}"""


def test_no_name_on_the_map_hides_a_drone_or_another_name(recorded):
    row = [[100 + 22 * place, 100] for place in range(4)]
    together = [[200, 200], [203, 201]]
    with served(recorded) as station, browsing(station.address) as page:
        for marks in (row, together, [[395, 150], [5, 5]]):
            assert page.evaluate(HIDDEN, marks) == [0] * len(marks)


def test_the_page_fits_a_tablet(recorded):
    with served(recorded) as station, browsing(station.address, 820, 1180) as page:
        until(page, "() => radron.frames > 0")
        assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
        shown = "[...document.querySelectorAll('button, select')].filter((each) => each.checkVisibility())"
        sizes = page.evaluate(f"() => {shown}.map((each) => each.getBoundingClientRect().height)")
        assert len(sizes) >= 3
        assert min(sizes) >= 44
        page.screenshot(path=PICTURES / "tablet.png")
        page.set_viewport_size({"width": 1180, "height": 820})  # turned
        drawn = "[...document.querySelectorAll('canvas.spectrum, #chart-rms')].map((each) => [each.width, each.clientWidth])"
        until(page, f"() => {drawn}.length > 1 && {drawn}.every(([drawn, shown]) => drawn === shown)")
