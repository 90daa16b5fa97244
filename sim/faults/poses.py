"""Faults of the vehicles' own poses: satellites lost, jumps, heading resets, and spoofed satellites. The vehicles fly by
their estimates.

A spoofed position and a jump move the vehicle's local frame (``radron.sim.world.movingframes``); without satellites the errors of
its filter grow, as those of a real PX4 (``radron.sim.vehicle.px4.filter.deadreckoning``).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, pi, radians, sin

import numpy as np

from radron.sim.faults.base import Fault
from radron.sim.faults.machines import Drag, HeadingReset, PositionJump, SatellitesLost
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.geometry import Array
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.vehicle.px4.filter.deadreckoning import DeadReckoning, FilterErrors
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.world.localization import Localization
from radron.sim.world.movingframes import Jump, MovingFrames, Reset

RECEIVER_PERIOD_S = 0.2  # five messages of the receiver a second
CONFIRM_S = 3.0  # of healthy status until the driver trusts a position again
_DRIFT_MPS, _DRIFT_MPS2 = 0.6, 0.25  # the driver's bound of the drift
PARAMETERS = {"EKF2_NOAID_TOUT": 2_000_000.0}  # as preflight requires


def with_filter_errors(faults: Sequence[Fault], small: Localization, step_s: float) -> Localization | FilterErrors:
    """Return the simulated errors of the vehicles' filters, with the faults that the scenario needs.

    For flights without lost satellites and heading resets these are the small errors alone.
    """
    grow = any(isinstance(fault, SatellitesLost | HeadingReset) for fault in faults)
    return FilterErrors(small, step_s) if grow else small


class _Doubt:
    """The driver's trust in one vehicle's position, from its receiver and its filter's status."""

    def __init__(self) -> None:
        self.blind_s = 0.0  # since satellites were lost, until the position is confirmed
        self.trusted = True
        self._well_s = CONFIRM_S
        self._missing_s = 0.0

    @property
    def aided(self) -> bool:
        """Return whether satellites are received, or were lost too recently to be noticed."""
        return self._missing_s < RECEIVER_PERIOD_S

    def jumped(self) -> None:
        """Note a jump of the position, which needs confirmation; with satellites received, the drift ends."""
        self._well_s, self.trusted = 0.0, False
        if self.aided:
            self.blind_s = 0.0

    def step(self, aided: bool, known: bool, step_s: float) -> None:
        """Advance one step. ``aided``: by satellites; ``known``: the filter reports a known position."""
        self._missing_s = 0.0 if aided else self._missing_s + step_s
        well = known and self.aided
        self._well_s = self._well_s + step_s if well else 0.0
        self.trusted = self._well_s >= CONFIRM_S
        if self.trusted:
            self.blind_s = 0.0
        elif not well:
            self.blind_s += step_s


class PoseFaults:
    """Plays all faults of the vehicles' own position estimates in a simulated flight."""

    def __init__(
        self,
        schedule: Schedule,
        frames: MovingFrames,
        errors: Localization | FilterErrors,
        autopilots: Sequence[Autopilot],
        step_s: float,
    ) -> None:
        self._schedule, self._frames, self._errors = schedule, frames, errors
        self._autopilots, self._step_s = autopilots, step_s
        self._turns = any(isinstance(fault, PositionJump) and fault.turn_deg > 0.0 for fault in schedule.faults)
        self._reckonings: dict[int, DeadReckoning] = {}  # of vehicles that have lost their satellites
        self._doubts: dict[int, _Doubt] = {}
        self._jumps: dict[tuple[Active, int], Jump] = {}
        self._courses: dict[tuple[Active, int], Array] = {}  # of spoofed vehicles: direction (3,)
        self._dragged_m: dict[tuple[Active, int], float] = {}

    def trusted(self, drone: int) -> bool:
        """Return whether a vehicle's driver (the agent's interface to the autopilot) trusts the position."""
        doubt = self._doubts.get(drone)
        return doubt is None or doubt.trusted

    def aided(self, drone: int) -> bool:
        """Return whether a vehicle's driver receives satellites; True for a vehicle that flies without them."""
        doubt = self._doubts.get(drone)
        return doubt is None or doubt.aided

    def axes_fixed(self, drone: int) -> bool:
        """Return whether a vehicle's local frame cannot turn: it flies by satellites, and no fault of this flight turns it."""
        return self._frames.flies_by_satellites(drone) and not self._turns

    def sigma_m(self, drone: int, usual_m: float) -> float:
        """Return the 1-sigma error of a vehicle's horizontal position as its driver reports it, metres."""
        doubt, reckoning = self._doubts.get(drone), self._reckonings.get(drone)
        if doubt is None:
            return usual_m
        bound_m = _DRIFT_MPS * doubt.blind_s + _DRIFT_MPS2 * doubt.blind_s**2
        return hypot(usual_m, 0.0 if reckoning is None else reckoning.reported_sigma_m) + bound_m

    def step(self) -> None:
        """Play the faults of one time step, before the local frames are simulated."""
        schedule = self._schedule
        schedule.dispatch(self._begin, self._end)
        for fault, one in schedule.active(Drag):
            for drone in sorted(one.drones):
                self._drag(fault, one, drone)
        for drone, reckoning in self._reckonings.items():
            self._reckon(drone, reckoning)
        for drone, doubt in self._doubts.items():
            known = self._reckonings[drone].known if drone in self._reckonings else True
            doubt.step(not self._is_blind(drone), known, self._step_s)

    def _begin(self, one: Active, drone: int) -> None:
        fault, rng = one.fault, one.rng
        if isinstance(fault, PositionJump):
            turn_rad = radians(fault.turn_deg) * float(rng.choice((-1.0, 1.0)))
            jump = Jump(fault.jump_m * _direction(rng), turn_rad, fault.announced)
            self._jumps[one, drone] = jump
            self._jump(drone, jump)
        elif isinstance(fault, HeadingReset):
            if self._frames.flies_by_satellites(drone):
                assert isinstance(self._errors, FilterErrors)
                self._errors.turn(drone, radians(fault.turn_deg) * float(rng.choice((-1.0, 1.0))))
        elif isinstance(fault, Drag):
            self._courses[one, drone], self._dragged_m[one, drone] = _direction(rng), 0.0
        elif isinstance(fault, SatellitesLost) and self._frames.flies_by_satellites(drone):
            self._frames.block(drone, True)
            self._doubts.setdefault(drone, _Doubt())
            if drone not in self._reckonings:
                growth = (fault.drift_mps2, fault.drift_mps2)
                parameters = Parameters(drone + 1, PARAMETERS)
                self._reckonings[drone] = DeadReckoning(parameters, self._step_s, rng.spawn(1)[0], lambda _: None, growth)

    def _end(self, one: Active, drone: int) -> None:
        if (one, drone) in self._jumps:
            jump = self._jumps.pop((one, drone))
            self._jump(drone, Jump(-jump.shift_m, -jump.turn_rad, jump.announced, undoes=not jump.announced))
        elif (one, drone) in self._courses:
            self._frames.spoof(drone, -self._dragged_m.pop((one, drone)) * self._courses.pop((one, drone)))
        elif drone in self._reckonings and not self._is_blind(drone):
            self._frames.block(drone, False)

    def _jump(self, drone: int, jump: Jump) -> None:
        if not jump.announced:
            self._frames.spoof(drone, jump.shift_m)
            if jump.turn_rad:
                self._frames.expect(drone, jump._replace(shift_m=np.zeros(3)))
            return
        self._frames.expect(drone, jump)
        if self._frames.flies_by_satellites(drone):
            self._doubts.setdefault(drone, _Doubt()).jumped()

    def _drag(self, fault: Drag, one: Active, drone: int) -> None:
        before_m = self._dragged_m[one, drone]
        self._dragged_m[one, drone] = min(fault.most_m, before_m + fault.speed_mps * self._step_s)
        self._frames.spoof(drone, (self._dragged_m[one, drone] - before_m) * self._courses[one, drone])

    def _reckon(self, drone: int, reckoning: DeadReckoning) -> None:
        assert isinstance(self._errors, FilterErrors)
        autopilot = self._autopilots[drone]
        jump_m = reckoning.step(not self._is_blind(drone), autopilot.armed)
        self._errors.take(drone, reckoning)
        if jump_m is not None:
            self._frames.expect(drone, Reset(jump_m))
            self._doubts[drone].jumped()
        autopilot.knows_position = reckoning.known

    def _is_blind(self, drone: int) -> bool:
        return bool(self._schedule.active(SatellitesLost, drone))


def _direction(rng: np.random.Generator) -> Array:
    """Draw a horizontal unit vector (3,)."""
    angle = float(rng.uniform(-pi, pi))
    return np.array([cos(angle), sin(angle), 0.0])
