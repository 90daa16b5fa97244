"""Hits of events with a geometry and energies chosen by the test."""

from itertools import pairwise

import numpy as np
import pytest

from radron.agent.detector.readout import PixelHits, Readout

A, B, C, T = 1.6, 24.0, 60.0, 1.8  # the nominal calibration, written down again
LINE = 661.66
DRIFT_NS = 86.0


class Blob:
    """A deposit: time in ns, place in mm (x, y from the sensor's centre; z from its rear), energy in keV, hits in a row."""

    def __init__(self, time_ns, place_mm, energy_kev, pixels):
        self.time_ns, self.place_mm, self.energy_kev, self.pixels = time_ns, place_mm, energy_kev, pixels

    def rows(self):
        """(tick, index, tot) of its hits: a symmetric cross or line around the pixel under it."""
        column = round(self.place_mm[0] / 0.055 + 127.5)
        row = round(self.place_mm[1] / 0.055 + 127.5)
        tick = round((self.time_ns + self.place_mm[2] / 2.0 * DRIFT_NS) * 16 / 25)
        energy = self.energy_kev / self.pixels
        tot = round(A * energy + B - C / (energy - T))
        for i in range(self.pixels):
            offset = (i + 1) // 2 * (1 if i % 2 else -1)
            yield tick, 256 * row + column + offset, tot


def hits_of(blobs):
    """PixelHits in the order of the end of the pulses, as a camera delivers them."""
    rows = sorted((row for blob in blobs for row in blob.rows()), key=lambda row: row[0] + 16 * row[2])
    table = np.array(rows, np.int64).reshape(-1, 3)
    return PixelHits(table[:, 0], table[:, 1].astype(np.uint16), table[:, 2].astype(np.uint16))


def readouts_of(hits, edges_ns, clock_ns=0):
    """Readouts between the edges, with the detector's hits in them by time of arrival."""
    time = hits.tick * 25
    for start, end in pairwise(edges_ns):
        part = (time >= 16 * (start - clock_ns)) & (time < 16 * (end - clock_ns))
        yield Readout(start, end, clock_ns, (end - start) * 1e-9, PixelHits(hits.tick[part], hits.index[part], hits.tot[part]))


def compton_event(rng, source, time_ns):
    """Two blobs of a photon of 661.66 keV from the unit vector ``source`` (camera frame): electron first, then absorption.

    Returns the blobs, or None where the scattered photon leaves the sensor. The scattering angle is even in cosine.
    """
    k = LINE / 510.99895
    cosine = rng.uniform(-0.9, 0.9)
    scattered = LINE / (1.0 + k * (1.0 - cosine))
    incoming = -np.asarray(source)
    u = np.cross(incoming, np.eye(3)[np.abs(incoming).argmin()])
    u /= np.linalg.norm(u)
    v = np.cross(incoming, u)
    turn = rng.uniform(0.0, 2.0 * np.pi)
    outgoing = cosine * incoming + np.sqrt(1.0 - cosine**2) * (np.cos(turn) * u + np.sin(turn) * v)
    first = np.array([*rng.uniform(-6.5, 6.5, 2), rng.uniform(0.0, 2.0)])
    second = first + rng.uniform(1.5, 6.0) * outgoing
    if abs(second[:2]).max() > 6.5 or not 0.0 <= second[2] <= 2.0:
        return None
    return [Blob(time_ns, first, LINE - scattered, 9), Blob(time_ns, second, scattered, 9)]


@pytest.fixture(scope="session")
def blob():
    return Blob


@pytest.fixture(scope="session")
def make_hits():
    return hits_of


@pytest.fixture(scope="session")
def make_readouts():
    return readouts_of


@pytest.fixture(scope="session")
def make_compton_event():
    return compton_event
