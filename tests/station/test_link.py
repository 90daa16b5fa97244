"""A link between browser and station that stalls: reported within seconds, and no command is executed when it goes on."""

import asyncio
import time

import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Stage, Status
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from radron.station.web.beat import MAX_COMMAND_AGE_S
from support.page.browser import browsing, needs_browser, until
from support.page.gate import gate
from support.page.served_page import served

pytestmark = [needs_browser, pytest.mark.slow]
MISSION = MissionConfig(
    name="m", area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))), drones=(DroneInMission(id="d1"),)
)
NOTICED_S = (
    MAX_COMMAND_AGE_S + 1.0
)  # between two heartbeats the newest proof is up to half a second old, and the browser has to draw
LOST = "() => !document.getElementById('lost').hidden"
SAYS = "() => document.getElementById('told').textContent.includes('{}')"


@pytest.fixture
def hub():
    """An operator's, in a flight of one drone that is heard all the time; ``given``: commands."""
    hub = Hub(Picture(MISSION, None), replay=False)
    hub.given = []
    hub.command = lambda action, drones, age_s: hub.given.append(str(action)) or ""
    return hub


def flight(hub):
    async def work():
        while True:
            now_ns = time.time_ns()
            status = Status(stamp_ns=now_ns, drone="d1", mission=MISSION.mission_id, boot="0" * 16, stage=Stage.RETURN)
            hub.picture.receive(key_of(MISSION.swarm, status), encode(status), now_ns)
            hub.show(now_ns)
            await asyncio.sleep(0.1)

    return work


def test_a_stalled_link_is_told_and_what_was_ordered_meanwhile_is_never_carried_out(hub):
    """The page said "connected" and "given to the station", and when the link went on the drone held on its way home."""
    with served(hub, work=flight(hub)) as station, gate(station.address, station.port) as way, browsing(way.address) as page:
        until(page, "() => radron.link?.isAlive && radron.frames > 3")
        assert page.locator("#lost").is_hidden()
        way.stall()
        stalled_s = time.monotonic()
        page.keyboard.press("h")  # before anything can be known
        assert "on its way" in page.locator("#told").inner_text()
        until(page, LOST, NOTICED_S)
        until(page, SAYS.format("Hold (H): FAILED"), NOTICED_S - (time.monotonic() - stalled_s))
        box = page.locator("#lost").bounding_box()
        assert box["width"] == 1400
        assert page.locator("#lost").inner_text().startswith("NO LINK TO THE STATION: what you see is old")
        assert "grayscale" in page.evaluate("() => getComputedStyle(document.querySelector('main')).filter")
        assert page.locator("#link").inner_text() == "NO LINK"
        page.keyboard.press("r")
        until(page, SAYS.format("Return (R): NOT SENT, there is no link to the station"))
        until(page, "() => /heard [6-9]/.test(document.getElementById('drone-d1').textContent)", 10.0)  # no "0.1 s ago"
        way.go()
        until(page, "() => radron.link?.isAlive && document.getElementById('lost').hidden", 10.0)
        events = "() => document.getElementById('events').textContent.includes('hold: refused, it was given more than 2 s ago')"
        until(page, events)
        assert hub.given == []
        page.keyboard.press("h")
        until(page, SAYS.format("given to the station"))
        assert hub.given == ["hold"]


def test_a_stopped_station_is_told_and_what_waits_in_its_sockets_is_never_carried_out(hub):
    with served(hub, work=flight(hub)) as station, browsing(station.address) as page:
        until(page, "() => radron.link?.isAlive && radron.frames > 3")
        stopping = station.call_later(time.sleep, 5.5)
        page.keyboard.press("h")
        until(page, LOST, NOTICED_S)
        until(page, SAYS.format("Hold (H): FAILED"), NOTICED_S)
        stopping.result(20.0)
        until(page, "() => radron.link?.isAlive && document.getElementById('lost').hidden", 10.0)
        assert hub.given == []


def test_a_picture_that_stands_still_is_told_though_the_link_is_alive(hub):
    with served(hub) as station, browsing(station.address) as page:
        station.call(hub.show, time.time_ns())
        until(page, "() => radron.frames > 0")
        until(page, LOST, NOTICED_S)
        assert page.locator("#lost").inner_text().startswith("NO NEW PICTURE FROM THE STATION")
        station.call(hub.show, time.time_ns())
        until(page, "() => document.getElementById('lost').hidden")
