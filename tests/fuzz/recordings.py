"""Files of the camera (``.t3pa``): ``DetectorError`` with the line, or readouts that make sense."""

from __future__ import annotations

import io
from pathlib import Path
from random import Random

import numpy as np

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.drivers.t3pa import playback
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.files.t3pa import T3paReader, readouts
from radron.agent.detector.readout import PixelHits, Readout
from radron.agent.errors import DetectorError
from radron.sim.radiation.t3pa import T3paWriter
from tests.fuzz.mutation import broken, broken_text
from tests.fuzz.target import Probe, Target, expect

_CHAINED = 20  # of so many files one is worked through to the end
_MOST_SLICES = 50  # of a playback: a file may claim centuries
_SECOND = 1_000_000_000


class Recordings(Target):
    """Files of a few hundred hits, with and without lost data, with other numbers, lines and bytes."""

    name = "t3pa"
    inputs = 100_000
    batch = 50
    limit_s = 2.0

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._examples = tuple(_recording(seed) for seed in range(4))

    def case(self, rng: Random, probe: Probe) -> None:
        """A series of files, under the same name."""
        path = self.folder / "fuzzed.t3pa"
        for _ in range(self.batch):
            data = self._content(rng)
            path.write_bytes(data)
            bits, piece_bytes = rng.choice((None, None, 14, 30)), rng.choice((None, 1 << 16, 1000, 1))
            probe.feed(data, _read, path, bits, piece_bytes, rng.randrange(_CHAINED) == 0)

    def _content(self, rng: Random) -> bytes:
        example, pick = rng.choice(self._examples), rng.random()
        if pick < 0.02:
            first = example.partition(b"\n")[0] + b"\n"
            return rng.choice(
                (b"", b"\n", first, first + b"\n" * 1000, first + b"9" * 100_000, first * 2, rng.randbytes(1000), b"\0" * 1000)
            )
        if pick < 0.2:
            return broken(rng, example, self._examples)
        for _ in range(rng.choice((1, 1, 2, 4))):
            example = broken_text(rng, example)
        return example


def _read(path: Path, bits: int | None, piece_bytes: int | None, chained: bool) -> None:
    try:
        for readout in readouts(T3paReader(path, bits, piece_bytes), _SECOND):
            _check(readout)
    except DetectorError as error:
        expect(
            "\n" not in str(error) and path.name in str(error), f"an error of several lines or without file: {str(error)[:200]!r}"
        )
    if not chained:
        return
    chain = DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())
    try:
        for number, readout in enumerate(playback(T3paReader(path, bits, piece_bytes), _SECOND)):
            _check(readout)
            chain.process(readout)
            if number >= _MOST_SLICES:
                return
    except DetectorError:
        return


def _check(readout: Readout) -> None:
    expect(readout.start_ns <= readout.end_ns, "a readout that ends before it begins")
    span_s = (readout.end_ns - readout.start_ns) * 1e-9
    expect(
        0.0 <= readout.live_time_s <= span_s * 1.000001 + 1e-9,
        f"a live time out of its readout: {readout.live_time_s} of {span_s}",
    )


def _recording(seed: int) -> bytes:
    """Some hundred hits in clusters of a second, with the rows of lost data in some."""
    rng = np.random.default_rng(seed)
    text = io.StringIO()
    writer, start_ns = T3paWriter(text), _SECOND
    for part in range(3):
        count = int(rng.integers(20, 120))
        tick = np.sort(np.repeat(rng.integers(part * 640_000_000, (part + 1) * 640_000_000, count // 4), 4))
        index = rng.integers(0, 65536, len(tick))
        hits = PixelHits(tick, index.astype(np.uint16), rng.integers(1, 300, len(tick)).astype(np.uint16))
        lost = 5 if seed % 2 and part == 1 else 0
        end_ns = start_ns + _SECOND
        writer.write(Readout(start_ns, end_ns, _SECOND, 0.9 if lost else 1.0, hits, lost))
        start_ns = end_ns
    return text.getvalue().encode()
