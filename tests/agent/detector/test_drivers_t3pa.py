"""Playback of a recording: the same hits, at the recorded times."""

import asyncio
import time
from itertools import pairwise

import numpy as np
import pytest

from radron.agent.config.drone import DetectorConfig
from radron.agent.detector.drivers import open_detector
from radron.agent.detector.drivers.t3pa import RecordedDetector, playback
from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.errors import ConfigError, DetectorError
from support.sensors.detector_feed import until

HEADER = "Index\tMatrix Index\tToA\tToT\tFToA\tOverflow"
SECOND = 40_000_000  # of ToA
START_NS = 1_700_000_000_000_000_000


def write(path, rows):
    """(matrix index, toa, tot, ftoa, overflow) rows."""
    lines = [HEADER, *("\t".join(map(str, (number, *row))) for number, row in enumerate(rows))]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def path(tmp_path):
    return tmp_path / "hits.t3pa"


def test_slices_hold_the_hits_of_their_time(path):
    rng = np.random.default_rng(1)
    toa = np.sort(rng.integers(7 * SECOND, 9 * SECOND, 20_000))
    toa += rng.integers(-20_000, 20_000, len(toa))  # not in order: up to 0.5 ms
    write(path, [(number % 65536, int(one), 30, number % 32, 0) for number, one in enumerate(toa)])
    first_tick = int((16 * toa - np.arange(len(toa)) % 32).min())
    readouts = list(playback(T3paReader(path, piece_bytes=5000), START_NS))
    assert readouts[0].start_ns == START_NS
    assert all(later.start_ns == earlier.end_ns for earlier, later in pairwise(readouts))
    assert {readout.end_ns - readout.start_ns for readout in readouts} == {200_000_000}
    assert sum(len(readout.hits) for readout in readouts) == len(toa)
    for readout in readouts:
        time_ns = START_NS + (readout.hits.tick - first_tick) * 25 // 16
        assert time_ns.min() >= readout.start_ns - 2  # of two roundings to ns
        assert time_ns.max() < readout.end_ns + 2
    assert sum(readout.live_time_s for readout in readouts) == pytest.approx(0.2 * len(readouts))


def test_missing_time_is_dead_time(path):
    rows = [(1, 0, 30, 0, 0), (0x74, 100, 0, 0, 1), (0x75, SECOND // 4, 0, 0, 1), (2, SECOND, 30, 0, 0)]
    readouts = list(playback(T3paReader(write(path, rows)), START_NS))
    assert sum(readout.live_time_s for readout in readouts) == pytest.approx(0.2 * len(readouts) - 0.25)
    assert min(readout.live_time_s for readout in readouts) >= 0.0
    assert sum(readout.lost_hits for readout in readouts) == 2


@pytest.mark.parametrize("rows", [[], [(0x74, 100, 0, 0, 1)]], ids=["no rows", "no hits"])
def test_a_recording_without_hits_is_over_at_once(path, rows):
    assert list(playback(T3paReader(write(path, rows)), START_NS)) == []


def test_it_plays_in_real_time_and_says_when_it_is_over(path):
    write(path, [(number, number * SECOND // 10, 30, 0, 0) for number in range(5)])

    async def run():
        detector = open_detector(DetectorConfig(driver="t3pa", file=str(path)))
        begun_ns = time.time_ns()
        received = []
        async for readout in detector.readouts():
            received.append((time.time_ns(), readout))
        assert detector.problems == (f"the recording {path} has ended",)
        assert [len(readout.hits) for _, readout in received] == [2, 2, 1]
        for there_ns, readout in received:
            assert there_ns >= readout.end_ns  # never before its time
        assert begun_ns <= received[0][1].start_ns

    asyncio.run(run())


def test_a_broken_row_ends_it_with_a_problem_that_names_the_line(path):
    write(path, [(number, number, 30, 0, 0) for number in range(10_000)])
    with path.open("a") as file:
        file.write("nonsense\n")

    async def run():
        detector = RecordedDetector(path)
        async for _ in detector.readouts():
            pass
        assert "line 10002" in detector.problems[0]

    asyncio.run(run())


def test_close_ends_it(path):
    write(path, [(1, 0, 30, 0, 0), (2, 3600 * SECOND, 30, 0, 0)])

    async def run():
        detector = RecordedDetector(path)
        received = []

        async def read():
            async for readout in detector.readouts():
                received.append(readout)

        task = asyncio.create_task(read())
        await until(lambda: len(received) == 1, "the first slice")
        await detector.close()
        await asyncio.wait_for(task, 10.0)
        assert detector.problems == ()

    asyncio.run(run())


def test_what_is_no_recording_is_refused_when_it_is_opened(path):
    with pytest.raises(DetectorError, match="cannot be read"):
        open_detector(DetectorConfig(driver="t3pa", file=str(path)))
    path.write_text("a,b,c\n1,2,3\n")
    with pytest.raises(DetectorError, match="line 1: not the header"):
        open_detector(DetectorConfig(driver="t3pa", file=str(path)))
    with pytest.raises(ConfigError, match=r"detector\.file is missing"):
        open_detector(DetectorConfig(driver="t3pa"))


def test_a_driver_that_is_not_installed_is_refused_with_the_known_names():
    with pytest.raises(ConfigError, match=r"detector\.driver: unknown detector 'pulsar'; known: none, feed, t3pa, pypixet"):
        open_detector(DetectorConfig(driver="pulsar"))
