"""Noisy pixels are masked quickly, healthy ones never; pixels that have become quiet are used again."""

from itertools import pairwise

import numpy as np
import pytest

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.noise import BEAT_NS, NoiseMask
from radron.agent.detector.readout import PixelHits, Readout

SECOND = 1_000_000_000
CLOCK_NS = 1_800_000_000 * SECOND + 777
NOISY = 30_000
PIXELS = 65536


def at(times_s, index):
    """Hits at sorted times after CLOCK_NS, of one pixel or of (N,) pixels, far above the threshold."""
    tick = np.floor(np.asarray(times_s) * 0.64e9).astype(np.int64)
    return PixelHits(tick, np.broadcast_to(np.asarray(index, np.uint16), tick.shape), np.full(len(tick), 80, np.uint16))


def merged(*parts):
    hits = PixelHits.joined(parts)
    return hits.take(hits.tick.argsort(kind="stable"))


def field(rng, hits_per_s, start_s, end_s):
    """Evenly over all pixels."""
    count = rng.poisson(hits_per_s * (end_s - start_s))
    return at(np.sort(rng.uniform(start_s, end_s, count)), rng.integers(0, PIXELS, count))


def noise(rng, per_s, start_s, end_s, pixel=NOISY):
    return at(np.sort(rng.uniform(start_s, end_s, rng.poisson(per_s * (end_s - start_s)))), pixel)


def left_out(mask, hits):
    """Pixels of the hits that did not come through."""
    kept = mask.without_noise(hits, CLOCK_NS, 0)
    return [] if len(kept) == len(hits) else np.setdiff1d(hits.index, kept.index).tolist()


def onset_s(mask, hits):
    """When the first hit was left out."""
    kept = mask.without_noise(hits, CLOCK_NS, 0)
    different = np.flatnonzero(hits.tick[: len(kept)] != kept.tick)
    return hits.tick[different[0]] / 0.64e9 if len(different) else np.inf


@pytest.mark.parametrize(
    ("per_s", "field_per_s", "within_s"),
    [
        (30.0, 8.0, 1.5),  # beside the natural background
        (3000.0, 8.0, 1.5),
        (1.0, 8.0, 40.0),
        (30.0, 1000.0, 4.0),  # a source of 1e10 Bq at 10 m
        (1e5, 3e5, 2.0),  # one of 3e12
    ],
)
def test_a_noisy_pixel_is_left_out_within_seconds(per_s, field_per_s, within_s):
    rng = np.random.default_rng(1)
    mask = NoiseMask()
    hits = merged(noise(rng, per_s, 3.0, 3.5 + within_s), field(rng, field_per_s, 0.0, 3.5 + within_s))
    assert mask.problems == ()
    assert onset_s(mask, hits) < 3.0 + within_s
    assert mask.problems == ("camera: 1 noisy pixel masked",)


def test_the_chain_counts_without_the_noise_and_says_how_many_hits_it_left_out():
    rng = np.random.default_rng(2)
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
    hits = noise(rng, 30.0, 0.0, 20.0)
    counts = []
    for k in range(100):
        part = (hits.tick >= k * 128_000_000) & (hits.tick < (k + 1) * 128_000_000)
        start_ns = CLOCK_NS + k * SECOND // 5
        counts.append(chain.process(Readout(start_ns, start_ns + SECOND // 5, CLOCK_NS, 0.2, hits.take(part))).hits)
    assert 0 < sum(counts[:10]) < 60
    assert sum(counts[10:]) == 0
    assert chain.noise.masked_hits == len(hits) - sum(counts)
    assert chain.lost_hits == 0


@pytest.mark.parametrize("hits_per_s", [0.5, 8.0, 300.0, 5e3, 4e5])
def test_pixels_that_fire_as_often_as_the_others_are_not_touched(hits_per_s):
    """Up to 6 hits a second of each pixel, as beside 3e12 Bq at 10 m."""
    rng = np.random.default_rng(3)
    mask = NoiseMask()
    hits = field(rng, hits_per_s, 0.0, min(300.0, 4e6 / hits_per_s))
    assert left_out(mask, hits) == []
    assert (mask.pixels, mask.masked_hits) == (0, 0)


@pytest.mark.parametrize("field_per_s", [8.0, 1e4, 4e5])
def test_neither_a_burst_nor_a_track_makes_a_pixel_noisy(field_per_s):
    rng = np.random.default_rng(4)
    track = at(np.full(500, 2.51), np.arange(500) * 257 % PIXELS)
    burst = at(np.sort(rng.uniform(1.01, 1.09, 20_000)), NOISY)
    mask = NoiseMask()
    assert left_out(mask, merged(burst, track, field(rng, field_per_s, 0.0, 5.0))) == []
    assert mask.pixels == 0


def test_a_brighter_border_is_not_noise():
    """Two columns that get 20 times the mean: far more than from a source in sight of the sensor's edge."""
    rng = np.random.default_rng(5)
    column = rng.integers(0, 2, 3000)
    border = at(np.sort(rng.uniform(0.0, 60.0, 3000)), 256 * rng.integers(0, 256, 3000) + column)
    mask = NoiseMask()
    assert left_out(mask, merged(border, field(rng, 270.0, 0.0, 60.0))) == []
    assert mask.pixels == 0


def test_who_was_quiet_for_a_minute_comes_back_and_after_a_relapse_only_for_two():
    rng = np.random.default_rng(6)
    mask = NoiseMask()
    background = field(rng, 8.0, 0.0, 600.0)
    now_and_then = at(np.arange(30.0, 290.0, 45.0), NOISY)  # as healthy pixels are hit, too
    hits = merged(noise(rng, 30.0, 2.0, 10.0), now_and_then, noise(rng, 30.0, 300.0, 310.0), background)
    out = []
    for second in range(600):
        low, high = np.searchsorted(hits.tick, (second * 640_000_000, (second + 1) * 640_000_000))
        mask.without_noise(hits.take(slice(low, high)), CLOCK_NS, 0)
        out.append(mask.pixels)
    first, second = np.flatnonzero(out[:300]), np.flatnonzero(out[300:])
    assert first[0] <= 4
    assert 60 <= first[-1] - 10 <= 60 + 2 * 20 + 1
    assert second[0] <= 2
    assert 120 <= second[-1] - 10 <= 120 + 2 * 20 + 1
    assert out[-1] == 0
    assert mask.problems == ()


def test_who_stays_noisy_stays_out():
    rng = np.random.default_rng(7)
    mask = NoiseMask()
    hits = merged(noise(rng, 1.0, 0.0, 1000.0), noise(rng, 30.0, 0.0, 1000.0, pixel=7), field(rng, 8.0, 0.0, 1000.0))
    kept = mask.without_noise(hits, CLOCK_NS, 0)
    assert np.count_nonzero(kept.index == 7) < 45
    assert np.count_nonzero(kept.index == NOISY) < 40
    assert mask.problems == ("camera: 2 noisy pixels masked",)


@pytest.mark.parametrize("length_s", [0.013, 0.1, 0.2, 1.7])
def test_the_result_does_not_depend_on_how_many_hits_are_given_at_a_time(length_s):
    rng = np.random.default_rng(8)
    hits = merged(noise(rng, 20.0, 1.0, 15.0), noise(rng, 500.0, 4.0, 50.0, pixel=9), field(rng, 2000.0, 0.0, 60.0))
    whole, cut = NoiseMask(), NoiseMask()
    expected = whole.without_noise(hits, CLOCK_NS, 0)
    edges = np.arange(0.0, 60.0 + length_s, length_s) * 0.64e9
    places = np.searchsorted(hits.tick, edges)
    parts = [cut.without_noise(hits.take(slice(a, b)), CLOCK_NS, 0) for a, b in pairwise(places)]
    np.testing.assert_array_equal(PixelHits.joined(parts).tick, expected.tick)
    assert cut.masked_hits == whole.masked_hits > 0


def test_a_clock_that_is_set_back_does_not_stop_the_watch():
    rng = np.random.default_rng(9)
    mask = NoiseMask()
    mask.without_noise(field(rng, 8.0, 0.0, 5.0), CLOCK_NS + 86_400 * SECOND, 0)
    hits = noise(rng, 30.0, 0.0, 5.0)
    assert len(mask.without_noise(hits, CLOCK_NS, 0)) < 60


def test_hits_that_come_late_are_reckoned_once():
    """A hit of the beat before, given with every readout, makes no two beats of one."""
    mask = NoiseMask()
    for beat in range(1, 8):
        times_s = (np.array([-0.05, 0.01, 0.02]) + beat * BEAT_NS / SECOND) - 777e-9
        mask.without_noise(at(times_s, NOISY), CLOCK_NS, 0)
    assert mask.pixels == 0


def test_wrong_stamps_are_of_the_present_beat():
    """Or else each of them would be judged by itself, and they would make many beats of one."""
    mask = NoiseMask()
    wrong = PixelHits(np.arange(-1000, 0) * 10**12, np.full(1000, NOISY, np.uint16), np.full(1000, 80, np.uint16))
    assert len(mask.without_noise(wrong, CLOCK_NS, CLOCK_NS)) == 1000
    mask.without_noise(at([1.0], 5), CLOCK_NS, CLOCK_NS)
    assert mask.pixels == 0


@pytest.mark.parametrize(
    ("activity_bq", "direction", "seconds"),
    [
        (0.0, (0.0, 0.0, 1.0), 600),
        (1e10, (1.0, 0.0, 0.0), 60),
        (3e12, (0.6, 0.0, 0.8), 12),
    ],
)
def test_a_healthy_camera_is_not_touched(activity_bq, direction, seconds):
    """The simulated camera, 10 m from the source."""
    camera = pytest.importorskip("radron.sim.radiation.camera")
    truth = pytest.importorskip("radron.sim.radiation.truth")
    seen = camera.Camera(truth.CameraTruth(), "Cs-137", np.random.default_rng(10), CLOCK_NS)
    views = (camera.SourceView(direction, 10.0, activity_bq),) if activity_bq else ()
    mask = NoiseMask()
    for start_ns in range(CLOCK_NS, CLOCK_NS + seconds * SECOND, SECOND // 5):
        hits = seen.expose(start_ns, start_ns + SECOND // 5, views).hits
        mask.without_noise(hits.take(hits.tick.argsort(kind="stable")), CLOCK_NS, 0)
    assert (mask.pixels, mask.masked_hits) == (0, 0)
