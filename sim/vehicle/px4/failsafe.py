"""Emulation of PX4's failsafes: lost offboard stream, lost ground station, geofence, battery, lost position.

Times are measured ones of a real PX4. Failsafes caused by a stream or the position end with their cause, and the intended mode is
flown again; the others last until a mode is chosen or the vehicle is disarmed, and hold for COM_FAIL_ACT_T before they act.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import dist
from typing import NamedTuple

from radron.sim.geometry import Vector3
from radron.sim.vehicle.px4 import events
from radron.sim.vehicle.px4.battery import Warning
from radron.sim.vehicle.px4.events import Action, Announcement, Cause
from radron.sim.vehicle.px4.modes import Mode
from radron.sim.vehicle.px4.parameters import Parameters

STREAM_END_DELAY_S = 0.05  # delay beyond COM_OF_LOSS_T until the end of a stream is noticed
FENCE_BACK_M = 1.0  # distance inside the fence at which the breach ends
_MODES = {Action.HOLD: Mode.HOLD, Action.RETURN: Mode.RETURN, Action.LAND: Mode.LAND, Action.DESCEND: Mode.DESCEND}
_OFFBOARD_LOSS = {4: Action.LAND, 5: Action.HOLD}  # COM_OBL_RC_ACT; the manual modes need a pilot at the sticks: return
_LINK_LOSS = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND}  # NAV_DLL_ACT
_FENCE = {2: Action.HOLD, 3: Action.RETURN, 5: Action.LAND}  # GF_ACTION
_BATTERY = {  # COM_LOW_BAT_ACT
    Warning.CRITICAL: {2: Action.LAND, 3: Action.RETURN},
    Warning.EMERGENCY: {2: Action.LAND, 3: Action.LAND},
}
_WARNINGS = {
    Warning.LOW: events.BATTERY_LOW,
    Warning.CRITICAL: events.BATTERY_CRITICAL,
    Warning.EMERGENCY: events.BATTERY_EMERGENCY,
}


class Situation(NamedTuple):
    """State of a vehicle that the failsafes need. Positions are local.

    offboard_silent_s: time since the last offboard target, 0 unless offboard is intended.
    """

    offboard_silent_s: float
    position: Vector3
    home: Vector3
    knows_position: bool
    has_home: bool
    station_lost: bool
    battery: Warning


@dataclass(frozen=True, slots=True)
class Fallback:
    """Decision of the failsafes: whether one is active, and the mode to fly; None: unchanged.

    here: the vehicle holds where the failsafe began, not at its stopping point.
    """

    active: bool = False
    mode: Mode | None = None
    here: bool = False


class _Reason(NamedTuple):
    action: Action
    cause: Cause
    lasts: bool  # outlasts its cause; it then holds first


class Failsafes:
    """Emulates the failsafes of one PX4 vehicle while it is armed. Failsafes that terminate the flight are left out.

    beyond_fence: the vehicle was outside the geofence at the latest step.
    """

    def __init__(self, parameters: Parameters, step_s: float, announce: Callable[[Announcement], None]) -> None:
        self.beyond_fence = False
        self._parameters, self._step_s, self._announce = parameters, step_s, announce
        self._warned = Warning.NONE
        self._overruled: set[str] = set()  # causes that persist, but were overruled by a chosen mode
        self._lasting: dict[str, _Reason] = {}
        self._present: set[str] = set()
        self._active_s = 0.0
        self._shown: tuple[Action, bool] | None = None

    def mode_chosen(self) -> None:
        """Take into account that a mode was chosen: present causes no longer count until they occur again."""
        still = self._lasting.keys() & self._present
        if still:
            self._announce(events.OVERRULED)
        self._overruled |= still
        self._lasting.clear()

    def end(self) -> None:
        """Reset the failsafes, as the vehicle has been disarmed."""
        self._lasting.clear()
        self._overruled.clear()
        self._shown = None

    def check(self, now: Situation, intended: Mode) -> Fallback:
        """Return the failsafes' decision for this time step."""
        self._watch_fence(now)
        self._watch_battery(now.battery)
        found = self._found(now)
        self._present = set(found)
        self._overruled &= self._present
        passing = []
        for name, reason in found.items():
            if not reason.lasts:
                passing.append(reason)
            elif name not in self._overruled:
                self._lasting[name] = reason
        reasons = [*passing, *self._lasting.values()]
        if not reasons:
            self._shown = None
            return Fallback()
        return self._act(max(reasons), intended, now.has_home)

    def warn(self, battery: Warning) -> None:
        """Announce battery warnings of a disarmed vehicle."""
        self._watch_battery(battery)

    def _act(self, reason: _Reason, intended: Mode, has_home: bool) -> Fallback:
        self._active_s = 0.0 if self._shown is None else self._active_s + self._step_s
        delay_s = self._parameters["COM_FAIL_ACT_T"]
        waits = reason.lasts and reason.action is not Action.HOLD and self._active_s < delay_s
        action = reason.action
        if action is Action.RETURN and not has_home:
            action = Action.LAND
        before, self._shown = self._shown, (Action.HOLD if waits else action, waits)
        if waits and before is None:
            self._announce(events.hold_first(intended, action, delay_s, reason.cause))
        elif not waits and self._shown != before:
            self._announce(events.failsafe(intended, action, reason.cause))
        at_the_fence = reason.lasts and reason.action is Action.HOLD and reason.cause is Cause.GENERIC
        return Fallback(True, _MODES[self._shown[0]], at_the_fence)

    def _found(self, now: Situation) -> dict[str, _Reason]:
        value = self._parameters
        found = {}
        if now.offboard_silent_s > value["COM_OF_LOSS_T"] + STREAM_END_DELAY_S:
            action = _OFFBOARD_LOSS.get(int(value["COM_OBL_RC_ACT"]), Action.RETURN)
            found["stream"] = _Reason(action, Cause.GENERIC, lasts=False)
        if not now.knows_position:
            found["position"] = _Reason(Action.DESCEND, Cause.GENERIC, lasts=False)
        lasting = {
            "station": (now.station_lost, _LINK_LOSS.get(int(value["NAV_DLL_ACT"])), Cause.GROUND_STATION_LOST),
            "fence": (self.beyond_fence, _FENCE.get(int(value["GF_ACTION"])), Cause.GENERIC),
        }
        for level, cause in ((Warning.CRITICAL, Cause.BATTERY_CRITICAL), (Warning.EMERGENCY, Cause.BATTERY_EMERGENCY)):
            lasting[cause.name] = (now.battery >= level, _BATTERY[level].get(int(value["COM_LOW_BAT_ACT"])), cause)
        for name, (present, action_or_none, cause) in lasting.items():
            if present and action_or_none is not None:
                found[name] = _Reason(action_or_none, cause, lasts=True)
        return found

    def _watch_fence(self, now: Situation) -> None:
        widest_m, highest_m = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        known = now.has_home and now.knows_position  # home is the centre of the fence
        slack_m = FENCE_BACK_M if self.beyond_fence else 0.0
        far_m, up_m = dist(now.position[:2], now.home[:2]) + slack_m, now.position[2] - now.home[2] + slack_m
        beyond = 0.0 < widest_m < far_m or 0.0 < highest_m < up_m
        before, self.beyond_fence = self.beyond_fence, known and beyond
        if self.beyond_fence and not before:
            self._announce(events.BEYOND_FENCE)

    def _watch_battery(self, warning: Warning) -> None:
        if warning is Warning.LOW < self._warned:
            self._announce(_WARNINGS[warning])  # less severe than before
        for level, announcement in _WARNINGS.items():
            if self._warned < level <= warning:
                self._announce(announcement)
                if level is Warning.LOW:
                    self._announce(events.RETURN_ADVISED)
        self._warned = warning
