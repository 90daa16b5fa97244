import io
from pathlib import Path

import numpy as np

from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.readout import PixelHits, Readout
from radron.sim.radiation.t3pa import T3paWriter


def readout(tick: list[int], lost: int = 0) -> Readout:
    count = len(tick)
    hits = PixelHits(np.array(tick), np.arange(count, dtype=np.uint16) * 300, np.arange(count, dtype=np.uint16) + 5)
    return Readout(0, 100_000_000, 0, 0.1 if lost == 0 else 0.025, hits, lost)


def test_the_agents_reader_gets_the_same_hits_back(tmp_path: Path) -> None:
    ticks = [16 * 7, 16 * 7 - 15, 16 * 9 + 1, 16 * 40_000_000_000 + 3]
    path = tmp_path / "x.t3pa"
    with path.open("w") as file:
        writer = T3paWriter(file)
        writer.write(readout(ticks[:2]))
        writer.write(readout(ticks[2:]))
    pieces = list(T3paReader(path))
    assert np.concatenate([piece.hits.tick for piece in pieces]).tolist() == ticks
    assert np.concatenate([piece.hits.index for piece in pieces]).tolist() == [0, 300, 0, 300]
    assert np.concatenate([piece.hits.tot for piece in pieces]).tolist() == [5, 6, 5, 6]
    assert writer.rows == 4


def test_the_columns_and_the_formula_of_the_time() -> None:
    file = io.StringIO()
    T3paWriter(file).write(readout([16 * 100 - 3]))
    header, row = file.getvalue().splitlines()
    assert header.split("\t") == ["Index", "Matrix Index", "ToA", "ToT", "FToA", "Overflow"]
    index, matrix, toa, tot, ftoa, overflow = map(int, row.split("\t"))
    assert (index, matrix, tot, overflow) == (0, 0, 5, 0)
    assert 25 * toa - 25 / 16 * ftoa == (16 * 100 - 3) * 25 / 16
    assert 0 <= ftoa < 16


def test_lost_hits_are_marked(tmp_path: Path) -> None:
    path = tmp_path / "x.t3pa"
    with path.open("w") as file:
        T3paWriter(file).write(readout([100, 200], lost=9))
    (piece,) = T3paReader(path)
    assert len(piece.hits) == 2
    assert piece.lost_hits == 2
    assert piece.lost_ns == 75_000_000
