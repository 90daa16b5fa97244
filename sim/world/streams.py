"""Random streams of a run: one independent generator for each random quantity, all from one seed.

A new quantity gets a stream with its own key, so that flights with existing seeds do not change otherwise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

_FRAMES, _RECEIVERS, _LIAR, _SIGHTINGS = range(1_000_000, 1_000_004)  # beyond any camera's key
_SOURCES, _GROUND, _CONTAMINATION = (
    1_000_008,
    1_000_010,
    1_000_030,
)  # the keys between belong to radron.sim.faults and radron.sim.campaign.faults


class Streams(NamedTuple):
    """Random number generators of a simulated flight, one for each random quantity, all from one seed.

    ``cameras``, ``frames``, ``receivers``: one for each drone. ``sources``: of all sources except ``source``. ``ground``: for the
    kind of ground. ``contamination``: patterns of contaminated ground.
    """

    source: np.random.Generator
    start: np.random.Generator
    vehicle: np.random.Generator
    localization: np.random.Generator
    radio: np.random.Generator
    cameras: list[np.random.Generator]
    frames: list[np.random.Generator]
    receivers: list[np.random.Generator]
    liar: np.random.Generator
    sightings: np.random.Generator
    sources: np.random.Generator
    ground: np.random.Generator
    contamination: np.random.Generator


def streams(seed: int, drones: int) -> Streams:
    """Return the random number generators of a simulated flight with this seed and number of drones."""
    children = np.random.SeedSequence(seed).spawn(5 + drones)
    generators = [np.random.default_rng(child) for child in children]
    source, start, vehicle, localization, radio, *cameras = generators
    return Streams(
        source,
        start,
        vehicle,
        localization,
        radio,
        cameras,
        frames=_each(seed, _FRAMES, drones),
        receivers=_each(seed, _RECEIVERS, drones),
        liar=_keyed(seed, _LIAR),
        sightings=_keyed(seed, _SIGHTINGS),
        sources=_keyed(seed, _SOURCES),
        ground=_keyed(seed, _GROUND),
        contamination=_keyed(seed, _CONTAMINATION),
    )


def _keyed(seed: int, *key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _each(seed: int, key: int, drones: int) -> list[np.random.Generator]:
    return [_keyed(seed, key, drone) for drone in range(drones)]
