"""Compute the flux of photons over soil for ordinary detectors: ``python benchmarks/ordinary_flux.py > TABLES.py``.

TABLES.py is agent/fusion/soilflux.py. SCATTERED: of a point source on soil, by ``common.soil`` (not by the simulation's
transport), as a mean over places about it; NATURAL: of the soil's own photons, by ``common.natural``, 3 m above it.
"""

from __future__ import annotations

import textwrap
from typing import Annotated

import numpy as np
import typer
from ground_response import NATURAL_BQ_KG, NATURAL_HEIGHT_M

from common.natural import natural_flux
from common.soil import scattered_flux
from radron.sim.radiation.ground.natural import SERIES
from radron.sim.radiation.nuclides import nuclide

NUCLIDES = ("Cs-137", "Co-60", "I-131")
EDGES_KEV = np.geomspace(30.0, 2700.0, 25)
HEIGHTS_M = np.array((1.0, 2.0, 4.0, 8.0, 16.0))
SLOPES = np.array((0.0, 0.7, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0))  # horizontal distance over height


def main(photons: Annotated[int, typer.Option(min=10_000)] = 20_000) -> None:
    """Print the tables as Python."""
    places = np.array([(height, height * slope) for height in HEIGHTS_M for slope in SLOPES])
    print('"""Written by ``benchmarks/ordinary_flux.py``; see radron.agent.fusion.ordinary."""\n\n# fmt: off')
    for name, values in (("EDGES_KEV", EDGES_KEV), ("HEIGHTS_M", HEIGHTS_M), ("SLOPES", SLOPES)):
        print(f"{name} = {_printed(values)}")
    series = zip(SERIES, NATURAL_BQ_KG, strict=True)
    own = sum(bq_kg * natural_flux(lines, NATURAL_HEIGHT_M, EDGES_KEV, photons, 6)[0] for lines, bq_kg in series)
    print(f"NATURAL = {_printed(np.asarray(own))}")
    print("SCATTERED: dict[str, tuple[tuple[float, ...], ...]] = {")
    for name in NUCLIDES:
        flux = scattered_flux(nuclide(name).lines, places, EDGES_KEV, photons, 5).sum(axis=2).mean(axis=1)
        print(f'    "{name}": (')
        for row in flux:
            print(f"{_printed(row, 8)},")
        print("    ),")
    print("}\n# fmt: on")


def _printed(values: np.ndarray, indent: int = 0) -> str:
    text = f"({', '.join(f'{value:.3g}' for value in values)})"
    return textwrap.fill(text, 116, initial_indent=" " * indent, subsequent_indent=" " * (indent + 4))


if __name__ == "__main__":
    typer.run(main)
