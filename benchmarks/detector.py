"""Measure the speed of the detector chain on one core: ``python -m benchmarks.detector``.

The hits are made here, of the usual shape (about ten hits per event, every tenth event a coincidence, 50,000 events/s), so that
the numbers do not depend on the simulation. Times are processor times, so that other programs matter little.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import NOMINAL, Calibration
from radron.agent.detector.files.t3pa import T3paReader
from radron.agent.detector.files.t3pa import readouts as file_readouts
from radron.agent.detector.readout import PixelHits, Readout

EVENT_NS = 20_000
COINCIDENCES = 0.1


def synthetic_hits(events: int, rng: np.random.Generator, event_ns: float = EVENT_NS) -> PixelHits:
    """Hits of Cs-137-like events in the order of a real camera: nearly by time."""
    times = np.cumsum(rng.exponential(event_ns, events))
    double = rng.random(events) < COINCIDENCES
    # each deposit: event, energy, place, size
    event = np.concatenate((np.arange(events), np.flatnonzero(double)))
    electron = rng.uniform(60.0, 450.0, events)
    energy = np.concatenate((electron, 661.66 - electron[double]))
    row, column = rng.integers(8, 246, len(event)), rng.integers(8, 246, len(event))
    size = np.maximum(rng.poisson(3.0 + energy / 40.0), 1)
    # a deposit's hits: a chain of touching pixels
    deposit = np.repeat(np.arange(len(event)), size)
    step = np.arange(len(deposit)) - np.repeat(np.cumsum(size) - size, size)
    rows = row[deposit] + step // 3
    columns = column[deposit] + step % 3
    drift_ns = rng.uniform(0.0, 86.0, len(event))[deposit] + rng.normal(0.0, 2.5, len(deposit))
    tick = np.floor((times[event[deposit]] + 1000.0 + drift_ns) * 16.0 / 25.0).astype(np.int64)
    a, b, c, t = NOMINAL
    kev = np.maximum(energy[deposit] / size[deposit], t + 3.0)
    tot = np.clip(np.round(a * kev + b - c / (kev - t)), 1, 1023)
    order = np.argsort(tick + tot * 16, kind="stable")  # a hit is sent when its time over threshold is known
    return PixelHits(tick[order], (256 * rows + columns).astype(np.uint16)[order], tot.astype(np.uint16)[order])


def write_t3pa(path: Path, hits: PixelHits) -> None:
    """The hits as a file of the camera's own format."""
    toa = -(-hits.tick // 16)
    columns = np.column_stack((np.arange(len(hits)), hits.index, toa, hits.tot, 16 * toa - hits.tick, np.zeros(len(hits), int)))
    with path.open("w") as file:
        file.write("Index\tMatrix Index\tToA\tToT\tFToA\tOverflow\n")
        file.writelines("\t".join(map(str, row)) + "\n" for row in columns.tolist())


def best_s(run: Callable[[], object], repeats: int) -> float:
    return min(times_s(run, repeats))


def times_s(run: Callable[[], object], repeats: int) -> list[float]:
    times = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return times


def readouts(hits: PixelHits, slice_ns: int) -> list[Readout]:
    """The hits cut into slices of equal length."""
    edges = np.arange(0, int(hits.tick.max() * 25 // 16) + 2 * slice_ns, slice_ns)
    order = np.argsort(hits.tick, kind="stable")
    tick, index, tot = hits.tick[order], hits.index[order], hits.tot[order]
    cuts = np.searchsorted(tick, edges * 16 // 25)
    return [
        Readout(int(start), int(start) + slice_ns, 0, slice_ns * 1e-9, PixelHits(tick[i:j], index[i:j], tot[i:j]))
        for start, i, j in zip(edges[:-1], cuts[:-1], cuts[1:], strict=True)
    ]


def cones_of_file(path: Path) -> int:
    """Number of cones of a file, from its bytes on."""
    chain = new_chain()
    cones = sum(len(chain.process(readout).cones) for readout in file_readouts(T3paReader(path)))
    return cones + len(chain.flush().cones)


def new_chain() -> DetectorChain:
    return DetectorChain(DetectionConfig(), "Cs-137", Calibration.nominal())


def main() -> None:
    rng = np.random.default_rng(1)
    hits = synthetic_hits(60_000, rng)
    end_ns = int(hits.tick.max() * 25 // 16) + 1000
    everything = Readout(0, end_ns, 0, end_ns * 1e-9, hits)
    found = new_chain().process(everything)
    whole_s = best_s(lambda: new_chain().process(everything), 5)
    print(f"hits to cones, one batch of {len(hits):,} hits, {len(found.cones):,} cones: {len(hits) / whole_s / 1e6:.2f} M hits/s")

    slices = readouts(hits, 10_000_000)
    sliced_s = best_s(lambda: [chain.process(part) for chain in (new_chain(),) for part in slices], 3)
    print(f"hits to cones, {len(slices)} readouts of 10 ms: {len(hits) / sliced_s / 1e6:.2f} M hits/s")

    quiet = [part for part in readouts(synthetic_hits(800, rng, event_ns=50e6), 200_000_000) if 25 <= len(part.hits) <= 60]
    with_cone = [part for part in quiet if len(new_chain().process(part).cones) == 1]
    chain = new_chain()
    batches = [best_s(lambda part=part: chain.process(part), 30) * 1e6 for part in with_cone]
    mean = np.mean([len(part.hits) for part in with_cone])
    print(f"one readout of {mean:.0f} hits with one cone: {np.median(batches):.0f} us (worst {max(batches):.0f} us)")

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hits.t3pa"
        write_t3pa(path, hits)
        read_s = best_s(lambda: [None for _ in T3paReader(path)], 3)
        cones_s = statistics.median(times_s(lambda: cones_of_file(path), 5))
        print(f"file to cones, median of 5: {len(hits) / cones_s / 1e6:.2f} M hits/s")
        print(f"file reader: {len(hits) / read_s / 1e6:.2f} M rows/s ({path.stat().st_size / read_s / 1e6:.0f} MB/s)")


if __name__ == "__main__":
    main()
