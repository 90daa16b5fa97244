"""The recipes for a detector, a localisation source, a vehicle and a scenario, each run as it stands on its page."""

import asyncio
import importlib.util
import os
import pty
import sys
from pathlib import Path

import pytest

from radron.agent.config.drone import DroneConfig
from radron.agent.config.estimators import FusionConfig, GivenHypothesisConfig
from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig, TrackConfig
from radron.agent.detector.drivers.feed import FeedDetector
from radron.agent.detector.wire import Unpacker, pack
from radron.agent.pilot import Pilot
from radron.agent.sensing.sighting_feed import SightingsFeed
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Action, Command, Stage
from radron.sim.scenario import load_scenario
from support import docs_pages

SECOND = 1_000_000_000


def module_of(page, name, folder: Path):
    docs_pages.files(docs_pages.DOCS / "how-to" / f"{page}.md", folder)
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


async def first_item(module, make, items, close):
    """First message to a client of a page's server."""
    server = await asyncio.start_server(module.serve, "127.0.0.1", 0)
    client = make(f"127.0.0.1:{server.sockets[0].getsockname()[1]}")
    try:
        async with asyncio.timeout(10.0):
            async for item in items(client):
                return item, client
    finally:
        await close(client)
        server.close()


def test_the_camera_of_the_page_is_read_by_the_agent(tmp_path):
    camera = module_of("detector", "camera", tmp_path)
    readout, client = asyncio.run(first_item(camera, FeedDetector, FeedDetector.readouts, FeedDetector.close))
    assert readout.hits.index.tolist() == [25650, 25651]
    assert readout.live_time_s == pytest.approx((readout.end_ns - readout.start_ns) * 1e-9)
    assert client.counters["readouts"] == 1


def test_spectra_of_a_serial_line_are_read_by_the_agent(tmp_path):
    """A pseudo terminal in the place of the device; bad lines in between."""
    program = module_of("detector", "serial_spectrum", tmp_path)
    controller, terminal = pty.openpty()
    device = program.SerialSpectra(os.ttyname(terminal))
    try:
        counts = list(range(program.CHANNELS))
        good = b"0.9 " + ",".join(map(str, counts)).encode() + b"\r\n"
        received = []
        for line in (b"hello\n", b"0.9 1 2 3\n", b"nan " + good[4:], b"\xff\n", good):
            for start in range(0, len(line), 1000):  # a terminal's buffer holds 4 kB
                os.write(controller, line[start : start + 1000])
                received += device.readouts()
        while not received:
            received += device.readouts()
    finally:
        device.close()
        os.close(controller)
        os.close(terminal)
    (readout,) = received
    assert device.bad_lines == 4
    assert readout.counts.tolist() == counts
    assert readout.live_time_s <= 0.9
    (again,) = Unpacker().feed(pack(readout))
    assert again.counts.tolist() == counts


def test_the_ranges_of_the_page_are_read_by_the_agent(tmp_path):
    ranging = module_of("localization", "ranging", tmp_path)
    seen, client = asyncio.run(first_item(ranging, SightingsFeed, SightingsFeed.sightings, SightingsFeed.close))
    assert [(sight.target, sight.range_m, sight.range_sigma_m) for sight in seen] == [("d2", 12.1, 0.15)]
    assert client.counters["malformed"] == 0


def test_the_vehicle_of_the_page_flies_a_mission(tmp_path):
    now = [1_800_000_000 * SECOND]
    mission = MissionConfig(
        name="test",
        drones=(DroneInMission(id="d1", origin_m=(5.0, 5.0, 0.0)),),
        area=AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0))),
        fusion=FusionConfig(estimator="given", given=GivenHypothesisConfig(schedule=((0.0, 25.0, 25.0),))),
        track=TrackConfig(duration_s=12.0),
    )
    pilot = Pilot(mission, DroneConfig(id="d1"), boot="0" * 16, nonce_key=b"")
    vehicle = module_of("vehicle", "ideal_vehicle", tmp_path).IdealVehicle(lambda: now[0])
    vehicle.on_state(pilot.observe_vehicle)
    asyncio.run(vehicle.connect())
    to = {"d1": pilot.ticket(now[0])}
    start = Command(stamp_ns=now[0], station="test", mission=mission.mission_id, action=Action.START, to=to)
    pilot.receive(key_of(mission.swarm, start), encode(start), now[0])
    stages = []
    while pilot.stage is not Stage.LANDED and now[0] < (1_800_000_000 + 120) * SECOND:
        now[0] += SECOND // 20
        vehicle.command(pilot.step(now[0]).command)
        if not stages or stages[-1] is not pilot.stage:
            stages.append(pilot.stage)
    assert stages == [Stage.TAKEOFF, Stage.TRACK, Stage.RETURN, Stage.LANDING, Stage.LANDED]


def test_the_scenario_of_the_page_loads_from_a_folder_of_its_own(tmp_path):
    docs_pages.files(docs_pages.DOCS / "how-to" / "scenario.md", tmp_path)
    scenario = load_scenario(str(tmp_path / "lab" / "yard.toml"))
    assert (scenario.name, len(scenario.mission.drones), scenario.source.nuclide) == ("yard", 4, "Co-60")
