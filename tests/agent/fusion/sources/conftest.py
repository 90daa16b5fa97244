"""Synthetic flights among several sources: own geometry and drawing, the spectra's shapes from the agent's tables."""

import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from shapely import Polygon

from radron.agent.config.estimators import FusionConfig, SourcesEstimatorConfig
from radron.agent.config.mission import AreaConfig, DetectionConfig
from radron.agent.detector.windows import Windows
from radron.agent.frames.transform import Transform
from radron.agent.fusion.facing import MEAN_FACING
from radron.agent.fusion.observation import ConeObservation, observe
from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import Cones, Rows
from radron.agent.fusion.sources.directions import ConeModel
from radron.agent.fusion.sources.fit import Prior, Problem
from radron.agent.fusion.sources.soil import AS_TABULATED
from radron.agent.fusion.sources.spectra import Spectra
from radron.agent.terrain.ground import Ground
from radron.protocol.entries import Counts
from radron.protocol.spectrum import SpectrumBin
from support.flights.fusions import fusion_of

SIDE_M = 40.0
NUCLIDES = ("Cs-137", "Co-60", "Ir-192")


def mission_of(kit, drones=("a", "b"), **config):
    """A small area, and few candidates: so that a test takes less than a second."""
    config = {"moved_s": 5.0, **config}
    nuclides, source_height_m = config.pop("nuclides", NUCLIDES), config.pop("source_height_m", (0.0, 0.0))
    ground = config.pop("ground", "none")
    square = ((0.0, 0.0), (SIDE_M, 0.0), (SIDE_M, SIDE_M), (0.0, SIDE_M))
    return msgspec.structs.replace(
        kit.mission_of(drones=drones),
        nuclide=nuclides,
        source_height_m=source_height_m,
        area=AreaConfig(polygon_m=square),
        fusion=FusionConfig(estimator="sources", ground=ground, sources=SourcesEstimatorConfig(**config)),
    )


def place_of(time_s, index, drones):
    """Lanes up and down, 3 m high, at 3 m/s."""
    lane, along = divmod(3.0 * time_s, SIDE_M)
    width = SIDE_M / drones
    x = width * index + width * (0.5 + lane % 2) / 2.0
    return np.array([x, along if lane % 2 == 0 else SIDE_M - along, 3.0])


def entries_of(kit, mission, rng, seconds, sources, bias=None, cones=True, passing=None, soil=AS_TABULATED):
    """Exposures, and cones of Cs-137; sources: (nuclide, x, y, Bq), or with their height, or these by the time in seconds.

    bias: by drone, measured minus true.

    passing: share of the direct photons between two places (3,).

    soil: strength and composition of the ground's scatter, over a mission with ``ground`` "soil".
    """
    entries = []
    drones = [drone.id for drone in mission.drones]
    spectra = Spectra.of(NUCLIDES, mission.fusion.ground)
    near, far, by_facing, *of_soil = spectra.templates(0.0, 0.0, soil).swapaxes(0, 1)
    direct, softer, *_ = spectra.direct_templates(0.0).swapaxes(0, 1)
    for index, drone in enumerate(drones):
        for number in range(int(seconds / 0.5)):
            time_s = number * 0.5
            true = place_of(time_s + 0.25, index, len(drones))
            measured = true + (0.0 if bias is None else np.array([*bias[index], 0.0]))
            expected = spectra.background_ps(0.0, soil).copy()
            for nuclide, x, y, becquerel, *high in sources(time_s + 0.25) if callable(sources) else sources:
                z = high[0] if high else 0.0
                n = NUCLIDES.index(nuclide)
                square = (x - true[0]) ** 2 + (y - true[1]) ** 2 + (z - true[2]) ** 2
                depth = spectra.air_per_m[n] * math.sqrt(square)
                per_mm2 = becquerel * 1e-6 / (4.0 * math.pi * square) * math.exp(-depth)
                stopped = 0.0 if passing is None else 1.0 - passing(true, np.array([x, y, z]))
                facing = abs(x - true[0]) / math.sqrt(square) - MEAN_FACING  # all drones look to the east
                clear = near[n] + depth * far[n] + facing * by_facing[n]
                if of_soil:
                    steepness = (true[2] - z) / math.sqrt(square)
                    clear += of_soil[0][n] + steepness * (of_soil[1][n] + facing * of_soil[2][n])
                expected += per_mm2 * (clear - stopped * (direct[n] + depth * softer[n] + facing * by_facing[n]))
                if cones and nuclide == "Cs-137":
                    entries += _cones(kit, mission, rng, time_s, (true, measured), (x, y, z), per_mm2, drone, 20 * number)
            counts = rng.poisson(0.5 * expected).tolist()
            exposure = kit.exposure_entry(mission, time_s, measured, drone=drone, sequence=20 * number, duration_s=0.5)
            spectrum = tuple(SpectrumBin(e, count, 0) for e, count in enumerate(counts) if count)
            entries.append(msgspec.structs.replace(exposure, spectrum=spectrum, counts=Counts(sum(counts), 0, 0)))
    return entries


def _cones(kit, mission, rng, time_s, places, source, per_mm2, drone, sequence):
    true, measured = places
    cones = []
    for k in range(min(int(rng.poisson(0.5 * 0.8 * per_mm2)), 18)):
        axis, theta = kit.cone_towards(rng, true, source, 0.1)
        cone = kit.cone_entry(mission, time_s + 0.01 * k, measured, axis, theta, drone=drone, sequence=sequence + 1 + k)
        cones.append(msgspec.structs.replace(cone, energies_kev=(200.0, 461.66)))
    return cones


def problem_of(mission, entries, **prior):
    """The likelihood problem of a fit of drones a and b, with enough cones."""
    seen = [observe(entry, Transform()) for entry in sorted(entries, key=lambda entry: entry.entry_id)]
    drones = {"a": 0, "b": 1}
    rows = Rows.none().plus([one for one in seen if not isinstance(one, ConeObservation)], drones)
    cones = Cones.none().plus([one for one in seen if isinstance(one, ConeObservation)], drones)
    assert len(cones) > 50
    spectra, ground = Spectra.of(NUCLIDES, mission.fusion.ground), Ground.from_config(mission)
    assumed = Prior(
        bias=np.array([(0.3, 0.3, 0.05)] * 2),
        background=0.3,
        scale=0.03,
        scatter=0.15,
        low=np.zeros(2),
        high=np.full(2, 40.0),
        log_activity=(-7.0, 7.0),
        area_m2=Polygon(mission.area.polygon_m).area,
        expected=1.5,
        **prior,
    )
    windows = Windows(NUCLIDES, DetectionConfig())
    counts, directions = CountModel(rows, spectra, ground, 2), ConeModel(cones, spectra, ground, 2, windows)
    return Problem(counts, directions, assumed, len(spectra.nuclides))


@pytest.fixture(scope="session")
def among(kit):
    """The helpers of this file."""

    def mission(*arguments, **settings):
        return mission_of(kit, *arguments, **settings)

    def entries(*arguments, **settings):
        return entries_of(kit, *arguments, **settings)

    return SimpleNamespace(NUCLIDES=NUCLIDES, mission_of=mission, entries_of=entries, problem_of=problem_of)


@pytest.fixture(scope="session")
def estimated(kit):
    """The hypothesis after so many seconds of a mission with these entries."""

    def hypothesis(mission, entries, seconds):
        fusion = fusion_of(mission)
        assert all(kit.feed(fusion, entries))
        return kit.settle(fusion, kit.T0_NS + round(seconds * 1e9))

    return hypothesis
