"""Energies of events that the simulation has transported through the sensor."""

from functools import cache

import numpy as np
import pytest

from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.chain import DetectorChain
from radron.agent.detector.files.calibration import Calibration

events = pytest.importorskip("radron.sim.radiation.events")
nuclides = pytest.importorskip("radron.sim.radiation.nuclides")
event_readout = pytest.importorskip("support.sensors.event_readout")
surroundings = pytest.importorskip("radron.sim.radiation.surroundings")
timepix3 = pytest.importorskip("radron.sim.radiation.timepix3")
truth = pytest.importorskip("radron.sim.radiation.truth")


def energies(lines, interactions):
    """Energies that the chain reads of photons from all sides, in the order of the events."""
    simulated = events.simulate(lines, interactions, timepix3.response(truth.CameraTruth()), np.random.default_rng(4))
    found = []
    chain = DetectorChain(DetectionConfig(), None, Calibration.nominal(), on_energies=lambda kev: found.extend(list(kev)))
    chain.process(event_readout.readout_of(simulated))
    return np.array(found)


@cache
def pool(what):
    """Energies of a nuclide's events, direct and scattered photons, or of the background's."""
    if what == "background":
        return energies(surroundings.background_lines(), 40_000)
    source = nuclides.nuclide(what)
    direct, scattered = energies(source.lines, 15_000), energies(surroundings.scattered_lines(source), 6_000)
    return np.random.default_rng(1).permutation(np.concatenate((direct, scattered[: len(direct) // 3])))
