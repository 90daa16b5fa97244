"""A bank of the bins near one polar angle, which takes a second instead of half a minute; and events read back from readouts."""

import math
from functools import cache

import numpy as np

from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import Readout
from radron.sim.radiation.bank import EventBank, bin_of, build_bank
from radron.sim.radiation.events import Events
from radron.sim.radiation.nuclides import nuclide
from radron.sim.radiation.timepix3 import ENERGY_STEP_KEV, PIXEL, response
from radron.sim.radiation.truth import CameraTruth

POLAR_DEG = 60.0
ALONE = CameraTruth(background_hits_per_s=0.0, scatter_near=0.0, scatter_air=0.0)


@cache
def partial_bank(name: str, polar_deg: float = POLAR_DEG) -> EventBank:
    """Bins within three degrees of the polar angle, all azimuths."""
    polars = np.radians(np.arange(polar_deg - 3.0, polar_deg + 3.1, 0.5))
    bins = {bin_of(polar, math.radians(turn))[0] for polar in polars for turn in np.arange(0.0, 45.0, 0.5)}
    return build_bank(nuclide(name), response(CameraTruth()), 1, only=bins)


def direction(polar_deg: float, azimuth_rad: float) -> tuple[float, float, float]:
    polar = math.radians(polar_deg)
    return math.sin(polar) * math.cos(azimuth_rad), math.sin(polar) * math.sin(azimuth_rad), math.cos(polar)


def regroup(readouts: list[Readout]) -> Events:
    """Events of sparse readouts: hits within 128 ticks of each other, energies by the nominal calibration; no truth."""
    tick = np.concatenate([readout.hits.tick for readout in readouts])
    index = np.concatenate([readout.hits.index for readout in readouts])
    energy = Calibration.nominal().energy_kev(index, np.concatenate([readout.hits.tot for readout in readouts]))
    order = np.argsort(tick, kind="stable")
    tick, index, energy = tick[order], index[order], energy[order]
    begins = np.concatenate(([True], np.diff(tick) > 128))
    first = np.append(np.flatnonzero(begins), len(tick))
    pixels = np.zeros(len(tick), PIXEL)
    pixels["column"], pixels["row"], pixels["energy"] = index % 256, index // 256, np.rint(energy / ENERGY_STEP_KEV)
    pixels["tick"] = tick - np.repeat(tick[first[:-1]], np.diff(first))
    count = len(first) - 1
    none = np.zeros(count, np.uint8)
    return Events(pixels, first, none, none, np.zeros((count, 3)), np.zeros((count, 2, 5)), np.zeros(3))
