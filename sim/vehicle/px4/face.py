"""One emulated vehicle: commander, parameters, battery and links put together."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.vehicle.guidance import Reframing, Target
from sim.vehicle.px4.battery import Battery
from sim.vehicle.px4.commander import Commander
from sim.vehicle.px4.config import Px4Config
from sim.vehicle.px4.estimate import Estimate, Geodetic
from sim.vehicle.px4.link import Link
from sim.vehicle.px4.modes import Mode
from sim.vehicle.px4.parameters import Parameters
from sim.vehicle.px4.requests import Requests
from sim.vehicle.px4.setpoint import SetpointLog
from sim.vehicle.px4.state import Reading, State
from sim.vehicle.px4.status import gps_global_origin
from sim.vehicle.px4.streams import GROUND_STATION_HZ, ONBOARD_HZ, Schedule
from sim.vehicle.px4.vision import Correction, Pose, Vision

HOME_JUMP_M, HOME_JUMP_S = 1.0, 2.0  # in flight, the home altitude is somewhere within +-1 m of the right one, anew every 2 s
_GROUND_STATION_GONE_S = 3.0  # without its heartbeat a link gets no texts any more


class Px4Face:
    """Vehicle ``index``, MAVLink system id ``index`` + 1; ``fleet.Px4Fleet`` steps it."""

    def __init__(
        self,
        index: int,
        config: Px4Config,
        place: Estimate,
        yaw_rad: float,
        origin: Geodetic,
        position_sigma_m: tuple[float, float],
        step_s: float,
        rng: np.random.Generator,
        clock_ns: Callable[[], int],
    ) -> None:
        """Standing at ``place``, its own first estimate, with its heading ``yaw_rad``, local ENU."""
        system_id = index + 1
        self.parameters = parameters = Parameters(system_id, config.parameters)
        faults = config.faults
        self.setpoints = SetpointLog()
        self.commander = Commander(parameters, place.position_enu_m, yaw_rad, step_s, self._say, faults.unhealthy)
        battery = Battery(parameters["BAT1_CAPACITY"], int(parameters["BAT1_N_CELLS"]), step_s)
        self._state = State(self.commander, battery, origin, position_sigma_m, system_id, estimate=place)
        self._state.home_altitude_m = place.place.altitude_m
        self.vision = Vision(parameters, rng.spawn(1)[0])
        requests = Requests(system_id, self._state, parameters, self.setpoints, self.vision, self._boot_ns)
        addresses = [(config.onboard, ONBOARD_HZ), (config.ground_station, GROUND_STATION_HZ)]
        self.links = [
            Link(address, system_id, Schedule(rates, 0.0), requests.receive)
            for address, rates in addresses
            if address is not None
        ]
        self._clock_ns, self._rng, self._faults = clock_ns, rng, faults
        self._boot_s = faults.boot_s
        self._cut_until_s = float("inf") if faults.silent else 0.0
        self._step_ns, self._stepped_ns = round(step_s * 1e9), clock_ns()
        self._home_altitude_m, self._next_jump_s = place.place.altitude_m, 0.0
        self._origin_told = False

    @property
    def target(self) -> Target:
        """What it wants to follow, local ENU; velocity alone along an axis whose position is NaN."""
        return self.commander.target

    @property
    def grounded(self) -> bool:
        """It stands, with rotors that stand or idle."""
        return self.commander.grounded

    def cut_links(self, duration_s: float) -> None:
        """From now on nothing passes for so long, either way."""
        self._cut_until_s = max(self._cut_until_s, self._state.boot_s + self._boot_s + duration_s)

    async def start(self) -> None:
        """Open the links on the running loop."""
        for link in self.links:
            await link.start()

    def close(self) -> None:
        """Close the links."""
        for link in self.links:
            link.close()

    @property
    def boot_us(self) -> int:
        """Its clock, as of the newest step."""
        return self._state.boot_us

    @property
    def by_satellites(self) -> bool:
        """Whether its filter takes satellites."""
        return self.parameters["EKF2_GPS_CTRL"] != 0.0

    def receive_satellites(self, receiver: bool, reading: Reading | None) -> None:
        """Take what the receiver on board says, if there is one."""
        state = self._state
        state.receiver, state.reading = receiver, reading
        state.has_origin = state.has_origin or (reading is not None and self.by_satellites)

    def look(self, time_s: float, estimate: Estimate, yaw_rad: float, step_s: float) -> list[Correction]:
        """Take the vision's poses, if there is one: what they make of the newest estimate, whose heading is ``yaw_rad`` (ENU)."""
        if not self.vision.wanted:
            return []
        now = Pose(max(0.0, time_s - self._boot_s), estimate.position_enu_m, yaw_rad)
        return self.vision.step(now, step_s)

    def be_guided(self, by_vision: bool) -> None:
        """By vision, which may have been gone for too long to know the position; else by satellites."""
        self._state.knows_position = not by_vision or self.vision.knows_position(self._state.boot_s)

    def claim(self, horizontal_m: float) -> None:
        """Its filter now tells so much for 1 sigma of its place."""
        self._state.position_sigma_m = (horizontal_m, self._state.position_sigma_m[1])

    def reset(self, frame: Reframing) -> None:
        """The filter has been reset: the local frame jumps, and the count of resets says so."""
        self._state.resets += 1
        self.commander.reframe(frame)

    def step(self, time_s: float, estimate: Estimate, contact: bool) -> None:
        """Take the newest estimate and decide what to fly; ``contact``: on the ground."""
        state, commander = self._state, self.commander
        state.boot_s = max(0.0, time_s - self._boot_s)
        state.utc_ns = self._stepped_ns = self._clock_ns()
        state.estimate = estimate
        for link in self.links:
            link.cut = time_s < self._cut_until_s or time_s < self._boot_s
        commander.know(state.knows_position, state.has_origin)
        commander.hear_ground_station(self._ground_station_silent_s())
        commander.step(state.boot_s, estimate.position_enu_m, contact)
        if commander.mode is not Mode.OFFBOARD:
            self.setpoints.leave_offboard()
        state.battery.step(not commander.grounded)
        self._move_home()

    def send_due(self) -> None:
        """Send what is due on all links."""
        state = self._state
        if state.has_origin and not self._origin_told:
            self._origin_told = True
            for link in self.links:
                link.send(gps_global_origin(state))
        for link in self.links:
            link.send_due(state)

    def _move_home(self) -> None:
        state = self._state
        if not self.commander.armed:
            self._home_altitude_m = state.now.place.altitude_m
        if self.commander.landed:
            state.home_altitude_m = self._home_altitude_m
        elif state.boot_s >= self._next_jump_s:
            self._next_jump_s = state.boot_s + HOME_JUMP_S
            state.home_altitude_m = self._home_altitude_m + float(self._rng.uniform(-HOME_JUMP_M, HOME_JUMP_M))

    def _ground_station_silent_s(self) -> float | None:
        heard = [link.ground_station_s for link in self.links if link.ground_station_s is not None]
        return self._state.boot_s - max(heard) if heard else None

    def _say(self, severity: int, text: str) -> None:
        for link in self.links:
            heard_s = link.ground_station_s
            if heard_s is not None and self._state.boot_s - heard_s < _GROUND_STATION_GONE_S:
                link.send_text(severity, text)

    def _boot_ns(self) -> int:
        """The vehicle's clock between two steps."""
        since_ns = min(max(0, self._clock_ns() - self._stepped_ns), self._step_ns)
        return int(self._state.boot_s * 1e9) + since_ns
