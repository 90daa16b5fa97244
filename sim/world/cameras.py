"""The cameras of all simulated drones, exposed in short time slices at their true poses; a readout joins several slices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig
from radron.agent.detector.readout import PixelHits, Readout
from radron.sim.geometry import Array
from radron.sim.radiation.calibration import PixelCalibration
from radron.sim.radiation.camera import Camera, SourceView
from radron.sim.radiation.crystal.emulated import Ordinary
from radron.sim.radiation.ground.area import AreaPose
from radron.sim.radiation.ground.materials import concrete_per
from radron.sim.scenario import Scenario
from radron.sim.world.contamination import contaminated_ground
from radron.sim.world.frame import CameraMount
from radron.sim.world.owncameras import OwnCamera, drone_file
from radron.sim.world.sources import Source
from radron.sim.world.streams import Streams
from radron.sim.world.terrain import CONCRETE_PER_SOIL, Terrain
from radron.sim.world.walls import Walls

_SAME = OwnCamera()
_ANY = "Cs-137"  # the nuclide of cameras that measure the background only, without a nuclide in the mission


class Motion(Protocol):
    """True motion of N vehicles in the world frame (east, north, up)."""

    @property
    def position_m(self) -> Array:
        """(N, 3) true positions, metres."""

    @property
    def velocity_mps(self) -> Array:
        """(N, 3) true velocities, m/s."""

    def quaternion(self, drone: int) -> tuple[float, float, float, float]:
        """Return the true attitude of a vehicle, which rotates from the body to the world frame (w, x, y, z)."""


class Cameras:
    """The simulated cameras of N vehicles, one each.

    All are exposed to the scenario's sources, through its walls, and to its contaminated ground, or to the background alone.
    """

    def __init__(
        self,
        scenario: Scenario,
        nuclides: Sequence[str],
        drones: Sequence[DroneConfig],
        random: Streams,
        clock_ns: int,
    ) -> None:
        """``nuclides``: nuclides of the sources, each once. ``drones``: mounting of each camera, except in ``scenario.cameras``.
        ``random``: random streams of the flight. ``clock_ns``: UTC time at which the cameras' clocks were reset.
        """
        areas = [part.source for part in contaminated_ground(scenario, random)]
        emitted = tuple(dict.fromkeys([*nuclides, *(area.nuclide for area in areas)])) or (scenario.mission.one_nuclide or _ANY,)
        self._walls = Walls(scenario.walls) if scenario.walls else None
        self._terrain = Terrain(scenario.terrain)
        ground = None if scenario.ground is None else scenario.ground.drawn(random.ground)
        self._scenario = scenario
        own = [scenario.cameras.get(drone.id, _SAME) for drone in drones]
        self._mounts = [CameraMount(one.mounting(drone.camera_rpy_deg)) for one, drone in zip(own, drones, strict=True)]
        self._cameras: list[Camera | Ordinary] = []
        for drone, one, rng in zip(drones, own, random.cameras, strict=True):
            ordinary = scenario.ordinary.get(drone.id)
            if ordinary is None or ground is None:
                self._cameras.append(Camera(one.of(scenario.camera), emitted, rng, clock_ns, ground, areas))
            else:
                self._cameras.append(Ordinary(ordinary, emitted, rng, clock_ns, ground, areas))
        self._is_contaminated = bool(areas)
        self._depth_m = 0.0 if ground is None else ground.depth_m
        self._concrete_per_ground = 0.0 if ground is None else concrete_per(ground.kind)
        self._exposed: list[list[Readout]] = [[] for _ in self._cameras]

    def expose(self, drone: int, start_ns: int, end_ns: int, motion: Motion, sources: Sequence[Source]) -> None:
        """Expose a drone's camera from ``start_ns`` until before ``end_ns`` (UTC), at the vehicle's present pose.

        Without a source the camera sees the background alone.
        """
        views = [self._view(drone, motion, source) for source in sources]
        x, y, z = motion.position_m[drone].tolist()
        height_m = z - self._terrain.height_m(x, y)
        pose = None
        if self._is_contaminated:
            pose = AreaPose(np.array((x, y, height_m)), self._mounts[drone].camera_from_world(motion.quaternion(drone)))
        self._exposed[drone].append(self._cameras[drone].expose(start_ns, end_ns, views, height_m, pose))

    def _view(self, drone: int, motion: Motion, source: Source) -> SourceView:
        place = motion.position_m[drone]
        view = self._mounts[drone].view(place, motion.quaternion(drone), source.place_m, source.activity_bq)
        x, y, z = source.place_m
        ground_m = self._terrain.height_m(x, y)
        camera_m, source_m = float(place[2]) - ground_m, z - ground_m
        concrete_m = self._concrete_m(place, np.array(source.place_m))
        if self._depth_m > 0.0 and source_m == 0.0 and camera_m > 0.0:
            concrete_m += self._concrete_per_ground * self._depth_m * view.distance_m / camera_m
        return replace(view, concrete_m=concrete_m, nuclide=source.nuclide, camera_m=camera_m, source_m=source_m)

    def _concrete_m(self, place: Array, source: Array) -> float:
        """Return the length of concrete between camera and source (3,), plus the concrete equivalent of the ground between
        them.
        """
        soil_m = CONCRETE_PER_SOIL * self._terrain.soil_m(place, source)
        return soil_m if self._walls is None else soil_m + self._walls.concrete_m(place, source)

    def read_out(self, drone: int) -> Readout:
        """Return all exposures of a drone's camera since the last call as one readout; there must have been one."""
        slices, self._exposed[drone] = self._exposed[drone], []
        first, last = slices[0], slices[-1]
        live_s, lost = sum(part.live_time_s for part in slices), sum(part.lost_hits for part in slices)
        hits = PixelHits.joined(part.hits for part in slices)
        parts = [part.counts for part in slices if part.counts is not None]
        counts = np.sum(parts, axis=0) if parts else None
        return Readout(first.start_ns, last.end_ns, first.clock_ns, live_s, hits, lost, counts=counts)

    @property
    def calibrations(self) -> dict[int, PixelCalibration]:
        """True energy calibration of each camera, by the drone's index; ordinary detectors have none."""
        return {drone: camera.calibration for drone, camera in enumerate(self._cameras) if isinstance(camera, Camera)}

    def calibrated(self, drones: Sequence[DroneConfig], folder: Path) -> list[DroneConfig]:
        """Return the drones' configurations with the energy calibration of each camera.

        Where the scenario prescribes a calibration, it is taken (``scenario.cameras``). If the pixels of the cameras differ, each
        camera's own calibration is written into ``folder``.
        """
        if self._scenario.camera.calibration_spread > 0.0:
            folders = [folder / drone.id for drone in drones]
            self.write_calibrations(folders)
            drones = [replace(drone, calibration=str(own)) for drone, own in zip(drones, folders, strict=True)]
        return [drone_file(drone, self._scenario.cameras) for drone in drones]

    def write_calibrations(self, folders: Sequence[Path]) -> None:
        """Write the calibration files of each camera into the folder of its drone."""
        for drone, calibration in self.calibrations.items():
            calibration.write(folders[drone])
