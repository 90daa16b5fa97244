"""Simplified PX4 autopilot for flights in lockstep: arming, takeoff, flight modes, landing, and failsafes.

It also handles requests as the driver on board does. Positions are the vehicle's own estimates in its local frame (ENU), as in
PX4. Like the driver (``radron.agent.vehicle.requests``), it does not repeat a fulfilled request after another mode was chosen,
not by the agent.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import dist

from radron.agent.config.mission import MissionConfig
from radron.agent.vehicle.interface import FlightMode, Request, VehicleCommand
from radron.sim.geometry import Array, Vector3
from radron.sim.vehicle.guidance import ARRIVED_M, BELOW_GROUND_M, Guidance, Reframing, Target, descent_mps, return_height_m

ARMING_S = 1.0
TAKEOFF_SPEED_MPS = 1.0
DESCENT_SPEED_MPS, LANDING_SPEED_MPS = 1.5, 0.7  # far above the ground, and near it (MPC_Z_V_AUTO_DN, MPC_LAND_SPEED)
RETURN_SPEED_MPS = 5.0
RETURN_CLIMB_MPS = 1.8  # mean over 10 m of a PX4's, which climbs at up to 3 m/s (MPC_Z_V_AUTO_UP) and slows down near the height
RETURN_HEIGHT_M = 10.0
DISARM_AFTER_S = 2.0
OFFBOARD_LOSS_S = 1.0
ACTS_AFTER_S = 5.0  # COM_FAIL_ACT_T: time in hold before the failsafe of an empty battery acts


class Autopilot:
    """Simulates the flight-mode logic of one vehicle's autopilot in fixed time steps.

    Set by faults: ``hears_requests``, ``hears_setpoints``: messages of this step arrive. ``refuses``: mode changes by the agent
    are refused. ``knows_position``: the filter's position is known.
    """

    def __init__(
        self,
        home: Vector3,
        yaw: float,
        step_s: float,
        return_height_m: float = RETURN_HEIGHT_M,
        *,
        has_home: bool = True,
        without_setpoints: FlightMode = FlightMode.RETURN,
    ) -> None:
        """Start on the ground at ``home``.

        ``return_height_m``: height of a return above home (PX4: RTL_RETURN_ALT); lower near home. ``has_home``: a PX4 without
        satellites has no home, and lands instead of a return; its preflight checks refuse a return as the reaction to lost
        setpoints. ``without_setpoints``: mode that is flown without setpoints (COM_OBL_RC_ACT).
        """
        self._highest_return_m, self._has_home = return_height_m, has_home
        self._return_height_m = return_height_m  # of this return
        self.mode = FlightMode.HOLD
        self.armed = False
        self.in_air = False
        self.failsafe = False
        self._without_setpoints = without_setpoints
        self._comes_down = False  # over home, still in return mode
        self._guidance = Guidance(home, yaw, step_s)
        self._position, self._velocity = home, (0.0, 0.0, 0.0)
        self._ground_m = home[2]
        self._step_s = step_s
        self._armed_for = 0.0
        self._landed_for = 0.0
        self._takeoff_height = 0.0
        self._setpoint_age = float("inf")
        self.hears_requests = self.hears_setpoints = self.knows_position = True
        self.refuses = False
        self._intended: FlightMode | None = None  # resumed after a failsafe
        self._request = Request.STAY
        self._yielded = False  # another mode was chosen since that request, not by the agent
        self._piloted = self._failed = False
        self._acts: tuple[FlightMode, float] | None = None  # mode of a battery failsafe, and the time of its begin

    @property
    def target(self) -> Target:
        """The target (position, velocity, heading) that the vehicle follows now."""
        return self._guidance.target

    @property
    def setpoint_age_s(self) -> float | None:
        """Age of the setpoint that the vehicle follows, seconds; None if it follows none."""
        return self._setpoint_age if self.mode is FlightMode.OFFBOARD else None

    @property
    def piloted(self) -> bool:
        """Whether a safety pilot flies by hand; the agent and the battery failsafe then have no effect."""
        return self._piloted

    @property
    def descends(self) -> bool:
        """Whether the vehicle descends to land, also at the end of a return."""
        return self.mode is FlightMode.LAND or self._comes_down

    @property
    def grounded(self) -> bool:
        """Whether the vehicle is on the ground with idling or stopped rotors."""
        return not self.armed or (self.mode is FlightMode.TAKEOFF and self._armed_for < ARMING_S)

    def command(self, command: VehicleCommand) -> None:
        """Apply the command that the agent has given in this time step."""
        setpoint = command.setpoint if self.hears_setpoints else None
        if setpoint is not None:
            self._setpoint_age = 0.0
        if self.hears_requests:
            self._ask(command, setpoint is not None)
        if self._intended is FlightMode.OFFBOARD and self.knows_position and setpoint is not None and not self._failed:
            self.failsafe, self._intended = False, None  # recovers without a request
            self._follow_setpoints()
        if self.mode is FlightMode.OFFBOARD and setpoint is not None:
            self._guidance.target = Target(
                setpoint.position_m, setpoint.velocity_mps, setpoint.yaw_rad, setpoint.acceleration_mps2, setpoint.yaw_rate_rps
            )

    def take_over(self, mode: FlightMode) -> None:
        """Begin a manual override: a safety pilot chooses a mode.

        In manual mode the pilot hovers, and the agent's requests have no effect.
        """
        if self.armed and not self._failed:
            self._piloted = mode is FlightMode.MANUAL
            self.in_air = self.in_air or self._armed_for > ARMING_S
            self._choose(mode)

    def give_back(self) -> None:
        """End the manual override: the vehicle holds, unless it is in a descent or a failsafe."""
        if self._piloted or (self._yielded and not (self.descends or self.failsafe)):
            self._piloted = False
            self._choose(FlightMode.HOLD)

    def fail(self) -> None:
        """Let the motors fail: the vehicle descends, is disarmed on the ground, and does not fly again."""
        self._failed, self._acts, self._intended = True, None, None
        if self.armed:
            self._switch(FlightMode.LAND)
        self.failsafe = True

    def save_battery(self, mode: FlightMode) -> None:
        """React to a nearly empty battery: fly this mode after some seconds in hold, unless another mode is chosen."""
        if self.armed and not self._failed and not self._piloted and self.mode not in (mode, FlightMode.LAND):
            waited = self.failsafe
            self._choose(mode if waited else FlightMode.HOLD)
            self._acts, self.failsafe = None if waited else (mode, ACTS_AFTER_S), True

    def reframe(self, frame: Reframing) -> None:
        """Adapt to a reported jump of the vehicle's local frame."""
        self._guidance.reframe(frame)

    def step(self, position: Vector3, ground_m: float | None = None, velocity: Vector3 = (0.0, 0.0, 0.0)) -> None:
        """Simulate the mode logic for one time step.

        ``position``, ``velocity``: the vehicle's own estimates; ``ground_m``: z of the ground below it (None: as at home), at
        which the rotors are unloaded.
        """
        self._position, self._velocity = position, velocity
        self._ground_m = self._guidance.home[2] if ground_m is None else ground_m
        self._setpoint_age += self._step_s
        self._armed_for = self._armed_for + self._step_s if self.armed else 0.0
        self._watch()
        if self.grounded:
            return
        if self.mode is FlightMode.TAKEOFF:
            self._climb(position)
        elif self.descends:
            self._descend(position)
        elif self.mode is FlightMode.RETURN:
            self._return_home()
        elif self.mode in (FlightMode.HOLD, FlightMode.MANUAL):
            self._guidance.hover()

    def _watch(self) -> None:
        """Check the failsafes: lost setpoints, lost position, battery. A lost-position failsafe ends with its cause."""
        if not self.armed or self._failed:
            return
        blind = not self.knows_position and self.in_air and self.mode is not FlightMode.MANUAL
        if blind and not (self.failsafe and self.mode is FlightMode.LAND):
            self._intended = self._intended or self.mode
            self._switch(FlightMode.LAND)
            self.failsafe = True
        elif self.mode is FlightMode.OFFBOARD and self._setpoint_age > OFFBOARD_LOSS_S:
            self._intended = FlightMode.OFFBOARD
            self._switch(self._without_setpoints)
            self.failsafe = True
        elif self.knows_position and self._intended not in (None, FlightMode.OFFBOARD):
            assert self._intended is not None
            self._switch(self._intended)
            self.failsafe, self._intended = False, None
        if self._acts is not None:
            mode, left_s = self._acts
            self._acts = (mode, left_s - self._step_s)
            if left_s <= 0.0:
                self._acts = None
                self._switch(mode)

    def _choose(self, mode: FlightMode) -> None:
        """Choose a mode, not by the agent."""
        self._yielded, self._intended, self._acts, self.failsafe = True, None, None, False
        self._switch(mode)

    def _ask(self, command: VehicleCommand, streaming: bool) -> None:
        """Handle the agent's request of a mode."""
        request = command.request
        if request is not self._request:
            self._request, self._yielded = request, False
        if self._yielded or self._piloted or self.refuses or self._failed:
            return
        fails = self._intended is not None  # the mode of a failsafe is not the requested one
        if request is Request.TAKEOFF:
            self._take_off(command.takeoff_height_m)
        elif request is Request.OFFBOARD and self.in_air and streaming:
            self._change(FlightMode.OFFBOARD)
        elif self.armed and request is Request.HOLD and self.in_air and (fails or self.mode is not FlightMode.HOLD):
            self._change(FlightMode.HOLD)
        elif self.armed and request is Request.RETURN and (fails or self.mode not in (FlightMode.RETURN, FlightMode.LAND)):
            self._change(FlightMode.RETURN)
        elif self.armed and request is Request.LAND and (fails or self.mode is not FlightMode.LAND):
            self._change(FlightMode.LAND)

    def _change(self, mode: FlightMode) -> None:
        """Change to a mode by request of the agent; modes that need a position are refused without a known one."""
        if not self.knows_position and mode is not FlightMode.LAND:
            return
        self._intended = self._acts = None
        self.failsafe = self.failsafe and not self.knows_position
        if mode is FlightMode.OFFBOARD:
            self._follow_setpoints()
        else:
            self._switch(mode)

    def _follow_setpoints(self) -> None:
        self.mode, self._comes_down = FlightMode.OFFBOARD, False

    def _switch(self, mode: FlightMode) -> None:
        """Change to an autonomous mode: it begins from the vehicle's position, not from the last setpoint."""
        if mode is FlightMode.RETURN and not self._has_home:
            mode = FlightMode.LAND
        self.mode, self._comes_down = mode, False
        if mode is FlightMode.RETURN:
            far_m = dist(self._position[:2], self._guidance.home[:2])
            self._return_height_m = return_height_m(self._highest_return_m, far_m)
        self._guidance.brake(self._position, self._velocity, back=mode is FlightMode.RETURN)

    def _take_off(self, height: float) -> None:
        if not self.armed:
            self.armed, self.mode = True, FlightMode.TAKEOFF
            self._takeoff_height = height
            self._landed_for = 0.0
            self._guidance.stay(self._guidance.home)

    def _climb(self, position: Vector3) -> None:
        self._guidance.climb(self._takeoff_height, TAKEOFF_SPEED_MPS)
        if position[2] > self._guidance.home[2] + self._takeoff_height - ARRIVED_M:
            self.mode, self.in_air = FlightMode.HOLD, True
            self._guidance.stay(self.target.position)

    def _return_home(self) -> None:
        """Fly the return; a PX4 stays in return mode until it is down."""
        if self._guidance.go_home(self._return_height_m, RETURN_CLIMB_MPS, RETURN_SPEED_MPS):
            self._comes_down = True

    def _descend(self, position: Vector3) -> None:
        if self._failed:
            self._guidance.stay(position)
        else:
            fastest_mps = DESCENT_SPEED_MPS if self.knows_position else LANDING_SPEED_MPS
            speed_mps = descent_mps(position[2] - self._ground_m, fastest_mps, LANDING_SPEED_MPS)
            self._guidance.descend(speed_mps, self._ground_m - self._guidance.home[2] - BELOW_GROUND_M)
        if position[2] < self._ground_m + ARRIVED_M:
            self._landed_for += self._step_s
            if self._landed_for > DISARM_AFTER_S:
                self.armed = self.in_air = False
                self.failsafe = self._failed
                self.mode, self._intended, self._acts = FlightMode.HOLD, None, None
                self._comes_down = False


def autopilots(mission: MissionConfig, homes: Iterable[Vector3], yaws: Array, step_s: float) -> list[Autopilot]:
    """Return the simulated autopilots of all drones of a mission.

    ``homes``: launch places in the drones' local frames. ``yaws``: (N,) headings of these frames in the mission frame, radians.
    """
    places = zip(homes, yaws.tolist(), mission.return_heights_m, mission.drones, strict=True)
    mode = FlightMode(mission.safety.agent_lost)
    return [
        Autopilot(home, -yaw, step_s, height_m, has_home=drone.localization != "slam", without_setpoints=mode)
        for home, yaw, height_m, drone in places
    ]
