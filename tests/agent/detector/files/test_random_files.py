"""Files with faults of all kinds drawn at random: each hit is read, each event stays whole, and no two events become one."""

from pathlib import Path

import numpy as np
import pytest

from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.files.toa import MAX_APART, PERIOD

NAMES = ("Index", "Matrix Index", "ToA", "ToT", "FToA", "Overflow")
EVENTS = 60
FILES = 1000


def events(rng: np.random.Generator) -> np.ndarray:
    """Times (N, 2) in 25 ns steps of two hits each, half of them across a border of two periods, further apart than 5 us.

    No other event lies just behind a border: two such events beside successive borders, 400 ns from 409.6 us apart, look like an
    event with misplaced hits.
    """
    start = np.cumsum(rng.integers(2_000, 60_000, EVENTS)) + PERIOD
    start[start % PERIOD < MAX_APART] += MAX_APART
    crossing = rng.random(EVENTS) < 0.5
    start[crossing] += PERIOD - start[crossing] % PERIOD - rng.integers(1, MAX_APART // 2, int(crossing.sum()))
    start = np.sort(start)
    start = start[np.diff(start, prepend=0) > 400]
    return np.column_stack((start, start + rng.integers(0, MAX_APART // 2, len(start))))


def misplaced(rng: np.random.Generator, times: np.ndarray) -> tuple[np.ndarray, int]:
    """Some of the hits behind a border get the number of the period before; returns the times and how many did."""
    crossing = times[:, 0] // PERIOD < times[:, 1] // PERIOD
    wrong = crossing & (rng.random(len(times)) < 0.3)
    written = times.copy()
    written[wrong, 1] -= PERIOD
    return written, int(wrong.sum())


def text(rng: np.random.Generator, measurements: list[np.ndarray]) -> str:
    """The rows of each measurement, with matrix indices that count all hits, in some layout."""
    delimiter = str(rng.choice(["\t", ";", ",", "    ", "\t ", ", "]))
    lines, pixel = [delimiter.join(NAMES)], 0
    for times in measurements:
        for index, toa in enumerate(times.ravel().tolist()):
            ftoa, pad = int(rng.integers(0, 16)), " " * int(rng.integers(0, 3))
            lines.append(delimiter.join(f"{value}{pad}" for value in (index, pixel, toa, 20, ftoa, 0)))
            pixel += 1
        lines += [""] * int(rng.integers(0, 2))
    return ("\ufeff" if rng.random() < 0.3 else "") + str(rng.choice(["\n", "\r\n"])).join(lines) + "\n"


@pytest.mark.slow
def test_no_hit_is_lost_no_event_is_split_and_no_two_events_become_one(tmp_path: Path) -> None:
    for seed in range(FILES):
        rng = np.random.default_rng(seed)
        true = [events(rng) for _ in range(int(rng.integers(1, 4)))]
        written = [misplaced(rng, times) for times in true]
        path = tmp_path / "hits.t3pa"
        path.write_bytes(text(rng, [times for times, _ in written]).encode())
        reader = T3paReader(path, piece_bytes=int(rng.choice([1 << 9, 1 << 12, 1 << 22])))
        pieces = list(reader)
        tick = np.concatenate([piece.hits.tick for piece in pieces])
        pixel = np.concatenate([piece.hits.index for piece in pieces])
        pairs = tick[np.argsort(pixel)].reshape(-1, 2) / 16.0
        assert reader.measurements == len(true), seed
        assert len(pairs) == sum(map(len, true)), seed
        assert np.abs(pairs[:, 1] - pairs[:, 0]).max() <= MAX_APART, seed
        assert np.diff(np.sort(pairs[:, 0])).min() > 300, seed
        assert sum(piece.repaired_hits for piece in pieces) == sum(count for _, count in written), seed
