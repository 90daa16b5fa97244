"""A camera that repeats itself is noticed with the first repeated readout; a measuring camera, never."""

import time

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.detector.repeats import KEPT_READOUTS, MAX_COMPARED_HITS, Repeats

START_NS, SPAN_NS = 1_800_000_000_000_000_000, 200_000_000
SPAN_TICKS = SPAN_NS * 16 // 25


def readout(number, hits):
    """The readout of that number, 0.2 s long; ticks from its start."""
    start_ns = START_NS + number * SPAN_NS
    return Readout(start_ns, start_ns + SPAN_NS, START_NS, 0.19, later(hits, number * SPAN_TICKS), 3)


def later(hits, ticks):
    return replace(hits, tick=hits.tick + ticks)


def random_hits(rng, count):
    tick = np.sort(rng.integers(0, SPAN_TICKS, count))
    return PixelHits(tick, rng.integers(0, 65536, count).astype(np.uint16), rng.integers(20, 40, count).astype(np.uint16))


def left_out(repeats, numbers, hits_of):
    """The numbers of the readouts that are left out."""
    return [number for number in numbers if repeats.without(readout(number, hits_of(number))).live_time_s == 0.0]


@pytest.mark.parametrize("count", [3, 20, 2000])
def test_a_readout_that_comes_again_is_left_out_at_once(count):
    rng, repeats = np.random.default_rng(count), Repeats()
    stuck = random_hits(rng, count)
    assert left_out(repeats, range(10), lambda number: random_hits(rng, count) if number < 4 else stuck) == [5, 6, 7, 8, 9]
    assert repeats.problems == ("camera: it delivers the same hits again and again; they are not used",)
    assert repeats.readouts == 5


def test_its_time_stays_without_hits_and_without_live_time():
    repeats, stuck = Repeats(), random_hits(np.random.default_rng(1), 50)
    first = readout(0, stuck)
    assert repeats.without(first) is first
    again = repeats.without(readout(1, stuck))
    assert (again.start_ns, again.end_ns, again.live_time_s, len(again.hits), again.lost_hits) == (
        START_NS + SPAN_NS,
        START_NS + 2 * SPAN_NS,
        0.0,
        0,
        0,
    )


def test_hits_under_their_old_stamps_come_again_too():
    repeats, stuck = Repeats(), readout(0, random_hits(np.random.default_rng(1), 50))
    repeats.without(stuck)
    moved = replace(stuck, start_ns=stuck.end_ns, end_ns=stuck.end_ns + SPAN_NS)
    assert repeats.without(moved).live_time_s == 0.0


def test_several_buffers_in_turn():
    """Empty buffers and buffers of a hit or two are left out, too, once known to come again."""
    rng, repeats = np.random.default_rng(1), Repeats()
    ring = [random_hits(rng, count) for count in (5, 0, 9, 1, 7)]
    assert left_out(repeats, range(20), lambda number: ring[number % 5]) == list(range(5, 20))


def test_a_camera_that_measures_again_is_used_again():
    rng, repeats = np.random.default_rng(1), Repeats()
    stuck = random_hits(rng, 50)
    assert left_out(repeats, range(20), lambda number: stuck if 5 <= number < 12 else random_hits(rng, 50)) == [*range(6, 12)]
    assert repeats.problems == ()


@pytest.mark.parametrize("hits_per_s", [0.0, 1.5, 8.0, 100.0])
def test_a_camera_that_measures_is_never_left_out(hits_per_s):
    """For half an hour, with nothing or the background alone, in which most readouts are empty."""
    rng, repeats = np.random.default_rng(1), Repeats()
    assert left_out(repeats, range(9000), lambda _: random_hits(rng, rng.poisson(0.2 * hits_per_s))) == []


def test_noisy_pixels_are_no_repetition():
    """One or two pixels that fire once in each readout, always with the same pulse, and a hundred that fire at random."""
    rng, repeats = np.random.default_rng(1), Repeats()
    for noisy in (1, 2):
        index, pulse = np.arange(noisy, dtype=np.uint16) * 300, np.full(noisy, 60, np.uint16)
        same = PixelHits(np.arange(noisy) * 1000, index, pulse)
        assert left_out(repeats, range(100), lambda _, same=same: same) == []

    def fired(_):
        return replace(random_hits(rng, 300), index=rng.integers(0, 100, 300).astype(np.uint16), tot=np.full(300, 60, np.uint16))

    assert left_out(repeats, range(100), fired) == []


def test_what_is_kept_is_bounded():
    rng, repeats = np.random.default_rng(1), Repeats()
    first = random_hits(rng, 50)
    repeats.without(readout(0, first))
    assert left_out(repeats, range(1, KEPT_READOUTS + 1), lambda _: random_hits(rng, 50)) == []
    assert left_out(repeats, [KEPT_READOUTS + 1], lambda _: first) == []


def test_it_takes_no_time():
    """The largest readout that the agent takes: 20,000 hits, whose evaluation takes tens of milliseconds."""
    rng, repeats = np.random.default_rng(1), Repeats()
    large = [readout(number, random_hits(rng, 20_000)) for number in range(20)]
    took_s = []
    for one in large:
        began_s = time.perf_counter()
        repeats.without(one)
        took_s.append(time.perf_counter() - began_s)
    assert min(took_s) < 1e-3
    assert MAX_COMPARED_HITS < 20_000
