"""Blocks of dead pixels, recognised by missing hits: such a camera counts less than its calibration says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import SENSOR_PIXELS
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText

BLOCK_PIXELS = 32  # pixels; a side of the sensor has 8 blocks
SENSOR_BLOCKS = (SENSOR_PIXELS // BLOCK_PIXELS) ** 2
MIN_HITS = 200  # in a block, on average, before one without any is dead: 20 clusters and more, by chance absent once in 1e8
MIN_GOOD = 0.5  # share of a block's pixels with an energy by the calibration, below which it is not judged


class DeadBlocks:
    """Finds dead blocks of the sensor (32 x 32 pixels without a hit): such a camera counts less than its calibration says.

    A block is dead if it has no hit while the blocks have ``MIN_HITS`` on average. ``dead``: number of dead blocks, evaluated
    again whenever that many hits have arrived.
    """

    def __init__(self, calibration: Calibration) -> None:
        good = np.bincount(_block(np.arange(SENSOR_PIXELS**2)), calibration.good_pixels, SENSOR_BLOCKS) / BLOCK_PIXELS**2
        self._judged: NDArray[np.bool_] = good >= MIN_GOOD
        self._needed = MIN_HITS * int(np.count_nonzero(self._judged))
        self._hits = np.zeros(SENSOR_BLOCKS, np.int64)
        self._total = 0
        self.dead = 0

    def add(self, index: NDArray[np.uint16]) -> None:
        """Add N pixel hits to the counts of their blocks (32 x 32 pixels). index: (N,) matrix indices of the pixels."""
        self._hits += np.bincount(_block(index), minlength=SENSOR_BLOCKS)
        self._total += len(index)
        if self._total >= self._needed:
            self.dead = int(np.count_nonzero(self._judged & (self._hits == 0)))
            self._hits[:] = self._total = 0

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """A line for the operator while the sensor has dead blocks (32 x 32 pixels without a hit); empty otherwise."""
        if self.dead == 0:
            return ()
        share = f"{self.dead} of {SENSOR_BLOCKS} blocks of the sensor"
        text = f"camera: no hit in {share}: its counts are at least {self.dead / SENSOR_BLOCKS:.0%} low; calibrate it"
        return (CodedText(Code.CAMERA_DEAD_BLOCKS, text),)


def _block(index: NDArray[np.integer]) -> NDArray[np.integer]:
    """Blocks (N,) of pixels, row by row from the lowest."""
    blocks: NDArray[np.integer] = (index // SENSOR_PIXELS) // BLOCK_PIXELS * (
        SENSOR_PIXELS // BLOCK_PIXELS
    ) + index % SENSOR_PIXELS // BLOCK_PIXELS
    return blocks
