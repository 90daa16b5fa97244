"""The autopilot's parameters that a flight relies on: what they must be, and what to set where they are not.

Values and their meanings are PX4's (commander, navigator and rtl parameters, 1.13 and later; of vision, 1.14 and later).
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from msgspec import Struct

from agent.vehicle.interface import Finding
from agent.vehicle.messages import ParameterValue

TAKEOFF_ALTITUDE = "MIS_TAKEOFF_ALT"
ASK_AGAIN_S = 0.5  # an unknown name gets no answer
MOST_ASKS = 6
REFRESH_S = 5.0  # a wrong one is read again, so that mending it shows
FLOAT, INT32 = 9, 6  # MAV_PARAM_TYPE
NEGATIVE = -1.0

_OFFBOARD_LOSS = {3: "return", 4: "land", 5: "hold"}
_REMOTE_LOSS = {1: "hold", 2: "return", 3: "land"}
_FENCE = {2: "hold", 3: "return", 5: "land"}
_EV_POSITION, _EV_YAW = 1, 8  # bits of EKF2_EV_CTRL
_GPS_HEIGHT = 1  # of EKF2_HGT_REF
_LONGEST_BLIND_US = 5_000_000.0

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
    return None if 0.0 < value <= 1.0 else "set it to 1 s or less: so long the vehicle flies on when the agent is gone"


def _below_ceiling(value: float, ceiling_m: float) -> str | None:
    return None if value < ceiling_m else f"set it below the mission's ceiling of {ceiling_m:g} m"


def _distance(value: float, _: float) -> str | None:
    return None if value > 0.0 else "set it to the farthest distance in metres that the mission needs: 0 means no fence"


def _guided_by_vision(value: float, _: float) -> str | None:
    return None if int(value) & _EV_POSITION else "set its bit 0: the autopilot is to use the positions of the vision"


def _guided_by_vision_alone(value: float, _: float) -> str | None:
    wanted = _EV_POSITION | _EV_YAW
    return (
        None
        if int(value) & wanted == wanted
        else "set its bits 0 and 3: without satellites position and heading are the vision's"
    )


def _no_satellites(value: float, _: float) -> str | None:
    return None if value == 0.0 else "set it to 0: satellites that are received now and then would pull it out of its frame"


def _height_without_satellites(value: float, _: float) -> str | None:
    return None if value != _GPS_HEIGHT else "set it to 0 (barometer), 2 (rangefinder) or 3 (vision): there are no satellites"


def _blind_time(value: float, _: float) -> str | None:
    return None if value <= _LONGEST_BLIND_US else "set it to 5000000 or less (us): so long it flies on when the vision is gone"


_OFFBOARD = Rule("COM_OF_LOSS_T", _loss_time)
_AGENT_GONE, _REMOTE_GONE = "what the vehicle does when the agent is gone", "what it does when the remote control is gone"
RULES = (
    _OFFBOARD,
    Rule("COM_OBL_RC_ACT", _one_of(_OFFBOARD_LOSS, _AGENT_GONE)),
    Rule("NAV_RCL_ACT", _one_of(_REMOTE_LOSS, _REMOTE_GONE)),
    Rule("RTL_RETURN_ALT", _below_ceiling),
    Rule("RTL_DESCEND_ALT", _below_ceiling),
    Rule("GF_ACTION", _one_of(_FENCE, "what it does at its own fence")),
    Rule("GF_MAX_HOR_DIST", _distance),
)
# Without satellites PX4 has no home: it can neither return nor keep a fence around it.
HOMELESS_RULES = (
    _OFFBOARD,
    Rule("COM_OBL_RC_ACT", _one_of(_without_return(_OFFBOARD_LOSS), f"{_AGENT_GONE}; it has no home to return to")),
    Rule("NAV_RCL_ACT", _one_of(_without_return(_REMOTE_LOSS), f"{_REMOTE_GONE}; it has no home to return to")),
    Rule("EKF2_EV_CTRL", _guided_by_vision_alone),
    Rule("EKF2_GPS_CTRL", _no_satellites),
    Rule("EKF2_HGT_REF", _height_without_satellites),
    Rule("EKF2_NOAID_TOUT", _blind_time),
)
VISION_RULES = (Rule("EKF2_EV_CTRL", _guided_by_vision), Rule("EKF2_NOAID_TOUT", _blind_time))


def rules_of(gnss: bool, vision: bool) -> tuple[Rule, ...]:
    """The rules for an autopilot that flies by satellites or without, and with the vision's poses from this agent or without."""
    if not gnss:
        return HOMELESS_RULES
    return RULES + VISION_RULES if vision else RULES


def value_of(message: ParameterValue) -> float:
    """The number in a PARAM_VALUE. PX4 puts the bits of an integer into the float.

    The bits of the negative integers next to 0 are a NaN, which is all that arrives: they come out as -1. No parameter that is
    read here may be negative.
    """
    if message.param_value is None:
        return NEGATIVE
    if message.param_type == FLOAT:
        return message.param_value
    (number,) = struct.unpack("<i", struct.pack("<f", message.param_value))
    return float(number)


class Parameters:
    """What is known of the parameters in ``rules``, and of the takeoff altitude."""

    def __init__(self, ceiling_m: float, rules: tuple[Rule, ...] = RULES) -> None:
        self._ceiling_m = ceiling_m
        self._rules = rules
        self._names = (*(rule.name for rule in rules), TAKEOFF_ALTITUDE)
        self._values: dict[str, float] = {}
        self._asked: dict[str, tuple[int, float]] = {}  # how often, and when last

    def receive(self, message: ParameterValue) -> None:
        """Take a PARAM_VALUE, asked for or not."""
        if message.param_id in self._names:
            self._values[message.param_id] = value_of(message)
            self._asked[message.param_id] = (0, self._asked.get(message.param_id, (0, 0.0))[1])

    def forget(self) -> None:
        """Begin anew: the autopilot may have been restarted, or be another one."""
        self._values.clear()
        self._asked.clear()

    def value(self, name: str) -> float | None:
        """The newest value, None while it is not known."""
        return self._values.get(name)

    def due(self, now_s: float) -> list[str]:
        """The names to ask the autopilot for now."""
        names = []
        for name in self._names:
            count, asked_s = self._asked.get(name, (0, float("-inf")))
            if now_s - asked_s >= self._pause_s(name, count):
                self._asked[name] = (count + 1, now_s)
                names.append(name)
        return names

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
            return Finding(name, "failed", "the autopilot does not answer for it: is it a PX4 of version 1.13 or later?")
        value, advice = self._values[name], self._advice(name)
        return Finding(name, "ok", f"{value:g}") if advice is None else Finding(name, "failed", f"is {value:g}; {advice}")
