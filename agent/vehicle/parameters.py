"""The autopilot's parameters that a flight relies on: their allowed values, and what to set otherwise.

Values and their meanings are PX4's (commander, navigator and rtl parameters, 1.13 and later; of vision, 1.14 and later).
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from msgspec import Struct

from agent.vehicle.interface import Finding
from agent.vehicle.mavlink.messages import ParameterError, ParameterValue
from agent.vehicle.trust import drift_m

TAKEOFF_ALTITUDE = "MIS_TAKEOFF_ALT"
RETURN_ALTITUDE = "RTL_RETURN_ALT"
ASK_AGAIN_S = 0.5  # PX4 1.17 reports unknown names; older versions do not answer
MOST_ASKS = 6
REFRESH_S = 5.0  # a wrong value is read again, so that a correction shows
FLOAT, INT32 = 9, 6  # MAV_PARAM_TYPE
LARGEST_FLOAT = 3.4028234e38  # in single precision, which the link has
NEGATIVE = -1.0

_OFFBOARD_LOSS = {3: "return", 4: "land", 5: "hold"}
_REMOTE_LOSS = {1: "hold", 2: "return", 3: "land"}
_BATTERY_EMPTY = {2: "land", 3: "return, and land if it gets too low for that"}
_FENCE = {2: "hold", 3: "return", 5: "land"}
_EV_POSITION, _EV_YAW = 1, 8  # bits of EKF2_EV_CTRL
_GPS_HEIGHT = 1  # of EKF2_HGT_REF
_LONGEST_BLIND_US = 5_000_000.0
# With satellites: after their loss the position error of a real PX4 was 1.9 m after 2 s, 3.4 m after 3 s, and 7.8 m after 5 s,
# its default; the separation of vehicles is 3 m. PX4 accepts no value below half a second.
_LONGEST_DRIFT_US, _SHORTEST_DRIFT_US = 2_000_000.0, 500_000.0
_NO_SUCH = 1  # MAV_PARAM_ERROR

Check = Callable[[float, float], str | None]  # value, ceiling -> what to do, or None


class Rule(Struct, frozen=True):
    """A parameter, and the check of its value: what to set, or None."""

    name: str
    check: Check


def _one_of(choices: dict[int, str], what: str) -> Check:
    allowed = ", ".join(f"{number} ({word})" for number, word in choices.items())
    return lambda value, _: None if value in choices else f"set it to {allowed}: {what}"


def _without_return(choices: dict[int, str]) -> dict[int, str]:
    return {number: word for number, word in choices.items() if word != "return"}


def _loss_time(value: float, _: float) -> str | None:
    return None if 0.0 < value <= 1.0 else "set it to 1 s or less: the vehicle flies on for this long without the agent"


def _climb_rate(value: float, _: float) -> str | None:
    return None if value >= 2.0 else "set it to 2 m/s or more: the other drones expect it to leave the place of a failsafe soon"


def _below_ceiling(value: float, ceiling_m: float) -> str | None:
    return None if value < ceiling_m else f"set it below the mission's ceiling of {ceiling_m:g} m"


def _distance(value: float, _: float) -> str | None:
    return None if value > 0.0 else "set it to the largest distance in metres that the mission needs: 0 means no fence"


def _guided_by_vision(value: float, _: float) -> str | None:
    return None if int(value) & _EV_POSITION else "set its bit 0: the autopilot must use the positions of the vision system"


def _guided_by_vision_alone(value: float, _: float) -> str | None:
    wanted = _EV_POSITION | _EV_YAW
    return (
        None
        if int(value) & wanted == wanted
        else "set its bits 0 and 3: without satellites, position and heading come from the vision system"
    )


def _no_satellites(value: float, _: float) -> str | None:
    return None if value == 0.0 else "set it to 0: occasional satellite fixes would shift its local frame"


def _height_without_satellites(value: float, _: float) -> str | None:
    return None if value != _GPS_HEIGHT else "set it to 0 (barometer), 2 (rangefinder) or 3 (vision): there are no satellites"


def _blind_time(value: float, _: float) -> str | None:
    return None if value <= _LONGEST_BLIND_US else "set it to 5000000 or less (us): it flies on for this long without vision"


def _drift_time(value: float, _: float) -> str | None:
    if _SHORTEST_DRIFT_US <= value <= _LONGEST_DRIFT_US:
        return None
    lost_m = drift_m(min(value, 5e6) * 1e-6)
    return (
        f"set it to {_LONGEST_DRIFT_US:.0f} or less (us; {_SHORTEST_DRIFT_US:.0f} at least): it flies on for this long without "
        f"satellites, and its position may then be wrong by {lost_m:.0f} m"
    )


_OFFBOARD = Rule("COM_OF_LOSS_T", _loss_time)
# Of an agent that ends in takeoff or hold, PX4 notices nothing: the battery is what ends such a flight.
_BATTERY = Rule("COM_LOW_BAT_ACT", _one_of(_BATTERY_EMPTY, "what ends a hold if neither agent nor pilot does"))
_AGENT_GONE, _REMOTE_GONE = "the reaction to the loss of the agent", "the reaction to the loss of the remote control"
RULES = (
    _OFFBOARD,
    Rule("COM_OBL_RC_ACT", _one_of(_OFFBOARD_LOSS, _AGENT_GONE)),
    Rule("NAV_RCL_ACT", _one_of(_REMOTE_LOSS, _REMOTE_GONE)),
    _BATTERY,
    Rule(RETURN_ALTITUDE, _below_ceiling),
    Rule("RTL_DESCEND_ALT", _below_ceiling),
    Rule("MPC_Z_V_AUTO_UP", _climb_rate),
    Rule("GF_ACTION", _one_of(_FENCE, "the reaction at its own fence")),
    Rule("GF_MAX_HOR_DIST", _distance),
)
# Without satellites PX4 has no home: neither a return nor a fence around it is possible.
HOMELESS_RULES = (
    _OFFBOARD,
    Rule("COM_OBL_RC_ACT", _one_of(_without_return(_OFFBOARD_LOSS), f"{_AGENT_GONE}; there is no home to return to")),
    Rule("NAV_RCL_ACT", _one_of(_without_return(_REMOTE_LOSS), f"{_REMOTE_GONE}; there is no home to return to")),
    _BATTERY,
    Rule("EKF2_EV_CTRL", _guided_by_vision_alone),
    Rule("EKF2_GPS_CTRL", _no_satellites),
    Rule("EKF2_HGT_REF", _height_without_satellites),
    Rule("EKF2_NOAID_TOUT", _blind_time),
)
SATELLITE_RULES = (Rule("EKF2_NOAID_TOUT", _drift_time),)
VISION_RULES = (Rule("EKF2_EV_CTRL", _guided_by_vision), Rule("EKF2_NOAID_TOUT", _blind_time))


def rules_of(gnss: bool, vision: bool, agent_lost: str | None = None) -> tuple[Rule, ...]:
    """The rules for an autopilot with or without satellites, and with or without vision poses from this agent.

    ``agent_lost``: the reaction that the mission's drones expect of each other; None: any. Without satellites none returns.
    """
    if not gnss:
        return HOMELESS_RULES
    expected = {number: word for number, word in _OFFBOARD_LOSS.items() if word == agent_lost}
    first = Rule("COM_OBL_RC_ACT", _one_of(expected, f"{_AGENT_GONE} that the mission names")) if expected else None
    rules = tuple(first if first is not None and rule.name == first.name else rule for rule in RULES)
    return rules + VISION_RULES if vision else rules + SATELLITE_RULES


def float32(value: float) -> float:
    """Rounded to the precision of a parameter."""
    rounded: float = struct.unpack("f", struct.pack("f", value))[0]
    return rounded


def value_of(message: ParameterValue) -> float:
    """The number in a PARAM_VALUE. PX4 puts the bits of an integer into the float.

    The bits of negative integers close to 0 are a NaN, which arrives without its bits: the result is -1. No parameter that is
    judged here may be negative.
    """
    if message.param_value is None or abs(message.param_value) > LARGEST_FLOAT:
        return NEGATIVE
    if message.param_type == FLOAT:
        return message.param_value
    (number,) = struct.unpack("<i", struct.pack("<f", message.param_value))
    return float(number)


def wire_value(value: float, kind: int) -> float:
    """The number for a PARAM_SET: the inverse of ``value_of``. Integers are not negative."""
    if kind == FLOAT:
        return value
    (bits,) = struct.unpack("<f", struct.pack("<i", round(value)))
    return float(bits)


class Parameters:
    """The values of the parameters in ``rules``, of the takeoff altitude, and of others, as far as they are known."""

    def __init__(
        self,
        ceiling_m: float,
        rules: tuple[Rule, ...] = RULES,
        return_height_m: float | None = None,
        *,
        sets: bool = True,
        others: tuple[str, ...] = (),
    ) -> None:
        """``return_height_m``: of this drone's return, to be set on its autopilot, or, without ``sets``, to be set before the
        start; None: that is left as it is. ``others``: names of parameters that are read, but not judged.
        """
        self._may_set = sets
        self._ceiling_m = ceiling_m
        self._return_m = float32(return_height_m) if return_height_m is not None else None
        self._sets, self._set_s = 0, float("-inf")
        self._rules = rules
        self._names = tuple(dict.fromkeys((*(rule.name for rule in rules), TAKEOFF_ALTITUDE, *others)))
        self._values: dict[str, float] = {}
        self._kinds: dict[str, int] = {}  # MAV_PARAM_TYPE
        self._asked: dict[str, tuple[int, float]] = {}  # how often, and when last asked for

    def receive(self, message: ParameterValue) -> None:
        """Take a PARAM_VALUE, asked for or not."""
        if message.param_id in self._names:
            self._values[message.param_id] = value_of(message)
            self._kinds[message.param_id] = message.param_type
            self._asked[message.param_id] = (0, self._asked.get(message.param_id, (0, 0.0))[1])

    def refused(self, message: ParameterError) -> None:
        """Take a PARAM_ERROR: there will be no answer."""
        if message.error == _NO_SUCH and message.param_id in self._names:
            self._values.pop(message.param_id, None)
            self._asked[message.param_id] = (MOST_ASKS, self._asked.get(message.param_id, (0, 0.0))[1])

    def forget(self) -> None:
        """Start again: the autopilot may have been restarted, or be another one."""
        self._values.clear()
        self._sets = 0
        self._asked.clear()

    def value(self, name: str) -> float | None:
        """The newest value, None while it is not known."""
        return self._values.get(name)

    @property
    def values(self) -> dict[str, float]:
        """All that are known."""
        return dict(self._values)

    def kind(self, name: str) -> int | None:
        """Its MAV_PARAM_TYPE, None while it is not known."""
        return self._kinds.get(name)

    def wrong(self) -> dict[str, float]:
        """The values that have to be changed, by name."""
        return {name: value for name, value in self._values.items() if self._advice(name) is not None}

    def due(self, now_s: float) -> list[str]:
        """The names to ask the autopilot for now."""
        names = []
        for name in self._names:
            count, asked_s = self._asked.get(name, (0, float("-inf")))
            if now_s - asked_s >= self._pause_s(name, count):
                self._asked[name] = (count + 1, now_s)
                names.append(name)
        return names

    def height_to_set(self, now_s: float) -> float | None:
        """The return altitude to set now; None where it is right, not known yet, or has been refused."""
        value, wanted = self._values.get(RETURN_ALTITUDE), self._return_m
        if (
            not self._may_set
            or wanted is None
            or value in (None, wanted)
            or self._sets >= MOST_ASKS
            or now_s - self._set_s < ASK_AGAIN_S
        ):
            return None
        self._sets, self._set_s = self._sets + 1, now_s
        return wanted

    def _pause_s(self, name: str, count: int) -> float:
        if name not in self._values:
            return ASK_AGAIN_S if count < MOST_ASKS else REFRESH_S
        return REFRESH_S if self._advice(name) is not None else float("inf")

    def _advice(self, name: str) -> str | None:
        value = self._values[name]
        return next((rule.check(value, self._ceiling_m) for rule in self._rules if rule.name == name), None)

    def findings(self) -> list[Finding]:
        """One line for each parameter."""
        return [self._finding(rule.name) for rule in self._rules]

    def _finding(self, name: str) -> Finding:
        if name not in self._values:
            if self._asked.get(name, (0, 0.0))[0] < MOST_ASKS:
                return Finding(name, "not yet", "being read")
            return Finding(name, "failed", "unknown to the autopilot: is it a PX4 of version 1.13 or later?")
        value, advice = self._values[name], self._advice(name)
        if name == RETURN_ALTITUDE and self._return_m not in (None, value):
            if not self._may_set:
                return Finding(name, "ok", f"{value:g}; the agent will set it to {self._return_m:g}, the layer of this drone")
            if self._sets < MOST_ASKS:
                return Finding(name, "not yet", f"is {value:g}; the agent sets it to {self._return_m:g}, the layer of this drone")
            advice = f"set it to {self._return_m:g}, the layer of this drone: the autopilot has not taken it from the agent"
        return Finding(name, "ok", f"{value:g}") if advice is None else Finding(name, "failed", f"is {value:g}; {advice}")
