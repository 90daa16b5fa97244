"""A bank of simulated events for every direction, so that a flight need not transport each photon anew.

The sphere of directions, less the sensor's eight symmetries, is cut into bins of about two degrees. Each holds events of
each kind (see Events) from directions spread evenly over the bin, and the effective areas with which the kinds occur. Single
events, whose energies hardly depend on the azimuth, are drawn from all bins of one polar angle. Two more bins hold isotropic
events: the nuclide's scattered photons and the natural background.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radron.sim.radiation.electronics import FLIP_COLUMN, FLIP_ROW, SWAP
from radron.sim.radiation.events import KINDS, SINGLE, Events, simulate
from radron.sim.radiation.nuclides import Nuclide
from radron.sim.radiation.surroundings import background_lines, scattered_lines
from radron.sim.radiation.timepix3 import PIXEL, Response

BIN_DEG = 2.0
_ROWS = round(180.0 / BIN_DEG)
_INTERACTIONS = 2500  # per bin
_QUOTA = (96, 48, 128)  # kept of them: single, scattered, complete
# Where a camera that faces a source while it circles has it all the time, in front or steeply below or above: so many that a
# flight hardly meets one twice. A few events that come again and again would bend the spectrum by more than a flight measures it.
_FRONT_ROWS = round(40.0 / BIN_DEG)
_STEEP_ROWS = round(72.0 / BIN_DEG)
_STEEP_AZIMUTH = math.radians(12.0)  # from the vertical
_OFTEN_INTERACTIONS = 40_000
_OFTEN_QUOTA = (2500, 800, 2200)
_ISOTROPIC_INTERACTIONS = 200_000
_ISOTROPIC_QUOTA = (20_000, 10_000, 10_000)
_OCTANT = 0.25 * math.pi

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class EventBank:
    """Stored simulated events of one camera, by the direction of the photons, from which a readout is made quickly.

    There are B direction bins; in the bank of a nuclide the last two are SCATTERED_BIN (scattered photons) and BACKGROUND_BIN.
    There are E events with P pixels. pixels: (P,) of PIXEL. first: (E + 1,) pixel range of each event. line: (E,) index of each
    event's gamma line. start, count: (B, KINDS) event ranges, which bins may share. area_mm2: (B, KINDS) effective area times
    photons per decay.
    """

    pixels: NDArray[np.void]
    first: NDArray[np.int64]
    line: NDArray[np.uint8]
    start: NDArray[np.int64]
    count: NDArray[np.int64]
    area_mm2: NDArray[np.float64]


def _columns(row: int) -> int:
    return max(1, math.ceil(45.0 * math.sin(math.radians((row + 0.5) * BIN_DEG)) / BIN_DEG))


_ROW_COLUMNS = [_columns(row) for row in range(_ROWS)]
_ROW_START = [sum(_ROW_COLUMNS[:row]) for row in range(_ROWS)]
DIRECTION_BINS = sum(_ROW_COLUMNS)
SCATTERED_BIN, BACKGROUND_BIN = DIRECTION_BINS, DIRECTION_BINS + 1


def bin_of(polar: float, azimuth: float) -> tuple[int, int]:
    """Return the direction bin of a direction, and the symmetry of the sensor that turns its events to that direction.

    polar, azimuth: direction in the camera frame, radians; azimuth from x.
    """
    x, y = math.cos(azimuth), math.sin(azimuth)
    symmetry = (FLIP_COLUMN if x < 0.0 else 0) | (FLIP_ROW if y < 0.0 else 0)
    x, y = abs(x), abs(y)
    if y > x:
        symmetry |= SWAP
        x, y = y, x
    row = min(_ROWS - 1, int(polar * _ROWS / math.pi))
    columns = _ROW_COLUMNS[row]
    return _ROW_START[row] + min(columns - 1, int(math.atan2(y, x) / _OCTANT * columns)), symmetry


def near_bin(direction: tuple[float, float, float], u: float, v: float) -> tuple[int, int]:
    """Return bin and symmetry of a direction (see :func:`bin_of`) that is first shifted at random by up to half a bin.

    The shift makes directions right on average. direction: unit vector. u, v: two uniform random numbers of [0, 1).
    """
    x, y, z = direction
    polar = math.acos(max(-1.0, min(1.0, z)))
    azimuth = math.atan2(y, x)
    row = min(_ROWS - 1, int(polar * _ROWS / math.pi))
    polar += (u - 0.5) * math.pi / _ROWS
    azimuth += (v - 0.5) * _OCTANT / _ROW_COLUMNS[row]
    if polar < 0.0:
        polar, azimuth = -polar, azimuth + math.pi
    elif polar > math.pi:
        polar, azimuth = 2.0 * math.pi - polar, azimuth + math.pi
    return bin_of(polar, azimuth)


def build_bank(
    nuclide: Nuclide,
    camera: Response,
    seed: int,
    progress: Progress | None = None,
    only: Collection[int] | None = None,
) -> EventBank:
    """Simulate the bank of events of a nuclide in a camera; equal seeds give equal banks.

    ``progress``: called now and then with the bins done and all bins. ``only``: fill these direction bins and leave all other
    bins empty.
    """
    rng = np.random.default_rng(seed)
    parts: list[Events] = []
    for b, (cosine, azimuth) in enumerate(_windows()):
        often = b < _ROW_START[_FRONT_ROWS] or (b < _ROW_START[_STEEP_ROWS] and azimuth[0] < _STEEP_AZIMUTH)
        interactions = (_OFTEN_INTERACTIONS if often else _INTERACTIONS) if only is None or b in only else 0
        quota = _OFTEN_QUOTA if often else _QUOTA
        parts.append(simulate(nuclide.lines, interactions, camera, rng, cosine=cosine, azimuth=azimuth, quota=quota))
        if progress is not None and b % 10 == 0:
            progress(b, DIRECTION_BINS)
    for lines in (scattered_lines(nuclide), background_lines()):
        parts.append(simulate(lines, _ISOTROPIC_INTERACTIONS, camera, rng, quota=_ISOTROPIC_QUOTA))
    bank = _pool(parts)
    bank.area_mm2[:DIRECTION_BINS] = _smooth(bank.area_mm2[:DIRECTION_BINS])
    return bank


def _windows() -> Iterator[tuple[tuple[float, float], tuple[float, float]]]:
    """Ranges of the polar cosine and the azimuth of each direction bin."""
    for row, columns in enumerate(_ROW_COLUMNS):
        cosine = (math.cos((row + 1) * math.pi / _ROWS), math.cos(row * math.pi / _ROWS))
        for column in range(columns):
            yield cosine, (column * _OCTANT / columns, (column + 1) * _OCTANT / columns)


def bin_centres() -> NDArray[np.float64]:
    """Return the unit vectors of the centres of all direction bins, (DIRECTION_BINS, 3)."""
    polar = np.repeat((np.arange(_ROWS) + 0.5) * math.pi / _ROWS, _ROW_COLUMNS)
    azimuth = np.concatenate([(np.arange(columns) + 0.5) * _OCTANT / columns for columns in _ROW_COLUMNS])
    return np.stack((np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=1)


def _smooth(area: NDArray[np.float64]) -> NDArray[np.float64]:
    """Average the kinds' shares, which vary slowly, over a few degrees; each bin's total, which does not, is kept.

    A rare kind's share in one bin is known to some 7 %, so to about 2 %.
    """
    total = area.sum(axis=1, keepdims=True)
    centres = bin_centres()
    weight = np.exp((centres @ centres.T - 1.0) / math.radians(3.0) ** 2)
    weight = weight * (total[:, 0] > 0.0)
    share = weight @ (area / np.maximum(total, 1e-30)) / np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    return np.asarray(np.where(area > 0.0, total * share, 0.0))


def _pool(parts: list[Events]) -> EventBank:
    """Join bins, sorted by pools: the bins of a row share one of single events, each has its own of every other kind."""
    row = np.append(np.repeat(np.arange(_ROWS), _ROW_COLUMNS), (_ROWS, _ROWS + 1))
    pool = np.arange(len(parts) * KINDS).reshape(-1, KINDS)  # (B, KINDS)
    pool[:, SINGLE] = pool[np.searchsorted(row, row), SINGLE]
    kind = np.concatenate([part.kind for part in parts]).astype(np.intp)
    pool_of = pool[np.repeat(np.arange(len(parts)), [len(part.kind) for part in parts]), kind]
    order = np.argsort(pool_of, kind="stable")
    length = np.concatenate([np.diff(part.first) for part in parts])
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    pixels = np.concatenate([part.pixels for part in parts])[np.argsort(np.repeat(place, length), kind="stable")]
    size = np.bincount(pool_of, minlength=pool.size)
    area = np.array([part.area_mm2 for part in parts])
    return EventBank(
        pixels.astype(PIXEL, copy=False),
        np.concatenate(([0], np.cumsum(length[order]))),
        np.concatenate([part.line for part in parts])[order],
        (np.cumsum(size) - size)[pool],
        size[pool],
        np.where(size[pool] > 0, area, 0.0),
    )
