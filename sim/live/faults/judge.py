"""Judgement of a live flight by conditions that must hold, from the true world and the agents' messages and logs."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Collection, Sequence
from math import asin, atan2, cos, degrees, hypot, remainder, sin, tau
from pathlib import Path
from typing import NamedTuple

import numpy as np

from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codes import Code
from radron.protocol.messages import AnyDroneMessage, Pose, Stage, Status
from radron.sim.campaign.faults.mission import Log
from radron.sim.faults.agents import Freeze, Kill, SlowCpu
from radron.sim.faults.base import Fault
from radron.sim.faults.machines import Disarm, StreamLost
from radron.sim.geometry import Quaternion
from radron.sim.live.monitor import Belief, ObservedAgent
from radron.sim.live.report import LiveReport
from radron.sim.live.worldlink import Truth
from radron.sim.scoring.invariants.base import Invariant, Setting, Violation
from radron.sim.scoring.invariants.beliefs import TruthPossible
from radron.sim.scoring.invariants.liveness import Landed
from radron.sim.scoring.invariants.space import Collision, Fence, Heights, Separation
from radron.sim.scoring.moment import OFF_GROUND_M, Scene

WRONG_SIGMAS, WRONG_M, WRONG_RAD, WRONG_S = 6.0, 1.0, 0.25, 2.0  # an own pose is wrong beyond all of these
STATUS_WITHIN_S = 6.0  # after 2 s without a message of the receiver its satellites count as lost; and a status comes each second
_INSTEAD = frozenset({Code.AUTOPILOT_LINK_LOST, Code.AUTOPILOT_DATA_MISSING})  # with these an agent names no single message
_SILENT = {
    "HEARTBEAT": _INSTEAD,
    "ATTITUDE_QUATERNION": _INSTEAD,
    "LOCAL_POSITION_NED": _INSTEAD,
    "GPS_RAW_INT": _INSTEAD | {Code.SATELLITES_LOST, Code.POSITION_DISPUTED, Code.POSITION_CONFIRMING},
}  # the codes by which an agent reports a message missing from its autopilot
_TRUTHS = 200  # 10 s of them
_DELAYED_NS = 700_000_000  # delay of stamps and world on a busy machine
_PAUSE_NS = 1_000_000_000  # between two poses: earlier poses do not count
_TRACEBACK = "Traceback (most recent call last)"


class _Member(NamedTuple):
    """An agent, as observed by its messages."""

    stage: Stage
    digest: str
    hypothesis: Belief | None


class _Autopilot(NamedTuple):
    mode: FlightMode
    armed: bool
    setpoint_age_s: float | None


class LiveJudge:
    """Judges one live flight by the conditions that must always hold.

    ``violations``: reports of violated conditions in order of time. ``log``: further numbers of the verdict; times since the
    start command.
    """

    def __init__(self, setting: Setting, agents: Sequence[ObservedAgent]) -> None:
        self.setting = setting
        self.landed, self.separation = Landed(setting), Separation(setting)
        self.invariants: tuple[Invariant[Scene], ...] = (
            self.separation, Collision(setting), Fence(setting), Heights(setting), TruthPossible(setting), self.landed,
        )  # fmt: skip
        self.violations: list[Violation] = []
        self._agents = agents
        self._poses = [OwnPose() for _ in agents]
        self._told: deque[tuple[int, Pose]] = deque()  # drones and their poses, until the truth around their stamps is known
        self._disarmed = [Disarmed(fault) for fault in setting.scenario.fault if isinstance(fault, Disarm)]
        silent = [fault for fault in setting.scenario.fault if isinstance(fault, StreamLost)]
        self._silent = [SilentStream(fault, name) for fault in silent for name in fault.strikes(setting.names)]
        self._truths: deque[Truth] = deque(maxlen=_TRUTHS)
        self.log = Log(len(setting.names))
        self.late_s = 0.0  # largest lag of the world behind the clock
        self._last: Scene | None = None

    def see(self, time_s: float, truth: Truth) -> bool:
        """Judge the true world, ``time_s`` seconds after the start command; return True if the flight is over."""
        self._truths.append(truth)
        self.late_s = max(self.late_s, truth.late_s)
        scene = self._last = self._scene(time_s, truth)
        self.log.see(scene, self.landed.able.drones)
        for invariant in self.invariants:
            self.violations += invariant.look(scene)
        self._check_poses(truth.stamp_ns)
        for disarmed in self._disarmed:
            for name in disarmed.broken(time_s, scene, self.setting.names):
                self._tell("disarmed", (name,), "somebody has disarmed it on the ground, and it is armed again")
        return time_s >= self.setting.end_s or (time_s > self.setting.heal_s and self.landed.is_over(scene))

    def hear(self, drone: int, message: AnyDroneMessage) -> None:
        """Judge an agent's message: its own pose must be possible, and missing autopilot messages must be reported."""
        if isinstance(message, Pose):
            self._told.append((drone, message))
        elif isinstance(message, Status) and self._truths:
            time_s = self.log.time_s + (message.stamp_ns - self._truths[-1].stamp_ns) * 1e-9
            for text in [text for silent in self._silent if (text := silent.check(time_s, message)) is not None]:
                self._tell("told", (message.drone,), text)

    def finish(self, logs: Sequence[Path], report: LiveReport, exits: dict[str, int | None]) -> None:
        """Judge the end of the flight. ``logs``: log files of the agents. ``exits``: exit codes of their processes."""
        if self._last is not None:
            for invariant in self.invariants:
                self.violations += invariant.finish(self._last)
        names = self.setting.names
        parted = {name for fault in self.setting.scenario.fault if self._parts(fault) for name in fault.strikes(names)}
        heard = [end for end in report.agents if end.alive and end.drone not in parted]
        told = {(end.digest, end.position_m) for end in heard}
        if len(told) > 1:
            text = f"{len({digest for digest, _ in told})} digests and {len(told)} beliefs at the end, with the cameras off"
            self._tell("convergence", tuple(end.drone for end in heard), text)
        for drone, code in exits.items():
            if code is not None and not any(_may_end(fault, drone) for fault in self.setting.scenario.fault):
                self._tell("process", (drone,), f"its agent ended by itself, exit code {code}")
        for name, log in zip(names, logs, strict=True):
            for text in exceptions(log):
                self._tell("exception", (name,), text)

    @property
    def able(self) -> Collection[int]:
        """Indices of the drones that must finish the mission; none before they are known."""
        return self.landed.able.drones or ()

    def _parts(self, fault: Fault) -> bool:
        """Return whether a fault separates drones for good: all others exchange their entries, also on the ground."""
        return fault.family == "network" and fault.end_s > self.setting.heal_s

    def _scene(self, time_s: float, truth: Truth) -> Scene:
        return Scene(
            time_s=time_s,
            position_m=np.array(truth.position_m),
            source=truth.source_m,
            pilots=[_member(agent) for agent in self._agents],
            autopilots=[
                _Autopilot(_mode(told.mode), told.armed, 0.0 if told.mode == "offboard" else None) for told in truth.vehicles
            ],
        )

    def _check_poses(self, now_ns: int) -> None:
        """Judge the poses old enough for all truths around their stamps: truths may arrive later than poses."""
        while self._told and self._told[0][1].stamp_ns <= now_ns - _DELAYED_NS:
            drone, pose = self._told.popleft()
            truths = [truth for truth in self._truths if abs(truth.stamp_ns - pose.stamp_ns) < _DELAYED_NS]
            told = self._poses[drone].check(pose, truths, drone, self.setting) if truths else None
            if told is not None:
                self._tell("own-pose", (self.setting.names[drone],), told)

    def _tell(self, name: str, drones: tuple[str, ...], text: str) -> None:
        self.violations.append(Violation(invariant=name, time_s=round(self.log.time_s, 3), drones=drones, text=text))


class OwnPose:
    """Requires that no drone publishes a pose for 2 s that excludes its true position or heading at 6 sigma.

    Separation and all measurements rest on these poses. Only poses in the first local frame are judged, and only with an exact
    launch layout in the mission.
    """

    def __init__(self) -> None:
        self._epoch: int | None = None
        self._since_ns = self._last_ns = 0
        self._wrong = False

    def check(self, pose: Pose, truths: Sequence[Truth], drone: int, setting: Setting) -> str | None:
        """Return the error of a pose in words, once it has lasted long enough; else None.

        ``truths``: states of the world, one of which the pose must match.
        """
        self._epoch = pose.epoch if self._epoch is None else self._epoch
        layout = setting.mission.drones[drone]
        if pose.epoch != self._epoch or not layout.is_exact:
            return None
        yaw_rad = np.radians(layout.yaw_deg)
        x, y, _ = pose.position_m
        east, north = x * cos(yaw_rad) - y * sin(yaw_rad), x * sin(yaw_rad) + y * cos(yaw_rad)
        east, north = east + layout.origin_m[0], north + layout.origin_m[1]
        off_m = min(hypot(east - truth.position_m[drone][0], north - truth.position_m[drone][1]) for truth in truths)
        heading = heading_rad(pose.quaternion) + yaw_rad
        turned = min(abs(remainder(heading - heading_rad(truth.attitude[drone]), tau)) for truth in truths)
        far = off_m > max(WRONG_M, WRONG_SIGMAS * pose.position_sigma_m)
        askew = turned > max(WRONG_RAD, WRONG_SIGMAS * pose.yaw_sigma_rad)
        if not (far or askew) or truths[-1].position_m[drone][2] < OFF_GROUND_M or pose.stamp_ns - self._last_ns > _PAUSE_NS:
            self._since_ns, self._wrong = pose.stamp_ns, False  # or the error begins here
        self._last_ns = pose.stamp_ns
        if self._wrong or pose.stamp_ns - self._since_ns < WRONG_S * 1e9:
            return None
        self._wrong = True
        return (
            f"it says that it is {off_m:.1f} m from where it is, sigma {pose.position_sigma_m:.2f} m, and turned by "
            f"{degrees(turned):.0f} degrees, sigma {degrees(pose.yaw_sigma_rad):.1f}, for {WRONG_S:g} s"
        )


class SilentStream:
    """Requires that a drone reports within 6 s that its autopilot has stopped sending a needed message.

    An agent started since then does not know the earlier messages.
    """

    def __init__(self, fault: StreamLost, drone: str) -> None:
        self._fault, self._drone, self._codes = fault, drone, _SILENT.get(fault.message)
        self._boot = ""  # of the agent at the begin of the fault

    def check(self, time_s: float, status: Status) -> str | None:
        """Return once that the report is missing in a status of that time; else None."""
        if self._codes is None or status.drone != self._drone:
            return None
        if time_s < self._fault.at_s:
            self._boot = status.boot
        due = self._fault.at_s + STATUS_WITHIN_S < time_s < self._fault.end_s and status.boot == self._boot
        if not due or any(text.code in self._codes for text in status.texts.problems):
            return None
        self._codes = None
        return f"its autopilot has not sent {self._fault.message} for {STATUS_WITHIN_S:g} s, and it does not say so"


class Disarmed:
    """Requires that a vehicle disarmed by a person on site before takeoff stays disarmed: a hand may be at its propellers."""

    def __init__(self, fault: Disarm) -> None:
        self._fault = fault
        self._was_armed: set[int] = set()
        self._off: set[int] = set()

    def broken(self, time_s: float, scene: Scene, names: Sequence[str]) -> list[str]:
        """Return the drones that are armed again now."""
        found = []
        for drone in [names.index(name) for name in self._fault.strikes(names)]:
            if scene.autopilots[drone].armed:
                if drone in self._off:
                    found.append(names[drone])
                    self._off.discard(drone)
                if time_s >= self._fault.at_s:
                    self._was_armed.add(drone)
            elif drone in self._was_armed and not scene.airborne(drone):
                self._was_armed.discard(drone)
                self._off.add(drone)
        return found


def exceptions(log: Path) -> list[str]:
    """Return the Python exceptions in an agent's log, the last line of each, without copies."""
    found: dict[str, None] = {}
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines() if log.is_file() else []
    for number, line in enumerate(lines):
        if _TRACEBACK not in line:
            continue
        try:
            told = str(json.loads(line)["exception"])
        except (ValueError, KeyError, TypeError):
            told = "\n".join(lines[number : number + 40])  # of the interpreter itself
        ends = [part for part in told.splitlines()[1:] if part and not part.startswith(" ")]
        found[ends[0] if ends else line] = None
    return list(found)


def heading_rad(quaternion: Quaternion) -> float:
    """Return the heading of an attitude (w, x, y, z) that rotates from body to world.

    It is the heading of the forward axis, or of the left axis if the forward axis is upright.
    """
    w, x, y, z = quaternion
    if abs(asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))) > 1.4:
        return atan2(-2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z))
    return atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _member(agent: ObservedAgent) -> _Member | None:
    if not agent.alive:
        return None
    return _Member(agent.stage, "" if agent.estimate is None else agent.estimate.digest, agent.hypothesis)


def _mode(told: str) -> FlightMode:
    """Return the mode in the autopilot's heartbeat; all modes flown by hand are one."""
    told = "land" if told == "descend" else told
    return FlightMode(told) if told in FlightMode.__members__.values() else FlightMode.MANUAL


def _may_end(fault: Fault, drone: str) -> bool:
    """Return whether a fault ends processes: by a signal, or by the watchdog of a frozen process."""
    return isinstance(fault, Kill | Freeze | SlowCpu) and drone in fault.strikes([drone])
