"""Measure count rates of a camera for each nuclide, by energy: ``python -m benchmarks.spectral_response --every > TABLES.py``.

Photons of each line meet the simulated sensor from below the horizon, the heading turning evenly as in flight. The hits go
through the chain of radron.agent.detector with the default configuration, and its coarse spectra are binned as in an exposure.
TABLES.py is agent/fusion/sources/tables.py. Effective areas (mm2, times photons per decay) come from the simulated transport.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from channel_response import directions
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.lines import CANDIDATES
from radron.agent.fusion.facing import MEAN_FACING
from radron.protocol.spectrum import BINS
from radron.sim.radiation.electronics import Electronics
from radron.sim.radiation.events import COMPLETE, Events, simulate
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import Nuclide, nuclide
from radron.sim.radiation.surroundings import background_lines, scattered_lines
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

Array = NDArray[np.float64]

TRUTH = CameraTruth()
SCALE = 0.015  # relative change of the energies for the derivative
SPACING_TICKS = 20_000  # 31 us between events: no chance coincidences, no pixel still busy
VIEWS = 24


def scaled(factor: float) -> Calibration:
    """The nominal calibration, all energies times a factor (see ``Calibration.table``)."""
    return Calibration(Calibration.nominal().table * np.array([factor, 1.0, 1.0, factor]))


@dataclass(frozen=True)
class Areas:
    """Areas by energy bin, (BINS,) each: all events; coincidences of a photon's whole energy; other coincidences; the derivative
    of all events by the logarithm of the energy scale.
    """

    every: Array
    complete: Array
    partial: Array
    by_scale: Array


def spectra(events: Events, chosen: NDArray[np.bool_], factor: float) -> tuple[Array, Array]:
    """Singles and coincidences (BINS,) of the chosen events as the chain reads them."""
    electronics = Electronics(TRUTH, np.random.default_rng(1), 0)
    which = np.flatnonzero(chosen)
    tick = np.arange(len(which)) * SPACING_TICKS
    end_ns = (len(which) + 1) * SPACING_TICKS * 25 // 16
    zeros = np.zeros(len(which), np.int64)
    readout = electronics.read_out(0, end_ns, events.pixels, events.first, which, zeros, tick)
    chain = DetectorChain(DetectionConfig(), None, scaled(factor))
    singles, pairs = np.zeros(BINS), np.zeros(BINS)
    for found in (chain.process(readout), chain.flush()):
        for one in found.spectrum:
            singles[one.place] += one.singles
            pairs[one.place] += one.coincidences
    return singles, pairs


def areas(events: Events) -> Areas:
    """Of one beam."""
    per_event = float(events.area_mm2.sum()) / max(len(events.kind), 1)
    complete = events.kind == COMPLETE
    whole, rest = spectra(events, complete, 1.0), spectra(events, ~complete, 1.0)
    more, less = (sum(spectra(events, np.ones(len(complete), np.bool_), 1.0 + s)) for s in (SCALE, -SCALE))
    return Areas(
        every=per_event * (sum(whole) + sum(rest)),
        complete=per_event * whole[1],
        partial=per_event * rest[1],
        by_scale=per_event * (more - less) / (2.0 * SCALE),
    )


def direct(line: tuple[float, float], events: int, seed: int) -> tuple[Areas, Array, float]:
    """The areas of a line, mean of all views; the derivative (BINS,) of all events by f, see radron.agent.fusion.sources.spectra;
    and the area of all its interactions. All events refer to f = ``MEAN_FACING``, for any mean of the drawn views.
    """
    rng = np.random.default_rng(seed)
    parts, total = [], 0.0
    views = directions(VIEWS, rng)
    for view in views:
        found = simulate((line,), events // VIEWS, response(TRUTH), rng, direction=view)
        parts.append(areas(found))
        total += float(found.area_mm2.sum()) / VIEWS
    facing = np.abs([ahead for _, _, ahead in views])
    every = np.array([part.every for part in parts])
    off = facing - facing.mean()
    by_facing: Array = off @ every / (off @ off)
    means = {name: np.mean([getattr(part, name) for part in parts], axis=0) for name in Areas.__dataclass_fields__}
    means["every"] = np.maximum(means["every"] + (MEAN_FACING - facing.mean()) * by_facing, 0.0)
    return Areas(**means), by_facing, total


def of_nuclide(source: Nuclide, events: int) -> Iterator[tuple[str, Array]]:
    """The rows of the table of one nuclide, and its attenuation in air (one number)."""
    attenuation = [air_attenuation_per_m(energy) for energy, _ in source.lines]
    least = min(attenuation)
    share = sum(intensity for _, intensity in source.lines)
    lines = [
        direct(line, max(VIEWS * 200, round(events * math.sqrt(line[1] / share))), 7 + k) for k, line in enumerate(source.lines)
    ]
    total = sum(interacting for *_, interacting in lines)
    around = simulate(scattered_lines(source), events, response(TRUTH), np.random.default_rng(5))
    scattered = areas(around)
    scale = total / float(around.area_mm2.sum())
    yield "air_per_m", np.array([least])
    yield "direct", sum((one.every for one, *_ in lines), np.zeros(BINS))
    absorbed = ((mu - least) / least * one.every for mu, (one, *_) in zip(attenuation, lines, strict=True))
    yield "softer", sum(absorbed, np.zeros(BINS))
    yield "direct_by_scale", sum((one.by_scale for one, *_ in lines), np.zeros(BINS))
    yield "by_facing", sum((by_facing for _, by_facing, _ in lines), np.zeros(BINS))
    yield "scattered", scale * scattered.every
    yield "scattered_by_scale", scale * scattered.by_scale
    yield "complete", sum((one.complete for one, *_ in lines), np.zeros(BINS))
    yield "partial", sum((one.partial for one, *_ in lines), np.zeros(BINS))
    yield "scattered_pairs", scale * (scattered.complete + scattered.partial)


def of_background(events: int) -> Iterator[tuple[str, Array]]:
    """Rates per second."""
    found = simulate(background_lines(), events, response(TRUTH), np.random.default_rng(3))
    all_of_it = areas(found)
    per_s = TRUTH.background_hits_per_s / float(found.area_mm2.sum())
    yield "every", per_s * all_of_it.every
    yield "by_scale", per_s * all_of_it.by_scale
    yield "pairs", per_s * (all_of_it.complete + all_of_it.partial)


def printed(name: str, rows: Iterator[tuple[str, Array]]) -> None:
    """An entry of the table."""
    print(f'    "{name}": {{')
    for key, values in rows:
        numbers = ", ".join(f"{value:.3g}" for value in np.where(np.abs(values) < 1e-4 * np.abs(values).max(), 0.0, values))
        print(textwrap.fill(f'"{key}": ({numbers},),', 128, initial_indent=8 * " ", subsequent_indent=12 * " "))
    print("    },", flush=True)


def main(
    nuclides: Annotated[list[str] | None, typer.Argument(help="By default Cs-137.")] = None,
    every: Annotated[bool, typer.Option("--every", help="All nuclides that can be recognised.")] = False,
    events: Annotated[int, typer.Option(help="Interactions of each nuclide and kind, about.")] = 200_000,
) -> None:
    print('"""Written by ``benchmarks/spectral_response.py``, with 100,000 events or more; see')
    print('radron.agent.fusion.sources.spectra."""\n')
    print("# fmt: off")
    print("TABLES: dict[str, dict[str, tuple[float, ...]]] = {")
    printed("background", of_background(2 * events))
    for name in CANDIDATES if every else nuclides or ["Cs-137"]:
        printed(name, of_nuclide(nuclide(name), events))
    print("}")


if __name__ == "__main__":
    typer.run(main)
