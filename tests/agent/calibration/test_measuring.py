"""Measuring with the camera: stops when it is enough, or the time is over, and says when nothing comes."""

import asyncio
import json

import numpy as np
import pytest

from radron.agent.calibration import command, measuring
from radron.agent.calibration.collection import Collection
from radron.agent.calibration.facing import Facing
from radron.agent.calibration.measuring import BackgroundCount, measure_background, measure_facing
from radron.agent.calibration.plan import Source
from radron.agent.config.drone import DroneConfig
from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import DetectorError


class Camera:
    """Delivers readouts of a second, each with a hit in every tenth of it, without pausing."""

    def __init__(self, problems=(), count=10_000):
        self.problems, self._count, self.closed = problems, count, False

    async def readouts(self):
        rng = np.random.default_rng(1)
        for k in range(self._count):
            tick = 640_000_000 * k + 64_000_000 * np.arange(10)
            hits = PixelHits(tick, rng.integers(0, 65536, 10).astype(np.uint16), np.full(10, 120, np.uint16))
            yield Readout(k * 10**9, (k + 1) * 10**9, 0, 1.0, hits)
            await asyncio.sleep(0)
        await asyncio.Event().wait()

    async def close(self):
        self.closed = True


def collection():
    return Collection(Calibration.nominal(), "Cs-137", 661.66, DetectionConfig())


def test_a_facing_ends_with_its_time_and_the_camera_is_released():
    camera, collected = Camera(), collection()
    told = []
    asyncio.run(measure_facing(lambda: camera, collected, Facing(0.0), (1, 3), 200.0, told.append))
    assert camera.closed
    assert collected.live_s == pytest.approx(200.0, abs=1.0)
    assert len(collected.cones) == 1
    assert collected.pixels.sum() == pytest.approx(2000, abs=10)
    assert told[-1].startswith("bearing 0 deg, elevation 0 deg: ")


def test_a_facing_ends_when_it_is_enough(monkeypatch):
    camera, collected = Camera(), collection()
    monkeypatch.setattr(measuring, "is_enough", lambda collected, share: collected.hits >= 1500 * share)
    asyncio.run(measure_facing(lambda: camera, collected, Facing(0.0), (1, 3), 5000.0, lambda text: None))
    assert collected.live_s < 300.0


def test_a_mute_camera_is_told_with_its_problem(monkeypatch):
    monkeypatch.setattr(measuring, "MAX_SILENCE_S", 0.05)
    camera = Camera(("unplugged",), count=3)
    with pytest.raises(DetectorError, match=r"camera: no readout for 0\.05 s: unplugged"):
        asyncio.run(measure_facing(lambda: camera, collection(), Facing(0.0), (1, 3), 100.0, lambda text: None))
    assert camera.closed


def test_the_background_is_counted():
    count = BackgroundCount(Calibration.nominal(), DetectionConfig())
    assert count.result is None
    asyncio.run(measure_background(Camera, count))
    assert count.result.per_s == pytest.approx(10.0, rel=0.01)
    assert count.result.sigma_per_s == pytest.approx((10.0 / 300.0) ** 0.5, rel=0.02)


def test_the_operator_is_led_through_background_and_facings(tmp_path, monkeypatch):
    asked, opened = [], []

    def open_camera(config):
        opened.append(Camera())
        return opened[-1]

    monkeypatch.setattr(command, "open_detector", open_camera)
    drone = DroneConfig(id="d1")
    facings = command.parse_facings(["0", "60,10", "-60"])
    order = command.Order(drone, Source("Cs-137", 1e10, 0.5), facings, None, tmp_path / "H07", "20260101T000000Z")
    assert not command.run_calibrate(order, asked.append)
    assert "at least 20 m away" in asked[0]
    assert asked[2].startswith("2 of 3: place the source at 0.5 m from the camera, at bearing 60 deg, elevation 10 deg")
    assert len(asked) == len(opened) == 4
    assert all(camera.closed for camera in opened)
    report = json.loads((tmp_path / "H07" / "20260101T000000Z" / "result.json").read_text())
    assert report["result"]["background"]["per_s"] == pytest.approx(10.0, rel=0.01)
    assert report["verdict"].startswith("not usable: gain, ")


def test_without_a_camera_files_are_needed(tmp_path):
    facings = command.parse_facings(["0", "60,10", "-60"])
    order = command.Order(DroneConfig(id="d1"), Source("Cs-137", 1e10, 0.5), facings, None, tmp_path, "20260101T000000Z")
    with pytest.raises(DetectorError, match="names no camera"):
        command.run_calibrate(order, lambda text: None)
