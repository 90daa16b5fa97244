"""The PX4 driver: vehicle states at the rate of the position, the pilot's commands, and problems in words."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Literal

from radron.agent.owntime import Utc
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.health import StatusMessages
from radron.agent.vehicle.interface import Finding, GnssFix, LaunchPlace, Request, Setpoint, VehicleCommand, VehicleState
from radron.agent.vehicle.mavlink.exposure import exposure
from radron.agent.vehicle.mavlink.link import Link, Received
from radron.agent.vehicle.mavlink.messages import (
    AutopilotVersion,
    CommandAck,
    Event,
    GpsRaw,
    Heartbeat,
    LocalPosition,
    ParameterError,
    ParameterValue,
    StatusText,
    TimeSync,
)
from radron.agent.vehicle.mavlink.signed import SIGNED
from radron.agent.vehicle.modes import CUSTOM_MODES, SET_MODE_FLAGS
from radron.agent.vehicle.parameters import FLOAT, TAKEOFF_ALTITUDE, Parameters, float32, wire_value
from radron.agent.vehicle.requests import Act, Requests
from radron.agent.vehicle.rules import RETURN_ALTITUDE
from radron.agent.vehicle.setpoints import SetpointStream
from radron.agent.vehicle.streams import GLOBAL_ORIGIN, HOME_POSITION, REQUEST, Streams
from radron.agent.vehicle.telemetry import Telemetry
from radron.agent.vehicle.vision import Vision
from radron.protocol.codes import Code
from radron.protocol.texts import CodedText, coded

SET_UP_S = 1.0  # between requests for missing streams and values
REFUSAL_S = 5.0  # a refusal counts as a problem for this long
FIX_S = 0.9  # between two fixes: errors at shorter intervals are strongly correlated

_TAKE_OFF, _LAND, _SET_MODE, _ARM = 22, 21, 176, 400  # MAV_CMD
_WATCHED = {_TAKE_OFF: "to take off", _LAND: "to land", _SET_MODE: "to change its mode", _ARM: "to arm"}
_RESULTS = {1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 6: "cancelled"}  # MAV_RESULT


class Px4Vehicle:
    """The driver of one PX4 autopilot: it reads telemetry, and sends setpoints and commands.

    All methods and callbacks are called in the event loop's thread. Nothing is pending between calls: a request that the
    autopilot does not show fulfilled is repeated with the next heartbeat or command. So an agent that hangs goes silent at once,
    and closing never waits.
    """

    def __init__(
        self,
        demands: Demands,
        launch: LaunchPlace | None = None,
        clock_ns: Callable[[], int] = time.time_ns,
        exact: bool = False,
        *,
        clock_s: Callable[[], float] = time.monotonic,
        utc: Utc | None = None,
        link: Link | None = None,
    ) -> None:
        """Set up a driver that is not connected yet.

        Args:
            demands: values that the mission requires of the autopilot, with the connection to it.
            launch: the launch place from before a restart in flight.
            clock_ns: own time; by default UTC, for a program that does not fly.
            exact: the mission's local frame is known exactly, so that it has only one epoch (period without a jump).
            clock_s: a clock that never goes back.
            utc: lead of UTC over own time; None: 0.
            link: to the autopilot; None: as in ``config``.
        """
        self._config = config = demands.vehicle
        self._clock_ns, self._clock_s = clock_ns, clock_s
        self._link = link or Link(config.address, clock_ns, clock_s, config.system_id, config.source)
        self.telemetry = self._telemetry = Telemetry(config, launch, exact)  # to be read only
        self.messages = self._messages = StatusMessages()  # as well
        self.parameters = Parameters(demands, others=config.parameters)
        self._requests, self._setpoints, self._streams = Requests(), SetpointStream(self._link), Streams(self._link)
        self._vision = Vision(config.vision.address, self._link.send, clock_ns, utc) if config.vision is not None else None
        self._seeing: asyncio.Task[None] | None = None
        self._callback: Callable[[VehicleState], None] | None = None
        self._fix_callback: Callable[[GnssFix], None] | None = None
        self._fix_s = float("-inf")
        self._set_up_s = float("-inf")
        self._refusal: tuple[CodedText, float] | None = None
        self.counters = self._link.counters

    async def connect(self) -> None:
        """Open the link to the autopilot, and wait until it is found.

        Raises:
            VehicleError: a bad address, a port in use, or no PX4 there within ``connect_timeout_s``.
        """
        try:
            await self._link.open(self._config.connect_timeout_s, self._receive)
        except BaseException:
            self._link.close()
            raise
        if self._vision is not None:
            self._seeing = asyncio.create_task(self._vision.run(), name="vision")

    def on_fix(self, callback: Callable[[GnssFix], None]) -> None:
        """Set the function that is called once a second with the satellite receiver's position, while the receiver has one."""
        self._fix_callback = callback

    def on_state(self, callback: Callable[[VehicleState], None]) -> None:
        """Set the function that is called with every new vehicle state, at the rate of the autopilot's position."""
        self._callback = callback

    @property
    def launch(self) -> LaunchPlace | None:
        """The origin of the drone's local frame in the autopilot's frame; None if not known."""
        return self._telemetry.launch.place

    @property
    def has_rebooted(self) -> bool:
        """Whether the autopilot was booted again since its first message; its local frame is then new."""
        return self._telemetry.has_rebooted

    @property
    def launch_to_keep(self) -> LaunchPlace | None:
        """The launch place to store for a restarted agent; None until it does not change any more."""
        return self._telemetry.launch.to_keep

    @property
    def problems(self) -> tuple[CodedText, ...]:
        """Obstacles to flying, one line each, together with messages of the autopilot."""
        now_s = self._clock_s()
        problems = self._telemetry.problems(now_s)
        if self._telemetry.is_lost(now_s):
            return tuple(problems)
        problems += [*([SIGNED] if self._link.is_signed else []), *self._vision_problems()]
        if self._refusal is not None and now_s - self._refusal[1] < REFUSAL_S:
            problems.append(self._refusal[0])
        if problems:
            problems += coded(Code.AUTOPILOT_MESSAGE, (f"the autopilot says: {text}" for text in self._told(now_s)))
        parameters = self.parameters.findings()
        wrong = (f"parameter {finding.name} {finding.text}" for finding in parameters if finding.verdict == "failed")
        problems += coded(Code.PARAMETER_WRONG, wrong)
        if any(finding.verdict == "not yet" for finding in parameters):
            problems.append(CodedText(Code.PARAMETERS_UNREAD, "the autopilot's parameters are being read"))
        return tuple(problems)

    @property
    def exposure(self) -> CodedText | None:
        """The warning to the operator that other senders can reach the autopilot's port, whose commands it would obey; None
        without one.
        """
        return exposure(self._config.address, self._config.source, self._link.taken_from)

    async def findings(self) -> list[Finding]:
        """Return the present results of the preflight check of autopilot, vision and parameters; "not yet" may change within
        seconds.
        """
        vision = [] if self._vision is None else [self._vision_finding()]
        parameters = self.parameters.findings()
        if self._telemetry.is_lost(self._clock_s()):  # a parameter without an answer is not unknown to the autopilot
            parameters = [Finding("parameters", "not yet", "not known without a link to the autopilot")]
        return [self._link_finding(), *vision, self._readiness(), self._launch_finding(), *parameters]

    def set_parameter(self, name: str, value: float) -> bool:
        """Ask the autopilot to set a parameter.

        Return False, without asking, if the vehicle is armed, the link is lost, or the parameter is not known.
        """
        seen, kind = self._telemetry.seen, self.parameters.kind(name)
        if seen is None or seen.armed or kind is None or self._telemetry.is_lost(self._clock_s()):
            return False
        self._link.send("PARAM_SET", {"param_id": name, "param_value": wire_value(value, kind), "param_type": kind})
        return True

    def command(self, command: VehicleCommand) -> None:
        """Carry out the pilot program's command of one step: send the setpoint, and the next autopilot command that the request
        needs.
        """
        now_s = self._clock_s()
        streaming = self._stream(command.setpoint, now_s) if command.request is Request.OFFBOARD else False
        seen = self._telemetry.seen
        if seen is None or self._telemetry.awaits_mode(now_s):  # a pilot may have taken over meanwhile
            return
        altitude_set = self.parameters.value(TAKEOFF_ALTITUDE) == float32(command.takeoff_height_m)
        act = self._requests.step(now_s, command.request, seen, streaming, altitude_set)
        if act is not None:
            self._ask(act, command)

    async def close(self) -> None:
        """Close the link. No command is sent: the autopilot continues by itself."""
        self._callback = self._fix_callback = None
        if self._vision is not None:
            await self._vision.close()
        if self._seeing is not None:
            self._seeing.cancel()
        self._link.close()

    def _receive(self, burst: list[Received]) -> None:
        """Take the messages received, in order; of several states only the newest is passed on."""
        state: VehicleState | None = None
        for received in burst:
            message, now_s = received.message, received.arrival_s
            match message:
                case Heartbeat() if self._telemetry.is_lost(now_s):
                    self._begin_anew()
                case LocalPosition():
                    self._streams.positions += 1
                case StatusText() | Event() | AutopilotVersion():
                    self._messages.receive(message, now_s)
                case CommandAck():
                    self._take_ack(message, now_s)
                case ParameterValue():
                    self.parameters.receive(message)
                case ParameterError():
                    self.parameters.refused(message)
                case GpsRaw() if now_s - self._fix_s >= FIX_S:
                    self._take_fix(message, now_s)
                case TimeSync(tc1=0) if self._vision is not None:
                    self._link.send("TIMESYNC", {"tc1": self._clock_ns(), "ts1": message.ts1})
            state = self._telemetry.receive(message, received.arrival_ns, now_s) or state
            if isinstance(message, Heartbeat):
                self._set_up(now_s)
        if state is not None and self._callback is not None:
            self._callback(state)

    def _take_fix(self, message: GpsRaw, now_s: float) -> None:
        fix = self._telemetry.fix(message)
        if fix is not None and self._fix_callback is not None:
            self._fix_s = now_s
            self._fix_callback(fix)

    def _begin_anew(self) -> None:
        """Begin with a link that is up for the first time or again: the autopilot may have been restarted, or replaced."""
        self._telemetry.begin_anew()
        self.parameters.forget()
        self._streams.begin_anew()
        self._set_up_s = float("-inf")

    def _set_up(self, now_s: float) -> None:
        """Request missing data, again and again: streams, home, origin, parameters.

        An autopilot without satellites has neither home nor origin; should it get them after all, it reports them by itself.
        """
        for name in self.parameters.due(now_s):
            self._link.send("PARAM_REQUEST_READ", {"param_id": name, "param_index": -1})
        seen = self._telemetry.seen
        height_m = self.parameters.height_to_set(now_s) if seen is not None and not seen.armed else None
        if height_m is not None:
            self._link.send("PARAM_SET", {"param_id": RETURN_ALTITUDE, "param_value": height_m, "param_type": FLOAT})
        elapsed_s = now_s - self._set_up_s
        if elapsed_s < SET_UP_S:
            return
        self._streams.check(SET_UP_S)
        if self._config.gnss and not self._telemetry.has_home:
            self._link.send_command(REQUEST, HOME_POSITION)
        if self._config.gnss and not self._telemetry.has_origin:
            self._link.send_command(REQUEST, GLOBAL_ORIGIN)
        self._set_up_s = now_s

    def _take_ack(self, ack: CommandAck, now_s: float) -> None:
        """Refusals are kept as a reason to report; acceptance only counts once the heartbeat shows it."""
        if ack.command in (_SET_MODE, _LAND):
            self._requests.acked()
        if ack.command in _WATCHED and ack.result in _RESULTS:
            text = f"the autopilot refuses {_WATCHED[ack.command]}: {_RESULTS[ack.result]}"
            self._refusal = CodedText(Code.AUTOPILOT_REFUSAL, text), now_s

    def _stream(self, setpoint: Setpoint | None, now_s: float) -> bool:
        """Send the setpoint; returns whether offboard mode may be requested.

        A setpoint planned before a jump of the frame would be wrong by the jump. None is sent until the pilot knows the new
        frame.
        """
        launch = self._telemetry.launch.place
        if setpoint is None or launch is None or self._telemetry.frame_in_doubt:
            return False
        return self._setpoints.send(setpoint, launch, now_s)

    def _ask(self, act: Act, command: VehicleCommand) -> None:
        match act:
            case Act.SET_TAKEOFF_ALTITUDE:
                fields = {"param_id": TAKEOFF_ALTITUDE, "param_value": command.takeoff_height_m, "param_type": FLOAT}
                self._link.send("PARAM_SET", fields)
            case Act.ARM:
                self._link.send_command(_ARM, 1)
            case Act.DISARM:
                self._link.send_command(_ARM, 0)
            case Act.TAKE_OFF:
                self._link.send_command(_TAKE_OFF)
            case Act.LAND:
                self._link.send_command(_LAND)
            case Act.OFFBOARD | Act.HOLD | Act.RETURN:
                self._link.send_command(_SET_MODE, SET_MODE_FLAGS, *CUSTOM_MODES[act])

    def _link_finding(self) -> Finding:
        now_s = self._clock_s()
        if self._link.is_signed:
            return Finding("autopilot", "failed", f"{self._config.address}: {SIGNED}")
        if not self._telemetry.is_lost(now_s):
            version, where = self._messages.version, self.exposure or self._config.address
            text = where if version is None else f"{where}, {version.text}"
            if version is not None and version.is_too_old:
                return Finding("autopilot", "failed", f"{text}: flash PX4 1.13 or later")
            return Finding("autopilot", "ok", text + (", its messages are not signed" if self._link.is_signed is False else ""))
        verdict: Literal["not yet", "failed"] = "not yet" if self._telemetry.seen is None else "failed"
        return Finding("autopilot", verdict, self._telemetry.problems(now_s)[0])

    def _readiness(self) -> Finding:
        reason, now_s = self._telemetry.not_ready(), self._clock_s()
        if reason is None:
            return Finding("ready to arm", "ok", "")
        return Finding("ready to arm", "not yet", "; ".join((reason, *self._told(now_s))))

    def _told(self, now_s: float) -> tuple[str, ...]:
        """The autopilot's own messages: on its failsafe or on what keeps it from being armed, and the recent ones."""
        seen = self._telemetry.seen
        lasting: tuple[str, ...] = ()
        if seen is not None and seen.failsafe and self._messages.failsafe:
            lasting = (self._messages.failsafe,)
        elif seen is not None and not seen.armed:
            lasting = self._messages.failed_checks(seen.mode)
        return tuple(dict.fromkeys((*lasting, *self._messages.recent(now_s))))

    def _vision_problems(self) -> tuple[CodedText, ...]:
        if self._vision is None or self._seeing is None:
            return ()
        if self._seeing.done() and not self._seeing.cancelled():
            text = f"internal error: poses of the vision system are not forwarded any more: {self._seeing.exception()!r}"
            return (CodedText(Code.INTERNAL_ERROR, text),)
        return self._vision.problems

    def _vision_finding(self) -> Finding:
        problems = self._vision_problems()
        return Finding("vision", "not yet", problems[0]) if problems else Finding("vision", "ok", "")

    def _launch_finding(self) -> Finding:
        launch, problem = self._telemetry.launch.place, self._telemetry.launch.problem
        if launch is None or problem is not None:
            return Finding("launch place", "not yet", problem or "no position from the autopilot yet")
        where = f"{launch.north_m:.1f} m north, {launch.east_m:.1f} m east, {-launch.down_m:.1f} m above the autopilot's origin"
        return Finding("launch place", "ok", where)
