"""The autopilot's parameters: read over the link with retries, and judged by ``radron.agent.vehicle.rules``."""

from __future__ import annotations

import struct

from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.interface import Finding
from radron.agent.vehicle.mavlink.messages import ParameterError, ParameterValue
from radron.agent.vehicle.rules import RETURN_ALTITUDE, rules_of

TAKEOFF_ALTITUDE = "MIS_TAKEOFF_ALT"
ASK_AGAIN_S = 0.5  # PX4 1.17 reports unknown names; older versions do not answer
MOST_ASKS = 6
REFRESH_S = 5.0  # a wrong value is read again, so that a correction shows
FLOAT, INT32 = 9, 6  # MAV_PARAM_TYPE
LARGEST_FLOAT = 3.4028234e38  # in single precision, which the link has
NEGATIVE = -1.0

_NO_SUCH = 1  # MAV_PARAM_ERROR


def float32(value: float) -> float:
    """Return a number rounded to single precision, in which MAVLink transports parameters."""
    rounded: float = struct.unpack("f", struct.pack("f", value))[0]
    return rounded


def value_of(message: ParameterValue) -> float:
    """Return the number in a PARAM_VALUE message. PX4 sends the bits of an integer in the field for a float.

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
    """Return the number for the float field of a PARAM_SET message: the inverse of ``value_of``.

    kind: MAV_PARAM_TYPE. Integers must not be negative.
    """
    if kind == FLOAT:
        return value
    (bits,) = struct.unpack("<f", struct.pack("<i", round(value)))
    return float(bits)


class Parameters:
    """The known values of the autopilot's parameters: of those with rules, of the takeoff altitude, and of further names."""

    def __init__(self, demands: Demands, others: tuple[str, ...] = ()) -> None:
        """Start without known values. ``others``: names of further parameters, which are read but have no rule."""
        self.demands = demands
        height_m = demands.return_height_m if demands.vehicle.gnss else None
        self._return_m = float32(height_m) if height_m is not None else None
        self._sets, self._set_s = 0, float("-inf")
        self._rules = {rule.name: rule for rule in rules_of(demands)}
        self._names = tuple(dict.fromkeys((*self._rules, TAKEOFF_ALTITUDE, *others)))
        self._values: dict[str, float] = {}
        self._kinds: dict[str, int] = {}  # MAV_PARAM_TYPE
        self._asked: dict[str, tuple[int, float]] = {}  # how often, and when last asked for

    def receive(self, message: ParameterValue) -> None:
        """Take the value of an autopilot parameter in a PARAM_VALUE message, whether it was asked for or not."""
        if message.param_id in self._names:
            self._values[message.param_id] = value_of(message)
            self._kinds[message.param_id] = message.param_type
            self._asked[message.param_id] = (0, self._asked.get(message.param_id, (0, 0.0))[1])

    def refused(self, message: ParameterError) -> None:
        """Take a PARAM_ERROR message: the autopilot has no such parameter, and is not asked again."""
        if message.error == _NO_SUCH and message.param_id in self._names:
            self._values.pop(message.param_id, None)
            self._asked[message.param_id] = (MOST_ASKS, self._asked.get(message.param_id, (0, 0.0))[1])

    def forget(self) -> None:
        """Forget all parameter values and ask again: the autopilot may have been restarted, or replaced."""
        self._values.clear()
        self._sets = 0
        self._asked.clear()

    def value(self, name: str) -> float | None:
        """Return the newest value of an autopilot parameter, None while it is not known."""
        return self._values.get(name)

    @property
    def values(self) -> dict[str, float]:
        """All known values of autopilot parameters, by name."""
        return dict(self._values)

    def kind(self, name: str) -> int | None:
        """Return the type (MAV_PARAM_TYPE) of an autopilot parameter, None while it is not known."""
        return self._kinds.get(name)

    def wrong(self) -> dict[str, float]:
        """Return the present values of the autopilot parameters that must be changed, by name."""
        return {name: value for name, value in self._values.items() if self._advice(name) is not None}

    def due(self, now_s: float) -> list[str]:
        """Return the names of the parameters to ask the autopilot for now. They count as asked for."""
        names = []
        for name in self._names:
            count, asked_s = self._asked.get(name, (0, float("-inf")))
            if now_s - asked_s >= self._pause_s(name, count):
                self._asked[name] = (count + 1, now_s)
                names.append(name)
        return names

    def height_to_set(self, now_s: float) -> float | None:
        """Return the return altitude (m) to set in the autopilot now; None if it is right, not known yet, or refused."""
        value, wanted = self._values.get(RETURN_ALTITUDE), self._return_m
        if (
            not self.demands.sets
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
        rule = self._rules.get(name)
        return None if rule is None else rule.check(self._values[name], self.demands)

    def findings(self) -> list[Finding]:
        """Return one line of the preflight check for each parameter that has a rule."""
        return [self._finding(name) for name in self._rules]

    def _finding(self, name: str) -> Finding:
        if name not in self._values:
            if self._asked.get(name, (0, 0.0))[0] < MOST_ASKS:
                return Finding(name, "not yet", "being read")
            return Finding(name, "failed", "unknown to the autopilot: is it a PX4 of version 1.13 or later?")
        value, advice = self._values[name], self._advice(name)
        if name == RETURN_ALTITUDE and self._return_m not in (None, value):
            if not self.demands.sets:
                return Finding(name, "ok", f"{value:g}; the agent will set it to {self._return_m:g}, the layer of this drone")
            if self._sets < MOST_ASKS:
                return Finding(name, "not yet", f"is {value:g}; the agent sets it to {self._return_m:g}, the layer of this drone")
            advice = f"set it to {self._return_m:g}, the layer of this drone: the autopilot has not taken it from the agent"
        return Finding(name, "ok", f"{value:g}") if advice is None else Finding(name, "failed", f"is {value:g}; {advice}")
