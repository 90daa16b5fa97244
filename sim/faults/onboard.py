"""All faults of cameras, clocks, positions and vehicles of a flight in lockstep."""

from __future__ import annotations

from collections.abc import Sequence

from radron.agent.detector.readout import Readout
from radron.sim.faults.cameras import CameraFaults
from radron.sim.faults.clocks import ClockFaults
from radron.sim.faults.poses import PoseFaults
from radron.sim.faults.schedule import Schedule
from radron.sim.faults.vehicles import VehicleFaults
from radron.sim.radiation.truth import CameraTruth
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.vehicle.multirotor import Multirotors
from radron.sim.vehicle.px4.filter.deadreckoning import FilterErrors
from radron.sim.world.cameras import Cameras
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import MovingFrames


class OnboardFaults:
    """Plays all faults of cameras, clocks, positions and vehicles in a simulated flight (lockstep: all in one process)."""

    def __init__(
        self,
        schedule: Schedule,
        start_ns: int,
        step_s: float,
        frames: MovingFrames,
        errors: Localization | FilterErrors,
        motion: Multirotors,
        autopilots: Sequence[Autopilot],
        cameras: tuple[CameraTruth, Cameras | None],
    ) -> None:
        """``start_ns``: UTC time at the start of the simulation."""
        self.clocks = ClockFaults(schedule, start_ns)
        self.poses = PoseFaults(schedule, frames, errors, autopilots, step_s)
        self.vehicles = VehicleFaults(schedule, autopilots, motion, step_s)
        truth, read = cameras
        self._cameras = CameraFaults(schedule, truth, {} if read is None else read.calibrations)

    def readout(self, drone: int, readout: Readout) -> Readout | None:
        """Return a camera readout as the agent gets it, after faults of camera and clock; None if the camera delivers nothing."""
        spoilt = self._cameras.spoil(drone, readout)
        return None if spoilt is None else self.clocks.restamped(drone, spoilt)
