"""The page of a recorded survey: track, count rates, spectrum with lines, and time statistics, as a PNG."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from radron.protocol.contamination import Contamination
from radron.station.survey.check import PARTS, Statistics, smoothed
from radron.station.survey.table import Array, Survey

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHADE = "#d55e00"


def draw(figure: Figure, survey: Survey, edges_kev: Array, found: Statistics) -> None:
    """Draw the page of a survey; edges_kev: (R + 1,) of its channels."""
    track, rate, spectrum, gain = figure.subplots(2, 2).ravel()
    total = survey.counts.sum(axis=1)
    rates = total / np.maximum(survey.live_s, 1e-9)
    _draw_track(track, survey, rates)
    since_s = survey.time_s - survey.time_s[0]
    rate.plot(since_s, rates, ".", ms=2, color="#999999")
    alive = ~np.isin(np.arange(len(survey)), found.empty)
    rate.plot(since_s, smoothed(rates, alive), color="#0072b2")
    rate.plot(since_s[list(found.empty)], np.zeros(len(found.empty)), "x", color=_SHADE)
    rate.set(xlabel="time, s", ylabel="counts/s", title=f"{found.rate_ps:.1f}/s; Poisson index {found.poisson_index:.2f}")
    _draw_spectrum(spectrum, survey, edges_kev, found)
    if found.gain:
        gain.plot(range(1, PARTS + 1), 100.0 * (np.array(found.gain) - 1.0), "o-")
        gain.set(title=f"gain by the line at {found.gain_line_kev:.0f} keV", xlabel="quarter of the survey", ylabel="%")
    else:
        gain.set(title="gain: no line strong enough")
    figure.suptitle(f"{found.records} records, {found.dropped} rows dropped, {len(found.empty)} empty, {found.gaps} gaps")


def draw_ground(figure: Figure, ground: Contamination, places_m: Array) -> None:
    """Draw the map of contaminated ground: medians of its blocks, and the records' places (N, 2) in the mission frame."""
    axes = figure.subplots()
    medians = np.array([block.median for block in ground.blocks], np.float64)
    blocks = ground.unit_bqm2 * medians.reshape(-1, ground.across)
    x, y = ground.corner_m
    extent = (x, x + ground.block_m * blocks.shape[1], y, y + ground.block_m * blocks.shape[0])
    shown = axes.imshow(blocks, origin="lower", extent=extent, cmap="viridis")
    axes.figure.colorbar(shown, ax=axes, label=f"{ground.nuclide}, Bq/m2")
    axes.plot(*places_m.T, ".", ms=1, color="white")
    axes.set(xlabel="east, m", ylabel="north, m", title=f"{ground.finding}; surface-equivalent, blocks of {ground.block_m:.0f} m")


def _draw_track(axes: Axes, survey: Survey, rates: Array) -> None:
    x, y = survey.place.T
    shown = axes.scatter(x, y, c=rates, s=4, cmap="viridis")
    axes.figure.colorbar(shown, ax=axes, label="counts/s")
    if survey.on_earth:
        axes.set_aspect(1.0 / max(np.cos(np.radians(float(y.mean()))), 0.01))
        axes.set(xlabel="longitude, deg", ylabel="latitude, deg")
    else:
        axes.set_aspect("equal")
        axes.set(xlabel="east, m", ylabel="north, m")
    axes.ticklabel_format(useOffset=False)
    low, high = float(survey.height_m.min()), float(survey.height_m.max())
    axes.set_title(f"track, {low:.1f} to {high:.1f} m above ground")


def _draw_spectrum(axes: Axes, survey: Survey, edges_kev: Array, found: Statistics) -> None:
    summed = survey.counts.sum(axis=0)
    axes.stairs(np.maximum(summed, 0.5) / np.diff(edges_kev), edges_kev)
    axes.set_yscale("log")
    for line in found.lines:
        axes.axvline(line.energy_kev, color=_SHADE, lw=0.5)
        axes.text(
            line.energy_kev, axes.get_ylim()[1], f" {line.nuclide or f'{line.energy_kev:.0f}'}", rotation=90, va="top", size=6
        )
    axes.set(xlabel="keV", ylabel="counts/keV", title="sum of all records")
