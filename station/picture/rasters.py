"""Raster layers of the map from the estimator's posterior: probability density of the source, and dose rate."""

from __future__ import annotations

import base64
import math

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import Hypothesis, Outlook
from radron.agent.fusion.posterior import Posterior
from radron.station.picture.dose import expected_usvph
from radron.station.picture.frame import Point, Raster

CELLS = 128  # along the longer side of a layer
SEARCH_CELLS = 64  # of the dose rate while thousands of places are possible
_NEAR_SIGMAS = 5.0
_PLAIN = 4.0  # times a uniform density: the full colour
DECADE = 32.0  # bytes for a factor of ten of the dose rate
MIN_USVPH = 1e-3


class Rasters:
    """Makes the raster layers of the map, which cover the mission's area up to its fence.

    While the source is tracked, the layer of its probability density covers only its surroundings.
    """

    def __init__(self, mission: MissionConfig) -> None:
        corners, margin_m = np.array(mission.area.polygon_m), mission.area.fence_margin_m
        self._low, self._high = corners.min(0) - margin_m, corners.max(0) + margin_m
        self._area_m2 = Polygon(mission.area.polygon_m).area
        self._nuclide = mission.nuclide_text

    def belief(self, posterior: Posterior, at_ms: int) -> Raster:
        """Return the probability density of the source's position (per m2) as a layer of the map."""
        low, high = self._low, self._high
        if posterior.kind != "grid":
            low, high = _around(posterior)
        places, columns, cell_m = _grid(low, high, CELLS)
        density = _cells(posterior, places) if posterior.kind == "grid" else _mixture(posterior, places)
        # Without any information yet, the whole area is possible: a uniform density must not look like a found source.
        plain = _PLAIN * float(posterior.weight.sum()) / self._area_m2 if posterior.kind == "grid" else 0.0
        most = max(float(density.max()), plain)
        values = 255.0 * density / most if most > 0.0 else density
        return _raster("belief", at_ms, low, cell_m, columns, values, most)

    def dose(self, posterior: Posterior, hypothesis: Hypothesis | None, outlook: Outlook | None, at_ms: int) -> Raster | None:
        """Return the expected dose rate at 1 m above the ground as a layer of the map.

        ``hypothesis``: the found source; ``outlook``: state of the search while no source has been found. Return None if the
        activity or the nuclide's dose rate constant is unknown.
        """
        if hypothesis is not None and hypothesis.activity_bq is not None:
            strength = posterior.weight * hypothesis.activity_bq
        elif hypothesis is None and outlook is not None:
            strength = outlook.weight * outlook.activity_bq
        else:
            return None
        places, columns, cell_m = _grid(self._low, self._high, CELLS if hypothesis is not None else SEARCH_CELLS)
        told = hypothesis.nuclide if hypothesis is not None else None
        rates = expected_usvph(told or self._nuclide, posterior.position, strength, places)
        if rates is None:
            return None
        values = DECADE * np.log10(np.maximum(rates / MIN_USVPH, 1.0))
        return _raster("dose", at_ms, self._low, cell_m, columns, values, float(rates.max()))


def _around(posterior: Posterior) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return bounds of the probable places of a Gaussian sum."""
    middle = posterior.weight @ posterior.position
    apart = posterior.position - middle
    spread = (posterior.weight[:, None] * (apart**2 + np.diagonal(posterior.covariance, axis1=1, axis2=2))).sum(0)
    half = _NEAR_SIGMAS * max(math.sqrt(float(spread.max())), 0.05)
    return middle - half, middle + half


def _grid(low: NDArray[np.float64], high: NDArray[np.float64], cells: int) -> tuple[NDArray[np.float64], int, float]:
    """Centres (N, 2) of the cells row by row from the south-west, the number of columns, and the cells' size."""
    cell_m = float((high - low).max()) / cells
    columns, rows = (max(1, math.ceil(float(size) / cell_m - 1e-9)) for size in high - low)
    x = low[0] + cell_m * (np.arange(columns) + 0.5)
    y = low[1] + cell_m * (np.arange(rows) + 0.5)
    across, up = np.meshgrid(x, y)
    return np.column_stack((across.ravel(), up.ravel())), columns, cell_m


def _mixture(posterior: Posterior, places: NDArray[np.float64]) -> NDArray[np.float64]:
    heavy = posterior.weight > 1e-4 * float(posterior.weight.max())
    density = np.zeros(len(places))
    for weight, mean, covariance in zip(
        posterior.weight[heavy], posterior.position[heavy], posterior.covariance[heavy], strict=True
    ):
        apart = places - mean
        squared = np.einsum("ni,ij,nj->n", apart, np.linalg.inv(covariance), apart)
        density += weight * np.exp(-0.5 * squared) / (2.0 * math.pi * math.sqrt(float(np.linalg.det(covariance))))
    return density


def _cells(posterior: Posterior, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the density of the search grid's cell at each place; 0 beyond the cells, which are squares along the axes."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  half a second that only the search's map needs

    sides = np.sqrt(12.0 * posterior.covariance[:, 0, 0])
    density = np.zeros(len(places))
    for side in np.unique(sides).tolist():
        of_size = np.flatnonzero(sides == side)
        distance, nearest = cKDTree(posterior.position[of_size]).query(places, p=np.inf)
        found = posterior.weight[of_size][nearest] / side**2
        density = np.maximum(density, np.where(distance <= 0.501 * side, found, 0.0))
    return density


def _raster(
    kind: str, at_ms: int, low: NDArray[np.float64], cell_m: float, columns: int, values: NDArray[np.float64], scale: float
) -> Raster:
    origin: Point = (float(low[0]), float(low[1]))
    packed = base64.b64encode(np.clip(np.rint(values), 0, 255).astype(np.uint8).tobytes()).decode()
    return Raster(
        kind=kind,
        at_ms=at_ms,
        origin=origin,
        cell_m=cell_m,
        columns=columns,
        rows=len(values) // columns,
        values=packed,
        scale=scale,
    )
