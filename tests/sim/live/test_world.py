"""The world process: in real time, with the truth for its launcher and hits for the agents."""

from __future__ import annotations

import asyncio
import time
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from pymavlink import mavutil

from radron.agent.detector.readout import Readout
from radron.agent.detector.wire import Unpacker
from radron.agent.vehicle.interface import SeenDrone
from radron.agent.vehicle.vision import VisionPose
from radron.sim.live.world import SLIP_S
from radron.sim.live.worldlink import Order, Ready, Truth, WorldConfig, pack, read
from radron.sim.live.worldprocess import LiveError, WorldProcess
from radron.sim.scenario import load_scenario, override
from radron.sim.world.localization import Localization, LocalizationTruth
from radron.sim.world.streams import streams

NOBODY = ("127.0.0.1", 9)


def world_config(**settings: str | float) -> WorldConfig:
    scenario = override(load_scenario("paper-demo"), {"drones": 1.0, "source.start_m": "[20.0, 4.0]", **settings})
    return WorldConfig(scenario=scenario, seed=1, onboard=(NOBODY,))


def test_messages_pass_the_pipe_in_pieces_and_end_with_it() -> None:
    async def course() -> None:
        stream = asyncio.StreamReader()
        truth = Truth(
            time_s=1.5,
            position_m=((1.0, 2.0, 3.0),),
            velocity_mps=((0.0, 0.0, 0.0),),
            sources=(),
            vehicles=(),
            late_s=0.0,
            dropped=2,
        )
        data = pack(Ready((1, 2))) + pack(truth)
        for start in range(0, len(data), 7):
            stream.feed_data(data[start : start + 7])
        stream.feed_data(data[:5])  # the world was killed in the middle of a message
        stream.feed_eof()
        assert await read(stream) == Ready((1, 2))
        assert await read(stream) == truth
        assert await read(stream) is None

    asyncio.run(course())


@pytest.mark.slow
def test_a_world_runs_in_real_time_and_obeys(tmp_path: Path) -> None:
    async def course() -> None:
        truths: list[Truth] = []
        readouts: list[Readout] = []
        world = await WorldProcess.start(world_config(), tmp_path / "world.json")
        watching = asyncio.create_task(world.watch(truths.append))
        reader, writer = await asyncio.open_connection("127.0.0.1", world.ready.feed_ports[0])
        unpacker = Unpacker()

        async def listen() -> None:
            while data := await reader.read(65_536):
                readouts.extend(unpacker.feed(data))

        async def until(condition: object) -> None:
            async with asyncio.timeout(20.0):
                while not condition():  # type: ignore[operator]
                    assert not watching.done()
                    await asyncio.sleep(0.01)

        listening = asyncio.create_task(listen())
        try:
            await until(lambda: len(readouts) >= 3)
            assert truths[-1].source_m is None
            before = len(readouts)
            world.order(Order.GO)
            await until(lambda: truths[-1].source_m is not None)
            assert truths[-1].source_m == (20.0, 4.0)
            began, began_s = truths[-1].time_s, time.monotonic()
            await until(lambda: truths[-1].time_s >= began + 1.5)
            took_s, late_s = time.monotonic() - began_s, sum(truth.late_s for truth in truths)
            assert 1.0 < took_s < 2.0 + late_s
            assert [round((b.time_s - a.time_s) * 100.0) for a, b in pairwise(truths)] == [5] * (len(truths) - 1)
            await until(lambda: len(readouts) >= before + 8)
            slipped = max(truth.late_s for truth in truths) > SLIP_S  # the machine is shared
            assert slipped or all(a.end_ns == b.start_ns for a, b in pairwise(readouts))
            assert abs(readouts[-1].end_ns - time.time_ns()) < 1e9
            assert sum(len(readout.hits) for readout in readouts[-5:]) > 10 * sum(len(r.hits) for r in readouts[:before])
            world.order(Order.CAMERAS_OFF)
            moment = truths[-1].time_s
            await until(lambda: truths[-1].time_s > moment + 0.5)
            silent = len(readouts)
            moment = truths[-1].time_s
            await until(lambda: truths[-1].time_s > moment + 0.5)
            assert len(readouts) == silent
            assert sum(truth.dropped for truth in truths) == 0
        finally:
            watching.cancel()
            listening.cancel()
            writer.close()
            await world.stop()
        assert world.exit_code == 0

    asyncio.run(course())


def test_cameras_of_a_world_without_a_source_see_the_background(tmp_path: Path) -> None:
    async def course() -> None:
        scenario = override(load_scenario("empty"), {"drones": 1.0, "camera.background_hits_per_s": 500.0})
        world = await WorldProcess.start(WorldConfig(scenario=scenario, seed=1, onboard=(NOBODY,)), tmp_path / "world.json")
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", world.ready.feed_ports[0])
            unpacker = Unpacker()
            readouts: list[Readout] = []
            async with asyncio.timeout(20.0):
                while len(readouts) < 2:
                    readouts.extend(unpacker.feed(await reader.read(65_536)))
            writer.close()
        finally:
            await world.stop()
        assert all(len(readout.hits) > 100 for readout in readouts)  # 100 events in 0.2 s, of some pixels each

    asyncio.run(course())


@pytest.mark.slow
def test_a_constant_bias_is_the_error_of_the_place_where_a_vehicle_is_put_down(tmp_path: Path) -> None:
    """A live agent's frame begins where it stands, so that a bias of the autopilot's own positions would cancel."""

    async def starts(values: dict[str, str | float]) -> list[tuple[float, ...]]:
        scenario = override(load_scenario("empty"), values)
        world = await WorldProcess.start(WorldConfig(scenario=scenario, seed=1, onboard=(NOBODY,) * 3), tmp_path / "world.json")
        await world.stop()
        return list(world.truth.position_m)

    async def course() -> None:
        ideal, biased = await starts({}), await starts({"localization.bias_m": 1.0})
        assert ideal == [drone.origin_m for drone in load_scenario("empty").mission.drones]
        off = np.subtract(biased, ideal)
        expected = Localization(LocalizationTruth(bias_m=1.0), 3, 0.01, streams(1, 3).localization).position_bias_m
        np.testing.assert_allclose(off, -expected, atol=1e-12)
        assert np.abs(expected[:, :2]).min() > 0.0

    asyncio.run(course())


@pytest.mark.slow
def test_slams_and_sightings_are_told_to_whoever_asks(tmp_path: Path) -> None:
    """In mixed-frames: the third drone has a SLAM, and all see each other."""

    async def lines(port: int, count: int) -> list[bytes]:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        found: list[bytes] = []
        async with asyncio.timeout(20.0):
            while len(found) < count:
                line = await reader.readline()
                found += [line] if line.strip() else []
        writer.close()
        return found

    async def course() -> None:
        scenario = load_scenario("mixed-frames")
        world = await WorldProcess.start(WorldConfig(scenario=scenario, seed=1, onboard=(NOBODY,) * 3), tmp_path / "world.json")
        try:
            assert [bool(port) for port in world.ready.vision_ports] == [False, False, True]
            poses = [msgspec.json.decode(line, type=VisionPose) for line in await lines(world.ready.vision_ports[2], 10)]
            seen = [msgspec.json.decode(line, type=SeenDrone) for line in await lines(world.ready.sightings_ports[0], 20)]
        finally:
            await world.stop()
        for pose in poses:  # its map begins at the place of the start, but for the height, known to the ground
            assert np.abs(pose.position_m[:2]).max() < 0.01
            assert np.linalg.norm(pose.quaternion) == pytest.approx(1.0)
            assert pose.covariance is not None
        assert [round((b.stamp_ns - a.stamp_ns) * 1e-7) for a, b in pairwise(poses)] == [3] * 9
        assert abs(poses[-1].stamp_ns - time.time_ns()) < 30e9
        places = np.array(world.truth.position_m)
        beside_m = np.hypot(*(places - [drone.origin_m for drone in scenario.mission.drones])[:, :2].T)
        assert (beside_m > 0.05).all()  # no drone stands exactly at the mission's place
        assert beside_m.max() < 6.0  # four of its sigmas
        assert np.abs(places[:, 2]).max() < 0.01
        assert {one.target for one in seen} == {"d2", "d3"}
        for drone, target in ((1, "d2"), (2, "d3")):
            ranges = [one.range_m for one in seen if one.target == target and one.range_m is not None]
            assert np.median(ranges) == pytest.approx(np.linalg.norm(places[drone] - places[0]), abs=0.5)

    asyncio.run(course())


def test_a_world_that_cannot_be_says_why(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    async def course() -> None:
        config = WorldConfig(scenario=world_config().scenario, seed=1, onboard=(("no-such-host.invalid", 14540),))
        with pytest.raises(LiveError, match="the world ended before it was up"):
            await WorldProcess.start(config, tmp_path / "world.json")

    asyncio.run(course())
    said = capfd.readouterr().err
    assert "no-such-host.invalid" in said
    assert "Traceback" not in said


@pytest.mark.slow
def test_one_ground_station_hears_all_vehicles_and_is_answered_by_each(tmp_path: Path) -> None:
    async def course() -> None:
        station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=255, source_component=190)
        scenario = override(load_scenario("paper-demo"), {"drones": 2.0})
        config = WorldConfig(
            scenario=scenario, seed=1, onboard=(NOBODY, NOBODY), ground_station=("127.0.0.1", station.port.getsockname()[1])
        )
        world = await WorldProcess.start(config, tmp_path / "world.json")
        watching = asyncio.create_task(world.watch(lambda truth: None))
        try:
            async with asyncio.timeout(30.0):
                for system in (1, 2):
                    assert await asyncio.to_thread(parameters_of, station, system) > 50
        finally:
            await world.stop()
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)
            station.close()

    asyncio.run(course())


def parameters_of(station: mavutil.mavudp, system: int) -> int:
    """How many parameters a vehicle has sent on request, each once."""
    while station.recv_match(type="HEARTBEAT", blocking=True, timeout=10.0).get_srcSystem() != system:
        station.mav.heartbeat_send(6, 8, 0, 0, 4)
    station.mav.param_request_list_send(system, 1)
    found: dict[str, int] = {}
    while not found or len(found) <= next(iter(found.values())):
        value = station.recv_match(type="PARAM_VALUE", blocking=True, timeout=10.0)
        if value.get_srcSystem() == system:
            found[value.param_id] = value.param_count
    return len(found)
