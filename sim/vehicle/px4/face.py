"""One emulated PX4 vehicle as other programs see it: commander, parameters, battery and links put together."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import hypot

import numpy as np

from radron.sim.geometry import Array
from radron.sim.vehicle.guidance import Reframing, Target
from radron.sim.vehicle.px4 import events
from radron.sim.vehicle.px4.battery import Battery
from radron.sim.vehicle.px4.commander import Commander
from radron.sim.vehicle.px4.config import Px4Config
from radron.sim.vehicle.px4.events import Announcement
from radron.sim.vehicle.px4.filter.deadreckoning import DeadReckoning
from radron.sim.vehicle.px4.filter.estimate import Estimate, Geodetic
from radron.sim.vehicle.px4.filter.heading import TakeoffAlignment
from radron.sim.vehicle.px4.filter.vision import Correction, Pose, Vision
from radron.sim.vehicle.px4.mavlink.contacts import Contacts
from radron.sim.vehicle.px4.mavlink.dialect import Event
from radron.sim.vehicle.px4.mavlink.link import Link
from radron.sim.vehicle.px4.mavlink.requests import Requests
from radron.sim.vehicle.px4.mavlink.setpoint import SetpointLog
from radron.sim.vehicle.px4.mavlink.status import gps_global_origin
from radron.sim.vehicle.px4.mavlink.streams import GROUND_STATION_HZ, ONBOARD_HZ, Schedule
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.vehicle.px4.release import RELEASES
from radron.sim.vehicle.px4.state import ORIGIN_S, Reading, State

HOME_JUMP_M, HOME_JUMP_S = 1.0, 2.0  # in flight the home altitude is random within +-1 m of the true one, redrawn every 2 s
LOSS_REPORTED_S = 0.035  # after the last fix, until the receiver reports that there is none
FIRST_PACKET_S = (0.6, 0.9)  # after the start
ORIGIN_RESETS = 2  # step of the reset counter that reports a moved origin


class Px4Face:
    """Emulates vehicle ``index`` with the MAVLink system id ``index`` + 1; ``fleet.Px4Fleet`` steps it."""

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
        """Start with the vehicle on the ground at ``place`` (its first estimate) with its heading ``yaw_rad``, local ENU."""
        system_id, release = index + 1, RELEASES[config.release]
        self.parameters = parameters = Parameters(system_id, config.parameters)
        self._faults = faults = config.faults
        self.setpoints = SetpointLog()
        self.commander = Commander(
            parameters, place.position_enu_m, yaw_rad, step_s, rng.spawn(1)[0], self._announce, faults.unhealthy
        )
        self.reckoning = DeadReckoning(parameters, step_s, rng.spawn(1)[0], self._announce)
        self._state = State(
            self.commander,
            Battery(parameters, step_s),
            self.reckoning,
            origin,
            position_sigma_m,
            release.software,
            system_id,
            estimate=place,
            home_altitude_m=place.place.altitude_m,
        )
        self.vision = Vision(parameters, rng.spawn(1)[0])
        height_m = release.heading_reset_m
        self._alignment = TakeoffAlignment(height_m, rng.spawn(1)[0]) if height_m is not None else None
        self._contacts = Contacts(parameters, self._announce)
        self._requests = Requests(
            system_id, self._state, parameters, self.setpoints, self.vision, self._contacts, self._announce, self._boot_ns
        )
        phases = rng.spawn(1)[0]
        first_s = float(phases.uniform(*FIRST_PACKET_S))
        addresses = [(config.onboard, ONBOARD_HZ), (config.ground_station, GROUND_STATION_HZ)]
        self.links = self._requests.links = [
            Link(address, system_id, Schedule(rates, first_s, phases), self._requests.receive)
            for address, rates in addresses
            if address is not None
        ]
        self._clock_ns, self._rng = clock_ns, rng
        self._boot_s, self._speaks_s = faults.boot_s, faults.boot_s + first_s
        self._cut_until_s = float("inf") if faults.silent else 0.0
        self._dark_until_s = self._read_s = 0.0
        self._claimed_m, self._frame_resets = position_sigma_m[0], 0
        self._step_ns, self._stepped_ns = round(step_s * 1e9), clock_ns()
        self._home_altitude_m, self._next_jump_s = place.place.altitude_m, 0.0
        self._origin_announced = self._to_be_disarmed = False

    @property
    def target(self) -> Target:
        """The target that the vehicle flies to, local ENU; only the velocity counts along an axis whose position is NaN."""
        return self.commander.target

    @property
    def grounded(self) -> bool:
        """Whether the vehicle stands on the ground, with rotors that are stopped or idle."""
        return self.commander.grounded

    def cut_links(self, duration_s: float) -> None:
        """Cut the vehicle's links in both directions from now on, for this long."""
        self._cut_until_s = max(self._cut_until_s, self._state.boot_s + self._boot_s + duration_s)

    def lose_satellites(self, duration_s: float) -> None:
        """Block the vehicle's satellite reception from now on, for this long."""
        self._dark_until_s = max(self._dark_until_s, self._state.boot_s + duration_s)

    def disarm_before_takeoff(self) -> None:
        """Let a person on site disarm the vehicle as soon as the heartbeat shows it armed, unless it is in the air by then."""
        self._to_be_disarmed = True

    @property
    def battery(self) -> Battery:
        """The battery that the vehicle reports, and on which its failsafes act."""
        return self._state.battery

    @battery.setter
    def battery(self, battery: Battery) -> None:
        self._state.battery = battery

    @property
    def refuses(self) -> bool:
        """Whether the vehicle refuses arming and all changes of its mode."""
        return self._requests.refuses

    @refuses.setter
    def refuses(self, refuses: bool) -> None:
        self._requests.refuses = refuses

    @property
    def in_sight(self) -> bool:
        """Whether the vehicle's receiver can see satellites."""
        lost, now_s = self._faults.satellites_lost_s, self._state.boot_s
        fault = lost is not None and lost[0] <= now_s < lost[0] + lost[1]
        return self.parameters["SIM_GPS_USED"] > 0.0 and now_s >= self._dark_until_s and not fault

    async def start(self) -> None:
        """Open the links in the running event loop."""
        for link in self.links:
            await link.start()

    def close(self) -> None:
        """Close the links."""
        for link in self.links:
            link.close()

    @property
    def boot_us(self) -> int:
        """The vehicle's clock at the latest time step, microseconds since its start."""
        return self._state.boot_us

    @property
    def by_satellites(self) -> bool:
        """Whether the vehicle's filter uses satellites."""
        return self.parameters["EKF2_GPS_CTRL"] != 0.0

    def receive_satellites(self, receiver: bool, reading: Reading | None) -> None:
        """Process the reading of the satellite receiver.

        ``receiver``: there is one on board. ``reading``: None without reception.
        """
        state = self._state
        if reading is not None:
            self._read_s = state.boot_s
        elif state.boot_s - self._read_s < LOSS_REPORTED_S:
            reading = state.reading
        state.receiver, state.reading = receiver, reading
        begun = reading is not None and self.by_satellites and state.boot_s >= ORIGIN_S
        state.has_origin = state.has_origin or begun

    def reckon(self, by_vision: bool) -> Array | None:
        """Emulate the vehicle's filter for one time step with the present satellites.

        Return the jump (3,) of the position in world axes, or None.
        """
        state = self._state
        needs_them = self.by_satellites and state.has_origin and not by_vision and not self.vision.wanted
        return self.reckoning.step(not needs_them or state.reading is not None, self.commander.armed)

    def align_heading(self) -> float | None:
        """Return the angle (rad) by which the vehicle's filter resets its heading now; None without a reset."""
        if self._alignment is None or self.vision.wanted or not self.by_satellites:
            return None
        return self._alignment.step(self.commander.landed, self._state.now.position_enu_m[2])

    def take_external_places(self) -> tuple[Geodetic | None, Geodetic | None]:
        """Return the vehicle's position and the origin of its local frame if an external source has sent them; each only once."""
        requests = self._requests
        told = (requests.told, requests.external_origin)
        requests.told = requests.external_origin = None
        return told

    def move_origin(self, origin: Geodetic, frame: Reframing) -> None:
        """Move the origin of the vehicle's local frame, and report it at once."""
        self._state.origin = origin
        self.reset(frame, ORIGIN_RESETS)
        self._origin_announced = False

    def look(self, time_s: float, estimate: Estimate, yaw_rad: float, step_s: float) -> list[Correction]:
        """Process the poses of an external vision system, and return corrections of the latest estimate.

        ``yaw_rad``: heading of the estimate (ENU).
        """
        if not self.vision.wanted:
            return []
        now = Pose(max(0.0, time_s - self._boot_s), estimate.position_enu_m, yaw_rad)
        return self.vision.step(now, step_s)

    def update_position_known(self, by_vision: bool) -> None:
        """Update whether the position is known, by vision or else by satellites: either may have been lost for too long."""
        vision, boot_s = self.vision, self._state.boot_s
        self._state.knows_position = vision.knows_position(boot_s) if by_vision else self.reckoning.known

    def set_truth_source(self, truth: Callable[[], Estimate]) -> None:
        """Set the function that gives the true state, which can be requested from a simulated vehicle."""
        self._state.truth = truth

    def claim(self, horizontal_m: float) -> None:
        """Set the 1-sigma horizontal accuracy that the vehicle's filter reports, metres."""
        self._claimed_m = horizontal_m

    def reset(self, frame: Reframing, resets: int = 1) -> None:
        """Report a reset of the filter: the local frame jumps, and the reset counter shows it."""
        self._frame_resets += resets
        self.commander.reframe(frame)

    def step(self, time_s: float, estimate: Estimate, contact: bool) -> None:
        """Process the latest estimate, and decide the target for one time step. ``contact``: the vehicle is on the ground."""
        state, commander = self._state, self.commander
        state.boot_s = max(0.0, time_s - self._boot_s)
        state.utc_ns = self._stepped_ns = self._clock_ns()
        state.estimate = estimate
        state.resets = self._frame_resets + self.reckoning.resets
        state.position_sigma_m = (hypot(self._claimed_m, self.reckoning.reported_sigma_m), state.position_sigma_m[1])
        for link in self.links:
            link.cut = time_s < self._cut_until_s or time_s < self._speaks_s
        self._contacts.step(state.boot_s)
        commander.knows_position, commander.has_home = state.knows_position, state.has_origin
        commander.fixless = state.has_origin and state.reading is None and self.by_satellites
        commander.station_lost, commander.station_missing = self._contacts.station_lost, self._contacts.station_missing
        commander.battery, commander.home_altitude_m = state.battery.warning, state.home_altitude_m
        north, east, down = estimate.velocity_ned_mps
        armed = commander.armed
        if self._to_be_disarmed and armed and all(link.schedule.beat_s > commander.armed_s for link in self.links):
            self._to_be_disarmed = False
            commander.disarm(force=False)
        commander.step(state.boot_s, estimate.position_enu_m, (east, north, -down), contact)
        if commander.armed and not armed and self.parameters["SDLOG_MODE"] == 0.0:
            self._announce(events.log_opened(time.gmtime(state.utc_ns * 1e-9)[:6]))
        if commander.mode is not Mode.OFFBOARD:
            self.setpoints.leave_offboard()
        state.battery.step(commander.armed, not commander.grounded)
        self._move_home()

    def send_due(self) -> None:
        """Send the messages that are due on all links."""
        state = self._state
        if state.has_origin and not self._origin_announced:
            self._origin_announced = True
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

    def _announce(self, announcement: Announcement) -> None:
        """Send an event to every link, and queue its text for ground stations."""
        state = self._state
        if announcement.number is not None:
            state.events = (state.events + 1) % 65_536
            event = Event(
                event_id=announcement.number,
                event_time_boot_ms=state.boot_ms,
                sequence=state.events,
                destination_component=0,
                destination_system=0,
                log_levels=announcement.levels,
                arguments=announcement.arguments,
            )
            for link in self.links:
                link.send(event)
        for link in self.links:
            if announcement.text is not None:
                link.texts.say(announcement.severity, announcement.text, state.boot_s)

    def _boot_ns(self) -> int:
        """The vehicle's clock between two steps."""
        since_ns = min(max(0, self._clock_ns() - self._stepped_ns), self._step_ns)
        return int(self._state.boot_s * 1e9) + since_ns
