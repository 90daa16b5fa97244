"""What an airborne vehicle is to follow in each of PX4's modes."""

from __future__ import annotations

from math import hypot, isfinite

from agent.vehicle.interface import Vector3
from sim.vehicle.guidance import ARRIVED_M, Guidance, Target
from sim.vehicle.px4.modes import Mode
from sim.vehicle.px4.parameters import Parameters
from sim.vehicle.px4.setpoint import OffboardTarget

TAKEOFF_MPS = 0.6  # to 5 m within 10 s of arming
CRAWL_BELOW_M, CRAWL_MPS = 1.0, 0.3
DEEP_M = -1000.0  # a descent ends at the ground, wherever that is
FALL_MPS = 10.0
DRAG, TRIM_S = 0.2, 20.0  # of velocity targets: on a circle of 12 m at 3 m/s a real one flies 2.6 m too small


class Steering:
    """Moves one vehicle's target, by its mode and the parameters; local frame ENU.

    landing: on the last leg, down to the ground. takeoff_m: how high a takeoff goes, above home. offboard: the newest target.
    """

    def __init__(self, parameters: Parameters, guidance: Guidance, step_s: float) -> None:
        self.guidance = guidance
        self.landing = False
        self.takeoff_m = 0.0
        self.offboard: OffboardTarget | None = None
        self._parameters = parameters
        self._step_s = step_s
        self._trim_mps = (0.0, 0.0)

    @property
    def target(self) -> Target:
        """What the vehicle is to follow now; where the position is NaN only the velocity counts."""
        return self.guidance.target

    def begin(self, mode: Mode, position: Vector3) -> None:
        """Fly another mode from now on; those of the autopilot's own begin from where the vehicle is."""
        self.landing = mode is Mode.LAND
        self.guidance.stay(position)

    def wants_up(self, mode: Mode, position: Vector3) -> bool:
        """Whether a standing vehicle has something to climb to."""
        if mode is not Mode.OFFBOARD or self.offboard is None:
            return mode is Mode.TAKEOFF
        up = self.offboard.position_m[2]
        return up > position[2] + ARRIVED_M if isfinite(up) else self.offboard.velocity_mps[2] > 0.0

    def fly(self, mode: Mode, position: Vector3) -> bool:
        """Move the target by one step; True once a takeoff has come to its end."""
        if mode is Mode.TAKEOFF:
            return self._climb(position)
        if mode is Mode.OFFBOARD and self.offboard is not None:
            self._obey(self.offboard, position)
        elif mode is Mode.RETURN:
            self._return(position)
        elif mode is Mode.LAND:
            self._land(position)
        return False

    def fall(self, position: Vector3) -> None:
        """Rotors stopped in the air."""
        x, y, _ = position
        self.guidance.target = Target((x, y, float("nan")), (0.0, 0.0, -FALL_MPS), self.target.yaw)

    def _climb(self, position: Vector3) -> bool:
        self.guidance.climb(self.takeoff_m, TAKEOFF_MPS)
        return position[2] > self.guidance.home[2] + self.takeoff_m - ARRIVED_M

    def _return(self, position: Vector3) -> None:
        value = self._parameters
        if self.landing:
            self._land(position)
        elif self.guidance.go_home(value["RTL_RETURN_ALT"], value["MPC_Z_V_AUTO_UP"], value["MPC_XY_CRUISE"]):
            descended_m = value["RTL_DESCEND_ALT"]
            self.guidance.descend(value["MPC_Z_V_AUTO_DN"], min(descended_m, position[2] - self.guidance.home[2]))
            if position[2] - self.guidance.home[2] < descended_m + ARRIVED_M:
                self.landing = value["RTL_LAND_DELAY"] >= 0.0

    def _land(self, position: Vector3) -> None:
        low = position[2] - self.guidance.home[2] < CRAWL_BELOW_M
        self.guidance.descend(CRAWL_MPS if low else self._parameters["MPC_LAND_SPEED"], DEEP_M)

    def _obey(self, asked: OffboardTarget, position: Vector3) -> None:
        yaw = self.target.yaw
        if isfinite(asked.yaw_rad):
            yaw = asked.yaw_rad
        elif isfinite(asked.yaw_rate_rps):
            yaw += asked.yaw_rate_rps * self._step_s
        vx, vy, vz = (v if isfinite(v) else 0.0 for v in asked.velocity_mps)
        vx, vy = self._against_drag(vx, vy, steered=isfinite(asked.position_m[0]))
        x, y, z = (
            p if isfinite(p) or isfinite(v) else now
            for p, v, now in zip(asked.position_m, asked.velocity_mps, self.target.position, strict=True)
        )
        self.guidance.target = Target(self._within_reach((x, y, z), position), (vx, vy, vz), yaw)

    def _against_drag(self, vx: float, vy: float, steered: bool) -> tuple[float, float]:
        """Without a position to keep, the velocity falls short until the integrator has made up for the drag."""
        if steered:
            self._trim_mps = (vx, vy)
            return vx, vy
        share = self._step_s / TRIM_S
        tx, ty = self._trim_mps
        self._trim_mps = (tx + share * (vx - tx), ty + share * (vy - ty))
        return vx - DRAG * (vx - tx), vy - DRAG * (vy - ty)

    def _within_reach(self, wanted: Vector3, position: Vector3) -> Vector3:
        """The point on the way to ``wanted`` that asks for no more than the highest speeds; PX4 limits these themselves."""
        value, (x0, y0, z0) = self._parameters, position
        dx, dy, dz = wanted[0] - x0, wanted[1] - y0, wanted[2] - z0
        far = hypot(dx, dy) * value["MPC_XY_P"] / value["MPC_XY_VEL_MAX"]
        if far > 1.0:  # not where a coordinate is NaN
            dx, dy = dx / far, dy / far
        if isfinite(dz):
            gain = value["MPC_Z_P"]
            dz = max(-value["MPC_Z_VEL_MAX_DN"] / gain, min(dz, value["MPC_Z_VEL_MAX_UP"] / gain))
        return (x0 + dx, y0 + dy, z0 + dz)
