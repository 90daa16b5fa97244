"""``radron-agent preflight`` finds what ``run`` would refuse, and says what to do."""

from __future__ import annotations

import asyncio
import os
import pty
import time
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.config.drone import PeerMeshConfig
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.detector.wire import pack
from radron.agent.mission.memory import Memory
from radron.agent.preflight.check import Preflight
from radron.agent.shell.links import mesh_config
from radron.agent.shell.overrides import load_drone
from radron.agent.shell.statestore import State, StateFile
from radron.agent.vehicle.interface import Finding
from radron.agent.vehicle.mavlink.device import is_new
from radron.protocol.codec import decode, encode
from radron.protocol.mesh.session import Mesh, MeshConfig
from radron.protocol.messages import Stage
from radron.protocol.revocations import Revoked
from support.flights.members import revocation
from support.live.agents import Agent, free_ports, write_configs
from support.mesh.identities import DAY_NS, identity, new_issuer


def finding(folder: Path, name: str, **environment: str) -> Finding:
    """A finding, once it is more than "not yet"."""
    check = Preflight(*load_drone(folder / "d1.toml", environment))

    def found() -> Finding:
        return next(finding for finding in check.findings if finding.name == name)

    async def look() -> None:
        running = asyncio.create_task(check.run(60.0, lambda findings: None))
        while found().verdict == "not yet":
            assert not running.done()
            await asyncio.sleep(0.02)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(look())
    return found()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_configs(tmp_path, 2, connect_timeout_s=0.2)
    return tmp_path


def test_an_unknown_nuclide(folder: Path) -> None:
    mission = folder / "mission.toml"
    mission.write_text('nuclide = "Xx-1"\n' + mission.read_text())
    told = finding(folder, "mission")
    assert told.verdict == "failed"
    assert told.text.startswith("nuclide 'Xx-1'")
    agent = Agent(folder, "d1")
    try:
        assert agent.ended(60.0) == 2
        assert f"radron-agent: {told.text}" in agent.log.splitlines()
    finally:
        agent.close()


def test_the_ground_that_the_mission_states(folder: Path) -> None:
    mission = folder / "mission.toml"
    assert finding(folder, "mission").text.endswith('over an empty ground (fusion.ground = "none")')
    mission.write_text('fusion.ground = "soil"\n' + mission.read_text())
    over_soil = finding(folder, "mission")
    assert (over_soil.verdict, over_soil.text.split(", ")[-1]) == ("ok", "over soil")
    mission.write_text('fusion.estimator = "sources"\nsource_height_m = [0.0, 5.0]\n' + mission.read_text())
    assert finding(folder, "mission").text.endswith("over soil: the errors of sources above the ground are larger than stated")


def test_folders_that_take_no_files(folder: Path) -> None:
    (folder / "taken").write_text("a file")
    state = finding(folder, "state", RADRON_STATE=str(folder / "taken/state"))
    assert (state.verdict, state.text) == ("failed", f"{folder}/taken/state: cannot be written to: Not a directory")
    records = finding(folder, "flight records", RADRON_RECORDER__FOLDER=str(folder / "taken"))
    assert (records.verdict, records.text) == ("failed", f"{folder}/taken: cannot be written to: File exists")


def test_a_file_in_the_states_place_is_named_and_stays(folder: Path) -> None:
    (folder / "state").mkdir()
    (folder / "state/d1.json").write_text("[my notes]")
    state = finding(folder, "state")
    assert state.verdict == "failed"
    assert f"{folder}/state/d1.json is not a readable state file" in state.text
    assert (folder / "state/d1.json").read_text() == "[my notes]"


def test_the_state_of_another_mission_is_named(folder: Path) -> None:
    memory = Memory(mission="0" * 16, stamp_ns=5, started_ns=3, stage=Stage.SURVEY, resume=Stage.SURVEY, home_m=None)
    StateFile(str(folder / "state"), "d1").save(State(memory=memory))
    state = finding(folder, "state")
    assert state.verdict == "ok"
    assert "of another mission, 0000000000000000" in state.text


def test_a_drone_without_a_camera_is_not_ready(folder: Path) -> None:
    camera = finding(folder, "camera")
    assert camera.verdict == "failed"
    assert camera.text == 'no camera (detector.driver = "none"): this drone measures nothing and cannot search'


def test_counts_where_the_mission_has_a_camera_are_named(folder: Path) -> None:
    """A feed of an ordinary detector: the flight would take it for a camera without a hit."""

    async def serve(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        now_ns = time.time_ns()
        writer.write(pack(Readout(now_ns - 10**9, now_ns, now_ns, 1.0, PixelHits.none(), counts=np.array([1, 2]))))
        await writer.drain()

    async def look() -> str:
        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        address = f"127.0.0.1:{server.sockets[0].getsockname()[1]}"
        check = Preflight(
            *load_drone(folder / "d1.toml", {"RADRON_DETECTOR__DRIVER": "feed", "RADRON_DETECTOR__ADDRESS": address})
        )
        running = asyncio.create_task(check.run(60.0, lambda findings: None))
        while (camera := next(one for one in check.findings if one.name == "camera")).verdict == "not yet":
            assert not running.done()
            await asyncio.sleep(0.02)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        server.close()
        assert camera.verdict == "failed"
        return camera.text

    assert asyncio.run(look()) == "it sends counts instead of pixel hits; correct detector.kind in mission and drone file"


def test_the_address_of_another_computer(folder: Path) -> None:
    mesh = finding(folder, "mesh", RADRON_MESH__LISTEN="tls/192.0.2.1:7447")  # RFC 5737: unassigned
    assert mesh.verdict == "failed"
    assert mesh.text.startswith("mesh.listen: 'tls/192.0.2.1:7447' is not an address of this computer")


def test_a_serial_device_that_is_not_there(folder: Path) -> None:
    missing = finding(folder, "autopilot", RADRON_VEHICLE__ADDRESS="serial:///dev/ttyACM77:57600")
    assert missing.verdict == "failed"
    assert missing.text.startswith("serial:///dev/ttyACM77:57600: there is no device /dev/ttyACM77; ")
    none = finding(folder, "autopilot", RADRON_VEHICLE__ADDRESS=f"serial://{folder}/mission.toml:57600")
    assert none.text.endswith("/mission.toml is no serial device")


def test_a_serial_device_that_this_user_may_not_open(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pty.openpty()
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # root may open anything
    monkeypatch.setattr(Path, "group", lambda path: "dialout")
    try:
        refused = finding(folder, "autopilot", RADRON_VEHICLE__ADDRESS=f"serial://{os.ttyname(theirs)}:57600")
    finally:
        os.close(ours)
        os.close(theirs)
    assert "no permission to open /dev/pts/" in refused.text
    assert "add this user to the group dialout" in refused.text


def test_a_serial_device_is_new_until_udev_has_set_it_up(tmp_path: Path) -> None:
    adapter = os.makedev(188, 0)
    assert not is_new(adapter, tmp_path)  # a computer without udev: no set-up to wait for
    for file in ("run/udev/control", "sys/dev/char/188:0", "run/udev/data/c4:64"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    assert is_new(adapter, tmp_path)
    assert not is_new(os.makedev(136, 0), tmp_path)  # a pseudo terminal, unknown to udev
    (tmp_path / "run/udev/data/c188:0").touch()
    assert not is_new(adapter, tmp_path)


def test_the_certificate_and_who_it_is_for(folder: Path) -> None:
    good = finding(folder, "certificate")
    assert good.verdict == "ok"
    assert good.text.startswith("d1, drone, until ")
    other = finding(folder, "mesh", RADRON_MESH__IDENTITY=str(folder / "identity/d2"))
    assert (other.verdict, "is the certificate of d2 (drone), and this drone is d1" in other.text) == ("failed", True)
    missing = finding(folder, "certificate", RADRON_MESH__IDENTITY=str(folder / "nowhere"))
    assert (missing.verdict, "radron-deploy pki issue" in missing.text) == ("failed", True)


def test_a_certificate_that_has_expired_prevents_the_next_start(folder: Path) -> None:
    identity(new_issuer(), folder / "old", "d1", from_ns=-40 * DAY_NS)
    expired = finding(folder, "certificate", RADRON_MESH__IDENTITY=str(folder / "old/d1"))
    assert expired.verdict == "failed"
    assert "expired at" in expired.text
    assert "radron-deploy pki issue d1 --role drone" in expired.text


def test_a_drone_whose_certificate_is_of_another_authority_is_named(folder: Path) -> None:
    """d2 has been given a folder of another authority: neither lets the other in."""
    own = identity(new_issuer(), folder / "foreign", "d2")
    drone, _ = load_drone(folder / "d2.toml", {})

    async def course() -> Finding:
        config = MeshConfig(listen=drone.mesh.endpoints["d2"], identity=own, drones=("d1", "d2"))
        mesh = await Mesh.open(config, "radron", "d2", receive=lambda key, payload: None)
        try:
            return await asyncio.to_thread(finding, folder, "d2")
        finally:
            await mesh.close()

    found = asyncio.run(course())
    assert found.verdict == "failed"
    assert f": its certificate is not of the authority in {folder}/identity/d1/ca.pem: take a folder of the same" in found.text


def test_a_drone_that_was_in_contact_is_still_so_in_the_findings_when_the_links_are_closed(folder: Path) -> None:
    check = Preflight(*load_drone(folder / "d1.toml", {}))
    other = mesh_config(*load_drone(folder / "d2.toml", {}))

    def found() -> str:
        return next(finding.text for finding in check.findings if finding.name == "d2")

    async def course() -> None:
        mesh = await Mesh.open(other, "radron", "d2", receive=lambda key, payload: None)
        running = asyncio.create_task(check.run(60.0, lambda findings: None))
        while "in contact" not in found():
            assert not running.done()
            await asyncio.sleep(0.02)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        await mesh.close()

    asyncio.run(course())
    assert found() == "in contact, no status so far"


def test_links_that_are_not_encrypted_are_told(folder: Path) -> None:
    drone, mission = load_drone(folder / "d1.toml", {})
    listen = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    check = Preflight(replace(drone, mesh=PeerMeshConfig(listen=listen, insecure=True)), mission)
    (told,) = (finding for finding in check.findings if finding.name == "certificate")
    assert (told.verdict, "links are not encrypted (mesh.insecure = true)" in told.text) == ("ok", True)


def test_whom_an_operator_has_revoked_is_named_and_does_not_count_as_ready_if_it_is_this_drone(folder: Path) -> None:
    state = folder / "state"
    assert not [one for one in Preflight(*load_drone(folder / "d1.toml", {})).findings if one.name == "revoked"]
    state.mkdir(exist_ok=True)
    held = tuple(decode(revocation(member=name)[1]) for name in ("d2", "anna"))
    (state / "d1.revoked").write_bytes(encode(Revoked(stamp_ns=1, drone="d1", held=held)))
    other = finding(folder, "revoked")
    assert other == Finding("revoked", "ok", "d2 by lockstep, 2027-01-15 08:00 UTC, anna by lockstep, 2027-01-15 08:00 UTC")
    (state / "d1.revoked").write_bytes(encode(Revoked(stamp_ns=1, drone="d1", held=(decode(revocation(member="d1")[1]),))))
    assert finding(folder, "revoked").verdict == "failed"
    (state / "d1.revoked").write_bytes(b"damaged")
    damaged = finding(folder, "revoked")
    assert (damaged.verdict, "move it away, and revoke them again" in damaged.text) == ("failed", True)
