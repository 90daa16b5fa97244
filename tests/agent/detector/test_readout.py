"""Readouts with more hits than can be analysed in flight."""

import time

import numpy as np
import pytest
from detector import COINCIDENCES, synthetic_hits

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.clustering import cluster_many
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import PixelHits, Readout, shed
from radron.agent.shell.node import MOST_HITS
from radron.agent.shell.problems import LATE_STEP_S
from support.sensors.detector_feed import readout_at

END_NS = 1_800_000_000_000_000_000


def flooded(count: int) -> Readout:
    """0.2 s of a camera with ``count`` hits all over the sensor, evenly in time."""
    rng = np.random.default_rng(1)
    tick = np.linspace(0, 128_000_000, count, endpoint=False).astype(np.int64)
    hits = PixelHits(tick, rng.integers(0, 65536, count).astype(np.uint16), rng.integers(1, 60, count).astype(np.uint16))
    return Readout(END_NS - 200_000_000, END_NS, END_NS - 200_000_000, 0.18, hits, 5)


def test_the_time_of_the_hits_that_are_left_out_is_dead() -> None:
    cut = shed(flooded(1000), 250)
    assert len(cut.hits) == 250
    assert cut.hits.tick[-1] == flooded(1000).hits.tick[249]
    assert cut.live_time_s == pytest.approx(0.18 / 4, abs=1e-6)
    assert cut.lost_hits == 5 + 750
    assert (cut.start_ns, cut.end_ns) == (END_NS - 200_000_000, END_NS)


@pytest.mark.parametrize(("dose_msv_h", "slices"), [(1.0, 8), (10.0, 6), (100.0, 4)])
def test_near_a_strong_source_whole_events_are_shed_and_the_live_time_says_so(dose_msv_h: float, slices: int) -> None:
    """Cs-137: 75 photons/cm2/s per uSv/h, of which 9 % interact in 2 cm2 of CdTe; the camera reads out 2.35 M hits/s."""
    rng = np.random.default_rng(5)
    events_per_s = 1000.0 * dose_msv_h * 75.0 * 2.0 * 0.09
    capacity = 470_000
    span_s = min(0.2, 1.3 * capacity / 10.0 / events_per_s)
    counted, live_s = 0, 0.0
    for _ in range(slices):
        hits = synthetic_hits(round(events_per_s * span_s), rng, 1e9 / events_per_s)
        everything = len(hits) * 0.2 / span_s
        hits = hits.take(slice(capacity))
        seen_s = 0.2 * min(1.0, capacity / everything)
        readout = Readout(0, 200_000_000, 0, seen_s, hits, max(0, round(everything) - capacity))
        kept = shed(readout, MOST_HITS)
        assert 0.9 * MOST_HITS < len(kept.hits) <= MOST_HITS
        assert kept.lost_hits == readout.lost_hits + len(hits) - len(kept.hits)
        assert events_of(kept.hits) <= events_of(hits)
        chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
        for part in (chain.process(kept), chain.flush()):
            counted += part.hits
            live_s += part.live_time_s
    assert counted / live_s == pytest.approx((1.0 + COINCIDENCES) * events_per_s, rel=0.05)


def events_of(hits: PixelHits) -> set[tuple[int, int, float]]:
    """The clusters by their first tick, number of pixels and energy."""
    hits = hits.take(np.argsort(hits.tick, kind="stable"))
    found = cluster_many(hits, Calibration.nominal().energy_kev(hits.index, hits.tot), 64.0)
    return set(zip(found.tick.tolist(), found.pixels.tolist(), np.round(found.energy_kev, 6).tolist(), strict=True))


def test_an_ordinary_readout_is_left_as_it_is() -> None:
    readout = readout_at(END_NS, 250)
    assert shed(readout, 250) is readout


def test_a_flood_does_not_keep_the_loop_from_its_steps() -> None:
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
    began_s = time.process_time()
    chain.process(shed(flooded(1_000_000), MOST_HITS))
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
