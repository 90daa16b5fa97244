"""PX4's parameters: read with retries, checked with PX4's own enumerations, reported with the value to set."""

import math
import re
import struct
from pathlib import Path

import pytest
from msgspec.structs import replace

from radron.agent.config.drone import VehicleConfig, VisionConfig
from radron.agent.vehicle.demands import Demands
from radron.agent.vehicle.mavlink.messages import ParameterValue
from radron.agent.vehicle.parameters import (
    ASK_AGAIN_S,
    FLOAT,
    INT32,
    MOST_ASKS,
    NEGATIVE,
    REFRESH_S,
    Parameters,
    value_of,
)
from radron.agent.vehicle.rules import RETURN_ALTITUDE, RULES, rules_of

GOOD = {
    "COM_OF_LOSS_T": 1.0,
    "COM_OBL_RC_ACT": 3,
    "NAV_RCL_ACT": 2,
    "COM_LOW_BAT_ACT": 3,
    "RTL_RETURN_ALT": 30.0,
    "RTL_DESCEND_ALT": 10.0,
    "MPC_Z_V_AUTO_UP": 3.0,
    "GF_ACTION": 3,
    "GF_MAX_HOR_DIST": 200.0,
    "COM_DISARM_LAND": 2.0,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_TILTMAX_AIR": 45.0,
    "MPC_ACC_HOR": 3.0,
    "MPC_JERK_AUTO": 4.0,
    "MPC_LAND_SPEED": 0.7,
    "RTL_TYPE": 0,
    "RTL_MIN_DIST": 10.0,
    "MPC_XY_CRUISE": 5.0,
    "EKF2_NOAID_TOUT": 2_000_000,
}
MISSION = Demands(VehicleConfig(), 60.0, speed_mps=8.0, climb_mps=2.0, acceleration_mps2=4.0)


def message(name: str, value: float) -> ParameterValue:
    """As PX4 sends it and JSON brings it: an int32 as the bits of a float32, a NaN as null."""
    if isinstance(value, float):
        return ParameterValue(name, value, FLOAT)
    (bits,) = struct.unpack("<f", struct.pack("<i", value))
    return ParameterValue(name, None if math.isnan(bits) else bits, INT32)


def known(**changed: float) -> Parameters:
    parameters = Parameters(MISSION)
    parameters.due(0.0)
    for name, value in (GOOD | changed).items():
        parameters.receive(message(name, value))
    return parameters


def failed(parameters: Parameters) -> dict[str, str]:
    return {finding.name: finding.text for finding in parameters.findings() if finding.verdict == "failed"}


@pytest.mark.parametrize("value", [0, 3, 21196, -1, 1.5, -2.0])
def test_values_come_through_the_float_of_the_link(value: float) -> None:
    assert value_of(message("ANY", value)) == value


@pytest.mark.parametrize("number", [3.5e38, -1e300])
def test_a_number_that_no_parameter_can_hold(number: float) -> None:
    assert value_of(ParameterValue("ANY", number, INT32)) == NEGATIVE


def test_a_sane_vehicle_has_nothing_to_mend() -> None:
    assert failed(known()) == {}
    assert {finding.verdict for finding in known().findings()} == {"ok"}


@pytest.mark.parametrize(
    ("name", "value", "advice"),
    [
        ("COM_OF_LOSS_T", 5.0, "1 s"),
        ("COM_OBL_RC_ACT", 0, "3 (return)"),
        ("COM_OBL_RC_ACT", 6, "3 (return)"),
        ("COM_OBL_RC_ACT", -1, "3 (return)"),
        ("NAV_RCL_ACT", 5, "2 (return)"),
        ("COM_LOW_BAT_ACT", 0, "2 (land)"),
        ("RTL_RETURN_ALT", 60.0, "60 m"),
        ("RTL_DESCEND_ALT", 80.0, "60 m"),
        ("MPC_Z_V_AUTO_UP", 1.0, "2 to 3 m/s"),
        ("MPC_Z_V_AUTO_UP", 4.0, "2 to 3 m/s"),
        ("GF_ACTION", 1, "3 (return)"),
        ("GF_ACTION", 4, "3 (return)"),
        ("GF_MAX_HOR_DIST", 0.0, "distance"),
        ("COM_DISARM_LAND", 0.0, "2 s"),
        ("COM_DISARM_LAND", -1.0, "2 s"),
        ("COM_DISARM_LAND", 60.0, "at most 10"),
        ("MPC_XY_VEL_MAX", 2.0, "8 m/s or more"),
        ("MPC_Z_VEL_MAX_UP", 1.0, "2 m/s or more"),
        ("MPC_TILTMAX_AIR", 15.0, "23 degrees or more"),
        ("MPC_ACC_HOR", 2.0, "3 m/s2 or more"),
        ("MPC_JERK_AUTO", 2.0, "4 m/s3 or more"),
        ("MPC_LAND_SPEED", 0.3, "0.5 m/s or more"),
        ("MPC_XY_CRUISE", 1.0, "3 to 6 m/s"),
        ("RTL_TYPE", 1, "0 (home)"),
        ("RTL_MIN_DIST", 25.0, "12 m"),
        ("EKF2_NOAID_TOUT", 5_000_000, "2000000"),
    ],
)
def test_what_is_not_sane_is_told_with_what_to_set(name: str, value: float, advice: str) -> None:
    texts = failed(known(**{name: value}))
    assert list(texts) == [name]
    assert advice in texts[name]


def test_unanswered_names_are_asked_again_and_then_reported() -> None:
    parameters = Parameters(MISSION)
    names = set(GOOD) | {"MIS_TAKEOFF_ALT"}
    for ask in range(MOST_ASKS):
        assert {finding.verdict for finding in parameters.findings()} == {"not yet"}
        assert set(parameters.due(ask * ASK_AGAIN_S)) == names
        assert parameters.due(ask * ASK_AGAIN_S + 0.1) == []
    assert set(failed(parameters)) == {rule.name for rule in rules_of(MISSION)}


def test_others_are_read_and_not_judged() -> None:
    parameters = Parameters(MISSION, others=("SYS_HITL", "GF_ACTION"))
    assert parameters.due(0.0).count("GF_ACTION") == 1
    parameters.receive(message("SYS_HITL", 1))
    assert parameters.values == {"SYS_HITL": 1.0}
    assert "SYS_HITL" not in {finding.name for finding in parameters.findings()}
    assert "SYS_HITL" not in parameters.due(10 * REFRESH_S)
    assert parameters.wrong() == {}


def test_a_wrong_value_is_read_again_so_that_mending_it_shows() -> None:
    parameters = known(GF_ACTION=1)
    assert "GF_ACTION" not in parameters.due(REFRESH_S - 1.0)
    assert "GF_ACTION" in parameters.due(REFRESH_S)
    parameters.receive(message("GF_ACTION", 3))
    assert failed(parameters) == {}
    assert "GF_ACTION" not in parameters.due(10 * REFRESH_S)


VISION = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 4, "NAV_RCL_ACT": 3, "EKF2_EV_CTRL": 9, "EKF2_GPS_CTRL": 0}
VISION |= {"COM_LOW_BAT_ACT": 2, "EKF2_HGT_REF": 0, "EKF2_NOAID_TOUT": 1_000_000}
VISION |= {name: GOOD[name] for name in GOOD if name.startswith(("MPC_", "COM_DIS")) and name not in VISION}


def by_vision(gnss: bool, values: dict[str, float], **changed: float) -> Parameters:
    parameters = Parameters(Demands(VehicleConfig(gnss=gnss, vision=VisionConfig(address="127.0.0.1:1")), 60.0))
    parameters.due(0.0)
    for name, value in (values | changed).items():
        parameters.receive(message(name, value))
    return parameters


@pytest.mark.parametrize(
    ("name", "value", "advice"),
    [
        ("COM_OBL_RC_ACT", 3, "no home"),
        ("NAV_RCL_ACT", 2, "no home"),
        ("EKF2_EV_CTRL", 1, "0 and 3"),
        ("EKF2_GPS_CTRL", 7, "0"),
        ("EKF2_HGT_REF", 1, "barometer"),
        ("EKF2_NOAID_TOUT", 10_000_000, "5000000"),
    ],
)
def test_without_satellites_the_vision_must_guide(name: str, value: float, advice: str) -> None:
    assert failed(by_vision(False, VISION)) == {}  # no fence, no return: it has no home
    assert advice in failed(by_vision(False, VISION, **{name: value}))[name]


def test_a_vehicle_with_satellites_and_vision_needs_both() -> None:
    both = GOOD | {"EKF2_EV_CTRL": 1, "EKF2_NOAID_TOUT": 5_000_000}
    assert {finding.verdict for finding in by_vision(True, both).findings()} == {"ok"}
    assert "bit 0" in failed(by_vision(True, both, EKF2_EV_CTRL=8))["EKF2_EV_CTRL"]
    assert "EKF2_EV_CTRL" not in {finding.name for finding in Parameters(MISSION).findings()}


def test_the_return_altitude_is_set_to_the_drones_layer() -> None:
    parameters = Parameters(replace(MISSION, return_height_m=13.125, sets=True))
    parameters.due(0.0)
    assert parameters.height_to_set(0.0) is None  # not known yet
    for name, value in GOOD.items():
        parameters.receive(message(name, value))
    found = {finding.name: finding for finding in parameters.findings()}[RETURN_ALTITUDE]
    assert (found.verdict, found.text) == ("not yet", "is 30; the agent sets it to 13.125, the layer of this drone")
    assert parameters.height_to_set(1.0) == 13.125
    assert parameters.height_to_set(1.1) is None  # asked for, not confirmed yet
    parameters.receive(message(RETURN_ALTITUDE, 13.125))
    assert parameters.height_to_set(9.0) is None
    assert failed(parameters) == {}


def test_preflight_tells_the_layer_and_sets_nothing() -> None:
    parameters = Parameters(replace(MISSION, return_height_m=13.0))
    for name, value in GOOD.items():
        parameters.receive(message(name, value))
    assert parameters.height_to_set(1.0) is None
    found = {finding.name: finding for finding in parameters.findings()}[RETURN_ALTITUDE]
    assert (found.verdict, found.text) == ("ok", "30; the agent will set it to 13, the layer of this drone")


def test_an_autopilot_that_does_not_take_its_layer_fails() -> None:
    parameters = Parameters(replace(MISSION, return_height_m=13.0, sets=True))
    for name, value in GOOD.items():
        parameters.receive(message(name, value))
    asked = [parameters.height_to_set(ASK_AGAIN_S * turn) for turn in range(20)]
    assert asked.count(None) == 20 - MOST_ASKS
    assert "set it to 13, the layer of this drone" in failed(parameters)[RETURN_ALTITUDE]


def test_the_reaction_to_a_lost_agent_is_the_one_that_the_others_expect() -> None:
    parameters = Parameters(replace(MISSION, agent_lost="land"))
    for name, value in GOOD.items():
        parameters.receive(message(name, value))
    assert "set it to 4 (land)" in failed(parameters)["COM_OBL_RC_ACT"]


@pytest.mark.parametrize("page", ["drone.md", "localization.md"])
def test_the_tables_of_the_documentation_list_the_parameters_with_rules(page: str) -> None:
    """Each table its own: with satellites, and without."""
    vehicle = VehicleConfig() if page == "drone.md" else VehicleConfig(gnss=False, vision=VisionConfig(address="127.0.0.1:1"))
    text = (Path(__file__).parents[3] / "docs" / page).read_text()
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    listed = {name for row in rows for name in re.findall(r"`([A-Z][A-Z0-9_]+)`", row)}
    assert listed == {rule.name for rule in rules_of(Demands(vehicle, 60.0))}
    assert {rule.name for rule in RULES} >= listed
