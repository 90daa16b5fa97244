"""Measure how well a camera's gain follows from the sensor's own fluorescence (Cd 23.2 keV, Te 27.5 keV).

``python -m benchmarks.fluorescence``

Photons from all sides go through the simulated sensor and the agent's clustering. A satellite is a small cluster of 14 to 38 keV
within 1.2 mm of a larger one (agent/detector/coincidence.py). For photons of a source, photons scattered by its surroundings, and
the background, the table shows by gain:

- satellites: per 1000 events; mean, sigma: of their energies, keV, by the calibration;
- 400 events: 1 sigma of the logarithm of the gain by the satellites' energies, in 1 keV, from the change of their rates between
  gains of 0.97 and 1.03. The noise of the simulation counts as information, so the result is a lower bound.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.clustering import cluster_many
from radron.agent.detector.coincidence import SATELLITE_KEV, SATELLITE_PIXELS, SATELLITE_REACH_MM, events_of
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import TICK_NS, PixelHits
from radron.agent.geometry import Array
from radron.sim.faults.cameras import amplified
from radron.sim.radiation.calibration import PixelCalibration
from radron.sim.radiation.events import simulate
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.surroundings import background_lines, scattered_lines
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from support.sensors.event_readout import readout_of

GAINS = (1.0, 0.97, 1.03, 1.1)
EDGES_KEV = np.arange(SATELLITE_KEV[0], SATELLITE_KEV[1] + 1.0)


def satellites_kev(hits: PixelHits) -> tuple[Array, int]:
    """Energies of all satellites, and the number of events."""
    config = DetectionConfig()
    hits = hits.take(hits.tick.argsort(kind="stable"))
    energy = Calibration.nominal().energy_kev(hits.index, hits.tot)
    clusters = cluster_many(hits, energy, config.cluster_gap_ns / TICK_NS)
    found, events = list[float](), 0
    for event in events_of(clusters.each(), config.coincidence_window_ns / TICK_NS):
        events += 1
        for small in event:
            near = (
                other.energy_kev > small.energy_kev
                and np.hypot(other.x_mm - small.x_mm, other.y_mm - small.y_mm) <= SATELLITE_REACH_MM
                for other in event
            )
            if SATELLITE_KEV[0] <= small.energy_kev <= SATELLITE_KEV[1] and small.pixels <= SATELLITE_PIXELS and any(near):
                found.append(small.energy_kev)
    return np.array(found), events


def main(
    name: Annotated[str, typer.Argument(metavar="NUCLIDE", help="Of the source.")] = "Cs-137",
    interactions: Annotated[int, typer.Option(help="Simulated ones of each kind of photons.")] = 20_000,
) -> None:
    """Print the satellites of a source's photons, of scattered ones and of the background, by gain."""
    source, truth = nuclide(name), CameraTruth()
    calibration = PixelCalibration.draw(truth, np.random.default_rng(1))
    for label, lines in (("direct", source.lines), ("scattered", scattered_lines(source)), ("background", background_lines())):
        hits = readout_of(simulate(lines, interactions, response(truth), np.random.default_rng(3))).hits
        rates = {}
        for gain in GAINS:
            energies, events = satellites_kev(hits if gain == 1.0 else amplified(hits, gain, calibration))
            rates[gain] = np.histogram(energies, EDGES_KEV)[0] / events
            place = f"mean {energies.mean():5.2f}, sigma {energies.std():4.2f} keV"
            print(f"{label:10} gain {gain:4.2f}: {1e3 * len(energies) / events:5.1f} satellites, {place}")
        slope = (rates[1.03] - rates[0.97]) / np.log(1.03 / 0.97)
        information = float((slope**2 / np.maximum(rates[1.0], 1.0 / events)).sum())
        print(f"{label:10} 400 events: {100.0 / np.sqrt(400.0 * information):.1f} %")


if __name__ == "__main__":
    typer.run(main)
