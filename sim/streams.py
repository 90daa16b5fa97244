"""The random numbers of a run: from its seed one independent stream for each thing that is random."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Streams(NamedTuple):
    """Generators of one seed. ``cameras``: one for each drone."""

    source: np.random.Generator
    start: np.random.Generator
    vehicle: np.random.Generator
    localization: np.random.Generator
    radio: np.random.Generator
    cameras: list[np.random.Generator]


def streams(seed: int, drones: int) -> Streams:
    """The streams of a run with so many drones."""
    children = np.random.SeedSequence(seed).spawn(5 + drones)
    generators = [np.random.default_rng(child) for child in children]
    source, start, vehicle, localization, radio, *cameras = generators
    return Streams(source, start, vehicle, localization, radio, cameras)
