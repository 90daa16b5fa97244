"""Statistics of a recorded survey by which a broken record or detector is seen before any map is made."""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import curve_fit

from radron.station.survey.table import Survey

Array = NDArray[np.float64]

MIN_LINE_SIGMA = 5.0  # of a line in the summed spectrum
MAX_LINES = 12
MIN_LINE_CHANNELS = 0.7  # 1 sigma of a line
MAX_WIDE = 2.5  # significance of a hump of twice the line's width over that of the line; more is no line
PARTS = 4  # of the survey, of which the gain is compared
SMOOTHED_RECORDS = 20  # over which the rate's slow change is a mean
MIN_FITTED_COUNTS = 300  # of a line in each part
_FWHM_PER_SIGMA = sqrt(8.0 * log(2.0))
_KNOWN_KEV = {
    "Am-241": 59.5, "Pb-212": 238.6, "Pb-214": 351.9, "I-131": 364.5, "Tl-208 (583)": 583.2, "Bi-214": 609.3, "Cs-137": 661.7,
    "Ac-228": 911.2, "Bi-214 (1120)": 1120.3, "Co-60 (1173)": 1173.2, "Co-60 (1333)": 1332.5, "K-40": 1460.8,
    "Bi-214 (1764)": 1764.5, "Tl-208": 2614.5,
}  # fmt: skip


class FoundLine(Struct, frozen=True):
    """A line in the summed spectrum: its energy, its channel, its significance, and the nuclide whose line is nearest."""

    energy_kev: float
    channel: float
    sigma: float
    nuclide: str


class Statistics(Struct, frozen=True):
    """Statistics of a survey.

    rate_ps: mean count rate. poisson_index: variance of the counts from record to record over that of chance; 1 for a sound
    record. slow_change: relative standard deviation of the smoothed rate. empty: places of records (0: the first) without a
    count that should have some, by chance less than once in a million. gaps: longer pauses than 1.5 records. gain: place of the
    strongest line in each quarter of the survey, relative to its mean; empty if it is too weak. gain_line_kev: energy of that
    line.
    """

    records: int
    dropped: int
    duration_s: float
    live_s: float
    rate_ps: float
    poisson_index: float
    slow_change: float
    empty: tuple[int, ...]
    gaps: int
    lines: tuple[FoundLine, ...]
    gain: tuple[float, ...]
    gain_line_kev: float | None


def statistics(survey: Survey, edges_kev: Array, fwhm_share: float) -> Statistics:
    """Return the statistics of a survey.

    edges_kev: (R + 1,) of the channels. fwhm_share: width of the lines at 662 keV over their energy.
    """
    total = survey.counts.sum(axis=1)
    summed = survey.counts.sum(axis=0)
    lines = find_lines(summed, edges_kev, fwhm_share)
    line = max(lines, key=lambda one: one.sigma * one.energy_kev, default=None)  # a line high up shows the gain best
    empty = np.flatnonzero((total == 0) & (np.median(total) > 14.0))
    alive = np.ones(len(total), bool)
    alive[empty] = False
    expected = smoothed(total.astype(float), alive)
    watched = total if line is None else survey.counts[:, _window(line, edges_kev, fwhm_share, 2.0)].sum(axis=1)
    pairs = alive[1:] & alive[:-1]
    step, both = np.diff(watched)[pairs], (watched[1:] + watched[:-1])[pairs]
    smooth = expected[alive & (expected > 0.0)]
    chance = 1.0 / max(np.mean(total[alive]) * 2.0 * sqrt(np.pi) * SMOOTHED_RECORDS, 1.0)
    spread = max(float(np.var(smooth / smooth.mean())) - chance, 0.0) if len(smooth) else 0.0
    gaps_s = np.diff(survey.time_s)
    gain = () if line is None else _gain(survey, line, edges_kev, fwhm_share)
    return Statistics(
        records=len(survey),
        dropped=len(survey.dropped),
        duration_s=float(survey.time_s[-1] - survey.time_s[0]),
        live_s=float(survey.live_s.sum()),
        rate_ps=float(total.sum() / max(survey.live_s[alive].sum(), 1e-9)),
        poisson_index=float(np.sum(step**2) / max(np.sum(both), 1)),
        slow_change=sqrt(spread),
        empty=tuple(empty.tolist()),
        gaps=int((gaps_s > 1.5 * np.median(gaps_s)).sum()),
        lines=lines,
        gain=gain,
        gain_line_kev=line.energy_kev if line is not None and gain else None,
    )


def smoothed(values: Array, alive: NDArray[np.bool_]) -> Array:
    """Return the slow change of values (N,) of the records; those that are not alive take their neighbours' values."""
    at = np.arange(len(values))
    found: Array = gaussian_filter1d(np.interp(at, at[alive], values[alive]), SMOOTHED_RECORDS, mode="nearest")
    return found


def find_lines(counts: NDArray[np.int64], edges_kev: Array, fwhm_share: float) -> tuple[FoundLine, ...]:
    """Return the lines in a spectrum, (R,) counts, strongest first.

    A filter of the line's width compares its middle with its flanks, as the second difference of Mariscotti (1967, Nucl. Instrum.
    Methods 50, 309); its significance is that of the counts' own scatter.
    """
    middle, widths = 0.5 * (edges_kev[1:] + edges_kev[:-1]), np.diff(edges_kev)
    sigmas = _sigma_kev(np.maximum(middle, 1.0), fwhm_share) / widths
    scores = np.array([_score(counts, channel, sigma) for channel, sigma in enumerate(sigmas.tolist())])
    lines: list[FoundLine] = []
    for channel in np.argsort(-scores).tolist():
        score, sigma = float(scores[channel]), float(sigmas[channel])
        if score < MIN_LINE_SIGMA or len(lines) == MAX_LINES:
            break
        near = scores[max(channel - int(2.0 * sigma) - 1, 0) : channel + int(2.0 * sigma) + 2]
        if score < near.max() or _score(counts, channel, 2.0 * sigma) > MAX_WIDE * score:
            continue
        energy = float(middle[channel])
        lines.append(FoundLine(energy, float(channel), score, _nearest(energy, fwhm_share)))
    return tuple(lines)


def _score(counts: NDArray[np.int64], channel: int, sigma: float) -> float:
    """Significance of a line of this width (in channels) at a channel; 0 where the spectrum is too short or too coarse for it."""
    reach = int(4.0 * sigma) + 1
    if channel < reach or channel + reach >= len(counts) or sigma < MIN_LINE_CHANNELS:
        return 0.0
    at = np.arange(-reach, reach + 1) / sigma
    weights = (1.0 - at**2) * np.exp(-0.5 * at**2)
    weights -= weights.mean()
    window = counts[channel - reach : channel + reach + 1]
    return float(weights @ window) / sqrt(float(weights**2 @ np.maximum(window, 1)))


def _sigma_kev(energy_kev: Array, fwhm_share: float) -> Array:
    """1 sigma of the lines at these energies; fwhm_share: full width at half maximum at 662 keV over the energy."""
    found: Array = fwhm_share * np.sqrt(661.7 * energy_kev) / _FWHM_PER_SIGMA
    return found


def _nearest(energy_kev: float, fwhm_share: float) -> str:
    name, line = min(_KNOWN_KEV.items(), key=lambda one: abs(one[1] - energy_kev))
    return name if abs(line - energy_kev) < 0.5 * fwhm_share * sqrt(661.7 * line) else ""


def _window(line: FoundLine, edges_kev: Array, fwhm_share: float, sigmas: float) -> NDArray[np.intp]:
    """Channels within so many standard deviations of a line."""
    middle = 0.5 * (edges_kev[1:] + edges_kev[:-1])
    return np.flatnonzero(np.abs(middle - line.energy_kev) < sigmas * _sigma_kev(np.array(line.energy_kev), fwhm_share))


def _gain(survey: Survey, line: FoundLine, edges_kev: Array, fwhm_share: float) -> tuple[float, ...]:
    """Place of a line in each part of the survey over their mean, by a fit of a Gaussian on a straight background."""
    middle = 0.5 * (edges_kev[1:] + edges_kev[:-1])
    sigma_kev = float(_sigma_kev(np.array(line.energy_kev), fwhm_share))
    window = _window(line, edges_kev, fwhm_share, 4.0)
    at = (middle[window] - line.energy_kev) / sigma_kev
    places = []
    for part in np.array_split(survey.counts, PARTS):
        counts = part.sum(axis=0)[window].astype(float)
        if counts.sum() < MIN_FITTED_COUNTS:
            return ()
        start = (max(counts.max() - counts.min(), 1.0), 0.0, 1.0, counts.min(), 0.0)
        try:
            fit, _ = curve_fit(_peak, at, counts, start, np.sqrt(np.maximum(counts, 3.0)), bounds=(_LOW, _HIGH))
        except RuntimeError:  # no convergence
            return ()
        places.append(line.energy_kev + float(fit[1]) * sigma_kev)
    return tuple(place / float(np.mean(places)) for place in places)


_LOW, _HIGH = (0.0, -2.0, 0.5, 0.0, -np.inf), (np.inf, 2.0, 2.0, np.inf, np.inf)


def _peak(at: Array, height: float, place: float, width: float, level: float, slope: float) -> Array:
    found: Array = height * np.exp(-0.5 * ((at - place) / width) ** 2) + level + slope * at
    return found
