"""The autopilot's parameters that a flight relies on, once: required values, reasons, and corrections.

Preflight and status judge by this table (``radron.agent.vehicle.parameters``), and the doctor corrects by it
(``radron.agent.preflight.corrections``). The tables of the documentation list the same names. Values and their meanings are PX4's
(commander, navigator, rtl and mc_pos_control parameters, 1.13 and later; of vision, 1.14 and later).
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan, ceil, degrees

from msgspec import Struct

from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.trust import drift_m

RETURN_ALTITUDE = "RTL_RETURN_ALT"
FENCE_SPARE_M = 20.0  # between the agents' fence and the autopilot's own

_OFFBOARD_LOSS = {3: "return", 4: "land", 5: "hold"}
_REMOTE_LOSS = {1: "hold", 2: "return", 3: "land"}
_BATTERY_EMPTY = {2: "land", 3: "return, and land if it gets too low for that"}
_FENCE = {2: "hold", 3: "return", 5: "land"}
_HOME = {0: "home"}
_EV_POSITION, _EV_YAW = 1, 8  # bits of EKF2_EV_CTRL
_GPS_HEIGHT = 1  # of EKF2_HGT_REF
_GRAVITY_MPS2 = 9.80665
# Reactions to a lost agent, as the others expect them (``radron.agent.navigation.unheard.agentless``).
_CLIMB_MPS, _RETURN_MPS, _MIN_DESCENT_MPS = (2.0, 3.0), (3.0, 6.0), 0.5
_MIN_BRAKING_MPS2, _MIN_BRAKING_MPS3 = 3.0, 4.0
_MAX_LOW_RETURN_M = 12.0
_MAX_DISARMING_S = 10.0
_MAX_BLIND_US = 5_000_000.0
# With satellites: after their loss the position error of a real PX4 was 1.9 m after 2 s, 3.4 m after 3 s, and 7.8 m after 5 s,
# its default. The separation of vehicles is 3 m. PX4 accepts no value below half a second.
_MAX_DRIFT_US, _MIN_DRIFT_US = 2_000_000.0, 500_000.0

Check = Callable[[float, Demands], str | None]
Correct = Callable[[float, Demands], float | None]


class Rule(Struct, frozen=True):
    """The required value of one autopilot parameter.

    check: returns the advice on a wrong value, or None. correct: the value to set in place of a wrong one; None: only a person
    can choose. applies: whether an autopilot with these demands of its mission needs the rule.
    """

    name: str
    check: Check
    correct: Correct
    applies: Callable[[Demands], bool] = lambda _: True


def _one_of(choices: Callable[[Demands], dict[int, str]], why: Callable[[Demands], str]) -> Check:
    def check(value: float, demands: Demands) -> str | None:
        allowed = choices(demands)
        told = ", ".join(f"{number} ({word})" for number, word in allowed.items())
        return None if value in allowed else f"set it to {told}: {why(demands)}"

    return check


def _at_least(least: Callable[[Demands], float], unit: str, why: str) -> Check:
    return lambda value, demands: None if value >= least(demands) else f"set it to {least(demands):g} {unit} or more: {why}"


def _within(least: float, most: float, unit: str, why: str) -> Check:
    return lambda value, _: None if least <= value <= most else f"set it to {least:g} to {most:g} {unit}: {why}"


def _reactions(choices: dict[int, str], demands: Demands) -> dict[int, str]:
    """Return the possible reactions: for an autopilot without a home only the ones it can fly."""
    return choices if demands.vehicle.gnss else {number: word for number, word in choices.items() if word != "return"}


def _without_agent(demands: Demands) -> dict[int, str]:
    expected = {number: word for number, word in _OFFBOARD_LOSS.items() if word == demands.agent_lost}
    return _reactions(expected if demands.vehicle.gnss and expected else _OFFBOARD_LOSS, demands)


def _homeless(why: str, named: str = "") -> Callable[[Demands], str]:
    def told(demands: Demands) -> str:
        if not demands.vehicle.gnss:
            return f"{why}; there is no home to return to"
        return f"{why}{named}" if demands.agent_lost is not None else why

    return told


def _first(choices: Callable[[Demands], dict[int, str]], word: str) -> Correct:
    """Return the correction to a reaction, or to landing if that is not allowed."""

    def correct(_: float, demands: Demands) -> float:
        numbers = {name.split(",")[0]: number for number, name in choices(demands).items()}
        return float(numbers.get(demands.agent_lost or word, numbers.get(word, numbers.get("land", 0))))

    return correct


def _loss_time(value: float, _: Demands) -> str | None:
    return None if 0.0 < value <= 1.0 else "set it to 1 s or less: the vehicle flies on for this long without the agent"


def _disarming(value: float, _: Demands) -> str | None:
    if 0.0 < value <= _MAX_DISARMING_S:
        return None
    return f"set it to 2 s (above 0, at most {_MAX_DISARMING_S:g}): else the vehicle stays armed where it has landed"


def _below_ceiling(value: float, demands: Demands) -> str | None:
    return None if value < demands.ceiling_m else f"set it below the mission's ceiling of {demands.ceiling_m:g} m"


def _distance(value: float, _: Demands) -> str | None:
    return None if value > 0.0 else "set it to the largest distance in metres that the mission needs: 0 means no fence"


def _low_return(value: float, _: Demands) -> str | None:
    return None if value <= _MAX_LOW_RETURN_M else f"set it to {_MAX_LOW_RETURN_M:g} m or less: nearer to home it returns lower"


def _guided_by_vision(value: float, demands: Demands) -> str | None:
    wanted = _EV_POSITION if demands.vehicle.gnss else _EV_POSITION | _EV_YAW
    if int(value) & wanted == wanted:
        return None
    if demands.vehicle.gnss:
        return "set its bit 0: the autopilot must use the positions of the vision system"
    return "set its bits 0 and 3: without satellites, position and heading come from the vision system"


def _no_satellites(value: float, _: Demands) -> str | None:
    return None if value == 0.0 else "set it to 0: occasional satellite fixes would shift its local frame"


def _height_without_satellites(value: float, _: Demands) -> str | None:
    return None if value != _GPS_HEIGHT else "set it to 0 (barometer), 2 (rangefinder) or 3 (vision): there are no satellites"


def _blind_time(value: float, demands: Demands) -> str | None:
    if not demands.vehicle.by_satellites:
        return None if value <= _MAX_BLIND_US else "set it to 5000000 or less (us): it flies on for this long without vision"
    if _MIN_DRIFT_US <= value <= _MAX_DRIFT_US:
        return None
    lost_m = drift_m(min(value, 5e6) * 1e-6)
    return (
        f"set it to {_MAX_DRIFT_US:.0f} or less (us; {_MIN_DRIFT_US:.0f} at least): it flies on for this long without "
        f"satellites, and its position may then be wrong by {lost_m:.0f} m"
    )


def _tilt_deg(demands: Demands) -> float:
    """Tilt of the hardest acceleration of a plan."""
    return float(ceil(degrees(atan(demands.acceleration_mps2 / _GRAVITY_MPS2))))


def _always(value: float) -> Correct:
    return lambda _, __: value


def _has_home(demands: Demands) -> bool:
    """Without satellites PX4 has no home: neither a return nor a fence around it is possible."""
    return demands.vehicle.gnss


def _by_vision(demands: Demands) -> bool:
    return demands.vehicle.vision is not None or not demands.vehicle.gnss


def _by_vision_alone(demands: Demands) -> bool:
    return not demands.vehicle.gnss


_AGENT_GONE, _REMOTE_GONE = "the reaction to the loss of the agent", "the reaction to the loss of the remote control"
_STOPS = "the other drones expect it to stop as soon without its agent"
RULES = (
    Rule("COM_OF_LOSS_T", _loss_time, _always(1.0)),
    Rule(
        "COM_OBL_RC_ACT",
        _one_of(_without_agent, _homeless(_AGENT_GONE, " that the mission names")),
        _first(_without_agent, "return"),
    ),
    Rule(
        "NAV_RCL_ACT",
        _one_of(lambda demands: _reactions(_REMOTE_LOSS, demands), _homeless(_REMOTE_GONE)),
        lambda _, demands: 2.0 if demands.vehicle.gnss else 3.0,
    ),
    Rule(  # of an agent that ends in takeoff or hold PX4 notices nothing: the battery is what ends such a flight
        "COM_LOW_BAT_ACT",
        _one_of(lambda _: _BATTERY_EMPTY, lambda _: "what ends a hold if neither agent nor pilot does"),
        lambda _, demands: 3.0 if demands.vehicle.gnss else 2.0,
    ),
    Rule("COM_DISARM_LAND", _disarming, _always(2.0)),
    Rule(
        "MPC_XY_VEL_MAX",
        _at_least(lambda demands: demands.speed_mps, "m/s", "the mission's plans are as fast (limits.speed_mps)"),
        lambda _, demands: max(12.0, demands.speed_mps),
    ),
    Rule(
        "MPC_Z_VEL_MAX_UP",
        _at_least(lambda demands: demands.climb_mps, "m/s", "the mission's plans climb as fast (limits.climb_mps)"),
        lambda _, demands: max(3.0, demands.climb_mps),
    ),
    Rule(
        "MPC_TILTMAX_AIR",
        _at_least(_tilt_deg, "degrees", "the mission's plans accelerate as hard (limits.acceleration_mps2)"),
        lambda _, demands: max(45.0, _tilt_deg(demands)),
    ),
    Rule("MPC_ACC_HOR", _at_least(lambda _: _MIN_BRAKING_MPS2, "m/s2", _STOPS), _always(3.0)),
    Rule("MPC_JERK_AUTO", _at_least(lambda _: _MIN_BRAKING_MPS3, "m/s3", _STOPS), _always(4.0)),
    Rule("MPC_LAND_SPEED", _at_least(lambda _: _MIN_DESCENT_MPS, "m/s", "the others expect it to be down as soon"), _always(0.7)),
    Rule(RETURN_ALTITUDE, _below_ceiling, lambda _, demands: demands.return_height_m, _has_home),
    Rule("RTL_DESCEND_ALT", _below_ceiling, lambda _, demands: demands.return_height_m, _has_home),
    Rule(
        "RTL_TYPE",
        _one_of(lambda _: _HOME, lambda _: "the others expect it to return to its launch place"),
        _always(0.0),
        _has_home,
    ),
    Rule("RTL_MIN_DIST", _low_return, _always(10.0), _has_home),
    Rule(
        "MPC_Z_V_AUTO_UP",
        _within(*_CLIMB_MPS, "m/s", "the other drones expect it to leave the place of a failsafe soon, and no sooner"),
        _always(3.0),
        _has_home,
    ),
    Rule("MPC_XY_CRUISE", _within(*_RETURN_MPS, "m/s", "the others expect it to return as fast"), _always(5.0), _has_home),
    Rule("GF_ACTION", _one_of(lambda _: _FENCE, lambda _: "the reaction at its own fence"), _always(3.0), _has_home),
    Rule("GF_MAX_HOR_DIST", _distance, lambda _, demands: float(ceil(demands.farthest_m + FENCE_SPARE_M)), _has_home),
    Rule(
        "EKF2_EV_CTRL",
        _guided_by_vision,
        lambda before, demands: float(int(max(before, 0.0)) | (_EV_POSITION if demands.vehicle.gnss else _EV_POSITION | _EV_YAW)),
        _by_vision,
    ),
    Rule("EKF2_GPS_CTRL", _no_satellites, _always(0.0), _by_vision_alone),
    Rule("EKF2_HGT_REF", _height_without_satellites, lambda _, __: None, _by_vision_alone),  # by the sensors that it has
    Rule("EKF2_NOAID_TOUT", _blind_time, lambda _, demands: _MAX_DRIFT_US if demands.vehicle.by_satellites else _MAX_BLIND_US),
)


def rules_of(demands: Demands) -> tuple[Rule, ...]:
    """Return the rules for the parameters of an autopilot, given the demands of its mission."""
    return tuple(rule for rule in RULES if rule.applies(demands))


def correction(name: str, before: float, demands: Demands) -> float | None:
    """Return the value to set for a parameter whose value is wrong.

    Return None if only a person can choose the value, or if no rule needs the parameter. before: the present value.
    """
    return next((rule.correct(before, demands) for rule in rules_of(demands) if rule.name == name), None)
