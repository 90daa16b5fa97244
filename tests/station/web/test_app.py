"""Refusals of the server; each refusal beside the allowed case."""

import datetime
import json
import ssl
import stat
import threading
from contextlib import ExitStack, suppress
from socket import create_connection
from urllib.parse import quote

import psutil
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from msgspec.structs import replace
from websockets.exceptions import ConnectionClosed, InvalidStatus

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.station.hub import Hub
from radron.station.outbox import GAVE_WAY, MAX_AHEAD
from radron.station.picture.picture import Picture
from radron.station.web import beat
from radron.station.web.app import MAX_PAGES
from radron.station.web.connections import MAX_CONNECTIONS
from radron.station.web.serving import Place, Serving, StationError
from radron.station.web.token import TokenError
from support.page.served_page import first, fresh, served

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
    port = page.port
    foreign = ("http://evil.example", "http://localhost:1", "null", f"ftp://localhost:{port}", f"https://localhost:{port}")
    for origin in (*foreign, "http://localhost", f"http://localhost:{port}.evil.example", "http://localhost:99999", "localhost"):
        with pytest.raises(REFUSED):
            page.socket(origin=origin)
        assert page.get("/", Origin=origin)[0] == 403


@pytest.mark.parametrize("token", ["", "x", "é"])
def test_nothing_of_the_mission_is_given_without_the_token(page, token):
    """Any other process or user of this computer can connect."""
    with pytest.raises(REFUSED):
        page.socket(token=token)
    for path in ("/report.zip", "/layer.json", "/tiles/1/1/1"):
        assert page.get(f"{path}?token={quote(token)}")[0] == 403
        assert page.get(f"{path}?token={page.token}")[0] != 403
    with page.socket() as socket:
        assert first(socket, "mission")["name"] == "m"


def test_each_start_has_a_token_of_its_own_unless_a_file_has_it(hub, tmp_path):
    file = tmp_path / "page.token"
    with served(hub) as one, served(hub) as other:
        assert one.token != other.token
    with served(hub, Place(port=0, token_file=file)) as one:
        assert (file.read_text().strip(), stat.S_IMODE(file.stat().st_mode)) == (one.token, 0o600)
    with served(hub, Place(port=0, token_file=file)) as again:
        assert again.token == one.token


WRONG_FILES = {
    "readable": ("x" * 22, 0o644, "others can read or change it .mode 644.; run `chmod 600 "),
    "short": ("x" * 21, 0o600, "holds no token"),
    "binary": ("\0" * 30, 0o600, "holds no token"),
    "two lines": ("x" * 22 + "\n" + "x" * 22, 0o600, "holds no token"),
}


@pytest.mark.parametrize("wrong", WRONG_FILES)
def test_a_token_file_that_is_no_secret_is_refused(hub, tmp_path, wrong):
    text, mode, says = WRONG_FILES[wrong]
    file = tmp_path / "page.token"
    file.write_text(text)
    file.chmod(mode)
    with pytest.raises(TokenError, match=says):
        Serving(hub, Place(port=0, token_file=file))
    with pytest.raises(TokenError, match="cannot be used"):
        Serving(hub, Place(port=0, token_file=tmp_path / "nowhere" / "page.token"))


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
        assert first(socket, "at")["at_ms"] == 5000  # first frame
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
        assert len(frames) <= MAX_AHEAD
        assert sum(message["kind"] == "overview" for message in got) == 5  # a row each second: nothing of the flight is lost
        socket.send('{"drawn": true}')
        assert first(socket, "frame")["at_ms"] == 9900


def test_an_observers_page_offers_no_commands_and_its_requests_are_refused(page):
    with page.socket() as socket:
        assert first(socket, "mission")["commands"] == []
        socket.send(json.dumps({"command": "land", "stamp": fresh(socket), "number": 7}))
        event = first(socket, "event")
        assert event["values"]["line"] == "land: refused, this station may not command"
        assert event["level"] == "warning"
        assert first(socket, "answer") == {"kind": "answer", "number": 7, "refused": event["values"]["line"]}


def test_an_operators_page_commands_the_drones_that_it_names(page):
    given = taking(page.hub)
    with page.socket() as socket:
        assert first(socket, "mission")["commands"] == ["start", "hold", "resume", "return", "land", "abort"]
        now = fresh(socket)
        assert ordered(socket, now, command="hold") == ""
        assert ordered(socket, now, command="land", drones=["d1"]) == ""
        assert ordered(socket, now, command="land", drones=["d7"]) == "land: refused, there is no such drone"
    assert given == [("hold", ()), ("land", ("d1",))]


def taking(hub):
    """Commands to a station that may command."""
    given = []

    def take(action, drones, age_s):
        assert 0.0 <= age_s <= beat.MAX_COMMAND_AGE_S
        given.append((str(action), drones))
        return ""

    hub.command = take
    return given


def ordered(socket, now, **order):
    """Why an order is refused; empty: it is not."""
    socket.send(json.dumps({"stamp": now, "number": 3, **order}))
    answer = first(socket, "answer")
    assert answer["number"] == 3
    return answer["refused"]


TOO_OLD = "refused, it was given more than 2 s ago: give it again"


def test_a_command_that_was_held_back_for_two_seconds_is_refused_and_told(page, monkeypatch):
    """The link or the station has stalled meanwhile; the clocks of browser and station have nothing to do with it."""
    given, clock_ms = taking(page.hub), [1_000_000.5]
    monkeypatch.setattr(beat, "elapsed_s", lambda: clock_ms[0] * 1e-3)
    with page.socket() as socket, page.socket() as other:
        now = fresh(socket)
        clock_ms[0] += 2000
        assert ordered(socket, now, command="hold") == ""
        clock_ms[0] += 1
        assert ordered(socket, now, command="hold") == f"hold: {TOO_OLD}"
        line = first(other, "event")["values"]["line"]
        assert line == f"hold: {TOO_OLD}"
        assert ordered(socket, now + 10_000, command="land") == f"land: {TOO_OLD}"  # no stamp of this station
        assert ordered(socket, None, command="land") == f"land: {TOO_OLD}"
        assert ordered(socket, fresh(socket), command="land") == ""
    assert [action for action, _ in given] == ["hold", "land"]


def test_commands_in_the_buffers_of_a_socket_whose_station_was_stopped_are_refused(page):
    given = taking(page.hub)
    with page.socket() as socket:
        now = fresh(socket)
        stopped, stop = threading.Event(), threading.Event()

        def stand_still():
            stopped.set()
            stop.wait(30.0)

        stopping = threading.Thread(target=page.call, args=(stand_still,))
        stopping.start()
        stopped.wait()
        socket.send(json.dumps({"command": "hold", "stamp": now, "number": 1}))
        while beat.age_s(now) is not None:
            stop.wait(0.05)
        stop.set()
        stopping.join()
        assert first(socket, "answer")["refused"] == f"hold: {TOO_OLD}"
    assert given == []


def test_a_heartbeat_is_answered_with_its_own_time_and_does_not_wait_for_pictures(page):
    with page.socket() as socket:
        for tenth in range(2 * MAX_AHEAD):
            page.call(page.hub.show, tenth * 100_000_000)
        socket.send('{"beat": 4711}')
        assert first(socket, "beat")["beat"] == 4711


DRAFT = {"area": [[0, 0], [60, 0], [60, 50]], "launches": {}, "values": {"survey.height_m": 4}, "number": 3}


def test_an_observers_page_has_no_editor_and_its_mission_is_refused(page):
    with page.socket() as socket:
        assert first(socket, "mission")["editor"] is None
        socket.send(json.dumps({"draft": DRAFT, "upload": True, "stamp": fresh(socket)}))
        event = first(socket, "event")
        assert event["values"]["line"] == "refused, this station may not upload a mission"
        assert event["level"] == "warning"


def test_an_operators_mission_is_checked_and_uploaded_only_without_a_flaw(page):
    given = []
    page.hub.upload = lambda mission, age_s: given.append(mission) or ""
    with page.socket() as socket:
        assert first(socket, "mission")["editor"]["launches"] == {"d1": [0.0, 0.0, 0.0]}
        wrong = {**DRAFT, "values": {"survey.height_m": 400}}
        now = fresh(socket)
        socket.send(json.dumps({"draft": wrong, "upload": True, "stamp": now}))
        answer = first(socket, "checked")
        assert [flaw["field"] for flaw in answer["flaws"]] == ["survey.height_m"]
        assert (answer["number"], answer["id"], answer["file"]) == (3, "", "")
        socket.send(json.dumps({"draft": DRAFT}))
        checked = first(socket, "checked")
        assert not given
        assert ordered(socket, now - 2001, draft=DRAFT, upload=True) == TOO_OLD
        assert not given
        socket.send(json.dumps({"draft": DRAFT, "upload": True, "stamp": fresh(socket)}))
        assert first(socket, "checked") == checked
        assert first(socket, "answer")["refused"] == ""
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


def test_of_too_many_pages_the_one_that_has_been_idle_the_longest_gives_way(page):
    """Such requests locked the operator out."""
    with ExitStack() as stack:
        sockets = [stack.enter_context(page.socket()) for _ in range(MAX_PAGES)]
        for socket in sockets:
            first(socket, "mission")
        for socket in (*sockets[:4], *sockets[5:]):
            socket.send('{"live": true}')  # its operator does something
            fresh(socket)
        assert first(stack.enter_context(page.socket()), "mission")["name"] == "m"
        with pytest.raises(ConnectionClosed) as closed:
            first(sockets[4], "never")
        assert closed.value.rcvd.code == GAVE_WAY
        fresh(sockets[3])
        assert page.hub.pages == MAX_PAGES


def test_half_requests_of_other_processes_take_neither_the_descriptors_of_the_station_nor_its_pages(page):
    """A thousand of them locked the operator out, and filled the log with errors."""
    with ExitStack() as stack, page.socket() as socket:
        first(socket, "progress")
        half = [stack.enter_context(create_connection(("127.0.0.1", page.port), 10.0)) for _ in range(MAX_CONNECTIONS)]
        for one in half:
            one.sendall(b"GET / HT")
        assert page.get("/")[0] == 200
        for _ in range(MAX_CONNECTIONS):
            stack.enter_context(create_connection(("127.0.0.1", page.port), 10.0)).sendall(b"GET / HT")
            assert page.get("/")[0] == 200
        with suppress(ConnectionResetError):
            assert half[0].recv(1) == b""
        fresh(socket)  # not an idle connection


def test_a_page_that_reads_too_slowly_is_let_go(hub):
    with hub.joined(1) as page:
        for second in range(1000):
            hub.show(second * 10**9)
        assert page.left.is_set()


def test_other_computers_need_tls_and_the_token(hub, tmp_path):
    with pytest.raises(StationError, match="give --tls-certificate and --tls-key"):
        Serving(hub, Place(host="0.0.0.0", port=0))
    certificate, key = certificate_for("localhost", tmp_path)
    with served(hub, Place(host="0.0.0.0", port=0, certificate=certificate, key=key)) as page:
        tls = ssl.create_default_context(cafile=certificate)
        tls.check_hostname = False
        assert page.address.startswith("https://")
        assert page.get("/layer.json", tls)[0] == 403
        assert page.get(f"/layer.json?token={page.token[:-1]}", tls)[0] == 403
        assert page.get(f"/layer.json?token={page.token}", tls)[0] == 200
        with pytest.raises(REFUSED):
            page.socket(tls=tls, token="")
        with page.socket(tls=tls, origin=f"https://localhost:{page.port}") as socket:
            assert first(socket, "mission")["name"] == "m"
        with pytest.raises(REFUSED):
            page.socket(tls=tls, origin=f"http://localhost:{page.port}")


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
