"""Response of the Timepix3 (pixel detector): from deposits of energy in the sensor to charge, time and energy in the pixels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import PIXEL_PITCH_MM, SENSOR_PIXELS, SENSOR_THICKNESS_MM, TICK_NS
from radron.sim.radiation._jit import jit
from radron.sim.radiation.electrons import Electrons, track
from radron.sim.radiation.truth import CameraTruth

FloatArray = NDArray[np.float64]

# One pixel of an event: column and row, ticks after the photon, energy before the conversion to ToT in steps of ENERGY_STEP_KEV:
# far finer than the pixel's noise, and a bank of some 20 million pixels is smaller by a quarter than with floats.
PIXEL = np.dtype([("column", np.uint8), ("row", np.uint8), ("tick", np.int16), ("energy", np.uint16)])
ENERGY_STEP_KEV = 1.0 / 64.0
_MAX_ENERGY = 65_535  # 1,024 keV, beyond the largest ToT
MAX_PIXELS = 2000
_PITCH = PIXEL_PITCH_MM
_HALF_Z = 0.5 * SENSOR_THICKNESS_MM
_MIN_SIGMA_MM = 0.004  # the cloud's own size
# Spread over 3 x 3 pixels: beyond them lies, at worst, 2.5 % of a charge that starts at a pixel's edge; the outer pixels get it.
_LATENCY_NS = 10.0  # keeps every tick at or after the photon, jitter included


def energies_kev(pixels: NDArray[np.void]) -> FloatArray:
    """Return the energies (P,) of pixels in keV. pixels: (P,) of PIXEL."""
    return ENERGY_STEP_KEV * pixels["energy"].astype(np.float64)


class Response(NamedTuple):
    """The parameters of a camera that shape an event's pixels, in the form that compiled functions need (see ``CameraTruth``)."""

    drift_ns: float
    diffusion_mm: float
    gain_noise: float
    pixel_noise_kev: float
    threshold_kev: float
    charge_scale: float
    toa_jitter_ns: float


def response(truth: CameraTruth) -> Response:
    """Return the parameters of a camera that shape an event's pixels."""
    return Response(*(float(getattr(truth, name)) for name in Response._fields))


class Scratch(NamedTuple):
    """Work space that is reused from event to event.

    charge, moment: (256, 256) by column, row, all zero between events; touched: (MAX_PIXELS, 2).
    """

    charge: FloatArray
    moment: FloatArray
    touched: NDArray[np.int64]
    points: FloatArray


def scratch() -> Scratch:
    """Return a new work space."""
    shape = (SENSOR_PIXELS, SENSOR_PIXELS)
    return Scratch(np.zeros(shape), np.zeros(shape), np.zeros((MAX_PIXELS, 2), np.int64), np.zeros((1000, 4)))


@jit
def _share(x: float, y: float, z: float, energy: float, camera: Response, work: Scratch, count: int) -> int:
    """Spread a charge that starts at (x, y, z) mm over the 3 x 3 pixels under it; returns the number of touched pixels."""
    depth = (z + _HALF_Z) / (2.0 * _HALF_Z)  # share of the full drift
    sigma = math.sqrt(_MIN_SIGMA_MM * _MIN_SIGMA_MM + camera.diffusion_mm * camera.diffusion_mm * depth)
    scale = 1.0 / (math.sqrt(2.0) * sigma)
    column = min(SENSOR_PIXELS - 1, max(0, math.floor(x / _PITCH) + SENSOR_PIXELS // 2))
    row = min(SENSOR_PIXELS - 1, max(0, math.floor(y / _PITCH) + SENSOR_PIXELS // 2))
    left = (column - SENSOR_PIXELS // 2) * _PITCH - x
    low = (row - SENSOR_PIXELS // 2) * _PITCH - y
    xl, xr = 0.5 * math.erf(left * scale), 0.5 * math.erf((left + _PITCH) * scale)
    yl, yr = 0.5 * math.erf(low * scale), 0.5 * math.erf((low + _PITCH) * scale)
    across = (0.5 + xl, xr - xl, 0.5 - xr)
    along = (0.5 + yl, yr - yl, 0.5 - yr)
    time = camera.drift_ns * depth
    for i in range(3):
        c = column + i - 1
        if c < 0 or c >= SENSOR_PIXELS:
            continue
        for j in range(3):
            r = row + j - 1
            part = energy * across[i] * along[j]
            if r < 0 or r >= SENSOR_PIXELS or part < 0.02:
                continue
            if work.charge[c, r] == 0.0:
                if count >= MAX_PIXELS:
                    continue
                work.touched[count, 0] = c
                work.touched[count, 1] = r
                count += 1
            work.charge[c, r] += part
            work.moment[c, r] += part * time
    return count


@jit
def respond(
    sites: FloatArray,
    count: int,
    half: FloatArray,
    camera: Response,
    electrons: Electrons,
    rng: np.random.Generator,
    work: Scratch,
    pixels: NDArray[np.void],
    first: int,
) -> int:
    """Simulate the pixels of one event from its deposits of energy, write them to pixels[first:], and return the end index.

    sites: deposits of the event (see ``transport``). A pixel's time is the mean arrival time of its charge.
    """
    touched = 0
    for k in range(count):
        gain = camera.charge_scale * max(0.0, 1.0 + camera.gain_noise * rng.normal())
        site = sites[k]
        rest = site[3] - site[4]
        steps = track(site[:3], site[5:8], site[4], half, electrons, rng, work.points)
        for step in range(steps):
            point = work.points[step]
            touched = _share(point[0], point[1], point[2], gain * point[3], camera, work, touched)
        # What is not kinetic energy: Auger electrons and soft X rays, on the spot. Negative where fluorescence took more than
        # the K edge left over, which cannot be: a K line is weaker than its edge.
        if rest > 0.0:
            touched = _share(site[0], site[1], site[2], gain * rest, camera, work, touched)
    phase = rng.random()
    end = first
    for k in range(touched):
        c, r = work.touched[k, 0], work.touched[k, 1]
        energy = work.charge[c, r]
        time = work.moment[c, r] / energy
        work.charge[c, r] = 0.0
        work.moment[c, r] = 0.0
        energy += camera.pixel_noise_kev * rng.normal()
        if energy > camera.threshold_kev and end < len(pixels):
            tick = (_LATENCY_NS + time + camera.toa_jitter_ns * rng.normal()) / TICK_NS + phase
            pixels[end]["column"] = c
            pixels[end]["row"] = r
            pixels[end]["tick"] = max(0, math.floor(tick))
            pixels[end]["energy"] = min(_MAX_ENERGY, int(energy / ENERGY_STEP_KEV + 0.5))
            end += 1
    return end
