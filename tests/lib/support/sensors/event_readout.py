"""Simulated events as a camera would deliver them: one readout with the events at equal intervals, by the nominal calibration."""

from __future__ import annotations

import numpy as np

from radron.agent.detector.files.calibration import NOMINAL
from radron.agent.detector.readout import PixelHits, Readout
from radron.sim.radiation.events import Events
from radron.sim.radiation.timepix3 import energies_kev

SPACING_NS = 100_000  # an event's stamp over this is its number
SPACING = SPACING_NS * 16 // 25  # ticks


def readout_of(events: Events) -> Readout:
    """All events, in their order; pixels that would count nothing are left out."""
    pixels = events.pixels
    owner = np.repeat(np.arange(len(events.first) - 1), np.diff(events.first))
    energy = energies_kev(pixels)
    a, b, c, t = NOMINAL
    tot = np.clip(np.floor(a * energy + b - c / np.maximum(energy - t, 1e-3) + 0.5), 0, 1022).astype(np.uint16)
    index = (256 * pixels["row"].astype(int) + pixels["column"]).astype(np.uint16)
    tick = owner * SPACING + pixels["tick"].astype(np.int64)
    end_ns = len(events.first) * SPACING_NS
    return Readout(0, end_ns, 0, end_ns * 1e-9, PixelHits(tick, index, tot).take(tot > 0))
