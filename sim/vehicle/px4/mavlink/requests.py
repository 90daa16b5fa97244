"""Processing of received MAVLink messages: commands, parameters, modes, setpoints, time synchronisation."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from math import isfinite, isnan

from pymavlink.dialects.v20 import common as mavlink

from radron.sim.vehicle.px4.commander import ACCEPTED, DENIED, FORCE, TEMPORARILY_REJECTED, Commander
from radron.sim.vehicle.px4.events import SETPOINT_INVALID, Announcement
from radron.sim.vehicle.px4.filter.estimate import Geodetic
from radron.sim.vehicle.px4.filter.vision import Vision
from radron.sim.vehicle.px4.mavlink.contacts import Contacts
from radron.sim.vehicle.px4.mavlink.dialect import AvailableModes, ProtocolVersion
from radron.sim.vehicle.px4.mavlink.link import Link
from radron.sim.vehicle.px4.mavlink.missionlink import MissionLink
from radron.sim.vehicle.px4.mavlink.parameterlink import ParameterLink
from radron.sim.vehicle.px4.mavlink.setpoint import SetpointLog, offboard_target
from radron.sim.vehicle.px4.mavlink.status import available_modes
from radron.sim.vehicle.px4.mavlink.streams import BUILDERS
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters
from radron.sim.vehicle.px4.state import Message, State

MAX_SYNC_ROUND_TRIP_NS = 30_000_000  # round trip; a slower answer is too inaccurate
SYNC_WINDOW_NS = 2_000_000_000
_UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED
_OWN_COMPONENTS = (0, mavlink.MAV_COMP_ID_AUTOPILOT1)
_WRONG_FRAME = 9  # PX4's answer
_ALTITUDES_M = (-12_000.0, 100_000.0)  # limits of an origin for its filter
_NO_NUMBER = 65_535  # of no message, mode or unit
_CUSTOM_MODE = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


class Requests:
    """Processes the MAVLink messages that one emulated vehicle receives. ``boot_ns``: returns the vehicle's clock.

    links: all links of the vehicle, over which heartbeats are forwarded. told, external_origin: position of the vehicle, or
    origin of its local frame, as an external source has sent it; the reader sets it to None.
    """

    def __init__(
        self,
        system_id: int,
        state: State,
        parameters: Parameters,
        log: SetpointLog,
        vision: Vision,
        contacts: Contacts,
        announce: Callable[[Announcement], None],
        boot_ns: Callable[[], int],
    ) -> None:
        settings, plans = ParameterLink(parameters), MissionLink()
        self._system_id = system_id
        self._state = state
        self._commander: Commander = state.commander
        self._log = log
        self._vision = vision
        self._contacts = contacts
        self._announce = announce
        self.links: list[Link] = []
        self.refuses = False  # all requests to the commander
        self.told: Geodetic | None = None
        self.external_origin: Geodetic | None = None
        self._synchronised: deque[tuple[int, int]] = deque()  # time, and the companion's clock at the vehicle's 0
        self._boot_ns = boot_ns
        self._handlers: dict[str, Callable[[Link, Message], None]] = {
            "HEARTBEAT": self._heartbeat,
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._position_target,
            "PARAM_REQUEST_READ": settings.read,
            "PARAM_REQUEST_LIST": settings.list,
            "PARAM_SET": settings.set,
            "MISSION_REQUEST_LIST": plans.list,
            "MISSION_CLEAR_ALL": plans.clear,
            "MISSION_COUNT": plans.upload,
            "TIMESYNC": self._timesync,
            "ODOMETRY": self._odometry,
            "PING": self._ping,
            "SET_GPS_GLOBAL_ORIGIN": self._set_origin,
        }

    def receive(self, link: Link, message: Message) -> None:
        """Process a message; messages for another system, or of a kind that PX4 does not answer, are ignored silently."""
        handler = self._handlers.get(message.get_type())
        if handler is not None and self._concerns(message):
            handler(link, message)

    def _concerns(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        return system in (0, self._system_id) and getattr(message, "target_component", 0) in _OWN_COMPONENTS

    def _heartbeat(self, link: Link, message: Message) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            link.texts.station_s = self._state.boot_s
            self._contacts.hear_station(self._state.boot_s)
        elif message.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER:
            self._contacts.hear_companion(self._state.boot_s)
        for other in self.links:
            if other is not link:
                other.forward(message)

    # Commands

    def _command(self, link: Link, message: Message) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        acknowledge = partial(self._acknowledge, link, message.command, sender)
        if message.command == mavlink.MAV_CMD_INJECT_FAILURE:
            self._inject(link, message)
            return
        at_once = self._by_the_link(link, message)
        if at_once is not None:
            acknowledge(at_once)
            return
        carried_out = self._by_the_commander(message)
        if carried_out is None:
            acknowledge(_UNSUPPORTED)
            return
        if message.command == mavlink.MAV_CMD_DO_SET_MODE:
            acknowledge(ACCEPTED)  # by the link, which knows nothing of modes; the commander's own answer follows
        self._commander.ask(self._unless_refused(carried_out), acknowledge)

    def _unless_refused(self, change: Callable[[], int]) -> Callable[[], int]:
        return (lambda: int(TEMPORARILY_REJECTED)) if self.refuses else change

    def _acknowledge(self, link: Link, command: int, sender: tuple[int, int], result: int) -> None:
        link.send(mavlink.MAVLink_command_ack_message(command, result, 255, 0, *sender))

    def _by_the_link(self, link: Link, message: Message) -> int | None:
        """Handle the commands that the MAVLink module answers itself; None for others."""
        number = message.command
        if number == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._request_message(link, _whole(message.param1), message.param2)
        if number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            known = link.schedule.set_interval(_whole(message.param1), message.param2, self._state.boot_s)
            return int(ACCEPTED if known else DENIED)
        if number == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            return self._request_message(link, mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL, message.param1)
        if number == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return self._request_message(link, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0.0)
        if number == mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION:
            return self._request_message(link, ProtocolVersion.id, 0.0)
        if number == mavlink.MAV_CMD_GET_HOME_POSITION:
            return self._request_message(link, mavlink.MAVLINK_MSG_ID_HOME_POSITION, 0.0)
        if number == mavlink.MAV_CMD_EXTERNAL_POSITION_ESTIMATE:
            return self._take_place(message)
        return None

    def _take_place(self, message: Message) -> int:
        """Handle an externally sent position; by COMMAND_INT only in a frame with latitudes."""
        if message.get_type() == "COMMAND_INT":
            return _WRONG_FRAME
        place = Geodetic(message.param5, message.param6, message.param7)
        if not _is_on_earth(place._replace(altitude_m=0.0) if isnan(place.altitude_m) else place):  # it may be left out
            return int(DENIED)
        self.told = place
        return int(ACCEPTED)

    def _inject(self, link: Link, message: Message) -> None:
        """Inject failures of PX4's simulated parts: the battery; motors by text only; others are ignored. The answer is
        broadcast.
        """
        unit = _whole(message.param1)
        if unit == mavlink.FAILURE_UNIT_SYSTEM_BATTERY:
            self._state.battery.dead = _whole(message.param2) == mavlink.FAILURE_TYPE_OFF
        elif unit != mavlink.FAILURE_UNIT_SYSTEM_MOTOR:
            return
        self._commander.ask(lambda: int(ACCEPTED), partial(self._acknowledge, link, message.command, (0, 0)))

    def _request_message(self, link: Link, number: int, detail: float) -> int:
        if number == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            asked = _whole(detail)
            link.send(mavlink.MAVLink_message_interval_message(asked, link.schedule.interval_us(asked)))
            return int(ACCEPTED)
        if number == AvailableModes.id:
            modes = available_modes(_whole(detail))
            for mode in modes:
                link.send(mode)
            return int(ACCEPTED if modes else DENIED)
        message = BUILDERS[number](self._state) if number in BUILDERS else None
        link.send(message)
        return int(DENIED if message is None else ACCEPTED)

    def _by_the_commander(self, message: Message) -> Callable[[], int] | None:
        """The commander's action for its next step; None for an unknown command."""
        commander, number = self._commander, message.command
        modes = {
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Mode.RETURN,
            mavlink.MAV_CMD_NAV_LOITER_UNLIM: Mode.HOLD,
        }
        if number in modes:
            return partial(commander.set_mode, modes[number])
        if number == mavlink.MAV_CMD_NAV_LAND:
            return commander.land
        if number == mavlink.MAV_CMD_RUN_PREARM_CHECKS:
            return lambda: int(ACCEPTED)  # streams run all the time
        if number == mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN:
            return lambda: int(DENIED)  # not while armed; and disarmed, no vehicle here is rebooted
        if number == mavlink.MAV_CMD_DO_SET_MODE:
            return self._mode_change(*map(_whole, (message.param1, message.param2, message.param3)))
        if number == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            change = commander.arm if message.param1 >= 0.5 else commander.disarm
            return partial(change, message.param2 == FORCE)
        if number == mavlink.MAV_CMD_NAV_TAKEOFF:
            return partial(commander.take_off, self._takeoff_height(message))
        return None

    def _takeoff_height(self, message: Message) -> float | None:
        """Height above home; the command gives it above sea level, or not at all."""
        altitude = message.z if message.get_type() == "COMMAND_INT" else message.param7
        return altitude - self._state.home_altitude_m if isfinite(altitude) else None

    def _mode_change(self, base: int, main: int, sub: int) -> Callable[[], int]:
        mode = Mode.of(main, sub) if base & _CUSTOM_MODE else None
        if mode is None:
            return lambda: int(DENIED)
        return partial(self._commander.set_mode, mode)

    def _set_mode(self, link: Link, message: Message) -> None:
        custom = message.custom_mode
        change = self._mode_change(message.base_mode, custom >> 16 & 0xFF, custom >> 24)
        self._commander.ask(self._unless_refused(change), lambda result: None)

    # Setpoints

    def _position_target(self, link: Link, message: Message) -> None:
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            text = f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {message.coordinate_frame} unsupported"
            self._announce(Announcement(None, 0, b"", mavlink.MAV_SEVERITY_CRITICAL, text))
            return
        target = offboard_target(message)
        if target is None:
            self._announce(SETPOINT_INVALID)
            return
        self._log.add(message.get_payload(), link.arrived_ns, self._commander.mode is Mode.OFFBOARD)
        self._commander.follow(target)

    def _set_origin(self, link: Link, message: Message) -> None:
        origin = Geodetic(message.latitude * 1e-7, message.longitude * 1e-7, message.altitude * 1e-3)
        if _is_on_earth(origin):
            self.external_origin = origin

    # Clocks

    def _timesync(self, link: Link, message: Message) -> None:
        now_ns = self._boot_ns()
        if message.tc1 == 0:
            link.send(mavlink.MAVLink_timesync_message(now_ns, message.ts1))
        elif 0 <= now_ns - message.ts1 < MAX_SYNC_ROUND_TRIP_NS:
            self._synchronised.append((now_ns, message.tc1 - (message.ts1 + now_ns) // 2))
            while self._synchronised[0][0] < now_ns - SYNC_WINDOW_NS:
                self._synchronised.popleft()

    def _odometry(self, link: Link, message: Message) -> None:
        """Handle ODOMETRY. Stamps are of the companion's clock; before TIMESYNC, PX4 uses the arrival time."""
        offsets = [offset_ns for _, offset_ns in self._synchronised]
        # The minimum: while the simulation lags behind the wall clock, until it catches up, the vehicle's clock stands still.
        stamp_ns = message.time_usec * 1000 - min(offsets) if offsets else self._boot_ns()
        self._vision.hear(message, stamp_ns * 1e-9)

    def _ping(self, link: Link, message: Message) -> None:
        if message.target_system == 0:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            link.send(mavlink.MAVLink_ping_message(message.time_usec, message.seq, *sender))


def _whole(parameter: float) -> int:
    """Return a command's parameter as an integer; ``_NO_NUMBER`` if it is none."""
    return int(parameter) if 0.0 <= parameter < _NO_NUMBER else _NO_NUMBER


def _is_on_earth(place: Geodetic) -> bool:
    """Return whether a place is within the limits of PX4's filter."""
    low_m, high_m = _ALTITUDES_M
    return abs(place.latitude_deg) <= 90.0 and abs(place.longitude_deg) <= 180.0 and low_m <= place.altitude_m <= high_m
