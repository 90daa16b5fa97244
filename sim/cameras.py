"""The drones' cameras: exposed slice by slice at their true poses, read out as one readout of several slices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from agent.config import DroneConfig
from agent.detector.readout import PixelHits, Readout
from sim.frame import CameraMount
from sim.radiation.camera import Camera, CameraTruth, SourceView
from sim.scenario import SourceTruth

Array = NDArray[np.float64]


class Motion(Protocol):
    """The true motion of N vehicles in the world (ENU)."""

    @property
    def position_m(self) -> Array:
        """(N, 3)."""

    @property
    def velocity_mps(self) -> Array:
        """(N, 3)."""

    def quaternion(self, drone: int) -> tuple[float, float, float, float]:
        """World-from-body attitude (w, x, y, z)."""


class Cameras:
    """One camera on each of N vehicles, all looking at one source."""

    def __init__(
        self,
        truth: CameraTruth,
        source: SourceTruth,
        drones: Sequence[DroneConfig],
        rngs: Sequence[np.random.Generator],
        clock_ns: int,
    ) -> None:
        """``drones``: how each carries its camera. ``clock_ns``: UTC time at which the cameras' clocks were reset."""
        self._activity_bq = source.activity_bq
        self._mounts = [CameraMount(drone.camera_rpy_deg) for drone in drones]
        self._cameras = [Camera(truth, source.nuclide, rng, clock_ns) for rng in rngs]
        self._exposed: list[list[Readout]] = [[] for _ in self._cameras]

    def expose(self, drone: int, start_ns: int, end_ns: int, motion: Motion, source: tuple[float, float] | None) -> None:
        """Take [start_ns, end_ns), UTC, all of it seen from where the vehicle is now; no source: background alone."""
        views: tuple[SourceView, ...] = ()
        if source is not None:
            place, attitude = motion.position_m[drone], motion.quaternion(drone)
            views = (self._mounts[drone].view(place, attitude, source, self._activity_bq),)
        self._exposed[drone].append(self._cameras[drone].expose(start_ns, end_ns, views))

    def read_out(self, drone: int) -> Readout:
        """What a camera saw since the last call; there must have been an exposure."""
        readout = _joined(self._exposed[drone])
        self._exposed[drone].clear()
        return readout

    def write_calibrations(self, folders: Sequence[Path]) -> None:
        """The files of each camera's own calibration, into its drone's folder."""
        for camera, folder in zip(self._cameras, folders, strict=True):
            camera.calibration.write(folder)


def _joined(readouts: Sequence[Readout]) -> Readout:
    """Consecutive readouts of one camera as one."""
    hits = PixelHits(
        np.concatenate([readout.hits.tick for readout in readouts]),
        np.concatenate([readout.hits.index for readout in readouts]),
        np.concatenate([readout.hits.tot for readout in readouts]),
    )
    first, last = readouts[0], readouts[-1]
    live_s, lost = sum(readout.live_time_s for readout in readouts), sum(readout.lost_hits for readout in readouts)
    return Readout(first.start_ns, last.end_ns, first.clock_ns, live_s, hits, lost)
