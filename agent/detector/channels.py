"""Counts of an ordinary detector in the channels of its table of response, with its dead time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.config.drone import DetectorConfig
from radron.agent.config.responses import ResponseTable
from radron.agent.detector.detection import Detections
from radron.agent.detector.readout import Readout
from radron.agent.errors import DetectorError

Array = NDArray[np.float64]


def energies_of(channels: int, energy_kev: tuple[float, ...]) -> Array:
    """Return the energies (channels + 1,) at the edges of a device's channels; energy_kev: a, b, c, ... of a + b n + c n^2 + ...;
    n counts the edges from 0.
    """
    edges: Array = np.polynomial.polynomial.polyval(np.arange(channels + 1), np.array(energy_kev))
    return edges


class Channels:
    """Converts the readouts of an ordinary detector to counts in the channels of its table of response.

    A channel of the device across an edge of the table is divided in proportion. Fractions of counts are carried to the next
    readout, so that no count is lost and none is drawn at random. Counts beyond the table's channels are left out.
    """

    def __init__(self, config: DetectorConfig, table: ResponseTable) -> None:
        """Set up the conversion; ``config``: section ``[detector]`` of the drone file."""
        self._edges_kev: Array = np.array(table.edges_kev)
        self._energy_kev, self._kind = config.energy_kev, table.kind
        self._dead_s = None if config.dead_time_us is None else 1e-6 * config.dead_time_us
        self._shares: Array | None = None  # (R, C) of the device's channels in the table's
        self._carried: Array = np.zeros(table.channels)

    def detections(self, readout: Readout) -> Detections:
        """Return the counts of a readout, with the live time in which they were measured.

        Of a constant dead time tau that counts do not extend, the live time of an interval T with N counts is T - N tau (Knoll,
        Radiation Detection and Measurement, ch. 4.VII: non-paralyzable).

        Raises:
            DetectorError: the readout has no counts, or another number of channels than the configuration.
        """
        counts = readout.counts
        if counts is None:
            raise DetectorError("pixel hits instead of counts; correct detector.kind, or the driver")
        if self._shares is None or len(self._shares) != len(counts):
            self._shares = self._divided(len(counts))
        exact = counts @ self._shares + self._carried
        whole = np.rint(exact)
        self._carried = exact - whole  # at least -0.5, so that no channel ever gets a negative count
        bins = tuple(int(one) for one in whole)
        live_s = readout.live_time_s
        if self._dead_s is not None:
            live_s = max((readout.end_ns - readout.start_ns) * 1e-9 - float(counts.sum()) * self._dead_s, 0.0)
        return Detections(readout.start_ns, readout.end_ns, live_s, sum(bins), bins=bins)

    def _divided(self, channels: int) -> Array:
        """Shares (R, C) of each channel of the device in the table's channels."""
        table = len(self._edges_kev) - 1
        if self._kind == "counts":
            return np.ones((channels, 1))
        if self._energy_kev is None:
            if channels != table:
                raise DetectorError(
                    f"spectra of {channels} channels, its table of response has {table}; give detector.energy_kev"
                )
            return np.eye(table)
        edges_kev = energies_of(channels, self._energy_kev)
        if not np.all(np.diff(edges_kev) > 0.0):
            raise DetectorError(f"detector.energy_kev does not rise over {channels} channels; correct it")
        low = np.clip(self._edges_kev[None, :], edges_kev[:-1, None], edges_kev[1:, None])
        shares: Array = np.diff(low, axis=1) / np.diff(edges_kev)[:, None]
        return shares
