"""The content of a file of the camera: times, rates, pixels, clusters and spectrum (``radron-agent inspect``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.clustering import Clusters, cluster_many
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.files.frames import read_frame
from radron.agent.detector.files.t3pa import T3paReader, readouts
from radron.agent.detector.readout import SATURATED_TOT, SENSOR_PIXELS, TICK_NS, PixelHits
from radron.agent.detector.spectroscopy.recognition import Recogniser

MIN_HITS_PER_PIXEL = 10.0  # mean below which a pixel without hits says nothing: at 10 it is one healthy pixel in 22,000
NOISY_RATIO = 20.0  # times as many hits as the mean pixel
MAX_NOISY_LISTED = 100
SPECTRUM_BIN_KEV = 2.0
SPECTRUM_BINS = 1000
_RATE_BIN_NS = 10_000_000
MAX_RATE_BINS = 200
MAX_CLUSTER_PIXELS = 40
_PIXELS = SENSOR_PIXELS**2


class NoisyPixel(Struct, frozen=True):
    """A pixel that fires far more often than the mean: column and row from the lower left, and its number of hits."""

    column: int
    row: int
    hits: int


class Inspection(Struct, frozen=True, kw_only=True):
    """A summary of the content of a recording: times, rates, pixels, clusters and spectrum; the lists are for the picture.

    pixels: hits of each pixel (65536,) by matrix index. spectrum: events in bins of 2 keV. sizes: clusters by their number of
    pixels; the last bin is for larger ones. rate: hits in successive parts of ``rate_bin_s``. dead_pixels: pixels without hits;
    None with too few hits. delay_ns: median and 95 % quantile, over the clusters, of the energy-weighted mean time after the
    earliest hit:
    the drift in the sensor, and the time walk. lines_kev: lines in the spectrum that belong to no known nuclide.
    """

    file: str
    format: str
    measurements: int
    duration_s: float | None
    live_time_s: float | None
    hits: int
    lost_rows: int
    repaired_hits: int
    saturated_hits: int
    masked_pixels: int
    pixels_hit: int
    dead_pixels: int | None
    noisy_pixels: tuple[NoisyPixel, ...]
    clusters: int
    delay_ns: tuple[float, float] | None
    nuclide: str | None
    lines_kev: tuple[int, ...]
    notes: tuple[str, ...]
    pixels: list[int]
    spectrum: list[int]
    sizes: list[int]
    rate: list[int]
    rate_bin_s: float


class _Counts:
    """Sums over the hits and clusters of a file."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self.pixels = np.zeros(_PIXELS, np.int64)
        self.sizes = np.zeros(MAX_CLUSTER_PIXELS + 1, np.int64)
        self.spectrum = np.zeros(SPECTRUM_BINS, np.int64)
        self.recogniser = Recogniser()
        self.rate = np.zeros(0, np.int64)
        self.delays: list[NDArray[np.float64]] = []
        self.saturated = self.clusters = 0

    def add_hits(self, hits: PixelHits, gap_ticks: float) -> Clusters | None:
        """Count the hits, and their clusters; returns these."""
        self.pixels += np.bincount(hits.index, minlength=_PIXELS)
        self.saturated += int(np.count_nonzero(hits.tot >= SATURATED_TOT))
        energy_kev = self._calibration.energy_kev(hits.index, hits.tot)
        known = energy_kev > 0.0
        if not known.any():
            return None
        hits, energy_kev = hits.take(known), energy_kev[known]
        order = np.argsort(hits.tick, kind="stable")
        found = cluster_many(hits.take(order), energy_kev[order], gap_ticks)
        self.sizes += np.bincount(np.minimum(found.pixels, MAX_CLUSTER_PIXELS), minlength=MAX_CLUSTER_PIXELS + 1)
        self.delays.append(found.delay[found.pixels > 1])
        self.clusters += len(found)
        return found

    def add_energies(self, energies_kev: Sequence[float] | NDArray[np.float64]) -> None:
        """Count events in the spectrum."""
        self.spectrum += np.histogram(energies_kev, SPECTRUM_BINS, (0.0, SPECTRUM_BINS * SPECTRUM_BIN_KEV))[0]
        self.recogniser.add(energies_kev)

    def add_times(self, since_ns: NDArray[np.int64]) -> None:
        """Count hits by their time since the first one."""
        if len(since_ns):
            more = np.bincount(since_ns.clip(0) // _RATE_BIN_NS, minlength=len(self.rate))
            more[: len(self.rate)] += self.rate
            self.rate = more

    @property
    def delay_ns(self) -> tuple[float, float] | None:
        """Median and 95 % quantile of the clusters' delays; None without clusters of several pixels, or times."""
        delays = TICK_NS * np.concatenate((np.empty(0), *self.delays))
        return (float(np.median(delays)), float(np.quantile(delays, 0.95))) if len(delays) and len(self.rate) else None


def inspect_hits(
    reader: T3paReader, calibration: Calibration, progress: Callable[[int], None] = lambda position_bytes: None
) -> Inspection:
    """Summarise a file of pixel hits.

    progress: called with the position in the file (bytes).

    Raises:
        DetectorError: the file cannot be read to its end.
    """
    config = DetectionConfig()
    counts = _Counts(calibration)
    chain = DetectorChain(config, None, calibration, on_energies=counts.add_energies)
    live_s, start_ns, end_ns = 0.0, None, 0
    for readout in readouts(reader):
        start_ns = readout.start_ns if start_ns is None else start_ns
        end_ns = readout.end_ns
        live_s += readout.live_time_s
        counts.add_hits(readout.hits, config.cluster_gap_ns / TICK_NS)
        counts.add_times(readout.hits.tick * 25 // 16 - (start_ns - readout.clock_ns))
        chain.process(readout)
        progress(reader.position_bytes)
    chain.flush()
    duration_s = 0.0 if start_ns is None else (end_ns - start_ns) * 1e-9
    return _inspection(
        reader.path, "pixel hits (.t3pa, .t3p)", counts, calibration, reader.measurements, (duration_s, live_s),
        (chain.lost_hits, chain.repaired_hits), reader.notes,
    )  # fmt: skip


def inspect_frame(path: Path, calibration: Calibration) -> Inspection:
    """Summarise an image of time over threshold: its hits have no time, so touching hits are one cluster.

    Raises:
        DetectorError: the file is not such an image.
    """
    frame = read_frame(path)
    index = np.flatnonzero(frame.tot)
    hits = PixelHits(np.zeros(len(index), np.int64), index.astype(np.uint16), frame.tot[index].clip(0, 65535).astype(np.uint16))
    counts = _Counts(calibration)
    found = counts.add_hits(hits, 0.0)
    if found is not None:
        counts.add_energies(found.energy_kev[~found.saturated])
    times = (frame.acquisition_s, frame.acquisition_s)
    notes = ("a frame: hits without time of their own, so no coincidences and no cones",)
    return _inspection(path, "frame of time over threshold", counts, calibration, 1, times, (0, 0), notes)


def _inspection(
    path: Path,
    form: str,
    counts: _Counts,
    calibration: Calibration,
    measurements: int,
    times_s: tuple[float | None, float | None],
    lost_and_repaired: tuple[int, int],
    notes: tuple[str, ...],
) -> Inspection:
    found = counts.recogniser.look()
    hits = int(counts.pixels.sum())
    together = max(1, -(-len(counts.rate) // MAX_RATE_BINS))
    return Inspection(
        file=path.name,
        format=form,
        measurements=measurements,
        duration_s=times_s[0],
        live_time_s=times_s[1],
        hits=hits,
        lost_rows=lost_and_repaired[0],
        repaired_hits=lost_and_repaired[1],
        saturated_hits=counts.saturated,
        masked_pixels=calibration.bad_pixels,
        pixels_hit=int(np.count_nonzero(counts.pixels)),
        dead_pixels=_dead_pixels(counts.pixels),
        noisy_pixels=_noisy_pixels(counts.pixels),
        clusters=counts.clusters,
        delay_ns=counts.delay_ns,
        nuclide=found.nuclide if found is not None and found.certain else None,
        lines_kev=counts.recogniser.unknown_lines_kev(found),
        notes=notes,
        pixels=counts.pixels.tolist(),
        spectrum=counts.spectrum.tolist(),
        sizes=counts.sizes.tolist(),
        rate=np.add.reduceat(counts.rate, np.arange(0, len(counts.rate), together)).tolist() if len(counts.rate) else [],
        rate_bin_s=together * _RATE_BIN_NS * 1e-9,
    )


def _dead_pixels(pixels: NDArray[np.int64]) -> int | None:
    return int(np.count_nonzero(pixels == 0)) if np.median(pixels) >= MIN_HITS_PER_PIXEL else None


def _noisy_pixels(pixels: NDArray[np.int64]) -> tuple[NoisyPixel, ...]:
    """Return the pixels that fire ``NOISY_RATIO`` times as often as the mean of the others, and than a single hit, the worst
    first.
    """
    limit = NOISY_RATIO * max(1.0, float(np.mean(np.sort(pixels)[: _PIXELS - _PIXELS // 100])))
    worst = np.argsort(-pixels, kind="stable")[:MAX_NOISY_LISTED]
    return tuple(NoisyPixel(int(k % SENSOR_PIXELS), int(k // SENSOR_PIXELS), int(pixels[k])) for k in worst if pixels[k] > limit)
