"""Energy calibration of the simulated camera: true conversion of energy to time over threshold, and the files for the agent."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radron.agent.detector.readout import SENSOR_PIXELS
from radron.sim.radiation.truth import CameraTruth

FloatArray = NDArray[np.float64]

# A typical Timepix3 pixel: ToT = a E + b - c / (E - t), ToT in 25 ns counts, E in keV.
NOMINAL_A, NOMINAL_B, NOMINAL_C, NOMINAL_T = 1.6, 24.0, 60.0, 1.8
MAX_TOT = 1022  # the counter's 10 bits saturate


@dataclass(frozen=True, slots=True)
class PixelCalibration:
    """Energy calibration of every pixel of a simulated camera: coefficients of ToT = a E + b - c / (E - t).

    Each array has 65,536 values, by matrix index. ``a`` is the slope in the calibration files, which the agent reads; ``true_a``
    is the pixel's true slope.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    t: FloatArray
    true_a: FloatArray

    @classmethod
    def draw(cls, truth: CameraTruth, rng: np.random.Generator) -> PixelCalibration:
        """Draw the calibration of a camera at random, with the spread, error and gain given in ``truth``.

        ``rng`` is only used for the spread and the error, if they are not zero. The gain is drawn from a random stream that is
        split off from ``rng``.
        """
        count = SENSOR_PIXELS**2

        def vary(nominal: float, spread: float) -> FloatArray:
            return np.full(count, nominal) if spread == 0.0 else nominal * (1.0 + spread * rng.standard_normal(count).clip(-4, 4))

        a, b, c, t = (vary(value, truth.calibration_spread) for value in (NOMINAL_A, NOMINAL_B, NOMINAL_C, NOMINAL_T))
        gain = np.exp(truth.energy_gain_spread * rng.spawn(1)[0].standard_normal())
        return cls(a, b, c, t, a * vary(1.0, truth.calibration_error) * gain)

    def write(self, folder: Path) -> None:
        """Write the agent's calibration files a.txt, b.txt, c.txt and t.txt.

        Each has 256 lines of 256 numbers, the lowest row of pixels first.
        """
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("a", "b", "c", "t"):
            np.savetxt(folder / f"{name}.txt", getattr(self, name).reshape(SENSOR_PIXELS, SENSOR_PIXELS), fmt="%.6g")
