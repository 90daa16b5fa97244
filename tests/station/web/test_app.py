"""The server against whom it should not serve; each refusal beside the allowed case."""

import datetime
import json
import ssl
from contextlib import ExitStack

import psutil
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from msgspec.structs import replace
from served_page import first, served
from websockets.exceptions import ConnectionClosed, InvalidStatus

from agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from station.hub import Hub
from station.outbox import MOST_AHEAD
from station.picture.picture import Picture
from station.web.app import MOST_PAGES
from station.web.serving import Place, Serving, StationError

MISSION = MissionConfig(
    name="m", area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))), drones=(DroneInMission(id="d1"),)
)
REFUSED = (ConnectionClosed, InvalidStatus)


@pytest.fixture
def hub():
    return Hub(Picture(MISSION, None), replay=False)


@pytest.fixture
def page(hub):
    with served(hub) as found:
        yield found


def test_the_page_and_its_files_are_served_with_a_policy_against_foreign_scripts(page):
    for path in ("/", "/app.js", "/leaflet/leaflet.js", "/texts.en.json"):
        status, headers, body = page.get(path)
        assert (status, len(body) > 100) == (200, True)
        assert headers["content-security-policy"].startswith("default-src 'self'")


@pytest.mark.parametrize(
    "path", ["/../cli.py", "/%2e%2e/cli.py", "/leaflet/../../cli.py", "//etc/passwd", "/app.js/..%2f..%2fcli.py"]
)
def test_no_path_leads_out_of_the_page(page, path):
    status, _, body = page.get(path)
    assert (status, body) == (404, b"no such file")


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8087", "localhost.evil.example", "", "[::1"])
def test_a_foreign_name_that_points_here_is_refused(page, host):
    assert page.get("/", Host=host)[0] == 403
    assert page.get("/", Host="localhost")[0] == 200


def test_a_foreign_name_gets_no_socket_either(page):
    with pytest.raises(REFUSED):
        page.socket(host="evil.example")
    for own in ("localhost", "127.0.0.1", "[::1]"):
        with page.socket(host=own) as socket:
            assert first(socket, "mission")["name"] == "m"


def test_the_scripts_of_other_sites_are_refused(page):
    with page.socket(origin=f"http://localhost:{page.port}") as socket:
        assert first(socket, "mission")["name"] == "m"
    for foreign in ("http://evil.example", "http://localhost:1", "null"):
        with pytest.raises(REFUSED):
            page.socket(origin=foreign)
        assert page.get("/", Origin=foreign)[0] == 403


NO_WISHES = (
    "",
    "[]",
    "{",
    '{"at_ms": -1}',
    '{"at_ms": 1e99}',
    '{"live": 1}',
    '{"fly": true}',
    '{"command": "fly"}',
    '{"command": "land", "drones": ["D 1"]}',
    '{"draft": {"area": [], "launches": {}, "values": {"a": []}}}',
    '{"at_ms": 1' + " " * 17_000 + "}",
)


@pytest.mark.parametrize("text", NO_WISHES, ids=range(len(NO_WISHES)))
def test_a_page_that_says_what_no_page_says_is_let_go(page, text):
    with page.socket() as socket:
        first(socket, "progress")
        socket.send(text)
        with pytest.raises(ConnectionClosed):
            first(socket, "never")
    with page.socket() as socket:
        assert first(socket, "mission")["name"] == "m"


def test_bytes_that_are_no_text_end_the_page_and_no_other(page):
    with page.socket() as other, page.socket() as socket:
        first(other, "progress")
        socket.send(b"\x00" * 100)
        with pytest.raises(ConnectionClosed):
            first(socket, "never")
        other.send('{"at_ms": 1}')
        assert first(other, "at")["at_ms"] == 1


def test_nobody_else_can_connect_unless_told(page):
    listening = {one.laddr.ip for one in psutil.Process().net_connections() if one.laddr.port == page.port and not one.raddr}
    assert listening == {"127.0.0.1"}


def test_a_page_may_look_back_and_follow_again(page):
    page.call(page.hub.show, 5_000_000_000)
    with page.socket() as socket:
        first(socket, "progress")
        assert first(socket, "at")["at_ms"] == 5000  # what it begins with
        socket.send('{"live": false, "at_ms": 5500}')
        assert first(socket, "at")["at_ms"] == 5500
        assert first(socket, "frame")["at_ms"] == 5000
        assert first(socket, "spectra")["at_ms"] == 5000
        page.call(page.hub.show, 7_000_000_000)
        page.call(page.hub.report, 0.5)
        kinds = []
        while not kinds or kinds[-1] != "progress":
            kinds.append(json.loads(socket.recv(timeout=10.0))["kind"])
        assert kinds == ["overview", "progress"]  # and no frame
        socket.send('{"live": true}')
        assert first(socket, "at")["at_ms"] == 7000
        assert first(socket, "frame")["at_ms"] == 7000
        page.call(page.hub.show, 8_000_000_000)
        assert first(socket, "frame")["at_ms"] == 8000


def test_a_page_that_draws_slowly_gets_fewer_frames_and_the_newest(page):
    with page.socket() as socket:
        first(socket, "progress")
        for tenth in range(50, 100):
            page.call(page.hub.show, tenth * 100_000_000)
        page.call(page.hub.report, 0.5)
        got = []
        while not got or got[-1]["kind"] != "progress":
            got.append(json.loads(socket.recv(timeout=10.0)))
        frames = [message["at_ms"] for message in got if message["kind"] == "frame"]
        assert frames == sorted(frames)
        assert len(frames) <= MOST_AHEAD
        assert sum(message["kind"] == "overview" for message in got) == 5  # a row each second: nothing of the flight is lost
        socket.send('{"drawn": true}')
        assert first(socket, "frame")["at_ms"] == 9900


def test_an_observers_page_offers_no_commands_and_its_requests_are_refused(page):
    with page.socket() as socket:
        assert first(socket, "mission")["commands"] == []
        socket.send('{"command": "land"}')
        event = first(socket, "event")
        assert event["values"]["line"] == "land: refused, this station may not command"
        assert event["level"] == "warning"


def test_an_operators_page_commands_the_drones_that_it_names(page):
    given = []
    page.hub.command = lambda action, drones: given.append((str(action), drones))
    with page.socket() as socket:
        assert first(socket, "mission")["commands"] == ["start", "hold", "resume", "return", "land", "abort"]
        socket.send('{"command": "hold"}')
        socket.send('{"command": "land", "drones": ["d1"]}')
        socket.send('{"command": "land", "drones": ["d7"]}')
        assert first(socket, "event")["values"]["line"] == "land: refused, there is no such drone"
    assert given == [("hold", ()), ("land", ("d1",))]


DRAFT = {"area": [[0, 0], [60, 0], [60, 50]], "launches": {}, "values": {"survey.height_m": 4}, "number": 3}


def test_an_observers_page_has_no_editor_and_its_mission_is_refused(page):
    with page.socket() as socket:
        assert first(socket, "mission")["editor"] is None
        socket.send(json.dumps({"draft": DRAFT, "upload": True}))
        event = first(socket, "event")
        assert event["values"]["line"] == "refused, this station may not upload a mission"
        assert event["level"] == "warning"


def test_an_operators_mission_is_checked_and_uploaded_only_without_a_flaw(page):
    given = []
    page.hub.upload = given.append
    with page.socket() as socket:
        assert first(socket, "mission")["editor"]["launches"] == {"d1": [0.0, 0.0, 0.0]}
        wrong = {**DRAFT, "values": {"survey.height_m": 400}}
        socket.send(json.dumps({"draft": wrong, "upload": True}))
        answer = first(socket, "checked")
        assert [flaw["field"] for flaw in answer["flaws"]] == ["survey.height_m"]
        assert (answer["number"], answer["id"], answer["file"]) == (3, "", "")
        socket.send(json.dumps({"draft": DRAFT}))
        checked = first(socket, "checked")
        assert not given
        socket.send(json.dumps({"draft": DRAFT, "upload": True}))
        assert first(socket, "checked") == checked
    assert [mission.mission_id for mission in given] == [checked["id"]]
    assert given[0].area.polygon_m == ((0.0, 0.0), (60.0, 0.0), (60.0, 50.0))
    assert given[0].survey.height_m == 4.0


def test_a_mission_that_the_drones_have_taken_over_is_shown_from_then_on(page):
    new = replace(MISSION, name="new")
    page.call(page.hub.tell, "d1: has it", False, "upload")
    page.call(page.hub.show, 5_000_000_000)
    with page.socket() as socket:
        first(socket, "progress")
        page.call(page.hub.adopt, new)
        assert first(socket, "mission")["id"] == new.mission_id
    with page.socket() as socket:
        assert first(socket, "mission")["name"] == "new"
        assert [event["text"] for event in first(socket, "events")["events"]] == ["upload"]
        first(socket, "progress")
        page.call(page.hub.show, 6_000_000_000)
        assert first(socket, "overview")["rows"] == [[6000, None, None]]


def test_a_flood_of_requests_ends_the_page_and_no_other(page):
    with page.socket() as other, page.socket() as socket:
        first(other, "progress")
        with pytest.raises(ConnectionClosed):
            flood(socket)
        other.send('{"at_ms": 1}')
        assert first(other, "at")["at_ms"] == 1


def flood(socket):
    for _ in range(1000):
        socket.send('{"live": true}')
    first(socket, "never")


def test_there_is_an_end_to_the_number_of_pages(page):
    with ExitStack() as stack:
        for _ in range(MOST_PAGES):
            first(stack.enter_context(page.socket()), "mission")
        with pytest.raises(REFUSED):
            page.socket()


def test_a_page_that_reads_too_slowly_is_let_go(hub):
    with hub.joined() as page:
        for second in range(1000):
            hub.show(second * 10**9)
        assert page.gone


def test_other_computers_need_tls_and_the_token(hub, tmp_path):
    with pytest.raises(StationError, match="give --tls-certificate and --tls-key"):
        Serving(hub, Place(host="0.0.0.0", port=0))
    certificate, key = certificate_for("localhost", tmp_path)
    with served(hub, Place(host="0.0.0.0", port=0, certificate=certificate, key=key)) as page:
        tls = ssl.create_default_context(cafile=certificate)
        tls.check_hostname = False
        token = page.address.split("token=")[1]
        assert page.address.startswith("https://")
        assert page.get("/", tls)[0] == 403
        assert page.get(f"/?token={token[:-1]}", tls)[0] == 403
        status, headers, _ = page.get(f"/?token={token}", tls)
        assert status == 200
        cookie = headers["set-cookie"]
        assert {"HttpOnly", "Secure", "SameSite=strict"} <= set(cookie.split("; "))
        assert page.get("/app.js", tls, Cookie=cookie.split(";")[0])[0] == 200
        assert page.get("/app.js", tls)[0] == 403
        with pytest.raises(REFUSED):
            page.socket(tls=tls)
        with page.socket(tls=tls, additional_headers={"Cookie": cookie.split(";")[0]}) as socket:
            assert first(socket, "mission")["name"] == "m"


def test_a_port_in_use_is_told(hub, page):
    with pytest.raises(StationError, match="give another --port"):
        Serving(hub, Place(port=page.port))


def certificate_for(name, folder):
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        .sign(key, hashes.SHA256())
    )
    files = folder / "page.pem", folder / "page.key"
    files[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    encoding = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    files[1].write_bytes(key.private_bytes(*encoding))
    return files
