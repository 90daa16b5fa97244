"""Emulation of PX4's trajectories: the target of an airborne vehicle in each flight mode."""

from __future__ import annotations

from math import dist, isfinite, nan

from radron.sim.geometry import Vector3
from radron.sim.vehicle.guidance import Guidance, Target, descent_mps, return_height_m
from radron.sim.vehicle.px4.landing import RAMP_S
from radron.sim.vehicle.px4.mavlink.setpoint import OffboardTarget
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters

CLIMB_MPS2 = 0.6  # acceleration of a takeoff after lift-off
AGAINST_DRAG = 0.87  # reached share of MPC_TKO_SPEED and MPC_XY_CRUISE
LIFTS_M = 0.1  # a target this far above makes a standing vehicle lift off
# A return slows down well before its end: speed by distance, in 1/s, the least speed, and the distance that is close enough.
UP_PS, UP_MPS, UP_NEAR_M = 0.62, 0.1, 0.45
UP_DELAY_S, UP_MPS2 = 1.2, 2.0
ACROSS_PS, ACROSS_MPS, ACROSS_NEAR_M = 0.55, 0.55, 2.0
CRAWL_BELOW_M, CRAWL_MPS = 0.8, 0.28
DEEP_M = -1000.0  # a descent ends at the ground, at any depth
FALL_MPS2 = 100.0  # beyond free fall at zero thrust


class Steering:
    """Moves one vehicle's target as PX4 does in each flight mode; local frame ENU.

    landing: on the last leg, down to the ground. takeoff_m, return_m: heights of a takeoff and a return above home. offboard: the
    latest target from a companion computer.
    """

    def __init__(self, parameters: Parameters, guidance: Guidance, step_s: float) -> None:
        self.guidance = guidance
        self.landing = False
        self.takeoff_m = 0.0
        self.return_m = 0.0
        self.offboard: OffboardTarget | None = None
        self._parameters, self._step_s = parameters, step_s
        self._climb_from_m = 0.0  # above home
        self._flown_s = 0.0  # in this mode
        self._up = False  # on its return

    @property
    def target(self) -> Target:
        """The target that the vehicle flies to now; if its position is NaN, only the velocity counts."""
        return self.guidance.target

    def begin(
        self,
        mode: Mode,
        position: Vector3,
        velocity: Vector3,
        acceleration: Vector3,
        *,
        standing: bool,
        back: bool = False,
    ) -> None:
        """Begin another flight mode; autonomous modes begin from the vehicle's present motion.

        ``back``: after braking the vehicle flies back to its present place, as always before a return. ``standing``: it is on the
        ground.
        """
        self.landing = mode is Mode.LAND
        self._flown_s = 0.0
        if mode in (Mode.HOLD, Mode.LAND, Mode.RETURN):
            self.guidance.brake(position, velocity, acceleration, back=back or mode is Mode.RETURN)
        else:
            self.guidance.stay(position)
        if mode is Mode.TAKEOFF:
            self._climb_from_m = 0.0 if standing else position[2] - self.guidance.home[2]
        if mode is Mode.RETURN:
            self.return_m, self._up = self._return_height(position), False

    def wants_up(self, mode: Mode, position: Vector3) -> bool:
        """Return whether a standing vehicle has a target above it."""
        if mode is not Mode.OFFBOARD or self.offboard is None:
            return mode is Mode.TAKEOFF
        up = self.offboard.position_m[2]
        return up > position[2] + LIFTS_M if isfinite(up) else self.offboard.velocity_mps[2] > 0.0

    def wants_down(self, mode: Mode, position: Vector3) -> bool:
        """Return whether the target leads below the vehicle's estimated position."""
        if mode is Mode.OFFBOARD and self.offboard is not None:
            up = self.offboard.position_m[2]
            return up < position[2] if isfinite(up) else self.offboard.velocity_mps[2] < 0.0
        return self.landing or mode is Mode.DESCEND

    def commanded_to_sink(self, mode: Mode) -> bool:
        """Return whether a commanded descent is one that the land detector expects of a landing.

        Of two recorded offboard landings, a landing by velocity only was noticed; a landing to a position below the ground never
        was.
        """
        if mode is Mode.OFFBOARD and self.offboard is not None:
            return self.offboard.velocity_mps[2] < 0.0 and not isfinite(self.offboard.position_m[2])
        return self.landing or mode is Mode.DESCEND

    def fly(self, mode: Mode, position: Vector3, velocity: Vector3, climbing_s: float) -> bool:
        """Move the target for one time step; return True once a takeoff is complete.

        ``climbing_s``: time since the takeoff began.
        """
        self._flown_s += self._step_s
        if mode is Mode.TAKEOFF:
            return self._climb(position, climbing_s)
        if mode is Mode.OFFBOARD and self.offboard is not None:
            self._obey(self.offboard)
        elif mode is Mode.HOLD:
            self.guidance.hover()
        elif mode is Mode.RETURN:
            self._return(position)
        elif mode is Mode.LAND:
            self._land(position)
        elif mode is Mode.DESCEND:
            self._descend(velocity)
        return False

    def end_takeoff(self) -> None:
        """Stop the target at the height of a takeoff, which ends slightly before the vehicle reaches it."""
        (x, y, _), top_m = self.guidance.target.position, self._climb_from_m + self.takeoff_m
        self.guidance.stay((x, y, self.guidance.home[2] + top_m))

    def fall(self, position: Vector3) -> None:
        """Let the vehicle fall, as the rotors were stopped in the air."""
        x, y, _ = position
        self.guidance.target = Target((x, y, nan), (0.0, 0.0, 0.0), self.target.yaw, (0.0, 0.0, -FALL_MPS2))

    def _climb(self, position: Vector3, climbing_s: float) -> bool:
        top_m = self._climb_from_m + self.takeoff_m
        fastest = AGAINST_DRAG * self._parameters["MPC_TKO_SPEED"]
        self.guidance.climb(top_m, max(0.0, min(CLIMB_MPS2 * (climbing_s - RAMP_S), fastest)))
        return position[2] > self.guidance.home[2] + top_m - self._parameters["NAV_MC_ALT_RAD"]

    def _return(self, position: Vector3) -> None:
        value, home = self._parameters, self.guidance.home
        place = self.guidance.target.position
        far, low = dist(place[:2], home[:2]), self.return_m - (place[2] - home[2])
        self._up = self._up or position[2] - home[2] > self.return_m - UP_NEAR_M
        if self.landing:
            self._land(position)
        elif not self._up:
            begun = UP_MPS2 * max(0.0, self._flown_s - UP_DELAY_S)
            self.guidance.climb(self.return_m, min(UP_MPS + UP_PS * max(low, 0.0), value["MPC_Z_V_AUTO_UP"], begun))
        elif far > ACROSS_NEAR_M:
            fastest = AGAINST_DRAG * value["MPC_XY_CRUISE"]
            self.guidance.go_home(place[2] - home[2], 0.0, min(ACROSS_MPS + ACROSS_PS * far, fastest))
        else:
            descended_m = value["RTL_DESCEND_ALT"]
            self.guidance.stay((home[0], home[1], place[2]))
            self.guidance.descend(value["MPC_Z_V_AUTO_DN"], min(descended_m, position[2] - home[2]))
            if position[2] - home[2] < descended_m + UP_NEAR_M:
                self.landing = value["RTL_LAND_DELAY"] >= 0.0

    def _return_height(self, position: Vector3) -> float:
        """Height of a return: lower near home, within a cone about it."""
        value, home = self._parameters, self.guidance.home
        far, within_m, angle_deg = dist(position[:2], home[:2]), value["RTL_MIN_DIST"], value["RTL_CONE_ANG"]
        height_m = return_height_m(value["RTL_RETURN_ALT"], far, within_m=within_m, angle_deg=angle_deg)
        return max(height_m, position[2] - home[2])

    def _descend(self, velocity: Vector3) -> None:
        """Descend. Without a position it only keeps level, and keeps its horizontal speed."""
        vx, vy, _ = velocity
        self.guidance.descend(self._parameters["MPC_LAND_SPEED"], DEEP_M)
        target = self.guidance.target
        self.guidance.target = Target((nan, nan, target.position[2]), (vx, vy, target.velocity[2]), target.yaw)

    def _land(self, position: Vector3) -> None:
        value, height_m = self._parameters, position[2] - self.guidance.home[2]
        speed = descent_mps(height_m, value["MPC_Z_V_AUTO_DN"], value["MPC_LAND_SPEED"])
        self.guidance.descend(CRAWL_MPS if height_m < CRAWL_BELOW_M else speed, DEEP_M)

    def _obey(self, asked: OffboardTarget) -> None:
        """Follow an offboard target. Missing values are 0, except positions, and the heading: it is kept, or free while
        yawing.
        """
        yaw, yaw_rate = asked.yaw_rad, asked.yaw_rate_rps
        if not isfinite(yaw_rate):
            yaw, yaw_rate = yaw if isfinite(yaw) else self.target.yaw, 0.0
        x, y, z = (
            p if isfinite(p) or isfinite(v) else now
            for p, v, now in zip(asked.position_m, asked.velocity_mps, self.target.position, strict=True)
        )
        velocity, acceleration = _given(asked.velocity_mps), _given(asked.acceleration_mps2)
        self.guidance.target = Target((x, y, z), velocity, yaw, acceleration, yaw_rate)


def _given(vector: Vector3) -> Vector3:
    x, y, z = (part if isfinite(part) else 0.0 for part in vector)
    return x, y, z
