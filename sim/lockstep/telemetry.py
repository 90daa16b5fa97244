"""Telemetry of each vehicle in a simulated flight, with the errors of its localisation and its faults."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot

from radron.agent.pilot import Pilot
from radron.agent.vehicle.interface import VehicleState
from radron.sim.faults.onboard import OnboardFaults
from radron.sim.geometry import Vector3
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.vehicle.multirotor import GRAVITY_MPS2, Multirotors, attitude
from radron.sim.vehicle.px4.filter.deadreckoning import FilterErrors
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.terrain import Terrain


class Telemetry:
    """Makes the autopilots' estimates of their motion, and the telemetry that the agents receive.

    estimated_m, velocity_mps: estimates of each vehicle in its local frame, by the last ``tell``; the autopilots fly by them.
    told_s: time of each agent's last telemetry, since the start of the simulation.
    """

    def __init__(
        self,
        motion: Multirotors,
        errors: Localization | FilterErrors,
        frames: MovingFrames,
        terrain: Terrain,
        onboard: OnboardFaults,
        start_ns: int,
    ) -> None:
        """``start_ns``: UTC time at the start of the simulation."""
        self._motion, self._errors, self._frames = motion, errors, frames
        self._terrain, self._onboard, self._start_ns = terrain, onboard, start_ns
        self.estimated_m: list[Vector3] = frames.local(motion.position_m)
        self.told_s = [0.0] * len(motion.position_m)
        self.velocity_mps: list[Vector3] = [(0.0, 0.0, 0.0)] * len(motion.position_m)

    def tell(self, now_ns: int, pilots: Sequence[Pilot], autopilots: Sequence[Autopilot]) -> None:
        """Estimate the vehicles' states, and pass each to its pilot unless the link is down."""
        motion, error, frames, onboard = self._motion, self._errors, self._frames, self._onboard
        self.estimated_m = frames.local(motion.position_m + error.position_error_m)
        self.velocity_mps = frames.turn(motion.velocity_mps + error.velocity_error_mps)
        # An attitude error acts like another thrust.
        thrusts = frames.turn(motion.thrust_mps2 + GRAVITY_MPS2 * error.tilt_error)
        yaws = (motion.yaw_rad + error.yaw_error_rad - frames.yaw_rad).tolist()
        heights = (self._terrain.above_ground(motion.position_m)[:, 2] + error.height_error_m).tolist()
        epochs, told_m = frames.epoch, frames.told_m
        for drone, (pilot, autopilot) in enumerate(zip(pilots, autopilots, strict=True)):
            if not onboard.vehicles.hears(drone):
                continue
            self.told_s[drone] = (now_ns - self._start_ns) * 1e-9
            pilot.observe_vehicle(
                VehicleState(
                    stamp_ns=onboard.clocks.own_ns(drone, now_ns),
                    epoch=epochs[drone],
                    position_m=self.estimated_m[drone],
                    velocity_mps=self.velocity_mps[drone],
                    quaternion=attitude(yaws[drone], *thrusts[drone]),
                    height_m=heights[drone],
                    position_sigma_m=onboard.poses.sigma_m(drone, hypot(error.position_sigma_m[0], told_m[drone])),
                    yaw_sigma_rad=error.yaw_sigma_rad,
                    mode=autopilot.mode,
                    armed=autopilot.armed,
                    in_air=autopilot.in_air,
                    healthy=not autopilot.failsafe,
                    battery=onboard.vehicles.battery(drone),
                    position_trusted=onboard.poses.trusted(drone),
                    aided=onboard.poses.aided(drone),
                    axes_fixed=onboard.poses.axes_fixed(drone),
                )
            )
