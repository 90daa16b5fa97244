"""What a camera counts of scattered photons beside a source on soil: ``python -m benchmarks.ground_response Cs-137 Co-60 ...``.

The flux of scattered photons by ``support.soil`` (not by the simulation's transport), at heights and distances as in flight, is
folded with the response of sensor and detection chain to photons of each energy, and fitted for each channel by

    area (near + steep s + air mu D) exp(-mu D) / (4 pi D^2),    s the sine of the source's depression below the horizon.

facing: relative change of what comes from the source's side by f, the cosine between source and sensor's normal. The
numbers stand in agent/fusion/bayes/soil.py. background: the ground's own photons by ``sim.radiation.ground``, 3 m above soil.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from agent.config.mission import DetectionConfig
from agent.detector.chain import DetectorChain
from agent.detector.files.calibration import Calibration
from benchmarks.channel_response import CHANNELS, Source, directions
from benchmarks.support.soil import scattered_flux
from sim.radiation.electronics import Electronics
from sim.radiation.events import Events, simulate
from sim.radiation.ground.field import natural_flux
from sim.radiation.nuclides import nuclide
from sim.radiation.timepix3 import response
from sim.radiation.truth import CameraTruth

Array = NDArray[np.float64]

TRUTH = CameraTruth()
EDGES_KEV = np.geomspace(30.0, 1500.0, 37)  # as in sim.radiation.ground.photons
HEIGHTS_M, HORIZONTAL_M = (1.5, 2.5, 4.0, 7.0), (1.0, 3.0, 6.0, 10.0, 16.0, 25.0)
PLACES = np.array([(h, r) for h in HEIGHTS_M for r in HORIZONTAL_M])
MEAN_FACING = 0.565  # as in agent.fusion.sources.spectra
VIEWS = 12
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


def responses(names: list[str], events: int) -> tuple[dict[str, Array], Array]:
    """Of each nuclide (views, groups, 4) effective areas of the channels, mm2; and (views,) f."""
    rng = np.random.default_rng(11)
    views = directions(VIEWS, rng)
    areas = {name: np.zeros((VIEWS, len(EDGES_KEV) - 1, len(CHANNELS))) for name in names}
    for v, view in enumerate(views):
        for g in range(len(EDGES_KEV) - 1):
            low, high = EDGES_KEV[g : g + 2]
            lines = tuple((float(e), 0.25) for e in np.geomspace(low, high, 9)[1::2])
            found = simulate(lines, events, response(TRUTH), rng, direction=view)
            for name in names:
                areas[name][v, g] = counted(found, name) * float(found.area_mm2.sum()) / len(found.kind)
    return areas, np.abs([ahead for _, _, ahead in views])


def background_ps(name: str, events: int) -> Array:
    """(4,) rates of CHANNELS by the soil's own photons, from all directions alike."""
    flux = 1e-6 * natural_flux("soil", 3.0)
    lines = tuple(zip(np.sqrt(EDGES_KEV[1:] * EDGES_KEV[:-1]).tolist(), flux.tolist(), strict=True))
    found = simulate(lines, events, response(TRUTH), np.random.default_rng(12))
    return counted(found, name) * float(found.area_mm2.sum()) / len(found.kind)


def fitted(name: str, area: Array, facing: Array, photons: int) -> tuple[Array, Array, Array]:
    """(4, 3) near, steep and air of the channels, mm2 per photon of the nuclide; (4,) facing; (4,) the fit's largest error."""
    source = Source.of(name)
    flux = scattered_flux(nuclide(name).lines, PLACES, EDGES_KEV, photons, 5) / source.photons_per_decay
    height, horizontal = PLACES.T
    distance = np.hypot(height, horizontal)
    flux *= np.exp(source.air_per_m * distance)[:, None]
    off = facing - facing.mean()
    slope = np.einsum("v,vgc->gc", off, area) / (off @ off)
    mean = area.mean(axis=0) + (MEAN_FACING - facing.mean()) * slope
    total = flux @ mean  # (places, 4)
    design = np.stack((np.ones(len(distance)), height / distance, source.air_per_m * distance), axis=1)
    parts, errors = [], []
    for column in total.T:
        found, *_ = np.linalg.lstsq(design / column[:, None], np.ones(len(column)), rcond=None)
        parts.append(found)
        errors.append(np.abs(design @ found / column - 1.0).max())
    near = flux[horizontal < 7.0].sum(axis=0)
    return np.array(parts), (near @ slope) / (near @ mean), np.array(errors)


def main(
    nuclides: Annotated[list[str] | None, typer.Argument(help="By default Cs-137.")] = None,
    events: Annotated[int, typer.Option(help="Of each view and energy group.")] = 600,
    photons: Annotated[int, typer.Option(help="That are followed through soil and air, of each nuclide.")] = 100_000,
) -> None:
    names = nuclides or ["Cs-137"]
    areas, facing = responses(names, events)
    for name in names:
        parts, turn, error = fitted(name, areas[name], facing, photons)
        background = background_ps(name, 100 * events)
        print(name)
        print(f"{'channel':14}{'near':>9}{'steep':>9}{'air':>9}{'facing':>9}{'background 1/s':>16}{'fit within':>12}")
        for k, channel in enumerate(CHANNELS):
            near, steep, air = parts[k]
            print(f"{channel:14}{near:9.3g}{steep:9.3g}{air:9.3g}{turn[k]:9.2f}{background[k]:16.3g}{100.0 * error[k]:10.0f} %")
        print(flush=True)


if __name__ == "__main__":
    typer.run(main)
