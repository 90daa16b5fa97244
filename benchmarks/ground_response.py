"""Measure count rates of scattered photons near a source on soil: ``python benchmarks/ground_response.py Cs-137 Co-60 ...``.

The flux of scattered photons by ``support.soil`` (not by the simulation's transport), at heights and distances as in flight, is
folded with the response of sensor and detection chain to photons of each energy and angle to the sensor's normal. For each
channel (kind of event), sources on the ground and above it, and headings, the rates are fitted by the formula of
agent/fusion/bayes/soil.py, which holds the numbers. background: the soil's own photons by ``common.natural``, 3 m above it. The
lines of nuclides and natural series, which are data, and the sensor come from the simulation.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, product
from typing import Annotated

import numpy as np
import typer
from channel_response import CHANNELS, Source
from numpy.typing import NDArray
from scipy.optimize import least_squares

from common.natural import natural_flux
from common.soil import FACINGS, HEADINGS_DEG, scattered_flux
from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.fusion.bayes.soil import IMAGE_DEPTH
from radron.agent.fusion.facing import MEAN_FACING
from radron.sim.radiation.electronics import Electronics
from radron.sim.radiation.events import Events, simulate
from radron.sim.radiation.ground.natural import SERIES
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

Array = NDArray[np.float64]

TRUTH = CameraTruth()
EDGES_KEV = np.geomspace(30.0, 1500.0, 37)  # as in radron.sim.radiation.ground.photons
HEIGHTS_M, HORIZONTAL_M = (1.5, 2.5, 4.0), (1.5, 3.0, 6.0, 10.0, 16.0, 25.0)
PLACES = np.array([(h, r) for h in HEIGHTS_M for r in HORIZONTAL_M])
SOURCES_M = (0.0, 0.5, 1.0)  # heights of the source
NORMALS = tuple((np.arange(FACINGS) + 0.5) / FACINGS)  # cosine between path and normal, middles of the bins
AZIMUTHS_DEG = (20.0, 65.0)  # of the path about the normal: the sensor is square
NATURAL_BQ_KG = (400.0, 35.0, 30.0)  # of K-40, U-238 and Th-232 series: medians of soils, UNSCEAR (2000), Annex B
NATURAL_EDGES_KEV = np.geomspace(30.0, 2700.0, 43)
NATURAL_HEIGHT_M = np.array([3.0])
SPACING_TICKS = 20_000  # 31 us between events


def counted(events: Events, name: str) -> Array:
    """Counts (4,) of CHANNELS."""
    electronics = Electronics(TRUTH, np.random.default_rng(1), 0)
    count = len(events.kind)
    tick = np.arange(count) * SPACING_TICKS
    end_ns = (count + 1) * SPACING_TICKS * 25 // 16
    readout = electronics.read_out(0, end_ns, events.pixels, events.first, np.arange(count), np.zeros(count, np.int64), tick)
    chain = DetectorChain(DetectionConfig(), name, Calibration.nominal())
    counts = np.zeros(len(CHANNELS))
    for found in (chain.process(readout), chain.flush()):
        counts += (found.hits, found.photopeak, found.coincidences, len(found.cones))
    return counts


def beams(events: int) -> Iterator[tuple[int, int, Events]]:
    """Events, by bin of the cosine between path and normal and by energy group, for each of AZIMUTHS_DEG."""
    rng = np.random.default_rng(11)
    for (f, cosine), turn in product(enumerate(NORMALS), np.deg2rad(AZIMUTHS_DEG)):
        flat = np.sqrt(1.0 - cosine * cosine)
        view = float(flat * np.cos(turn)), float(flat * np.sin(turn)), float(cosine)
        for g, (low, high) in enumerate(pairwise(EDGES_KEV)):
            lines = tuple((float(e), 0.25) for e in np.geomspace(low, high, 9)[1::2])
            yield f, g, simulate(lines, events, response(TRUTH), rng, direction=view)


def responses(names: list[str], events: int) -> dict[str, Array]:
    """Of each nuclide (FACINGS, groups, 4) effective areas of CHANNELS, mm2."""
    areas = {name: np.zeros((FACINGS, len(EDGES_KEV) - 1, len(CHANNELS))) for name in names}
    for f, g, found in beams(events):
        for name in names:
            counts = counted(found, name) * float(found.area_mm2.sum()) / len(found.kind)
            areas[name][f, g] += counts / len(AZIMUTHS_DEG)
    return areas


def natural_lines(photons: int) -> tuple[tuple[float, float], ...]:
    """The soil's own photons as lines: energy, and flux per mm2 and s."""
    edges = NATURAL_EDGES_KEV
    series = zip(SERIES, NATURAL_BQ_KG, strict=True)
    flux = np.sum([bq_kg * natural_flux(lines, NATURAL_HEIGHT_M, edges, photons, 6)[0] for lines, bq_kg in series], axis=0)
    return tuple(zip(np.sqrt(edges[1:] * edges[:-1]).tolist(), (1e-6 * flux).tolist(), strict=True))


def background_ps(name: str, lines: tuple[tuple[float, float], ...], events: int) -> Array:
    """(4,) rates of CHANNELS by photons of these lines, from all directions alike."""
    found = simulate(lines, events, response(TRUTH), np.random.default_rng(12))
    return counted(found, name) * float(found.area_mm2.sum()) / len(found.kind)


def scattered(name: str, area: Array, photons: int) -> tuple[Array, Array]:
    """(rows, 2) counts of partial- and full-energy events per photon from the source, mm2, and (rows, 4) where: height of camera
    and source, horizontal distance (m), heading (rad).
    """
    source = Source.of(name)
    hits, full, pairs, _ = np.moveaxis(area, -1, 0)
    channels = np.stack((hits - full - pairs, full), axis=-1)
    counts, places = [], []
    for source_m in SOURCES_M:
        flux = scattered_flux(nuclide(name).lines, PLACES, EDGES_KEV, photons, 5, source_m) / source.photons_per_decay
        distance = np.hypot(PLACES[:, 0] - source_m, PLACES[:, 1])
        flux *= np.exp(source.air_per_m * distance)[:, None, None, None]
        counts.append(np.einsum("phfg,fgc->phc", flux, channels).reshape(-1, 2))
        places += [(h, source_m, r, turn) for (h, r), turn in product(PLACES, np.deg2rad(HEADINGS_DEG))]
    return np.concatenate(counts), np.array(places)


def expected(near: float, steep: float, air: float, turn: float, depth: float, where: Array, air_per_m: float) -> Array:
    """(rows,) of the fitted terms; depth: of the image below the ground, per height of the source above it."""
    camera, source, horizontal, heading = where.T
    distance = np.hypot(camera - source, horizontal)
    image = np.hypot(camera + depth * source, horizontal)
    facing = horizontal * np.abs(np.cos(heading)) / image
    soil = (near + steep * (camera + depth * source) / image) * (1.0 + turn * (facing - MEAN_FACING))
    result: Array = (distance / image) ** 2 * soil + air * air_per_m * distance
    return result


def fitted(counts: Array, where: Array, air_per_m: float) -> tuple[Array, float]:
    """(5,) arguments of ``expected``, and the fit's error, root mean square, relative."""

    def off(values: Array) -> Array:
        return expected(*values, where, air_per_m) / np.maximum(counts, 0.01 * counts.max()) - 1.0

    least, most = [-np.inf] * 4 + [0.0], [np.inf] * 4 + [3.0]
    found = least_squares(off, (1.0, counts.mean(), 10.0 * counts.mean(), 0.5, IMAGE_DEPTH), bounds=(least, most))
    return found.x, float(np.sqrt(np.mean(found.fun**2)))


def main(
    nuclides: Annotated[list[str] | None, typer.Argument(help="By default Cs-137.")] = None,
    events: Annotated[int, typer.Option(help="Of each view and energy group.")] = 600,
    photons: Annotated[int, typer.Option(help="That are followed through soil and air, of each nuclide.")] = 100_000,
) -> None:
    names = nuclides or ["Cs-137"]
    areas = responses(names, events)
    natural = natural_lines(photons)
    for name in names:
        counts, where = scattered(name, areas[name], photons)
        hits, full, pairs, _ = background_ps(name, natural, 100 * events)
        print(name)
        print(f"{'channel':10}{'near':>9}{'steep':>9}{'air':>9}{'turn':>9}{'image':>9}{'background 1/s':>16}{'fit, rms':>12}")
        for channel, column, own_ps in zip(("partial", "full"), counts.T, (hits - full - pairs, full), strict=True):
            values, error = fitted(column, where, Source.of(name).air_per_m)
            print(f"{channel:10}{''.join(f'{value:9.3g}' for value in values)}{own_ps:16.3g}{100.0 * error:10.1f} %")
        print(flush=True)


if __name__ == "__main__":
    typer.run(main)
