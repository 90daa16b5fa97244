"""Measure count rates of a camera near a known source.

``python -m benchmarks.channel_response --events 400000 Cs-137 Co-60 ...``

The simulated camera looks at a source from several distances, its heading turning evenly as in flight, the source 5 to 45 degrees
below the horizon. Its hits go through the chain of radron.agent.detector with the default configuration. For each channel (kind
of event), the rate divided by the unscattered photons per mm2 and second is fitted by area x (direct + scattered x depth), with
depth = attenuation x distance. edge: the area lost at the sensor's edge, fitted to areas at several headings. The numbers are
used in agent/fusion/bayes/response.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration
from radron.agent.fusion.bayes.response import edge_factor
from radron.agent.fusion.facing import Facing
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.materials import air_attenuation_per_m
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.truth import CameraTruth

Array = NDArray[np.float64]

CHANNELS = ("hits", "photopeak", "coincidences", "cones")
DISTANCES_M = (2.0, 5.0, 10.0, 20.0, 35.0, 60.0)
EVENTS_PS = 2000.0  # few enough for chance coincidences below 0.1 % of the true ones
STEP_NS = 10_000_000
VIEWS = 8  # headings in a step
REFERENCE_BQ = 1e9
BELOW_DEG = 20.0  # the horizon, the source seen at these headings
HEADINGS_DEG = (0.0, 30.0, 60.0, 70.0, 80.0, 85.0, 90.0, 95.0, 100.0, 110.0, 120.0, 150.0, 180.0)
ALONE = CameraTruth(background_hits_per_s=0.0)
QUIET = CameraTruth(background_hits_per_s=0.0, scatter_near=0.0, scatter_air=0.0)


@dataclass(frozen=True)
class Source:
    """A nuclide for the agent: photons per decay of all its lines above 100 keV, and one attenuation for all."""

    name: str
    photons_per_decay: float
    air_per_m: float

    @classmethod
    def of(cls, name: str) -> Source:
        """The attenuation is the lines' mean, weighed by their photons."""
        lines = [line for line in nuclide(name).lines if line[0] > 100.0]
        photons = sum(intensity for _, intensity in lines)
        mean = sum(intensity * air_attenuation_per_m(energy) for energy, intensity in lines) / photons
        return cls(name, photons, mean)

    def flux(self, distance_m: float) -> float:
        """Unscattered photons per mm2 and s from REFERENCE_BQ."""
        per_mm2 = REFERENCE_BQ * self.photons_per_decay / (4e6 * math.pi * distance_m**2)
        return per_mm2 * math.exp(-self.air_per_m * distance_m)


def directions(count: int, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Towards the source, camera frame: z along the heading, y up."""
    heading = rng.uniform(0.0, 2.0 * math.pi, count)
    below = np.deg2rad(rng.uniform(5.0, 45.0, count))
    x, z = np.cos(below) * np.sin(heading), np.cos(below) * np.cos(heading)
    return [(float(a), float(b), float(c)) for a, b, c in zip(x, -np.sin(below), z, strict=True)]


def counted(camera: Camera, name: str, views: list[tuple[SourceView, ...]], step_ns: int) -> tuple[Array, float]:
    """Counts (4,) of CHANNELS, one step with each of the views, and the time in s."""
    chain = DetectorChain(DetectionConfig(), name, Calibration.nominal())
    counts, live_s = np.zeros(len(CHANNELS)), 0.0
    now_ns = 0
    for view in views:
        found = chain.process(camera.expose(now_ns, now_ns + step_ns, view))
        counts += (found.hits, found.photopeak, found.coincidences, len(found.cones))
        live_s += found.live_time_s
        now_ns += step_ns
    return counts, live_s


def per_photon(source: Source, truth: CameraTruth, distance_m: float, events: int, seed: int) -> Array:
    """Effective areas (4,) in mm2: rates over the unscattered photons, background not in it."""
    rng = np.random.default_rng([seed, round(distance_m)])
    camera = Camera(truth, source.name, rng, 0)
    area_mm2 = 20.0  # roughly, of any nuclide: it only sets how strong the source is
    gain = EVENTS_PS / (area_mm2 * source.flux(distance_m))
    steps = round(events / (EVENTS_PS * VIEWS * STEP_NS * 1e-9))
    views = [
        tuple(SourceView(one, distance_m, gain * REFERENCE_BQ / VIEWS) for one in directions(VIEWS, rng)) for _ in range(steps)
    ]
    counts, live_s = counted(camera, source.name, views, VIEWS * STEP_NS)
    return counts / (live_s * gain * source.flux(distance_m))


def background_ps(name: str, events: int) -> Array:
    """Rates (4,) without a source; taken from as many events at a hundred times the rate."""
    many = 100.0
    truth = CameraTruth(background_hits_per_s=CameraTruth().background_hits_per_s * many)
    camera = Camera(truth, name, np.random.default_rng(3), 0)
    step_ns = 1_000_000_000
    counts, live_s = counted(camera, name, [()] * round(events / truth.background_hits_per_s), step_ns)
    return counts / live_s / many


def around(source: Source, events: int) -> Array:
    """Areas (H, 4) without scatter by HEADINGS_DEG, the source 10 m away and BELOW_DEG below the horizon."""
    flux, step_ns = source.flux(10.0), 100_000_000
    gain = EVENTS_PS / (20.0 * flux)
    steps = round(0.25 * events / (EVENTS_PS * step_ns * 1e-9))
    rows = []
    for heading_deg in HEADINGS_DEG:
        polar, below = math.radians(heading_deg), math.radians(BELOW_DEG)
        unit = (math.cos(below) * math.sin(polar), -math.sin(below), math.cos(below) * math.cos(polar))
        views = [(SourceView(unit, 10.0, gain * REFERENCE_BQ),)] * steps
        camera = Camera(QUIET, source.name, np.random.default_rng(4), 0)
        counts, live_s = counted(camera, source.name, views, step_ns)
        rows.append(counts / (live_s * gain * flux))
    return np.array(rows)


def edge(areas: Array) -> Array:
    """(4,), of areas (H, 4) by HEADINGS_DEG: ``edge`` of ``Channel``."""
    headings, level = np.deg2rad(HEADINGS_DEG), math.cos(math.radians(BELOW_DEG))
    facing = Facing.of(np.array(level), np.array(0.0), np.array(1.0), np.cos(2.0 * headings), np.sin(2.0 * headings)).cosine()
    design = np.stack((np.ones(len(facing)), edge_factor(facing)), axis=1)
    (mean, slope), *_ = np.linalg.lstsq(design, areas, rcond=None)
    result: Array = slope / mean
    return result


def fitted(source: Source, events: int) -> tuple[Array, Array, Array, Array]:
    """Of each channel (4,): area in mm2, direct, scattered, and the fit's largest relative error up to 35 m."""
    distance = np.array(DISTANCES_M)
    direct = np.array([per_photon(source, QUIET, d, events, 1) for d in DISTANCES_M])  # (D, 4)
    total = np.array([per_photon(source, ALONE, d, events, 2) for d in DISTANCES_M])
    area = direct[distance <= 20.0].mean(axis=0)  # beyond, air has changed the mixture of a nuclide's lines
    depth = source.air_per_m * distance
    design = np.stack((np.ones(len(depth)), depth), axis=1)
    near = distance <= 35.0
    (constant, slope), *_ = np.linalg.lstsq(design[near], total[near] / area, rcond=None)
    error = np.abs(design @ np.stack((constant, slope)) * area / total - 1.0)[near].max(axis=0)
    return area, constant, slope, error


def main(
    nuclides: Annotated[list[str] | None, typer.Argument(help="By default Cs-137.")] = None,
    events: Annotated[int, typer.Option(help="At each distance, about.")] = 20_000,
) -> None:
    for name in nuclides or ["Cs-137"]:
        source = Source.of(name)
        area, direct, scattered, error = fitted(source, events)
        background = background_ps(name, events)
        print(f"{name}: {source.photons_per_decay:.4g} photons per decay, {source.air_per_m:.5f} 1/m in air")
        rows = around(source, events)
        lacking = edge(rows)
        print(f"{'channel':14}{'area mm2':>10}{'direct':>8}{'scattered':>11}{'background 1/s':>16}{'edge':>8}{'fit within':>12}")
        for k, channel in enumerate(CHANNELS):
            print(
                f"{channel:14}{area[k]:10.3g}{direct[k]:8.2f}{scattered[k]:11.2f}{background[k]:16.3g}{lacking[k]:8.2f}"
                f"{100.0 * error[k]:10.1f} %"
            )
        print("area / mean by heading: " + "  ".join(f"{deg:g}" for deg in HEADINGS_DEG) + " deg")
        for k, channel in enumerate(CHANNELS):
            print(f"{channel:14}" + "".join(f"{value:7.2f}" for value in rows[:, k] / area[k]))
        print(flush=True)


if __name__ == "__main__":
    typer.run(main)
