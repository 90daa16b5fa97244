"""A simulated camera on the bench with a known source; its gain, drift time and orientation differ from the assumed ones."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from radron.agent.calibration.collection import Collection
from radron.agent.calibration.facing import Facing
from radron.agent.config.mission import DetectionConfig
from radron.agent.detector.files.calibration import Calibration
from radron.agent.detector.readout import Readout
from radron.agent.detector.spectroscopy.shapes import strongest_line_kev
from radron.sim.radiation.beam import BeamCamera
from radron.sim.radiation.camera import SourceView
from radron.sim.radiation.truth import CameraTruth

RPY_DEG = (90.0, 0.0, 90.0)  # of the drone file
FACINGS = [Facing(0.0, -10.0), Facing(60.0, 5.0), Facing(-50.0, 25.0)]
ACTIVITY_BQ, DISTANCE_M = 1e7, 0.5
_SLICE_NS = 2_000_000_000


@dataclass(frozen=True)
class BenchCamera:
    """The truth of one camera. gains: of its 16 blocks; turned_rad: rotation vector against the drone file, camera axes."""

    seed: int
    gains: NDArray[np.float64]
    drift_ns: float
    turned_rad: NDArray[np.float64]

    @classmethod
    def draw(cls, seed: int) -> "BenchCamera":
        """A camera at random."""
        rng = np.random.default_rng((seed, 49))
        gains = rng.normal(1.0, 0.05) * rng.normal(1.0, 0.02, 16)
        return cls(seed, gains, rng.uniform(72.0, 100.0), np.deg2rad(rng.normal(0.0, 5.0, 3)))

    def readouts(self, place: int, facing: Facing, seconds: float) -> list[Readout]:
        """Measurement at one facing."""
        mounted = Rotation.from_euler("xyz", RPY_DEG, degrees=True) * Rotation.from_rotvec(self.turned_rad)
        x, y, z = mounted.inv().apply(facing.direction).tolist()
        view = SourceView((x, y, z), DISTANCE_M, ACTIVITY_BQ)
        truth = CameraTruth(drift_ns=self.drift_ns)
        camera = BeamCamera(truth, "Cs-137", view, np.random.default_rng((self.seed, place)), 0)
        index = np.arange(65536)
        block = 4 * (index // 256 // 64) + index % 256 // 64
        camera.calibration.true_a[:] = camera.calibration.a * self.gains[block]
        edges = np.append(np.arange(0, round(seconds * 1e9), _SLICE_NS), round(seconds * 1e9))
        return [camera.expose(int(start), int(end)) for start, end in pairwise(edges)]

    def collected(self, seconds: float, calibration: Calibration | None = None) -> Collection:
        """Data of a calibration with this duration at each facing; its present ``calibration``: the nominal one."""
        present = calibration or Calibration.nominal()
        collection = Collection(present, "Cs-137", strongest_line_kev("Cs-137"), DetectionConfig())
        for place, facing in enumerate(FACINGS):
            collection.begin_facing()
            for readout in self.readouts(place, facing, seconds):
                collection.add(readout)
        collection.end_facing()
        return collection
