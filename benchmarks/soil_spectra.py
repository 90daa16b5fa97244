"""Compute spectra of scattered photons near a source on soil: ``python benchmarks/soil_spectra.py --every > TABLES.py``.

TABLES.py is agent/fusion/sources/soiltables.py. The response of sensor and detection chain to photons of each energy group and
angle to the sensor's normal is simulated once, by energy bin, and folded with each nuclide's flux of scattered photons by
``support.soil`` (not by the simulation's transport). In each bin it is fitted, at heights, distances and headings as in flight,
by

    [near + h (steep + turned (f - ``MEAN_FACING``)) + air mu D] exp(-mu D) / (4 pi D^2),

see radron.agent.fusion.sources.spectra. background: the soil's own photons by ``common.natural``, 3 m above it, per second.

``--grounds`` compares the scatter of other grounds with soil's: by r and c of radron.agent.fusion.sources.soil, and by r alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
import typer
from ground_response import AZIMUTHS_DEG, EDGES_KEV, PLACES, beams, natural_lines
from numpy.typing import NDArray
from spectral_response import SCALE, printed, spectra

from common.soil import FACINGS, GROUNDS, HEADINGS_DEG, scattered_flux
from radron.agent.detector.lines import CANDIDATES
from radron.agent.fusion.facing import MEAN_FACING, MEAN_STEEPNESS
from radron.agent.fusion.sources.bins import pooled
from radron.agent.fusion.sources.soil import BY_NUMBER
from radron.protocol.spectrum import BINS
from radron.sim.radiation.events import Events, simulate
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import Nuclide, nuclide
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

Array = NDArray[np.float64]

LEAST_SHARE = 1e-5  # of a spectrum: bins with less are empty
COMPARED = ("Cs-137", "Co-60", "Ir-192", "I-131", "Ba-133", "Am-241")
COMPARED_SHARE = 0.01  # of soil's greatest bin: bins with less are not compared


class Response(NamedTuple):
    """Effective areas (mm2) of the sensor and the chain by the cosine between path and normal and by energy group, (FACINGS,
    GROUPS, BINS) each: all events, coincidences, and the derivative of all events by the logarithm of the energy scale.
    """

    every: Array
    pairs: Array
    by_scale: Array

    @classmethod
    def simulated(cls, events: int) -> Response:
        """With so many events of each beam."""
        areas = np.zeros((3, FACINGS, len(EDGES_KEV) - 1, BINS))
        for f, g, found in beams(events):
            areas[:, f, g] += np.array(counted(found)) / len(AZIMUTHS_DEG)
        return cls(*areas)


def counted(events: Events) -> tuple[Array, Array, Array]:
    """Areas (BINS,) of all events and of coincidences, and the derivative of all events by the logarithm of the energy scale."""
    per_event = float(events.area_mm2.sum()) / len(events.kind)
    every = np.ones(len(events.kind), np.bool_)
    singles, pairs = spectra(events, every, 1.0)
    more, less = (sum(spectra(events, every, 1.0 + s)) for s in (SCALE, -SCALE))
    return per_event * (singles + pairs), per_event * pairs, per_event * (more - less) / (2.0 * SCALE)


def of_nuclide(source: Nuclide, seen: Response, photons: int) -> Iterator[tuple[str, Array]]:
    """The rows of the table of one nuclide."""
    height, horizontal = PLACES.T
    distance = np.hypot(height, horizontal)
    depth = distance * min(air_attenuation_per_m(energy) for energy, _ in source.lines)
    flux = scattered_flux(source.lines, PLACES, EDGES_KEV, photons, 5) * np.exp(depth)[:, None, None, None]
    steepness, ahead = height / distance, np.abs(np.cos(np.deg2rad(HEADINGS_DEG)))
    turned = steepness[:, None] * (np.outer(horizontal / distance, ahead) - MEAN_FACING)
    level = (np.repeat(part[:, None], len(ahead), axis=1) for part in (np.ones(len(distance)), steepness, depth))
    design = np.stack((*level, turned), axis=-1).reshape(-1, 4)
    every, pairs, by_scale = (np.einsum("phfg,fgb->phb", flux, area).reshape(-1, BINS) for area in seen)
    empty = every.max(axis=0) < LEAST_SHARE * every.max()
    weight = np.where(empty, 0.0, 1.0 / np.maximum(every, np.where(empty, 1.0, 0.01 * every.max(axis=0))))
    near, steep, air, by_facing = fitted(design, every, weight)
    near, air = np.maximum(near, 0.0), np.maximum(air, 0.0)
    steep = np.maximum(steep, -near)  # prevents negative counts
    by_facing = np.clip(by_facing, (near + steep) / (MEAN_FACING - 1.0), (near + steep) / MEAN_FACING)
    scales, coincident = fitted(design, by_scale, weight), fitted(design, pairs, weight)
    rows = {"near": near, "steep": steep, "air": air, "turned": by_facing}
    rows |= {f"{name}_by_scale": part for name, part in zip(("near", "steep", "air"), scales[:3], strict=True)}
    rows["pairs"] = np.maximum(coincident[0] + MEAN_STEEPNESS * coincident[1], 0.0)
    yield from ((name, np.where(empty, 0.0, part)) for name, part in rows.items())


def fitted(design: Array, values: Array, weight: Array) -> Array:
    """(parts, BINS) least squares, bin by bin. design: (rows, parts); values, weight: (rows, BINS)."""
    each = zip(values.T, weight.T, strict=True)
    return np.array([np.linalg.lstsq(design * w[:, None], w * v, rcond=None)[0] for v, w in each]).T


def of_background(events: int, photons: int) -> Iterator[tuple[str, Array]]:
    """Rates per second, of photons from all directions alike."""
    rates = counted(simulate(natural_lines(photons), events, response(CameraTruth()), np.random.default_rng(12)))
    yield from zip(("every", "pairs", "by_scale"), rates, strict=True)


def compare(seen: Response, photons: int) -> None:
    """Print r and c of each ground and nuclide, with the weighted root mean square of what they leave of the logarithm."""
    print("ground    nuclide     r      c    left   left by r alone")
    for name in COMPARED:
        spectrum = {ground: _mean(nuclide(name), ground, seen, photons) for ground in GROUNDS}
        soil = spectrum["soil"]
        shown = soil > COMPARED_SHARE * soil.max()
        weight = np.sqrt(soil[shown] / soil[shown].sum())
        for ground in sorted(GROUNDS.keys() - {"soil"}):
            ratio = np.log(spectrum[ground][shown] / soil[shown])
            left, numbers = [], np.zeros(2)
            for count in (2, 1):
                design = BY_NUMBER[:count, shown].T
                found = np.linalg.lstsq(design * weight[:, None], weight * ratio, rcond=None)[0]
                left.append(float(np.sqrt(((weight * (ratio - design @ found)) ** 2).sum())))
                numbers = found if count == 2 else numbers
            print(f"{ground:9} {name:8} {numbers[0]:6.2f} {numbers[1]:6.2f} {left[0]:7.3f} {left[1]:7.3f}")


def _mean(source: Nuclide, ground: str, seen: Response, photons: int) -> Array:
    """(BINS,) counts of photons scattered by ground and air, mean over all places and headings."""
    flux = scattered_flux(source.lines, PLACES, EDGES_KEV, photons, 5, ground=ground)
    result: Array = pooled(np.einsum("phfg,fgb->b", flux, seen.every))
    return result


def main(
    nuclides: Annotated[list[str] | None, typer.Argument(help="By default Cs-137.")] = None,
    every: Annotated[bool, typer.Option("--every", help="All nuclides that can be recognised.")] = False,
    events: Annotated[int, typer.Option(help="Of each beam.")] = 600,
    photons: Annotated[int, typer.Option(help="That are followed through soil and air, of each nuclide.")] = 100_000,
    grounds: Annotated[bool, typer.Option("--grounds", help="Compare other grounds with soil instead.")] = False,
) -> None:
    if grounds:
        compare(Response.simulated(events), photons)
        return
    print('"""Written by ``benchmarks/soil_spectra.py``; see radron.agent.fusion.sources.spectra."""\n')
    print("# fmt: off")
    print("SOIL: dict[str, dict[str, tuple[float, ...]]] = {")
    printed("background", of_background(100 * events, photons))
    seen = Response.simulated(events)
    for name in CANDIDATES if every else nuclides or ["Cs-137"]:
        printed(name, of_nuclide(nuclide(name), seen, photons))
    print("}")


if __name__ == "__main__":
    typer.run(main)
