"""Cursor on Target, received on real sockets and read by an XML parser."""

import asyncio
import math
import socket
import ssl
from datetime import UTC, datetime, timedelta
from xml.etree import ElementTree

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from msgspec.structs import replace

from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.agent.frames.geodesy import mission_from_geodetic
from radron.station.picture.frame import DroneFrame, Frame, SourceFrame
from radron.station.picture.picture import Picture
from radron.station.picture.shapes import cordon_radius_m
from radron.station.viewers import tak
from radron.station.viewers.cot import CursorOnTarget
from radron.station.viewers.tak import Tak, TakError

DATUM = DatumConfig(latitude_deg=-33.9, longitude_deg=18.4, altitude_m=120.0)
MISSION = MissionConfig(
    name="<script>alert(1)</script>",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))),
    drones=(DroneInMission(id="d1"), DroneInMission(id="d2")),
    datum=DATUM,
)
AT_MS = 1_800_000_000_500
D1 = DroneFrame(
    id="d1",
    stage="survey",
    place=(10.0, 20.0, 8.0),
    yaw=0.5 * math.pi,  # north
    speed_mps=2.5,
    sigma_m=0.3,
    battery=0.755,
    alive=True,
    stale=False,
    problems=('<b>"cold"</b> & \x00\x1b wet',),
)
SILENT = DroneFrame(id="d2", place=(1.0, 1.0, 1.0), stale=True)
SOURCE = SourceFrame(
    place=(30.0, 12.0, 0.5),
    covariance_m2=(0.04, 0.0, 0.0, 0.01, 0.0, 0.0025),
    rms_m=0.22,
    region=(0.43, 0.21, 0.0),
    velocity_mps=(0.0, 0.0),
    cones=40,
    nuclide="Cs-137",
    activity_bq=4.0e8,
    activity_sigma_bq=2.0e7,
    dose_usvph=36.4,
)
FRAME = Frame(at_ms=AT_MS, drones=(D1, SILENT), source=SOURCE)


def sent(url, frames, receive):
    """Data that ``receive()`` gets after the frames have been shown."""

    async def course():
        outlet = Tak(Picture(MISSION, None), url, print)
        sending = asyncio.create_task(outlet.run())
        for frame in frames:
            outlet.show(frame, [], [])
        try:
            async with asyncio.timeout(20.0):
                return await receive()
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    return asyncio.run(course())


@pytest.fixture
def events():
    """Events of one frame by the ends of their names, received over UDP."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.setblocking(False)

    async def receive():
        loop = asyncio.get_running_loop()
        return [await loop.sock_recv(receiver, 65_536) for _ in range(4)]

    with receiver:
        packets = sent(f"udp://127.0.0.1:{receiver.getsockname()[1]}", [FRAME], receive)
    parsed = [ElementTree.fromstring(packet) for packet in packets]
    return {event.get("uid").rpartition(".")[2]: event for event in parsed}


def place_of(event):
    point = event.find("point")
    return mission_from_geodetic(DATUM, *(float(point.get(key)) for key in ("lat", "lon", "hae")))


def seconds(event, key):
    return datetime.strptime(event.get(key), "%Y-%m-%dT%H:%M:%S.%fZ").replace(tzinfo=UTC).timestamp()


def test_a_heard_drone_is_where_it_is_and_one_that_is_not_heard_is_left_to_become_stale(events):
    assert set(events) == {"d1", "source", "region", "cordon"}
    drone = events["d1"]
    assert (drone.tag, drone.get("version"), drone.get("type")) == ("event", "2.0", "a-f-A-M-H-Q")
    assert place_of(drone) == pytest.approx(D1.place, abs=0.01)  # CoT's heights have centimetres
    assert float(drone.find("point").get("ce")) == D1.sigma_m
    assert drone.find("detail/contact").get("callsign") == "d1"
    track = drone.find("detail/track")
    assert (float(track.get("course")), float(track.get("speed"))) == (0.0, 2.5)
    assert drone.find("detail/status").get("battery") == "76"


def test_events_are_of_the_frames_time_and_become_stale(events):
    for name, event in events.items():
        assert seconds(event, "time") == seconds(event, "start") == AT_MS / 1e3
        assert seconds(event, "stale") - seconds(event, "time") == (5.0 if name == "d1" else 15.0)


def test_markup_and_control_characters_are_told_as_text(events):
    assert events["d1"].find("detail/remarks").text == 'survey; <b>"cold"</b> & \ufffd\ufffd wet'
    assert not [element for event in events.values() for element in event.iter() if element.tag in ("b", "script")]


def test_the_source_has_its_region_and_its_cordon(events):
    source, region, cordon = events["source"], events["region"], events["cordon"]
    assert place_of(source) == pytest.approx(SOURCE.place, abs=0.01)
    assert (source.find("point").get("ce"), source.find("point").get("le")) == ("0.22", "0.05")
    assert "Cs-137" in source.find("detail/remarks").text
    assert "4e+08 +- 2e+07 Bq" in source.find("detail/remarks").text
    points = [tuple(map(float, link.get("point").split(","))) for link in region.findall("detail/link")]
    corners = [mission_from_geodetic(DATUM, *point, 120.5) for point in points]
    assert corners[0] == pytest.approx(corners[-1])  # closed
    for x, y, _ in corners:
        assert math.hypot((x - 30.0) / 0.43, (y - 12.0) / 0.21) == pytest.approx(1.0, abs=0.02)  # 8 decimals: 1 mm
    ellipse = cordon.find("detail/shape/ellipse")
    radius_m = cordon_radius_m("Cs-137", SOURCE.activity_bq)
    assert float(ellipse.get("major")) == float(ellipse.get("minor")) == pytest.approx(radius_m, abs=0.005)
    assert place_of(cordon) == pytest.approx(SOURCE.place, abs=0.01)


def test_each_of_several_sources_has_its_mark_region_and_cordon_under_a_uid_of_its_own():
    cot = CursorOnTarget(DATUM, Picture(MISSION, None).about(replay=False))
    other = replace(SOURCE, place=(5.0, 35.0, 0.0), nuclide="Co-60", region=(1.2, 0.4, 0.5), number=2)
    weak = replace(SOURCE, place=(50.0, 2.0, 0.0), nuclide="Ir-192", activity_bq=None, dose_usvph=None, number=5)

    def sent(frame):
        events = [ElementTree.fromstring(event) for event in cot.sources(frame)]
        return {event.get("uid").rpartition(".")[2]: event for event in events}

    found = sent(Frame(at_ms=AT_MS, drones=(), source=SOURCE, others=(other, weak)))
    assert set(found) == {
        *("source", "region", "cordon", "source-2", "region-2", "cordon-2"),
        *("source-5", "region-5"),  # activity unknown
    }
    assert place_of(found["source-2"]) == pytest.approx(other.place, abs=0.01)
    assert found["source-2"].find("detail/contact").get("callsign") == "source 2 Co-60"
    corners = [link.get("point").split(",") for link in found["region-2"].findall("detail/link")]
    places = [mission_from_geodetic(DATUM, float(lat), float(lon), DATUM.altitude_m) for lat, lon in corners]
    reach = [math.dist(place[:2], other.place[:2]) for place in places]
    assert (max(reach), min(reach)) == pytest.approx((1.2, 0.4), abs=0.01)
    swapped = sent(Frame(at_ms=AT_MS, drones=(), source=other, others=(SOURCE,)))
    assert {uid: place_of(event) for uid, event in swapped.items()} == {uid: place_of(found[uid]) for uid in swapped}


def test_a_lost_link_is_told_once_and_made_again(monkeypatch):
    monkeypatch.setattr(tak, "RECONNECT_S", 0.01)
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    told, lines = [], []

    async def course():
        outlet = Tak(Picture(MISSION, None), f"tcp://127.0.0.1:{port}", lambda line, warning: told.append((line, warning)))
        sending = asyncio.create_task(outlet.run())

        async def until(condition):
            number = 0
            while not condition():
                number += 1
                outlet.show(replace(FRAME, at_ms=AT_MS + 5000 * number), [], [])
                await asyncio.sleep(0.01)

        async def serve(reader, writer):
            lines.append(await reader.readuntil(b"</event>"))
            writer.close()

        async with asyncio.timeout(20.0):
            await until(lambda: told)  # no listener
            async with await asyncio.start_server(serve, "127.0.0.1", port):
                await until(lambda: len(lines) > 1)  # the server has ended the first connection
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)

    asyncio.run(course())
    assert all(ElementTree.fromstring(line).tag == "event" for line in lines)
    assert ["trying again" in line for line, _ in told[:3]] == [True, False, True]
    assert [warning for _, warning in told[:3]] == [True, False, True]


def test_what_waits_for_a_lost_link_is_bounded(monkeypatch):
    monkeypatch.setattr(tak, "MAX_WAITING_EVENTS", 10)
    outlet = Tak(Picture(MISSION, None), "tcp://127.0.0.1:9", print)
    for number in range(20):
        outlet.show(replace(FRAME, at_ms=AT_MS + 1000 * number), [], [])
    assert outlet.waiting == 10


def test_a_mission_without_a_place_on_earth_is_refused():
    with pytest.raises(TakError, match=r"the mission has no \[datum\]"):
        Tak(Picture(replace(MISSION, datum=None), None), "udp://239.2.3.1:6969", print)


@pytest.mark.parametrize(
    "url", ["", "239.2.3.1:6969", "udp://239.2.3.1", "http://a:1", "file:///tmp/x", "tcp://:1", "udp://a:99999", "udp://a:0"]
)
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(TakError, match=r"give udp, tcp, tls://HOST:PORT"):
        Tak(Picture(MISSION, None), url, print)


def test_tls_without_a_certificate_is_refused_before_anything_is_begun(monkeypatch):
    monkeypatch.delenv("PYTAK_TLS_CLIENT_CERT", raising=False)
    with pytest.raises(TakError, match="name a PEM file in the environment variable PYTAK_TLS_CLIENT_CERT"):
        Tak(Picture(MISSION, None), "tls://tak.example:8089", print)


def authority_of(name, folder):
    """A self-signed certificate and its key, as PEM files."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    now = datetime.now(UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(now)
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(name)]), critical=False)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(key, hashes.SHA256())
    )
    files = folder / f"{name}.pem", folder / f"{name}.key"
    files[0].write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    private = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    files[1].write_bytes(key.private_bytes(serialization.Encoding.PEM, *private))
    return files


@pytest.mark.parametrize("known", [True, False])
def test_a_server_is_reached_by_tls_with_both_certificates_checked(tmp_path, monkeypatch, known):
    (server_pem, server_key), (client_pem, client_key) = authority_of("localhost", tmp_path), authority_of("station", tmp_path)
    monkeypatch.setenv("PYTAK_TLS_CLIENT_CERT", str(client_pem))
    monkeypatch.setenv("PYTAK_TLS_CLIENT_KEY", str(client_key))
    monkeypatch.setenv("PYTAK_TLS_CLIENT_CAFILE", str(server_pem if known else client_pem))
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(server_pem, server_key)
    server.load_verify_locations(client_pem)
    server.verify_mode = ssl.CERT_REQUIRED
    came, told = [], []

    async def course():
        async def serve(reader, writer):
            came.append(await reader.readuntil(b"</event>"))
            came.append(writer.get_extra_info("peercert")["subject"][0][0][1])
            writer.close()

        async with asyncio.timeout(20.0), await asyncio.start_server(serve, "localhost", 0, ssl=server) as listening:
            url = f"tls://localhost:{listening.sockets[0].getsockname()[1]}"
            outlet = Tak(Picture(MISSION, None), url, lambda line, warning: told.append(line))
            sending = asyncio.create_task(outlet.run())
            while not (told and (came or not known)):
                outlet.show(FRAME, [], [])
                await asyncio.sleep(0.01)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    asyncio.run(course())
    if known:
        assert ElementTree.fromstring(came[0]).tag == "event"
        assert came[1] == "station"
    else:
        assert "certificate verify failed" in told[0]
        assert not came
