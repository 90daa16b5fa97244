"""The operator's commands on the page: their addressees and their outcome, always in sight."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from support.page.browser import browsing, needs_browser, until
from support.page.served_page import served

pytestmark = [needs_browser, pytest.mark.slow]
MANY = tuple(DroneInMission(id=f"d{number + 1}", origin_m=(5.0 * number, 0.0, 0.0)) for number in range(12))
MISSION = MissionConfig(name="m", area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))), drones=MANY[:3])


def operators(mission):
    """A hub of an operator; ``given``: commands."""
    hub = Hub(Picture(mission, None), replay=False)
    hub.given = []
    hub.command = lambda action, drones, age_s: hub.given.append((str(action), drones)) or ""
    return hub


def told(page, text):
    until(page, f"() => document.getElementById('told').textContent.includes('{text}')")
    return page.locator("#told").get_attribute("class")


def test_what_became_of_a_command_stands_beside_the_buttons():
    hub = operators(MISSION)
    with served(hub) as station, browsing(station.address, 820, 1180) as page:
        until(page, "() => radron.link?.isAlive")
        page.locator("#command-hold").click()
        assert told(page, "Hold (H): given to the station") == ""
        station.call(hub.tell, "hold: d1 hold, d2 hold, d3 hold", False)
        assert told(page, "00:00:00 hold: d1 hold, d2 hold, d3 hold") == ""
        station.call(hub.tell, "not started: d2: no satellites", True)
        assert told(page, "not started: d2: no satellites") == "warning"
        assert page.locator("#told").bounding_box()["y"] < 300  # not below what must be scrolled to
        assert page.locator("#said").inner_text() == "not started: d2: no satellites"  # spoken by a screen reader


def test_a_command_that_reaches_nobody_is_told_so():
    hub = operators(MISSION)
    with served(hub) as station, browsing(station.address) as page:
        for drone in MISSION.drones:
            page.locator(f"#to-{drone.id}").uncheck()
        page.keyboard.press("h")
        assert told(page, "Hold (H): NOT SENT, no drone is chosen") == "warning"
        page.locator("#to-d2").check()
        page.evaluate("() => Object.defineProperty(radron.link, 'socket', { get: () => null })")
        page.keyboard.press("h")
        assert told(page, "NOT SENT, there is no link to the station") == "warning"
        assert hub.given == []


def test_the_choice_of_drones_outlasts_a_lost_connection():
    hub = operators(MISSION)
    with served(hub) as station, browsing(station.address) as page:
        page.locator("#to-d1").uncheck()
        page.evaluate("() => { radron.first = radron.link.socket; radron.first.close(); }")
        until(page, "() => radron.link.socket !== radron.first && radron.link?.isAlive")
        page.keyboard.press("h")
        until(page, "() => document.getElementById('told').textContent.includes('given')")
        assert not page.locator("#to-d1").is_checked()
        while not hub.given:
            page.wait_for_timeout(10)
        assert hub.given == [("hold", ("d2", "d3"))]


def test_many_drones_are_folded_away_and_chosen_together():
    hub = operators(replace(MISSION, drones=MANY))
    with served(hub) as station, browsing(station.address, 820, 1180) as page:
        chosen = page.locator("#addressees summary")
        until(page, "() => document.querySelector('#addressees summary')?.textContent === 'to all 12 drones'")
        assert page.locator("#commands").bounding_box()["height"] < 200
        assert page.locator("#to-d12").is_hidden()
        until(page, "() => radron.link?.isAlive")
        chosen.click()
        page.locator("#choose-none").click()
        page.locator("#to-d12").check()
        assert chosen.inner_text() == "to 1 of 12 drones"
        page.locator("#command-hold").click()
        until(page, "() => document.getElementById('told').textContent.includes('given')")
        while not hub.given:
            page.wait_for_timeout(10)
        assert hub.given == [("hold", ("d12",))]
