"""Readouts with more hits than can be analysed in flight."""

import time

import numpy as np
import pytest
from detector_feed import readout_at

from agent.config.mission import DetectionConfig
from agent.detector.chain import DetectorChain
from agent.detector.files.calibration import Calibration
from agent.detector.readout import PixelHits, Readout, first_hits
from agent.shell.node import MOST_HITS
from agent.shell.problems import LATE_STEP_S

END_NS = 1_800_000_000_000_000_000


def flooded(count: int) -> Readout:
    """0.2 s of a camera with ``count`` hits all over the sensor, evenly in time."""
    rng = np.random.default_rng(1)
    tick = np.linspace(0, 128_000_000, count, endpoint=False).astype(np.int64)
    hits = PixelHits(tick, rng.integers(0, 65536, count).astype(np.uint16), rng.integers(1, 60, count).astype(np.uint16))
    return Readout(END_NS - 200_000_000, END_NS, END_NS - 200_000_000, 0.18, hits, 5)


def test_the_time_of_the_hits_that_are_left_out_is_dead() -> None:
    cut = first_hits(flooded(1000), 250)
    assert len(cut.hits) == 250
    assert cut.hits.tick[-1] == flooded(1000).hits.tick[249]
    assert cut.live_time_s == pytest.approx(0.18 / 4, abs=1e-6)
    assert cut.lost_hits == 5 + 750
    assert (cut.start_ns, cut.end_ns) == (END_NS - 200_000_000, END_NS)


def test_an_ordinary_readout_is_left_as_it_is() -> None:
    readout = readout_at(END_NS, 250)
    assert first_hits(readout, 250) is readout


def test_a_flood_does_not_keep_the_loop_from_its_steps() -> None:
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
    began_s = time.process_time()
    chain.process(first_hits(flooded(1_000_000), MOST_HITS))
    assert time.process_time() - began_s < LATE_STEP_S
    assert chain.lost_hits >= 1_000_000 - MOST_HITS


def test_hits_are_joined_and_taken_column_by_column() -> None:
    hits = flooded(10).hits
    parts = [hits.take(slice(4)), PixelHits.none(), hits.take(np.arange(10) >= 4)]
    joined = PixelHits.joined(parts)
    for column in ("tick", "index", "tot"):
        assert getattr(joined, column).tolist() == getattr(hits, column).tolist()
        assert getattr(joined, column).dtype == getattr(hits, column).dtype == getattr(PixelHits.joined([]), column).dtype
    assert hits.take(np.array([7, 2])).tick.tolist() == [hits.tick[7], hits.tick[2]]
