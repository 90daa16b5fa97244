"""The figures of the report, as SVG: the map of the flight, and charts of uncertainty, count rates and spectrum."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from html import escape

from radron.protocol.spectrum import BINS, EDGES_KEV
from radron.station.findings.facts import Findings
from radron.station.findings.n42 import spectrum_of
from radron.station.picture.shapes import circle, cordon_radius_m, region

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6d00", "#555555")  # as on the page
_WIDTH, _HEIGHT, _LEFT, _TOP, _BOTTOM = 640.0, 190.0, 52.0, 8.0, 34.0
_LEVELS = 5  # maximum number of labels
Line = tuple[str, list[tuple[float, float]]]  # colour and points


def flight_map(findings: Findings) -> str:
    """Return an SVG map of the search area with the drones' tracks, and each source with its 90 % region and its cordon."""
    area = findings.mission.area.polygon_m
    tracks = [
        [drone.place for frame in findings.frames if (drone := frame.drones[index]).place is not None]
        for index in range(len(findings.drones))
    ]
    everywhere = [*area, *((place[0], place[1]) for track in tracks for place in track if place is not None)]
    low_x, high_x = min(x for x, _ in everywhere) - 3.0, max(x for x, _ in everywhere) + 3.0
    low_y, high_y = min(y for _, y in everywhere) - 3.0, max(y for _, y in everywhere) + 3.0
    thin = (high_x - low_x) / 400.0
    shapes = [_line([*area, area[0]], "#111", 2 * thin)]
    for index, track in enumerate(tracks):
        shapes.append(_line([place[:2] for place in track if place is not None], _colour(index), thin))
    for source in findings.best.sources if findings.best is not None else ():
        radius_m = cordon_radius_m(source.nuclide, source.activity_bq)
        if radius_m is not None:
            shapes.append(_line(circle(source.place, radius_m), "#a33b00", 2 * thin))
        shapes.append(_line(region(source), "#111", 2 * thin))
        x, y, _ = source.place
        shapes.append(
            f'<circle cx="{x:.2f}" cy="{-y:.2f}" r="{3 * thin:.3f}" fill="#f0e442" stroke="#111" stroke-width="{thin:.3f}"/>'
        )
    shapes += _scale(low_x, high_x, low_y, thin)
    box = f"{low_x:.2f} {-high_y:.2f} {high_x - low_x:.2f} {high_y - low_y:.2f}"
    about = f"Area (black), each source with its 90 % region and cordon (red), tracks of {_legend(findings)}. North is up."
    return _figure(box, shapes, about)


def charts(findings: Findings) -> Iterator[str]:
    """Yield SVG charts of a flight: uncertainty of the source, hit rates, and the summed spectrum of all cameras.

    Charts without data are left out.
    """
    began_ms = findings.frames[0].at_ms
    times_s = [(frame.at_ms - began_ms) * 1e-3 for frame in findings.frames]
    sources = [(at_s, frame.source) for at_s, frame in zip(times_s, findings.frames, strict=True)]
    rms = [(at_s, source.rms_m) for at_s, source in sources if source is not None and source.rms_m > 0.0]
    if len(rms) > 1:
        yield _chart(
            [("#111", rms)], times_s[-1], "s", "Uncertainty of the source (1 sigma, RMS radius), m, over the time in seconds."
        )
    rates: list[Line] = []
    for index in range(len(findings.drones)):
        told = [(at_s, frame.drones[index].rates_ps) for at_s, frame in zip(times_s, findings.frames, strict=True)]
        rates.append((_colour(index), [(at_s, rate[0]) for at_s, rate in told if rate is not None and rate[0] > 0.0]))
    if any(len(points) > 1 for _, points in rates):
        yield _chart(rates, times_s[-1], "s", f"Hits per second, over the time in seconds: {_legend(findings)}.")
    counts = spectrum_of(findings.exposures).tolist()
    if any(counts):
        density = [counts[place] / (EDGES_KEV[place + 1] - EDGES_KEV[place]) for place in range(BINS)]
        steps = [
            (edge, value)
            for place, value in enumerate(density)
            if value > 0.0
            for edge in (EDGES_KEV[place], EDGES_KEV[place + 1])
        ]
        about = f"Spectrum of all cameras ({sum(counts)} single clusters and coincidences): counts per keV over the energy, keV."
        yield _chart([("#0072b2", steps)], float(EDGES_KEV[BINS]), "keV", about)


def _chart(lines: list[Line], last: float, unit: str, about: str) -> str:
    """Lines over an axis from 0 to ``last``, on a logarithmic scale."""
    values = [value for _, points in lines for _, value in points]
    low, high = math.log10(min(values)), math.log10(max(values))
    low, high = (low, high) if high - low > 0.1 else (low - 0.05, high + 0.05)

    def x_of(value: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - 8.0) * value / last

    def y_of(value: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * (math.log10(value) - low) / (high - low)

    shapes = []
    for level in _levels(low, high):
        y = y_of(level)
        shapes.append(f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{_WIDTH}" y2="{y:.1f}" stroke="#ccc"/>')
        shapes.append(f'<text x="{_LEFT - 5}" y="{y + 4:.1f}" text-anchor="end" font-size="12">{level:g}</text>')
    step = _step(last)
    for number in range(int(last / step) + 1):
        x = x_of(number * step)
        text = f"{number * step:g}" + (f" {unit}" if number == 0 else "")
        shapes.append(f'<line x1="{x:.1f}" y1="{_HEIGHT - _BOTTOM}" x2="{x:.1f}" y2="{_HEIGHT - _BOTTOM + 5}" stroke="#111"/>')
        shapes.append(f'<text x="{x:.1f}" y="{_HEIGHT - 14}" text-anchor="middle" font-size="12">{text}</text>')
    for colour, points in lines:
        places = " ".join(f"{x_of(at):.1f},{y_of(value):.1f}" for at, value in points)
        shapes.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    return _figure(f"0 0 {_WIDTH:g} {_HEIGHT:g}", shapes, about)


def _levels(low: float, high: float) -> list[float]:
    """Return the labels of an axis, from the logarithms of its limits."""
    digits = (1.0,) if high - low > 1.5 else (1.0, 2.0, 5.0)
    every = [digit * 10.0**power for power in range(math.floor(low), math.ceil(high) + 1) for digit in digits]
    return [level for level in every if low <= math.log10(level) <= high] or [round(10.0**high, 3)]


def _step(last: float) -> float:
    """Return a round step for a few values on an axis."""
    least = last / _LEVELS
    power = 10.0 ** math.floor(math.log10(least)) if least > 0.0 else 1.0
    return next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if digit * power >= least)


def _scale(low_x: float, high_x: float, low_y: float, thin: float) -> list[str]:
    """A bar of round length at the lower left."""
    length = _step((high_x - low_x) / 1.5)
    x, y = low_x + 4 * thin, -low_y - 6 * thin
    text = f'<text x="{x:.2f}" y="{y - 4 * thin:.2f}" font-size="{10 * thin:.2f}">{length:g} m</text>'
    return [f'<path d="M{x:.2f},{y:.2f}h{length:g}" stroke="#111" stroke-width="{2 * thin:.3f}"/>', text]


def _colour(index: int) -> str:
    return COLOURS[index % len(COLOURS)]


def _legend(findings: Findings) -> str:
    named = enumerate(findings.drones)
    return ", ".join(f'<span style="color:{_colour(index)}">{escape(name)}</span>' for index, name in named)


def _figure(box: str, shapes: Sequence[str], about: str) -> str:
    return f'<figure><svg viewBox="{box}" role="img">{"".join(shapes)}</svg><figcaption>{about}</figcaption></figure>'


def _line(places: Sequence[Sequence[float]], colour: str, width: float) -> str:
    points = " ".join(f"{place[0]:.2f},{-place[1]:.2f}" for place in places)
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width:.3f}"/>'
