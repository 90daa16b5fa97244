"""One emulated PX4 and the driver under test in one event loop, the vehicle's time running faster than the wall's."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import numpy as np
from msgspec import convert

from radron.agent.config.drone import VehicleConfig
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import LaunchPlace, Request, Setpoint, VehicleCommand, VehicleState
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.agent.vehicle.requests import REPEAT_S
from radron.sim.vehicle.multirotor import Multirotors, MultirotorTruth
from radron.sim.vehicle.px4.config import Faults, Px4Config
from radron.sim.vehicle.px4.fleet import Px4Fleet
from radron.sim.world.localization import Localization, LocalizationTruth
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.slam import Slam

STEP_S = 0.01
UTC_NS = 1_767_225_600_000_000_000
TICK_S = 0.02  # of the wall, between two commands
CEILING_M = 60.0
SANE = {"COM_OBL_RC_ACT": 3, "GF_ACTION": 3, "GF_MAX_HOR_DIST": 300.0}  # parameters that the driver needs beyond PX4's defaults
SANE |= {"EKF2_NOAID_TOUT": 2_000_000}
STAY = VehicleCommand(Request.STAY)
TAKEOFF = VehicleCommand(Request.TAKEOFF, takeoff_height_m=4.0)


def hover(east_m: float, north_m: float, up_m: float, yaw_rad: float = 0.0) -> VehicleCommand:
    """A setpoint that stands still."""
    return VehicleCommand(Request.OFFBOARD, Setpoint((east_m, north_m, up_m), (0.0,) * 3, (0.0,) * 3, yaw_rad, 0.0))


class Sky:
    """``vehicle`` is the driver under test; ``states``: all its states."""

    def __init__(
        self,
        fleet: Px4Fleet,
        motion: Multirotors,
        vehicle: VehicleConfig,
        clock_ns: Callable[[], int] = time.time_ns,
        slam: Slam | None = None,
    ) -> None:
        self.fleet = fleet
        self.slam = slam
        self.face = fleet.faces[0]
        self._motion = motion
        self._config = vehicle
        self._clock_ns = clock_ns
        self.address = vehicle.address
        self.speed = 16  # simulated seconds in one of the wall's
        self.each: Callable[[], None] = lambda: None  # called after every step
        self.states: list[VehicleState] = []
        self.vehicle = self.new_vehicle()

    def new_vehicle(self, launch: LaunchPlace | None = None) -> Px4Vehicle:
        """Another driver at the same address, as of an agent that was started anew."""
        self.vehicle = Px4Vehicle(Demands(self._config, CEILING_M), launch, self._clock_ns)
        self.states = []
        self.vehicle.on_state(self.states.append)
        return self.vehicle

    @property
    def state(self) -> VehicleState:
        return self.states[-1]

    @property
    def true_position_m(self) -> tuple[float, float, float]:
        """World, which has its origin at the launch place."""
        east_m, north_m, up_m = self._motion.position_m[0]
        return float(east_m), float(north_m), float(up_m)

    async def connect(self) -> None:
        connecting = asyncio.create_task(self.vehicle.connect())
        while not connecting.done():
            await self._tick()
        await connecting

    async def fly(self, command: VehicleCommand | None, until: Callable[[], bool], timeout_s: float = 10.0) -> None:
        """Give the command at every tick until the condition holds; none: nothing is commanded, as by an agent that hangs."""
        deadline_s = time.monotonic() + timeout_s
        while not until():
            last = self.states[-1] if self.states else None
            assert time.monotonic() < deadline_s, (command, self.vehicle.problems, last, self.fleet.reports())
            if command is not None:
                self.vehicle.command(command)
            await self._tick()

    async def wait(self, seconds: float, command: VehicleCommand | None = None) -> None:
        """A duration in the vehicle's time."""
        end_s = self.fleet.time_s + seconds
        await self.fly(command, lambda: self.fleet.time_s >= end_s, timeout_s=60.0)

    async def insist(self, command: VehicleCommand) -> None:
        """Give the command for longer than it takes until the driver asks the autopilot again."""
        end_s = time.monotonic() + REPEAT_S + 0.5
        await self.fly(command, lambda: time.monotonic() >= end_s)

    async def _tick(self) -> None:
        for _ in range(round(self.speed * TICK_S / STEP_S)):
            self.fleet.step()
            self.each()
        await asyncio.sleep(TICK_S)


async def ready(flight: Sky) -> None:
    """Connected, and nothing stands against a start."""
    await flight.connect()
    await flight.fly(STAY, lambda: bool(flight.states) and flight.state.healthy and not flight.vehicle.problems)


def free_port() -> int:
    """A UDP port without a listener."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@asynccontextmanager
async def sky(
    parameters: dict[str, float] | None = None,
    faults: Faults = Faults(),  # noqa: B008 - frozen
    frames: MovingFrames | None = None,
    onboard_port: int | None = None,
    **vehicle: object,
) -> AsyncIterator[Sky]:
    """An emulated vehicle on the ground, its links open; everything is closed at the end.

    ``frames``: where its localisation has its frame; then the driver's clock, too, is that of the simulation, by which poses are
    stamped. ``onboard_port``: to which it sends; None: a free one. ``vehicle``: the vehicle's part of the drone file.
    """
    rng = np.random.default_rng(5)
    port = onboard_port or free_port()
    motion = Multirotors(MultirotorTruth(), np.zeros((1, 3)), np.zeros(1), STEP_S, rng)
    error = Localization(LocalizationTruth(), 1, STEP_S, rng)
    config = Px4Config(onboard=("127.0.0.1", port), parameters=SANE | (parameters or {}), faults=faults)
    fleet = Px4Fleet([config], motion, error, STEP_S, rng, localized=frames)
    await fleet.start()
    settings = {"address": f"udpin://127.0.0.1:{port}", "connect_timeout_s": 8.0} | vehicle
    slam = Slam(motion, error, frames) if frames is not None else None
    clock_ns = time.time_ns if frames is None else lambda: UTC_NS + round(fleet.time_s * 1e9)
    flight = Sky(fleet, motion, convert(settings, VehicleConfig), clock_ns, slam)
    try:
        yield flight
    finally:
        await flight.vehicle.close()
        fleet.close()
