"""Quantities read from simulated events, for a check of the physics: clusters, coincidences and the angular resolution.

Deliberately apart from the agent's detector chain: energies are taken as deposited, and the order of the two clusters of a
coincidence is the true one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS, SENSOR_THICKNESS_MM, TICK_NS
from radron.sim.radiation._jit import jit
from radron.sim.radiation.events import Events
from radron.sim.radiation.materials import ELECTRON_MASS_KEV
from radron.sim.radiation.timepix3 import ENERGY_STEP_KEV

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CLUSTER_KEV = 5.0
SATELLITE_KEV = 32.0  # above the K lines of Cd and Te
SATELLITE_MM = 0.5  # five mean free paths of a K line photon
_MAX_CLUSTERS = 64


@dataclass(frozen=True, slots=True)
class Clusters:
    """Clusters of E events. number: (E,). Of the two most energetic, (E, 2): size in pixels, energy, mean position and tick."""

    number: IntArray
    size: IntArray
    energy_kev: FloatArray
    x_mm: FloatArray
    y_mm: FloatArray
    tick: FloatArray


@jit
def _label(pixels: NDArray[np.void], label: IntArray) -> int:
    """Number the 8-connected groups of an event's pixels in label (P,); returns how many there are."""
    label[: len(pixels)] = -1
    count = 0
    for seed in range(len(pixels)):
        if label[seed] >= 0 or count >= _MAX_CLUSTERS:
            continue
        label[seed] = count
        grown = True
        while grown:
            grown = False
            for p in range(len(pixels)):
                for q in range(len(pixels)):
                    columns = np.int64(pixels[p]["column"]) - np.int64(pixels[q]["column"])
                    rows = np.int64(pixels[p]["row"]) - np.int64(pixels[q]["row"])
                    if label[p] == count and label[q] < 0 and abs(columns) <= 1 and abs(rows) <= 1:
                        label[q] = count
                        grown = True
        count += 1
    return count


@jit
def _merge_satellites(cluster: FloatArray, order: IntArray) -> None:
    """Give each small cluster's pixels and energy to the nearest great one close by. cluster (C, 5), order: by falling energy."""
    for i in range(len(order) - 1, 0, -1):
        k = order[i]
        best, nearest = -1, SATELLITE_MM / PIXEL_PITCH_MM
        for j in order[:i]:
            distance = np.hypot(cluster[j, 2] - cluster[k, 2], cluster[j, 3] - cluster[k, 3])
            if cluster[k, 1] <= SATELLITE_KEV < cluster[j, 1] and distance < nearest:
                best, nearest = j, distance
        if best >= 0:
            cluster[best, :2] += cluster[k, :2]
            cluster[k, 1] = 0.0


@jit
def _clusters(pixels: NDArray[np.void], first: IntArray, merge: bool, number: IntArray, table: FloatArray) -> None:
    """Fill number (E,) and table (E, 2, 5): pixels, energy, mean column, row and tick."""
    label = np.empty(4000, np.int64)
    for e in range(len(number)):
        event = pixels[first[e] : first[e + 1]]
        cluster = np.zeros((_label(event, label), 5))
        for p in range(len(event)):
            energy = ENERGY_STEP_KEV * event[p]["energy"]
            row = cluster[label[p]]
            row[0] += 1.0
            row[1] += energy
            row[2] += energy * event[p]["column"]
            row[3] += energy * event[p]["row"]
            row[4] += energy * event[p]["tick"]
        for row in cluster:
            row[2:] /= row[1]
        if merge:
            _merge_satellites(cluster, np.argsort(-cluster[:, 1]))
        for k in np.argsort(-cluster[:, 1]):
            if cluster[k, 1] < CLUSTER_KEV:
                break
            if number[e] < 2:
                table[e, number[e]] = cluster[k]
            number[e] += 1


def clusters(events: Events, *, merge_satellites: bool = False) -> Clusters:
    """8-connected clusters of at least 5 keV; optionally with fluorescence's small ones given to their neighbours."""
    count = len(events.first) - 1
    number = np.zeros(count, np.int64)
    table = np.zeros((count, 2, 5))
    _clusters(events.pixels, events.first, merge_satellites, number, table)
    column, row = table[:, :, 2], table[:, :, 3]
    centre = 0.5 * (SENSOR_PIXELS - 1)
    return Clusters(
        number,
        table[:, :, 0].astype(np.int64),
        table[:, :, 1],
        (column - centre) * PIXEL_PITCH_MM,
        (row - centre) * PIXEL_PITCH_MM,
        table[:, :, 4],
    )


def complete(found: Clusters, line_kev: float, window_kev: float = 45.0, least_pixels: int = 15) -> NDArray[np.bool_]:
    """(E,) which events are coincidences of two clusters with the line's full energy and enough pixels."""
    full = np.abs(found.energy_kev.sum(axis=1) - line_kev) <= window_kev
    return np.asarray((found.number == 2) & full & (found.size.sum(axis=1) >= least_pixels))


def electron_first(events: Events, found: Clusters) -> NDArray[np.bool_]:
    """(E,) whether the more energetic cluster is the recoil electron's: the cluster nearer to the photon's first site."""
    site = events.sites[:, 0, :2]
    distance = np.hypot(found.x_mm - site[:, :1], found.y_mm - site[:, 1:])
    return np.asarray(distance[:, 0] < distance[:, 1])


def fwhm(values: FloatArray, bandwidth: float) -> float:
    """Full width at half maximum of a distribution, from a Gaussian kernel estimate, its own width taken out again."""
    grid = np.arange(values.min(), values.max(), 0.1 * bandwidth)
    fine = np.histogram(values, np.append(grid, grid[-1] + 0.1 * bandwidth))[0]
    kernel = np.exp(-0.5 * (np.arange(-40, 41) * 0.1) ** 2)
    density = np.convolve(fine, kernel, "same")
    above = np.flatnonzero(density > 0.5 * density.max())
    width = 0.1 * bandwidth * float(above[-1] - above[0] + 1)
    return float(np.sqrt(max(0.0, width**2 - 8.0 * np.log(2.0) * bandwidth**2)))


@dataclass(frozen=True, slots=True)
class Cones:
    """(C,) true-order cones. arm_rad: angle of source and axis less the opening angle. later_is_electron: by the ToA."""

    arm_rad: FloatArray
    later_is_electron: NDArray[np.bool_]


def cones(events: Events, found: Clusters, line_kev: float, drift_ns: float) -> Cones:
    """Cones of the complete coincidences with a kinematically allowed true order.

    The residual of the energies is shared by variance so that they sum to the line.
    """
    rows = np.flatnonzero(complete(found, line_kev))
    swap = ~electron_first(events, found)[rows]

    def ordered(values: FloatArray) -> tuple[FloatArray, FloatArray]:
        first, second = values[rows, 0], values[rows, 1]
        return np.where(swap, second, first), np.where(swap, first, second)

    electron, photon = ordered(found.energy_kev)
    variance_e, variance_g = 2.5**2 + (0.02 * electron) ** 2, 2.5**2 + (0.02 * photon) ** 2
    photon = photon + (line_kev - electron - photon) * variance_g / (variance_e + variance_g)
    cosine = 1.0 - ELECTRON_MASS_KEV * (1.0 / photon - 1.0 / line_kev)
    tick_e, tick_g = ordered(found.tick)
    x_e, x_g = ordered(found.x_mm)
    y_e, y_g = ordered(found.y_mm)
    dz = (tick_e - tick_g) * TICK_NS * SENSOR_THICKNESS_MM / drift_ns
    axis = np.stack((x_e - x_g, y_e - y_g, dz), axis=1)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arccos(np.clip((axis * events.source[rows]).sum(axis=1), -1.0, 1.0))
    allowed = np.abs(cosine) <= 1.0
    return Cones((angle - np.arccos(np.clip(cosine, -1.0, 1.0)))[allowed], (tick_e > tick_g)[allowed])
