"""Clients that must not reach the page, in a real browser; and actions forbidden to an observer's page."""

import http.server
import threading
from contextlib import contextmanager

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Pose, Stage, Status
from radron.station.hub import Hub
from radron.station.picture.picture import Picture
from support.page.browser import browsing, needs_browser, until, visiting
from support.page.served_page import first, served

pytestmark = [needs_browser, pytest.mark.slow]
MISSION = MissionConfig(
    name="m",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))),
    drones=(DroneInMission(id="d1"), DroneInMission(id="d2")),
)
BEGAN_NS = 1_800_000_000_000_000_000
# Outcome of a socket to an address: "message", or "refused".
SOCKET = """(address) => new Promise((resolve) => {
  const socket = new WebSocket(address);
  socket.addEventListener("message", () => resolve("message"));
  socket.addEventListener("close", () => resolve("refused"));
})"""
FRAME = """(address) => new Promise((resolve) => {
  const frame = Object.assign(document.createElement("iframe"), { src: address, onload: () => resolve() });
  document.body.append(frame);
})"""
FLOOD = """() => {
  for (let number = 0; number < 2000 && radron.link.socket?.readyState === WebSocket.OPEN; number += 1) {
    radron.link.socket.send('{"drawn": true}');
  }
  return document.getElementById("link").textContent.includes("NO LINK");
}"""
READ = "(address) => fetch(address).then((answer) => answer.text(), () => 'refused')"


@pytest.fixture
def hub():
    hub = Hub(Picture(MISSION, None), replay=False)
    hub.picture.appear(hub.picture.members)
    return hub


def pose(drone, at_ns):
    return Pose(
        stamp_ns=at_ns,
        drone=drone,
        epoch=0,
        position_m=(10.0, 10.0, 3.0),
        velocity_mps=(0.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )


def status(drone, at_ns):
    return Status(stamp_ns=at_ns, drone=drone, mission=MISSION.mission_id, boot="0" * 16, stage=Stage.HOLD)


def hear(hub, message, now_ns):
    hub.picture.receive(key_of(MISSION.swarm, message), encode(message), now_ns)


@contextmanager
def foreign_site():
    """Another site on this computer."""

    class Site(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<p>another site</p>")

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Site)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://localhost:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_another_sites_scripts_reach_neither_socket_nor_files_nor_show_the_page_in_a_frame(hub):
    with served(hub) as station, foreign_site() as foreign:
        own = f"http://localhost:{station.port}/"
        socket = f"ws://localhost:{station.port}/socket?token={station.token}"
        with visiting(own) as page:
            assert page.evaluate(SOCKET, socket) == "message"
            assert "connected" in page.evaluate(READ, f"{own}texts.en.json")
        with visiting(foreign) as page:
            assert page.evaluate(SOCKET, socket) == "refused"
            assert page.evaluate(READ, f"{own}texts.en.json") == "refused"
            page.evaluate(FRAME, own)
            assert len(page.frames) == 2
            assert all(frame.locator("#map").count() == 0 for frame in page.frames)
        assert hub.pages == 0


def test_a_foreign_name_that_is_made_to_point_here_is_refused(hub):
    with served(hub) as station, visiting("about:blank", "--host-resolver-rules=MAP evil.example 127.0.0.1") as page:
        answer = page.goto(f"http://evil.example:{station.port}/")
        assert answer is not None
        assert answer.status == 403
        assert page.locator("#map").count() == 0
        assert page.evaluate(SOCKET, f"ws://evil.example:{station.port}/socket?token={station.token}") == "refused"
        assert page.goto(f"http://localhost:{station.port}/").status == 200


def test_an_observers_page_has_no_command_buttons_nor_keys_and_its_requests_are_refused(hub):
    with served(hub) as station, browsing(station.address) as page:
        until(page, "() => radron.mission && radron.link.isAlive")
        assert page.locator("#commands").is_hidden()
        assert page.locator("#commands button").count() == 0
        page.keyboard.press("h")
        page.keyboard.press("r")
        page.evaluate("() => radron.link.order({ command: 'land' }, () => {})")
        until(page, "() => document.getElementById('events').textContent.includes('land: refused, this station may not command')")
        assert page.locator("#events li").count() == 1  # the keys have asked for nothing


def test_an_operators_page_has_them(hub):
    given = []
    hub.command = lambda action, drones, age_s: given.append(str(action)) or ""
    with served(hub) as station, browsing(station.address) as page:
        until(page, "() => document.querySelectorAll('#commands button').length === 6 && radron.link.isAlive")
        page.keyboard.press("h")
        page.locator("#command-land").click()
        page.locator("#confirm-yes").click()
        with station.socket() as socket:  # answered after the page's own requests
            socket.send('{"at_ms": 1}')
            first(socket, "at")
        until(page, "() => !document.getElementById('confirm').open")
        page.evaluate("() => radron.link.order({ command: 'hold', drones: ['d9'] }, () => {})")
        until(page, "() => document.getElementById('events').textContent.includes('there is no such drone')")
        assert given == ["hold", "land"]


def test_a_drone_that_falls_silent_is_marked_within_two_seconds_and_the_other_one_is_not(hub):
    with served(hub) as station, browsing(station.address) as page:
        silent_ns = BEGAN_NS + 1_000_000_000
        for tenth in range(31):
            now_ns = BEGAN_NS + tenth * 100_000_000
            for drone in ("d1", "d2") if now_ns <= silent_ns else ("d1",):
                station.call(hear, hub, pose(drone, now_ns), now_ns)
            station.call(hub.show, now_ns)
            until(page, f"() => radron.frame?.at_ms === {now_ns // 1_000_000}")
            stale = "(name) => document.getElementById(`drone-${name}`).classList.contains('stale')"
            if now_ns <= silent_ns + 1_400_000_000:
                assert not page.evaluate(stale, "d2")
            if now_ns >= silent_ns + 1_900_000_000:
                assert page.evaluate(stale, "d2")
            assert not page.evaluate(stale, "d1")


def test_the_longest_status_with_markup_is_shown_as_text_and_the_page_goes_on(hub):
    evil = ("<img src=x onerror=\"document.title='taken'\"></script><script>document.title='taken'</script>" * 3)[:256]
    longest = replace(status("d1", BEGAN_NS), problems=(evil,) * 32, notices=(evil,) * 8, finding=evil)
    with served(hub) as station, browsing(station.address) as page:
        station.call(hear, hub, longest, BEGAN_NS)
        station.call(hub.show, BEGAN_NS)
        until(page, "() => radron.frames > 0")
        assert page.locator("#drone-d1 .problem").count() == 32
        assert page.locator("main img:not(.leaflet-image-layer), main script").count() == 0
        station.call(hub.show, BEGAN_NS + 10**9)
        until(page, f"() => radron.frame.at_ms === {BEGAN_NS // 1_000_000 + 1000}")
        assert page.title() == "radron · m"


def test_a_page_that_floods_is_let_go_and_the_other_one_goes_on(hub):
    with served(hub) as station, browsing(station.address) as page, station.socket() as other:
        until(page, "() => radron.mission && radron.link.isAlive")
        until(page, FLOOD)
        first(other, "progress")
        station.call(hub.show, BEGAN_NS)
        assert first(other, "frame")["at_ms"] == BEGAN_NS // 1_000_000
