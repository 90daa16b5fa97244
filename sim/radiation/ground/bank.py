"""Bank of simulated events by photons from the ground: for each energy group and each of a few directions, for all nuclides.

The energy groups are those of ``photons``. Directions are bins of 15 degrees in the polar angle, three in the azimuth within one
of the sensor's eight symmetries; one more bin is isotropic.
"""

from __future__ import annotations

import hashlib
import math
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation.bank import EventBank
from radron.sim.radiation.electronics import FLIP_COLUMN, FLIP_ROW, SWAP
from radron.sim.radiation.events import KINDS, Events, simulate
from radron.sim.radiation.ground.photons import GROUPS, MAX_GROUP_KEV, MIN_KEV
from radron.sim.radiation.store import MADE_BY, Arrays, as_arrays, as_bank, kept
from radron.sim.radiation.timepix3 import Response

ROWS, COLUMNS = 12, 3
DIRECTIONS = ROWS * COLUMNS
ISOTROPIC = DIRECTIONS  # the place of the isotropic bin
_OCTANT = 0.25 * math.pi
_INTERACTIONS, _ISOTROPIC_INTERACTIONS = 1500, 20_000  # in each group
_QUOTA, _ISOTROPIC_QUOTA = (150, 50, 50), (3000, 1000, 1000)
_LINES = 5  # energies in a group


def direction_of(unit: tuple[float, float, float]) -> tuple[int, int]:
    """Return the bin of a direction (camera frame), and the symmetry of the sensor that turns its events to that direction."""
    x, y, z = unit
    symmetry = (FLIP_COLUMN if x < 0.0 else 0) | (FLIP_ROW if y < 0.0 else 0)
    x, y = abs(x), abs(y)
    if y > x:
        symmetry |= SWAP
        x, y = y, x
    row = min(ROWS - 1, int(math.acos(max(-1.0, min(1.0, z))) * ROWS / math.pi))
    return row * COLUMNS + min(COLUMNS - 1, int(math.atan2(y, x) / _OCTANT * COLUMNS)), symmetry


@cache
def ground_bank(camera: Response) -> EventBank:
    """Return the bank of simulated events by photons from the ground, for one sensor.

    The bin of a direction and an energy group is direction * GROUPS + group; its area is an effective area per photon.
    """
    code = hashlib.blake2b(repr(camera).encode(), digest_size=8)
    folder = Path(__file__).parent
    for path in (folder / "bank.py", folder / "photons.py", *(folder.parent / f"{name}.py" for name in MADE_BY)):
        code.update(path.read_bytes())
    return as_bank(kept(f"bank-ground-{code.hexdigest()}", lambda: _build(camera)))


def _build(camera: Response) -> Arrays:
    rng = np.random.default_rng(3)
    parts = []
    for place in range(DIRECTIONS + 1):
        row, column = divmod(place, COLUMNS)
        cosine = (math.cos((row + 1) * math.pi / ROWS), math.cos(row * math.pi / ROWS))
        azimuth = (column * _OCTANT / COLUMNS, (column + 1) * _OCTANT / COLUMNS)
        for group in range(GROUPS):
            if place == ISOTROPIC:
                parts.append(simulate(_lines(group), _ISOTROPIC_INTERACTIONS, camera, rng, quota=_ISOTROPIC_QUOTA))
            else:
                parts.append(simulate(_lines(group), _INTERACTIONS, camera, rng, cosine=cosine, azimuth=azimuth, quota=_QUOTA))
    return as_arrays(_pooled(parts))


def group_energies_kev() -> NDArray[np.float64]:
    """Return the middles of the energy groups, (GROUPS,) keV."""
    return np.asarray(MIN_KEV * np.exp(math.log(MAX_GROUP_KEV / MIN_KEV) / GROUPS * (np.arange(GROUPS) + 0.5)))


def _lines(group: int) -> tuple[tuple[float, float], ...]:
    """Energies all over the group, with the same share each."""
    step = math.log(MAX_GROUP_KEV / MIN_KEV) / GROUPS
    return tuple((MIN_KEV * math.exp(step * (group + (k + 0.5) / _LINES)), 1.0 / _LINES) for k in range(_LINES))


def _pooled(parts: list[Events]) -> EventBank:
    """Join the bins, their events sorted by kind."""
    sizes = np.array([np.bincount(part.kind, minlength=KINDS) for part in parts])
    orders = [np.argsort(part.kind, kind="stable") for part in parts]
    pixels, lengths = [], []
    for part, order in zip(parts, orders, strict=True):
        length = np.diff(part.first)[order]
        begin = part.first[order]
        offset = np.cumsum(length) - length
        pixels.append(part.pixels[np.repeat(begin - offset, length) + np.arange(length.sum())])
        lengths.append(length)
    ends = np.cumsum(sizes.ravel()).reshape(sizes.shape)
    area: NDArray[np.float64] = np.array([part.area_mm2 for part in parts])
    return EventBank(
        np.concatenate(pixels),
        np.concatenate(([0], np.cumsum(np.concatenate(lengths)))),
        np.concatenate([part.line[order] for part, order in zip(parts, orders, strict=True)]),
        ends - sizes,
        sizes,
        np.where(sizes > 0, area, 0.0),
    )
