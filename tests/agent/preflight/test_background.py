"""The camera on the bench: background, noisy pixels, and none at all."""

from __future__ import annotations

import numpy as np
import pytest

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.readout import TICK_NS, PixelHits, Readout
from radron.agent.preflight.background import Background
from radron.agent.vehicle.interface import Finding

SLICE_NS, BEGIN_NS = 200_000_000, 1_767_225_600_000_000_000


def measured(hits_per_s: float, noisy: int = 0, seconds: float = 12.0) -> Finding:
    """The finding after a measurement of single hits at random pixels, and of pixels that fire 50 times a second."""
    rng, background, finding = np.random.default_rng(1), Background(DetectionConfig()), Finding("camera", "not yet", "")
    for number in range(round(seconds * 1e9 / SLICE_NS)):
        start_ns = BEGIN_NS + number * SLICE_NS
        index = rng.integers(0, 65536, rng.poisson(hits_per_s * SLICE_NS * 1e-9))
        index = rng.permutation(np.concatenate((index, np.repeat(np.arange(noisy) * 7, 10))))
        at_ns = number * SLICE_NS + rng.integers(0, SLICE_NS, len(index))
        tick = np.sort((at_ns / TICK_NS).astype(np.int64))
        hits = PixelHits(tick, index.astype(np.uint16), np.full(len(index), 60, np.uint16))
        finding = background.take(Readout(start_ns, start_ns + SLICE_NS, BEGIN_NS, SLICE_NS * 1e-9, hits))
    return finding


def test_background_is_counted() -> None:
    found = measured(6.0)
    assert found.verdict == "ok"
    rate = float(found.text.partition(": ")[2].partition(" ")[0])
    assert rate == pytest.approx(6.0, abs=3.0 * (6.0 / 10.0) ** 0.5)  # three sigma of a Poisson count over ten seconds


def test_background_of_an_ordinary_detector() -> None:
    for counts in ([3, 4], [0, 0]):
        background = Background(DetectionConfig())
        for number in range(12):
            start_ns = BEGIN_NS + number * 10**9
            found = background.take(Readout(start_ns, start_ns + 10**9, start_ns, 0.9, PixelHits.none(), counts=np.array(counts)))
        assert found.verdict == ("ok" if any(counts) else "failed")
        assert ("7.8 counts a second" if any(counts) else "check the detector's high voltage") in found.text


def test_a_dead_camera() -> None:
    found = measured(0.0)
    assert found.verdict == "failed"
    assert "not even background" in found.text


def test_it_takes_ten_seconds() -> None:
    assert measured(6.0, seconds=5.0).verdict == "not yet"


def test_noisy_pixels_are_no_background() -> None:
    few = measured(6.0, noisy=3)
    assert (few.verdict, few.text.endswith("3 noisy pixels")) == ("ok", True)
    many = measured(6.0, noisy=110)
    assert (many.verdict, "110 noisy pixels" in many.text) == ("failed", True)


def test_a_camera_that_repeats_itself() -> None:
    background, finding = Background(DetectionConfig()), Finding("camera", "not yet", "")
    ticks = np.arange(5) * 1_000_000
    for number in range(3):
        start_ns = BEGIN_NS + number * SLICE_NS
        hits = PixelHits(ticks + number * SLICE_NS * 16 // 25, (np.arange(5) * 700).astype(np.uint16), np.full(5, 60, np.uint16))
        finding = background.take(Readout(start_ns, start_ns + SLICE_NS, BEGIN_NS, SLICE_NS * 1e-9, hits))
    assert finding.verdict == "failed"
    assert "the same hits again and again" in finding.text
