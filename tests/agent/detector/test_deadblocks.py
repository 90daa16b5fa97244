"""Dead blocks of pixels are reported once the others have seen enough, unless the calibration masks them."""

from __future__ import annotations

import numpy as np

from radron.agent.detector.deadblocks import MIN_HITS, DeadBlocks
from radron.agent.detector.files.calibration import PIXELS, Calibration

HOLED = np.flatnonzero((np.arange(PIXELS) % 256 >= 114) | (np.arange(PIXELS) // 256 >= 114)).astype(np.uint16)
EVERY = np.arange(PIXELS).astype(np.uint16)


def clusters(alive, count, rng):
    """Hits (N,) of clusters of ten pixels of these."""
    return np.repeat(rng.choice(alive, count), 10)


def seen(dead, alive, times):
    rng = np.random.default_rng(1)
    for _ in range(times):
        dead.add(clusters(alive, 64 * MIN_HITS // 100, rng))
    return dead


def test_a_block_of_dead_pixels_is_told_with_what_the_counts_lack():
    dead = seen(DeadBlocks(Calibration.nominal()), HOLED, 9)
    assert dead.problems == ()  # not enough hits yet
    seen(dead, HOLED, 2)
    assert dead.problems == ("camera: no hit in 9 of 64 blocks of the sensor: its counts are at least 14% low; calibrate it",)
    assert seen(dead, EVERY, 20).problems == ()  # alive again


def test_a_sensor_that_sees_everywhere_has_no_dead_block():
    dead = DeadBlocks(Calibration.nominal())
    for _ in range(50):
        assert seen(dead, EVERY, 10).problems == ()


def test_what_the_calibration_masks_is_not_told():
    gain = np.full(PIXELS, np.nan)
    gain[HOLED] = 1.0
    assert seen(DeadBlocks(Calibration.nominal().with_gain(gain)), HOLED, 20).problems == ()
