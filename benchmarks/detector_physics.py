"""Compare the simulated detector with a reference: efficiencies, effective areas and the angular resolution at 662 keV.

The reference is a prototype's independent Monte Carlo without K fluorescence. The small cluster of a K fluorescence photon is
merged with its neighbour in rows with "satellites merged"; "two clusters" counts everything above 5 keV.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from radron.sim.radiation.camera import Camera, CameraTruth, SourceView
from radron.sim.radiation.events import Events, simulate
from radron.sim.radiation.timepix3 import response
from radron.sim.radiation.transport import projected_area_mm2

sys.path.append(str(Path(__file__).parents[1] / "tests/lib"))

from support.sensors.event_quality import clusters, complete, cones, fwhm

LINE_KEV = 661.657
TRUTH = CameraTruth()
INTERACTIONS = 60_000
REFERENCE = {  # angle: P(hit) %, P(2 clusters) %, P(full energy, >= 15 px) %, hits mm2, usable cones mm2, later ToA = electron %
    0: (8.0, 0.72, 0.27, 15.8, 0.53, 38.0),
    60: (11.8, 1.25, 0.45, 15.3, 0.55, 46.0),
    90: (35.9, 4.0, 1.38, 12.9, 0.42, 50.0),
    180: (8.0, 0.71, 0.27, 15.9, 0.51, 63.0),
}
ROWS = ("P(hit) %", "P(2 clusters) %", "P(full energy, >= 15 px) %", "hits, mm2", "usable cones, mm2", "later ToA = electron %")
REFERENCE_ARM = (9.5, 6.3)


def beam(
    angle_deg: float,
    *,
    fluorescence: bool = True,
    interactions: int = INTERACTIONS,
    quota: tuple[int, int, int] | None = None,
) -> Events:
    """Events of a beam at that angle from the normal, evenly in azimuth."""
    cosine = math.cos(math.radians(angle_deg))
    rng = np.random.default_rng(round(angle_deg))
    camera, window = response(TRUTH), (cosine, cosine)
    return simulate([(LINE_KEV, 1.0)], interactions, camera, rng, cosine=window, fluorescence=fluorescence, quota=quota)


def mean_shadow_mm2(angle_deg: float) -> float:
    """Projected area of the sensor, mean over the azimuth."""
    turns = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    polar = math.radians(angle_deg)
    views = ((math.sin(polar) * math.cos(t), math.sin(polar) * math.sin(t), math.cos(polar)) for t in turns)
    return float(np.mean([projected_area_mm2(view) for view in views]))


def efficiencies(angle_deg: float, *, fluorescence: bool) -> tuple[float, ...]:
    """A row of the reference's table."""
    events = beam(angle_deg, fluorescence=fluorescence)
    area = float(events.area_mm2.sum())
    percent = 100.0 * area / mean_shadow_mm2(angle_deg)
    raw, merged = clusters(events), clusters(events, merge_satellites=True)
    found = cones(events, merged, LINE_KEV, TRUTH.drift_ns)
    hit = float((raw.number > 0).mean())
    return (
        percent * hit,
        percent * float((raw.number == 2).mean()),
        percent * float(complete(merged, LINE_KEV).mean()),
        area * hit,
        area * len(found.arm_rad) / len(raw.number),
        100.0 * float(found.later_is_electron.mean()),
    )


def arm(angle_deg: float) -> tuple[float, float]:
    """FWHM, and the angle that holds 68 %, degrees."""
    events = beam(angle_deg, interactions=8 * INTERACTIONS, quota=(0, 0, 8 * INTERACTIONS))
    found = clusters(events, merge_satellites=True)
    degrees = np.degrees(cones(events, found, LINE_KEV, TRUTH.drift_ns).arm_rad)
    return fwhm(degrees, 1.0), float(np.quantile(np.abs(degrees), 0.68))


def camera_speed() -> tuple[float, float]:
    """Microseconds for a slice of 100 ms at 12 m from 3 GBq, and pixel hits per second there."""
    camera = Camera(TRUTH, "Cs-137", np.random.default_rng(1), 0)
    views = [SourceView((0.6, 0.0, 0.8), 12.0, 3e9)]
    camera.expose(0, 100_000_000, views)
    slices, hits = 10_000, 0
    start = time.perf_counter()
    for k in range(1, slices + 1):
        hits += len(camera.expose(k * 100_000_000, (k + 1) * 100_000_000, views).hits)
    return (time.perf_counter() - start) / slices * 1e6, hits / slices / 0.1


def main() -> None:
    """Print the tables."""
    console = Console(width=130)
    table = Table("", *(f"{angle} deg" for angle in REFERENCE), title="662 keV in the detector: ours / reference (deviation)")
    ours = {angle: efficiencies(angle, fluorescence=True) for angle in REFERENCE}
    plain = {angle: efficiencies(angle, fluorescence=False)[1] for angle in REFERENCE}
    for row, name in enumerate(ROWS):
        cells = ((ours[a][row], REFERENCE[a][row]) for a in REFERENCE)
        table.add_row(name, *(f"{x:.3g} / {r:g} ({100 * (x / r - 1):+.0f} %)" for x, r in cells))
    cells = ((plain[a], REFERENCE[a][1]) for a in REFERENCE)
    table.add_row("P(2 clusters) %, no fluorescence", *(f"{x:.3g} / {r:g} ({100 * (x / r - 1):+.0f} %)" for x, r in cells))
    console.print(table)
    width, contained = arm(30.0)
    console.print(
        f"ARM at 30 deg: FWHM {width:.1f} deg (reference {REFERENCE_ARM[0]:g}), "
        f"68 % within {contained:.1f} deg (reference {REFERENCE_ARM[1]:g})"
    )
    microseconds, rate = camera_speed()
    console.print(f"Camera at 12 m from 3 GBq: {microseconds:.0f} us for a slice of 100 ms, {rate:.0f} pixel hits/s")


if __name__ == "__main__":
    main()
