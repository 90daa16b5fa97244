"""PX4's failsafes: lost offboard stream, lost data link, geofence, lost position. Times are those of a real PX4, measured."""

from __future__ import annotations

from dataclasses import dataclass
from math import dist

from agent.vehicle.interface import Vector3
from sim.vehicle.px4.modes import Mode
from sim.vehicle.px4.parameters import Parameters

NOTICED_S = 0.06  # after COM_OF_LOSS_T: the failsafe is announced
ACTED_S = 0.2  # after COM_OF_LOSS_T: the mode changes
LINK_NOTICED_S = 2.6  # after COM_DL_LOSS_T
_SEVERITY = (None, Mode.HOLD, Mode.RETURN, Mode.LAND)
_OFFBOARD_LOSS = {4: Mode.LAND, 5: Mode.HOLD}  # COM_OBL_RC_ACT; the modes by hand need somebody at the sticks: return
_LINK_LOSS = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND}  # NAV_DLL_ACT
_FENCE = {2: Mode.HOLD, 3: Mode.RETURN, 5: Mode.LAND}  # GF_ACTION


@dataclass(frozen=True, slots=True)
class Fallback:
    """Whether a failsafe is active, and the mode that it flies; none: as before."""

    active: bool = False
    mode: Mode | None = None


class Failsafes:
    """The failsafes of one vehicle while it is armed. Terminating ones are not emulated: nothing is done then."""

    def __init__(self, parameters: Parameters) -> None:
        self.ground_station_silent_s: float | None = None
        self.knows_position = self.has_home = True
        self._parameters = parameters
        self._beyond_fence = False
        self._fence_action: Mode | None = None
        self._overruled = False

    @property
    def ground_station_lost(self) -> bool:
        """No ground station, or not for COM_DL_LOSS_T."""
        silent_s = self.ground_station_silent_s
        return silent_s is None or silent_s > self._parameters["COM_DL_LOSS_T"]

    def mode_chosen(self) -> None:
        """Somebody chose a mode: what is wrong now no longer counts, until it comes anew."""
        self._fence_action = None
        self._overruled = True

    def check(self, offboard_silent_s: float, position: Vector3, home: Vector3) -> Fallback:
        """What is to be done now; ``offboard_silent_s``: since the last target, 0 where offboard is not intended."""
        found = (self._offboard(offboard_silent_s), self._link(), self._fence(position, home), self._lost())
        active = any(fallback.active for fallback in found)
        mode = max((fallback.mode for fallback in found), key=_SEVERITY.index)
        return Fallback(active, Mode.LAND if mode is Mode.RETURN and not self.has_home else mode)

    def _lost(self) -> Fallback:
        """Without a position it can only come down, which its heartbeat shows as landing."""
        return Fallback() if self.knows_position else Fallback(True, Mode.LAND)

    def _offboard(self, silent_s: float) -> Fallback:
        late_s = silent_s - self._parameters["COM_OF_LOSS_T"]
        if late_s < NOTICED_S:
            return Fallback()
        action = _OFFBOARD_LOSS.get(int(self._parameters["COM_OBL_RC_ACT"]), Mode.RETURN)
        return Fallback(True, action if late_s >= ACTED_S else None)

    def _link(self) -> Fallback:
        action = _LINK_LOSS.get(int(self._parameters["NAV_DLL_ACT"]))
        silent_s = self.ground_station_silent_s
        late_s = 0.0 if silent_s is None else silent_s - self._parameters["COM_DL_LOSS_T"] - LINK_NOTICED_S
        if action is None or late_s <= 0.0:
            self._overruled = False
            return Fallback()
        if self._overruled:
            return Fallback()
        return Fallback(True, action if late_s > self._parameters["COM_FAIL_ACT_T"] else Mode.HOLD)

    def _fence(self, position: Vector3, home: Vector3) -> Fallback:
        action = _FENCE.get(int(self._parameters["GF_ACTION"]))
        widest_m, highest_m = self._parameters["GF_MAX_HOR_DIST"], self._parameters["GF_MAX_VER_DIST"]
        if not self.has_home:
            return Fallback()  # home is where the fence is
        beyond = 0.0 < widest_m < dist(position[:2], home[:2]) or 0.0 < highest_m < position[2] - home[2]
        if beyond and not self._beyond_fence:
            self._fence_action = action
        self._beyond_fence = beyond
        return Fallback(self._fence_action is not None, self._fence_action)
