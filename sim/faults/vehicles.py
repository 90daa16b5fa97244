"""Faults of the vehicles and their control: gusts, a failed motor, batteries, the MAVLink link, safety pilots, refusals."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import numpy as np

from radron.agent.vehicle.interface import FlightMode
from radron.sim.faults.machines import EMPTY_MPS, Battery, Gust, MavlinkLoss, MotorFailure, Refusal, Takeover
from radron.sim.faults.schedule import Active, Schedule
from radron.sim.geometry import Array
from radron.sim.vehicle.autopilot import Autopilot
from radron.sim.vehicle.multirotor import Multirotors
from radron.sim.vehicle.px4.battery import Battery as Cells
from radron.sim.vehicle.px4.battery import Warning
from radron.sim.vehicle.px4.parameters import Parameters

_ACTIONS = {Warning.CRITICAL: FlightMode.RETURN, Warning.EMERGENCY: FlightMode.LAND}  # COM_LOW_BAT_ACT = 3


class VehicleFaults:
    """Plays the faults of all vehicles of a simulated flight, and their batteries."""

    def __init__(self, schedule: Schedule, autopilots: Sequence[Autopilot], motion: Multirotors, step_s: float) -> None:
        self._schedule, self._autopilots, self._motion, self._step_s = schedule, autopilots, motion, step_s
        self._true = [Cells(Parameters(drone + 1, {}), step_s) for drone in range(len(autopilots))]
        self._told = list(self._true)  # reported: differs for a battery with a false level
        self._warned = [Warning.NONE] * len(autopilots)
        self._due: list[FlightMode | None] = [None] * len(autopilots)  # modes that autopilots choose after a manual override
        self._pushes: dict[tuple[Active, int], Array] = {}
        self._heard = [True] * len(autopilots)

    @property
    def levels(self) -> list[float]:
        """True levels of all batteries, from 0 to 1."""
        return [cells.remaining for cells in self._true]

    def battery(self, drone: int) -> float:
        """Return the battery level that a vehicle reports, in steps of one percent, from 0 to 1."""
        return int(100.0 * self._told[drone].remaining) / 100.0

    def hears(self, drone: int) -> bool:
        """Return whether the telemetry of this time step arrives at the agent."""
        return self._heard[drone]

    def step(self) -> None:
        """Play the vehicle faults of one time step, before the agents make their steps."""
        schedule = self._schedule
        schedule.dispatch(self._begin, self._end)
        for drone, autopilot in enumerate(self._autopilots):
            self._power(drone, autopilot)
            autopilot.refuses = bool(schedule.active(Refusal, drone))
            losses = schedule.active(MavlinkLoss, drone)
            telemetry, autopilot.hears_setpoints, autopilot.hears_requests = (
                all([one.rng.random() >= fault.probability for fault, one in losses]) for _ in range(3)
            )
            self._heard[drone] = telemetry

    def _begin(self, one: Active, drone: int) -> None:
        fault, autopilot = one.fault, self._autopilots[drone]
        if isinstance(fault, Gust):
            angle = float(one.rng.uniform(-pi, pi))
            self._pushes[one, drone] = fault.acceleration_mps2 * np.array([cos(angle), sin(angle), 0.0])
            self._push(drone)
        elif isinstance(fault, MotorFailure):
            self._fail(drone, fault.descent_mps)
        elif isinstance(fault, Takeover):
            autopilot.take_over(FlightMode(fault.mode))
        elif isinstance(fault, Battery):
            if fault.lies:
                self._told[drone] = Cells(Parameters(drone + 1, {}), self._step_s)
            cells = self._told[drone]
            cells.used_mah = (1.0 - fault.level) * cells.capacity_mah

    def _end(self, one: Active, drone: int) -> None:
        if (one, drone) in self._pushes:
            del self._pushes[one, drone]
            self._push(drone)
        elif isinstance(one.fault, Takeover):
            self._autopilots[drone].give_back()
        elif isinstance(one.fault, Battery) and one.fault.lies:
            self._told[drone] = self._true[drone]

    def _push(self, drone: int) -> None:
        mine = [push for (_, pushed), push in self._pushes.items() if pushed == drone]
        self._motion.push_mps2[drone] = sum(mine, np.zeros(3))

    def _fail(self, drone: int, descent_mps: float) -> None:
        self._motion.fail(drone, descent_mps)
        self._autopilots[drone].fail()

    def _power(self, drone: int, autopilot: Autopilot) -> None:
        """Draw from the battery. A vehicle without a battery fault always has enough."""
        true, told = self._true[drone], self._told[drone]
        faults = self._schedule.active(Battery, drone)
        flying = not autopilot.grounded
        for fault, _ in faults:
            cells = told if fault.lies else true
            cells.used_mah += fault.drain_ps * self._step_s * cells.capacity_mah * flying
        true.step(autopilot.armed, flying)
        if told is not true:
            told.step(autopilot.armed, flying)
        if told.warning > self._warned[drone] and any(fault.acts for fault, _ in faults) and told.warning in _ACTIONS:
            self._due[drone] = _ACTIONS[told.warning]
        elif told.warning < self._warned[drone]:
            self._due[drone] = None
        self._warned[drone] = told.warning
        due = self._due[drone]
        if due is not None and not autopilot.piloted:
            autopilot.save_battery(due)
            self._due[drone] = None
        if faults and flying and true.remaining <= 0.0:
            self._fail(drone, EMPTY_MPS)
