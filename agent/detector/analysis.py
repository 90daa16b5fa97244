"""Analysis of a whole ``.t3pa`` file: its cones as CSV, and a summary."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.detection import ConeEvent, Detections
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.files.t3pa import T3paReader, readouts
from radron.agent.detector.imaging import Direction, DirectionScan
from radron.agent.detector.inspection import SPECTRUM_BIN_KEV, SPECTRUM_BINS
from radron.agent.detector.lines import CANDIDATES, lines_of
from radron.agent.detector.spectroscopy.recognition import Recogniser, Recognition
from radron.agent.detector.spectroscopy.residuals import told
from radron.agent.errors import DetectorError
from radron.agent.outputs import replacing

# Times in ns since the detector's clock was reset; camera frame (x along the rows, y up, z the outward normal). The axis is that
# of reading 1 (cluster 1 is the electron), from the absorbed photon to the electron. Reading 2 has its opposite.
CSV_COLUMNS = (
    "stamp_ns",
    "axis_x",
    "axis_y",
    "axis_z",
    "theta_1_deg",
    "sigma_1_deg",
    "probability_1",
    "theta_2_deg",
    "sigma_2_deg",
    "probability_2",
    "energy_1_kev",
    "energy_2_kev",
    "energy_sigma_kev",
    "separation_mm",
)
_SURE = 100.0  # evidence above which the rest of a file cannot change the result


@dataclass(frozen=True, slots=True)
class Peak:
    """A full-energy peak in a measured spectrum: the gamma line, the measured centre and width (keV), and the events in
    the peak.
    """

    line_kev: float
    centre_kev: float
    fwhm_kev: float
    events: int


@dataclass(frozen=True, slots=True)
class Summary:
    """The numbers that ``radron-agent cones`` prints about a recording."""

    rows: int
    lost_rows: int
    noise_rows: int
    repaired_rows: int  # hits moved to the neighbouring period of the chip's counter
    measurements: int  # of the file, one appended to the other
    notes: tuple[str, ...]  # on missing parts of the file
    duration_s: float
    live_time_s: float
    hits: int
    photopeak: int
    coincidences: int
    cones: int
    peak: Peak | None
    recognised: Recognition | None
    unknown_lines_kev: tuple[int, ...]  # of no one known nuclide
    direction: Direction | None


def analyse(
    reader: T3paReader,
    config: DetectionConfig,
    nuclide: str,
    calibration: Calibration,
    csv_path: Path,
    *,
    progress: Callable[[int], None] = lambda position_bytes: None,
) -> Summary:
    """Write the Compton cones of a recording to ``csv_path``, and return a summary; after an error no CSV is left behind.

    progress: called with the position in the file (bytes).

    Raises:
        DetectorError: the file cannot be read to its end.
        OutputError: the CSV cannot be written, or is the recording itself.
        ConfigError: an unknown nuclide.
    """
    spectrum = np.zeros(SPECTRUM_BINS, np.int64)
    recogniser = Recogniser()

    def count(energies_kev: Sequence[float] | NDArray[np.float64]) -> None:
        spectrum[:] += np.histogram(energies_kev, SPECTRUM_BINS, (0.0, SPECTRUM_BINS * SPECTRUM_BIN_KEV))[0]
        recogniser.add(energies_kev)

    chain = DetectorChain(config, nuclide, calibration, on_energies=count)
    scan = DirectionScan()
    parts: list[Detections] = []

    def stretches() -> Iterable[tuple[ConeEvent, ...]]:
        for readout in readouts(reader):
            yield keep(chain.process(readout))
            progress(reader.position_bytes)
        yield keep(chain.flush())

    def keep(part: Detections) -> tuple[ConeEvent, ...]:
        scan.add(part.cones)
        parts.append(
            Detections(part.start_ns, part.end_ns, part.live_time_s, part.hits, part.photopeak, part.coincidences)
        )  # the cones are left out: a long file has millions
        return part.cones

    cones = _write_csv(csv_path, reader.path, stretches())
    found = recogniser.look()
    return Summary(
        rows=reader.rows,
        lost_rows=chain.lost_hits,
        noise_rows=chain.noise.masked_hits,
        repaired_rows=chain.repaired_hits,
        measurements=reader.measurements,
        notes=reader.notes,
        duration_s=(parts[-1].end_ns - parts[0].start_ns) * 1e-9 if parts else 0.0,
        live_time_s=sum(part.live_time_s for part in parts),
        hits=sum(part.hits for part in parts),
        photopeak=sum(part.photopeak for part in parts),
        coincidences=sum(part.coincidences for part in parts),
        cones=cones,
        peak=find_peak(spectrum, lines_of(nuclide)),
        recognised=found if found is not None and found.certain else None,
        unknown_lines_kev=recogniser.unknown_lines_kev(found),
        direction=scan.best(),
    )


def recognise(
    reader: T3paReader,
    config: DetectionConfig,
    calibration: Calibration,
    *,
    progress: Callable[[int], None] = lambda position_bytes: None,
) -> Recognition:
    """Recognise the nuclide in a recording's spectrum; only as much of the file is read as is needed.

    progress: called with the position in the file (bytes).

    Raises:
        DetectorError: the file cannot be read, or no nuclide stands out.
    """
    recogniser = Recogniser()
    chain = DetectorChain(config, None, calibration, on_energies=recogniser.add)
    for readout in readouts(reader):
        chain.process(readout)
        progress(reader.position_bytes)
        found = recogniser.best()
        if found is not None and found.evidence >= _SURE:
            return found
    chain.flush()
    found = recogniser.look()
    if found is not None and found.certain:
        return found
    lines_kev = recogniser.unknown_lines_kev(found)
    what = f"an unknown nuclide or several, lines at {told(lines_kev)}," if lines_kev else "no nuclide stands out"
    raise DetectorError(
        f"{what} among {recogniser.events} events of the file; known are {', '.join(CANDIDATES)}; name one with --nuclide"
    )


def find_peak(spectrum: NDArray[np.int64], lines_kev: Iterable[float]) -> Peak | None:
    """Return the strongest full-energy peak near one of the gamma lines, in a spectrum of 2 keV bins; None with too few events.

    Centre and width come from the moments within 1.5 times the half width of a 5 % resolution, in two passes.
    """
    centres = (np.arange(len(spectrum)) + 0.5) * SPECTRUM_BIN_KEV
    best: Peak | None = None
    for line in lines_kev:
        near = np.abs(centres - line) <= 0.1 * line
        if spectrum[near].sum() < 50:
            continue
        middle = float(centres[near][np.argmax(np.convolve(spectrum, np.ones(5), "same")[near])])
        for _ in range(2):
            inside = np.abs(centres - middle) <= 0.05 * line
            counts = spectrum[inside]
            middle = float(np.average(centres[inside], weights=counts))
        sigma = float(np.sqrt(np.average((centres[inside] - middle) ** 2, weights=counts)))
        if best is None or counts.sum() > best.events:
            best = Peak(line, middle, 2.355 * sigma, int(counts.sum()))
    return best


def _write_csv(path: Path, recording: Path, stretches: Iterable[tuple[ConeEvent, ...]]) -> int:
    """Write the cones; returns their number."""
    written = 0
    with replacing(path, (recording,)) as temporary, temporary.open("w", newline="", encoding="ascii") as file:
        writer = csv.writer(file)
        writer.writerow(CSV_COLUMNS)
        for cones in stretches:
            writer.writerows(_row(cone) for cone in cones)
            written += len(cones)
    return written


def _row(cone: ConeEvent) -> tuple[str | int, ...]:
    theta, sigma = np.rad2deg(cone.theta_rad), np.rad2deg(cone.sigma_rad)
    numbers = (
        *cone.axis[0], theta[0], sigma[0], cone.probability[0], theta[1], sigma[1], cone.probability[1],
        *cone.energies_kev, cone.energy_sigmas_kev[0], cone.separation_mm,
    )  # fmt: skip
    return (cone.stamp_ns, *(f"{number:.5g}" for number in numbers))
