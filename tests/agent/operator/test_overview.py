"""``radron-agent status`` and ``watch``, of drones that publish over a real mesh."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from msgspec.structs import replace

import radron.agent.operator.overview
from radron.agent.cli import main
from radron.agent.config.mission import AreaConfig, DatumConfig, DroneInMission, MissionConfig
from radron.agent.operator.overview import Overview, OverviewError, Place, place_of, show
from radron.protocol.codec import encode
from radron.protocol.identity import Role
from radron.protocol.keys import key_of
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Estimate, Obeyed, Source, Stage, Status
from radron.protocol.signing import Verifier, sign_status
from radron.protocol.trust import trust_of
from radron.sim.lockstep.members import SimulatedAuthority
from support.live.agents import free_ports
from support.mesh.identities import identity, new_issuer

MISSION = MissionConfig(
    name="m",
    swarm="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0))),
    drones=(DroneInMission(id="d1"), DroneInMission(id="d2")),
    datum=DatumConfig(latitude_deg=50.0, longitude_deg=14.0),
)
PROGRAM = Path(sys.executable).parent / "radron-agent"


def status(drone="d1", **changes):
    given = {"stage": Stage.TRACK, "battery": 0.9, "problems": ("the camera is cold",), **changes}
    return Status(stamp_ns=time.time_ns(), drone=drone, mission=MISSION.mission_id, boot="0" * 16, **given)


def estimate(drone="d1", x=10.0):
    source = Source(position_m=(x, 20.0, 0.0), covariance_m2=(0.09, 0.0, 0.0, 0.16, 0.0, 0.01), nuclide="Cs-137", activity_bq=3e9)
    digest = "ab" * 16
    return Estimate(stamp_ns=1, drone=drone, mission=MISSION.mission_id, estimator="bayes", digest=digest, sources=(source,))


def overview(*messages, now_s=(100.0,), mission=MISSION, verifier=None):
    times = iter(now_s)
    last = [100.0]

    def clock_s():
        last[0] = next(times, last[0])
        return last[0]

    seen = Overview(mission, clock_s, verifier)
    for message in messages:
        seen.receive(key_of("test", message), encode(message))
    return seen


def test_what_a_drone_has_not_signed_it_does_not_tell():
    authority = SimulatedAuthority(1)
    signed = sign_status(status("d1"), authority.trust("d1"))
    seen = overview(signed, sign_status(status("d2"), authority.trust("d1")), verifier=Verifier(authority.authority))
    assert [row[:2] for row in seen.rows()] == [("d1", "track"), ("d2", "not heard")]


def test_who_gave_the_last_order_is_told_where_its_drone_has_signed_it():
    authority, obeyed = SimulatedAuthority(1), Obeyed("hold", "anna", 1, 5)
    signed = sign_status(status(obeyed=obeyed), authority.trust("d1"))
    forged = replace(signed, obeyed=replace(signed.obeyed, station="bert"))
    verifier = Verifier(authority.authority)
    assert overview(signed, verifier=verifier).rows()[0][5] == "hold by anna"
    assert overview(forged, verifier=verifier).rows()[0][:6:5] == ("d1", "")
    assert overview(status(obeyed=obeyed)).rows()[0][5] == "hold by anna"  # a swarm without certificates


def test_an_old_status_again_changes_nothing_but_after_a_pause_a_clock_may_have_been_set_back():
    landed, tracking = (replace(status(stage=stage), stamp_ns=stamp) for stage, stamp in ((Stage.LANDED, 1), (Stage.TRACK, 2)))
    assert overview(tracking, landed).rows()[0][1] == "track"
    assert overview(landed, tracking).rows()[0][1] == "track"
    assert overview(tracking, landed, now_s=(100.0, 104.0)).rows()[0][1] == "landed"


def test_what_a_drone_says_cannot_overwrite_what_else_is_on_the_terminal():
    lying = status(problems=("\x1b[2K\x1b[1Aall well\r", "7 °C"), notices=("a\nb",), finding="none\x9b")
    seen = overview(lying)
    assert seen.rows()[0][-1] == "?[2K?[1Aall well?; 7 °C; a?b"
    assert seen.sources() == ["none?"]


def test_estimates_are_taken_only_where_nobody_can_publish_them_under_another_name():
    seen = overview(status())
    seen.receive(key_of("test", estimate()), encode(estimate()), vouched=False)
    assert seen.sources() == ["no source found yet"]
    seen.receive(key_of("test", estimate()), encode(estimate()))
    assert "source at (10.00, 20.00) m" in seen.sources()[0]


@pytest.mark.parametrize("with_mission", [False, True])
def test_an_observer_that_forges_a_drones_estimate_is_not_believed(tmp_path, monkeypatch, with_mission):
    """Also where no mission file names the drones: they are known by their statuses then."""
    monkeypatch.setattr("radron.agent.operator.overview.LISTEN_S", 1.5)
    issuer = new_issuer("test")
    d1 = identity(issuer, tmp_path, "d1")
    eve, anna = (identity(issuer, tmp_path, name, Role.OBSERVER) for name in ("eve", "anna"))
    ends = [f"tls/127.0.0.1:{port}" for port in free_ports(2)]
    monkeypatch.setattr("radron.agent.operator.overview.load_mission", lambda _: MISSION)

    async def tell(mesh, own):
        forged = estimate(x=50.0)
        while True:
            for message in (sign_status(status(), trust_of(own)), estimate()) if own is d1 else (forged,):
                mesh.publish(key_of("test", message), encode(message))
            await asyncio.sleep(0.1)

    async def course():
        async with AsyncExitStack() as stack:
            for own, listen in ((d1, ends[0]), (eve, ends[1])):
                drone = own.own.name if own is d1 else None
                mesh = await Mesh.open(MeshConfig(listen=listen, identity=own), "test", drone, receive=lambda *_: None)
                stack.push_async_callback(mesh.close)
                telling = asyncio.create_task(tell(mesh, own))
                stack.callback(telling.cancel)
            mission = tmp_path / "mission.toml" if with_mission else None
            return await show(Place("test", tuple(ends), anna.folder, mission), None)

    (line,) = asyncio.run(course()).sources()
    assert line.startswith("d1: source at (10.00, 20.00) m")


def test_each_drone_has_a_line_also_one_that_is_not_heard():
    seen = overview(status(), estimate())
    (heard, unheard) = seen.rows()
    assert heard == ("d1", "track", "90%", "0.0 s", "abababab", "", "the camera is cold")
    assert unheard == ("d2", "not heard", "", "", "", "", "")


def test_a_drone_that_falls_silent_is_told_and_its_estimate_left_out():
    seen = overview(status(), estimate(), now_s=(100.0, 100.0, 110.0))
    assert seen.rows()[0][3] == "NOT HEARD for 10 s"
    assert seen.sources() == ["no source found yet"]


def test_the_source_is_told_in_metres_and_on_earth_once_where_drones_agree():
    seen = overview(estimate("d1"), estimate("d2"))
    (line,) = seen.sources()
    assert line == "d1, d2: source at (10.00, 20.00) m, 1 sigma 0.50 m, 50.0001798, 14.0001395 (WGS84), Cs-137 3e+09 Bq"
    assert len(overview(estimate("d1"), estimate("d2", x=11.0)).sources()) == 2


def test_a_source_whose_nuclide_is_none_of_the_candidates_is_told_by_its_lines():
    told = estimate("d1")
    nameless = replace(told.sources[0], nuclide=None, activity_bq=None, lines_kev=(136, 265))
    (line,) = overview(replace(told, sources=(nameless,))).sources()
    assert line.endswith("(WGS84), nuclide unknown, lines at 136, 265 keV")


def test_a_finding_is_told_where_nothing_was_found():
    assert overview(status(finding="no source above 50 MBq")).sources() == ["no source above 50 MBq"]


def test_without_a_mission_file_there_is_no_latitude_and_only_who_is_heard():
    seen = overview(status(), estimate(), mission=None)
    assert [row[0] for row in seen.rows()] == ["d1"]
    assert "WGS84" not in seen.sources()[0]


def test_invalid_messages_are_left_out():
    seen = overview()
    seen.receive("nonsense", b"\xc1")
    seen.receive(key_of("test", status()), b"\xc1")
    assert not seen.heard


@pytest.mark.parametrize(("identity", "insecure"), [(None, False), (Path("x"), True)])
def test_it_must_be_told_whether_links_are_encrypted(identity, insecure):
    with pytest.raises(OverviewError, match="--identity or --insecure: give one of them"):
        place_of("test", ("tcp/127.0.0.1:1",), identity, insecure, None)


async def publish_until(endpoint, done):
    mesh = await Mesh.open(MeshConfig(listen=endpoint), "test", "d1", receive=lambda key, payload: None)
    try:
        while not done.is_set():
            for message in (status(), estimate()):
                mesh.publish(key_of("test", message), encode(message))
            await asyncio.sleep(0.1)
    finally:
        await mesh.close()


@pytest.fixture
def radron_agent(monkeypatch, capsys):
    """The command in this process: its exit code, and its output."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["radron-agent", *arguments, "--swarm", "test", "--insecure"])
        monkeypatch.setenv("COLUMNS", "200")
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code or 0, capsys.readouterr()

    return run


def beside_a_drone(course):
    """The result of a course beside a drone at an endpoint; ``course(endpoint, done)`` ends all publishing by ``done``."""

    async def run():
        endpoint, done = f"tcp/127.0.0.1:{free_ports(1)[0]}", asyncio.Event()
        publishing = asyncio.create_task(publish_until(endpoint, done))
        try:
            return await course(endpoint, done)
        finally:
            done.set()
            await publishing

    return asyncio.run(run())


def test_status_prints_what_a_swarm_tells(radron_agent, monkeypatch):
    monkeypatch.setattr(radron.agent.operator.overview, "LISTEN_S", 1.0)
    code, said = beside_a_drone(lambda endpoint, _: asyncio.to_thread(radron_agent, "status", "--connect", endpoint))
    assert (code, said.err) == (0, "")
    assert "d1" in said.out
    assert "the camera is cold" in said.out
    assert "source at (10.00, 20.00) m" in said.out


def test_watch_goes_on_until_it_is_interrupted():
    async def course(endpoint, done):
        command = [str(PROGRAM), "watch", "--swarm", "test", "--connect", endpoint, "--insecure"]
        environment, said = {**os.environ, "COLUMNS": "200"}, b""
        process = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE, env=environment)
        try:
            async with asyncio.timeout(60.0):
                while chunk := await process.stdout.read(4096):
                    said += chunk
                    if b"source at" in said and not done.is_set():
                        process.send_signal(signal.SIGINT)
                        done.set()
                return said.decode(), await process.wait()
        finally:
            if process.returncode is None:
                process.kill()

    said, code = beside_a_drone(course)
    assert code == 0
    assert "source at (10.00, 20.00) m" in said


def test_nobody_heard_ends_in_one_line(radron_agent, monkeypatch):
    monkeypatch.setattr(radron.agent.operator.overview, "LISTEN_S", 0.1)
    code, said = radron_agent("status", "--connect", f"tcp/127.0.0.1:{free_ports(1)[0]}")
    assert code == 2
    assert said.err.count("\n") == 1
    assert "nothing heard from any drone of the swarm 'test'" in said.err
