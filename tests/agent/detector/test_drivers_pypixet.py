"""The camera's driver against a stand-in for the vendor's module: pixels, times, and a camera that disconnects and returns."""

import asyncio
import sys
import threading
import time
from contextlib import asynccontextmanager
from itertools import pairwise

import pytest

from radron.agent.config.drone import DetectorConfig
from radron.agent.detector.drivers import open_detector, pypixet
from radron.agent.detector.drivers.pypixet import BLOCK_BYTES, PixetDetector
from radron.agent.errors import DetectorError
from support.sensors.detector_feed import until
from support.sensors.pypixet_standin import Pypixet


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(pypixet, "READOUT_SLICE_S", 0.02)
    monkeypatch.setattr(pypixet, "CAMERA_RETRY_S", 0.05)


@asynccontextmanager
async def reading(module, bias_v=None):
    detector = PixetDetector(module, bias_v)
    received = []

    async def read():
        async for readout in detector.readouts():
            received.append(readout)

    task = asyncio.create_task(read())
    try:
        yield detector, received
    finally:
        await detector.close()
        await asyncio.wait_for(task, 10.0)
    assert not any(thread.name == "pypixet" and thread.is_alive() for thread in threading.enumerate())


def hits(received):
    return [
        (readout.clock_ns + int(tick) * 25 // 16, int(index), int(tot))
        for readout in received
        for tick, index, tot in zip(readout.hits.tick, readout.hits.index, readout.hits.tot, strict=True)
    ]


@pytest.mark.parametrize("reserved", [False, True], ids=["registerEvent(event, call)", "registerEvent(event, 0, call)"])
def test_pixels_become_hits_at_the_time_of_their_arrival(reserved):
    module = Pypixet(reserved=reserved)
    camera = module.plugged[0]

    async def run():
        begun_ns = time.time_ns()
        async with reading(module, bias_v=-450.0) as (detector, received):
            await until(camera.measuring.is_set, "the acquisition")
            started_ns = time.time_ns()
            await asyncio.to_thread(camera.deliver, [(300, 4000, 0, 16, 55), (0x74, 0, 1, 0, 0), (301, 4001, 0, 0, 66)])
            await asyncio.to_thread(camera.deliver, [(65535, 40_000, 0, 31, 1022), (0x75, 1000, 1, 0, 0)])
            await until(lambda: len(hits(received)) == 3, "three hits")
            assert detector.problems == ()
            first, second, third = hits(received)
            assert [hit[1:] for hit in (first, second, third)] == [(300, 55), (301, 66), (65535, 1022)]
            assert begun_ns <= first[0] - (100_000 - 25) <= started_ns  # ToA 4000 and FToA 16 after the start
            assert second[0] - first[0] == pytest.approx(50, abs=2)
            assert third[0] - first[0] == pytest.approx(1_000_000 - 25 * 31 / 16 - 100_000 + 25, abs=2)
            assert sum(readout.lost_hits for readout in received) == 2
            await until(lambda: received[-1].end_ns > started_ns + 100_000_000, "readouts of times without hits")
            pauses = {later.start_ns - earlier.end_ns for earlier, later in pairwise(received)}
            assert pauses == {0}
            missing_s = sum((readout.end_ns - readout.start_ns) * 1e-9 - readout.live_time_s for readout in received)
            assert missing_s == pytest.approx(25e-6, abs=1e-9)  # of the overflow row: 1000 steps of 25 ns
        assert camera.unreleased == 0
        assert ("setOperationMode", module.pixet.PX_TPX3_OPM_TOATOT) in camera.calls
        assert ("setBias", -450.0) in camera.calls
        assert camera.parameters_set == {"DDBlockSize": BLOCK_BYTES}
        assert (module.starts, module.exits, camera.handlers) == (1, 1, 0)

    asyncio.run(run())


def test_without_a_wish_the_bias_is_left_alone():
    module = Pypixet()

    async def run():
        async with reading(module):
            await until(module.plugged[0].measuring.is_set, "the acquisition")
        assert not [call for call in module.plugged[0].calls if call[0] == "setBias"]

    asyncio.run(run())


def test_a_camera_that_is_lost_is_reported_and_taken_up_again():
    module = Pypixet()
    camera = module.plugged[0]

    async def run():
        async with reading(module) as (detector, received):
            await until(camera.measuring.is_set, "the acquisition")
            await asyncio.to_thread(camera.deliver, [(1, 4000, 0, 0, 50)])
            await until(lambda: len(hits(received)) == 1, "a hit")
            module.plugged.clear()
            camera.lose()
            await until(lambda: any("no Timepix3 camera" in line for line in detector.problems), "the loss among the problems")
            lost_ns = time.time_ns()
            module.plugged.append(camera)
            await until(camera.measuring.is_set, "another acquisition")
            assert detector.problems == ()
            again_ns = time.time_ns()
            await asyncio.to_thread(camera.deliver, [(2, 4000, 0, 0, 60)])
            await until(lambda: len(hits(received)) == 2, "a hit of the second acquisition")
            assert lost_ns <= hits(received)[1][0] - 100_000 <= again_ns  # ToA 4000 after the start of that acquisition
            assert {readout.clock_ns for readout in received} == {received[0].clock_ns}
            assert all(later.start_ns >= earlier.end_ns for earlier, later in pairwise(received))
        assert module.starts == module.exits == 1

    asyncio.run(run())


def test_a_camera_without_what_it_needs_says_which_call_failed():
    module = Pypixet()
    module.plugged[0].refused["setOperationMode"] = -9

    async def run():
        async with reading(module) as (detector, _):
            expected = "camera MiniPIX H08-W0028: setOperationMode failed (code -9): Device disconnected"
            await until(lambda: detector.problems == (expected,), expected)

    asyncio.run(run())


@pytest.mark.parametrize("case", ["nothing", "placeholder", "start"])
def test_no_camera_and_no_core_are_problems(case):
    module = Pypixet(plugged=0 if case == "nothing" else 1)
    if case == "placeholder":
        module.plugged[0].name = "FileDevice 0"
    if case == "start":
        module.start_code = -1
    text = "Pixet failed to start (code -1)" if case == "start" else "Pixet finds no Timepix3 camera"

    async def run():
        async with reading(module) as (detector, received):
            await until(lambda: any(text in line for line in detector.problems), text)
            assert received == []

    asyncio.run(run())


def test_pixels_of_an_unknown_form_are_a_problem_not_a_crash():
    module = Pypixet()

    async def run():
        async with reading(module) as (detector, _):
            await until(module.plugged[0].measuring.is_set, "the acquisition")
            await asyncio.to_thread(module.plugged[0].deliver, [("?", 0, 0, 0, 0)])
            await until(lambda: any("cannot be read" in line for line in detector.problems), "the problem")
            assert module.plugged[0].unreleased == 0

    asyncio.run(run())


def test_a_missing_module_is_one_line_that_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "pypixet", raising=False)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(DetectorError, match="install Advacam's Pixet SDK") as caught:
        open_detector(DetectorConfig(driver="pypixet", pixet_folder=str(tmp_path)))
    assert "\n" not in str(caught.value)
    with pytest.raises(DetectorError, match="no such folder"):
        open_detector(DetectorConfig(driver="pypixet", pixet_folder=str(tmp_path / "absent")))


def test_the_module_is_found_in_its_folder(tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "pypixet", raising=False)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "pypixet.py").write_text("pixet = None\n")
    assert isinstance(open_detector(DetectorConfig(driver="pypixet", pixet_folder=str(tmp_path))), PixetDetector)
    del sys.modules["pypixet"]


def test_readouts_that_are_taken_up_again_need_no_second_worker():
    async def run():
        detector = PixetDetector(Pypixet())
        for _ in range(2):
            reading = asyncio.create_task(anext(detector.readouts()))
            await asyncio.wait((reading,), timeout=0.2)
            reading.cancel()
        working = sum(thread.name == "pypixet" for thread in threading.enumerate())
        await detector.close()
        return working

    assert asyncio.run(run()) == 1
