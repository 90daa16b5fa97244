"""Compare the agent's Compton cones with the true events, by gamma line.

``python -m benchmarks.cone_quality --interactions 1000000 Cs-137 Co-60 ...``

Photons of a nuclide from all sides go through the simulated sensor and the chain of radron.agent.detector, with widths and
probabilities (agent/detector/cones.py) first set at 662 keV. For each line to which a cone is assigned, the table shows:

- cones: their number; other: share of the cones caused by photons of another line;
- right: among all other cones, share with the energies of the photon's first scatter; for these cones:
- ARM 68 %: angular error of the true order, degrees; pull 68 %, 95 %: angular error in units of the cone's own sigma
  (agent/fusion/bayes uses a mixture with 1.15 and 2.70);
- order: share with the true order as the more probable one; bits: information of the stated probability (log score, 0 for
  "either").
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.detection import ConeEvent
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.lines import lines_of
from radron.sim.radiation.events import Events, simulate
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.truth import CameraTruth

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from support.sensors.event_readout import SPACING_NS, readout_of

RIGHT_KEV = 40.0


def detected(events: Events, name: str) -> tuple[ConeEvent, ...]:
    """Cones of the events, which follow each other at equal intervals."""
    return DetectorChain(DetectionConfig(), name, Calibration.nominal()).process(readout_of(events)).cones


def nearest(energy_kev: float, lines_kev: tuple[float, ...]) -> float:
    return min(lines_kev, key=lambda line: abs(line - energy_kev))


def readings(events: Events, cones: tuple[ConeEvent, ...], name: str) -> np.ndarray:
    """Rows: line read, line emitted (keV), ARM of the true order, its sigma, energy error, probability of the true order."""
    emitted = [energy for energy, _ in nuclide(name).lines]
    rows = []
    for cone in cones:
        event = cone.stamp_ns // SPACING_NS
        first, second = events.sites[event]
        order = 0 if cone.axis[0] @ (first[:3] - second[:3]) > 0.0 else 1
        arm = np.arccos(np.clip(cone.axis[order] @ events.source[event], -1, 1)) - cone.theta_rad[order]
        line = nearest(sum(cone.energies_kev), lines_of(name))
        error = cone.energies_kev[order] - first[3]
        rows.append((line, emitted[events.line[event]], arm, cone.sigma_rad[order], error, cone.probability[order]))
    return np.array(rows)


def main(
    nuclides: Annotated[list[str] | None, typer.Argument(help="By default Cs-137.")] = None,
    interactions: Annotated[int, typer.Option(help="Photons that interact.")] = 200_000,
) -> None:
    names = ("line keV", "cones", "other", "right", "ARM 68 %", "pull 68 %", "95 %", "order", "bits")
    print(" " * 8 + "".join(f"{name:>10}" for name in names))
    for name in nuclides or ["Cs-137"]:
        quota = (0, interactions, interactions)  # single deposits make no cone
        camera = response(CameraTruth())
        events = simulate(nuclide(name).lines, interactions, camera, np.random.default_rng(8), quota=quota)
        table = readings(events, detected(events, name), name)
        for line in lines_of(name):
            part = table[table[:, 0] == line]
            if len(part) < 100:
                continue
            own = np.abs(part[:, 1] - line) < 0.01 * line
            right = own & (np.abs(part[:, 4]) < RIGHT_KEV)
            arm, pull, probability = np.abs(part[right, 2]), np.abs(part[right, 2]) / part[right, 3], part[right, 5]
            shares = (1.0 - own.mean(), right.sum() / own.sum())
            widths = (np.degrees(np.quantile(arm, 0.68)), np.quantile(pull, 0.68), np.quantile(pull, 0.95))
            order = ((probability > 0.5).mean(), 1.0 + np.log2(np.maximum(probability, 1e-3)).mean())
            print(f"{name:8}{line:10.1f}{len(part):10}" + "".join(f"{x:10.2f}" for x in (*shares, *widths, *order)), flush=True)


if __name__ == "__main__":
    typer.run(main)
