"""Elevation grid of a scenario's ground for the agents: coarse, and slightly wrong.

``python -m radron.sim.world.elevation SCENARIO.toml OUT.asc``.

An ESRI ASCII grid over the mission's area and its fence margin, in metres of the mission frame. The errors are white and drawn
from a fixed seed: the same scenario gives the same grid.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from radron.sim.scenario import load_scenario
from radron.sim.world.terrain import Terrain

CELL_M = 5.0
ERROR_M = 0.2  # 1 sigma
SEED = 1


def surveyed(terrain: Terrain, bounds: tuple[float, float, float, float], cell_m: float, error_m: float, seed: int) -> str:
    """Return a ground survey as an ESRI ASCII grid with random errors, for the agents.

    ``bounds``: (west, south, east, north) in metres, covered by the centres of the cells. ``error_m``: 1 sigma of the heights,
    which are rounded to decimetres, as in surveys.
    """
    west, south, east, north = bounds
    x = np.arange(west, east + 0.999 * cell_m, cell_m)
    y = np.arange(south, north + 0.999 * cell_m, cell_m)[::-1]  # the first row is the northernmost
    columns, rows = np.meshgrid(x, y)
    heights = terrain.heights_m(columns.ravel(), rows.ravel())
    heights += error_m * np.random.default_rng(seed).standard_normal(len(heights))
    head = f"ncols {len(x)}\nnrows {len(y)}\nxllcenter {x[0]:g}\nyllcenter {y[-1]:g}\ncellsize {cell_m:g}\nNODATA_value -9999\n"
    return head + "".join(
        " ".join(f"{height + 0.0:.1f}" for height in row) + "\n" for row in heights.reshape(rows.shape).tolist()
    )


def main() -> None:
    """Write the elevation grid of a scenario's ground, from the command line."""
    name, out = sys.argv[1:]
    scenario = load_scenario(name, with_grid=False)
    area = scenario.mission.area
    x, y = zip(*area.polygon_m, strict=True)
    margin_m = area.fence_margin_m
    bounds = (min(x) - margin_m, min(y) - margin_m, max(x) + margin_m, max(y) + margin_m)
    Path(out).write_text(surveyed(Terrain(scenario.terrain), bounds, CELL_M, ERROR_M, SEED), encoding="ascii")


if __name__ == "__main__":
    main()
