"""The driver, given a real PX4's packets: it comes to the recorded states at the recorded times, whatever PX4 does.

Expected values come from the decoded timelines and the simulator's true state, made without the driver.
"""

from __future__ import annotations

import json
import lzma
from bisect import bisect_right
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from radron.agent.vehicle.interface import FlightMode
from radron.agent.vehicle.trust import CONFIRM_S
from support.px4.recorded import NAMES, Look, Replay

HERE = Path(__file__).parent / "recordings"
TIMELINES = {one["name"]: one for one in json.loads(lzma.decompress((HERE / "timelines.json.xz").read_bytes()))}
AIRBORNE = json.loads((HERE / "airborne.json").read_text())
LOOK_S = 0.25  # by which the driver may be behind: positions come ten times a second here
LATEST_S = 33.0  # after which PX4 notices at the latest that it has landed; two of these landings it never noticed
NEVER_NOTICED = ("B_offboard_landing_by_setpoints", "D_gps_loss_20s_hover")
MODES = {
    0x2040000: FlightMode.TAKEOFF,
    0x3040000: FlightMode.HOLD,
    0x5040000: FlightMode.RETURN,
    0x6040000: FlightMode.LAND,
    0x60000: FlightMode.OFFBOARD,
}


@cache
def replay(name: str) -> Replay:
    return Replay(name).run()


def rows(name: str, kind: str) -> list[tuple[float, list[Any]]]:
    return [(row[0] * 1e-3, row[2:]) for row in TIMELINES[name]["rows"] if row[1] == kind]


def newest(recorded: list[tuple[float, list[Any]]], time_s: float) -> list[Any] | None:
    """Row in force then; None where something changed a moment ago, or nothing is known yet."""
    place = bisect_right([at_s for at_s, _ in recorded], time_s)
    if place == 0 or time_s - recorded[place - 1][0] < LOOK_S:
        return None
    return recorded[place - 1][1]


def looks(name: str) -> list[Look]:
    return [look for look in replay(name).looks if look.state is not None]


@pytest.mark.parametrize("name", NAMES)
def test_mode_arming_and_failsafe_are_the_recorded_ones(name: str) -> None:
    heartbeats = rows(name, "heartbeat")
    judged = 0
    for look in looks(name):
        now, state = newest(heartbeats, look.time_s), look.state
        if now is None or state is None:
            continue
        custom_mode, base_mode, status = now
        assert (state.mode, state.armed) == (MODES[custom_mode], bool(base_mode & 0x80)), look
        if state.armed:
            assert state.healthy is (status != 5), look
        elif status not in (3, 4):
            assert not state.healthy, look
        judged += 1
    assert judged > 20 or not rows(name, "global_origin")  # without an origin there is no launch place, so no state


@pytest.mark.parametrize("name", NAMES)
def test_in_the_air_is_in_the_air(name: str) -> None:
    """In the air where the true vehicle is, its own takeoff being over; and not any more when PX4 has noticed that it landed."""
    known, flights = AIRBORNE[name]["known"], AIRBORNE[name]["airborne"]
    landed = rows(name, "landed")
    for look in looks(name):
        state, time_s = look.state, look.time_s
        if state is None or not known or not known[0][0] <= time_s <= known[0][1]:
            continue
        flies = any(begin <= time_s <= end for begin, end in flights)
        down_s = time_s - max((end for _, end in flights if end < time_s), default=float("-inf"))
        up_s = time_s - max((begin for begin, _ in flights if begin <= time_s), default=float("-inf"))
        if state.in_air:
            began_by_setpoints = any(0.0 <= begin - time_s < 2.0 for begin, _ in flights)  # the rotors have run up
            assert flies or began_by_setpoints or down_s < LATEST_S or name in NEVER_NOTICED, look
        elif flies and state.armed:
            now = newest(landed, time_s)
            assert now is None or now[0] == 3 or up_s < 2.0 or 1 in now, look
            assert up_s < 6.0, look  # of its own takeoff


@pytest.mark.parametrize("name", [name for name in NAMES if rows(name, "global_origin")])
def test_what_was_never_said_is_no_problem(name: str) -> None:
    """No report on a flight without faults, except for the parameters that were not requested."""
    heartbeats, fixes = rows(name, "heartbeat"), rows(name, "fix")
    for look in looks(name):
        now, fix, state = newest(heartbeats, look.time_s), newest(fixes, look.time_s), look.state
        if now is None or fix is None or state is None or not (state.armed and state.in_air and state.position_trusted):
            continue
        calm = now[2] == 4 and fix[0] >= 3 and not any("refuses" in problem or "moved" in problem for problem in look.problems)
        if calm:
            assert [problem for problem in look.problems if "parameter" not in problem] == [], look


WORDS = [  # recording, begin and end (s), and the reports to all
    ("A_boot_nogcs_armtries", 2.2, 3.6, "the autopilot is not ready to arm in mode hold: prearm check"),
    ("A_boot_nogcs_armtries", 2.2, 3.6, "the autopilot says: Heading estimate not stable"),
    ("A_boot_gcs_armtries", 2.4, 3.6, "the autopilot says: Heading estimate not stable"),
    ("A_boot_gcs_armtries", 2.4, 3.4, "the autopilot says: Arming denied: Resolve system health failures first"),
    ("E_mission_d1_onboard", 2.5, 3.5, "the autopilot says: Heading estimate not stable"),
    ("E_mission_d2_onboard", 125.5, 126.2, "the autopilot says: No offboard signal"),
    ("B_offboard_then_NAV_LAND_then_second_flight", 24.5, 28.0, "the autopilot says: No offboard signal"),
    ("B_offboard_then_NAV_LAND_then_second_flight", 27.0, 28.0, "the autopilot refuses to arm: temporarily rejected"),
    ("D_loss_return_act3_hover", 7.6, 20.0, "the autopilot is in a failsafe"),
    ("D_loss_return_act3_hover", 7.6, 20.0, "the autopilot says: Failsafe: return"),
    ("D_loss_hold_act5_resume_after_3s", 7.4, 9.0, "the autopilot says: Failsafe: hold"),
    ("D_loss_land_act4_while_circling", 7.4, 17.0, "the autopilot says: Failsafe: land"),
    ("D_geofence_return_50m", 14.3, 18.0, "the autopilot says: Failsafe: return in 5 s"),
    ("D_datalink_loss_dll_act2_hold", 14.4, 18.0, "the autopilot says: Failsafe: ground station lost: return in 5 s"),
    ("D_datalink_loss_dll_act2_offboard", 19.9, 26.0, "the autopilot says: Failsafe: ground station lost: return"),
    ("D_battery_drain_60s", 57.8, 62.0, "the autopilot says: Failsafe: battery critically low: return in 5 s"),
    ("D_battery_drain_60s", 62.9, 70.0, "the autopilot says: Failsafe: battery nearly empty: land"),
    ("D_gps_loss_20s_hover", 8.5, 20.0, "the autopilot says: Failsafe: descend"),
    ("D_link_silence_onboard_12s", 2.0, 15.0, "the autopilot says: Failsafe: return"),
    ("D_all_sensors_stop_after_arming", 13.5, 22.0, "the autopilot says: No valid position estimate"),
]


@pytest.mark.parametrize(("name", "begin_s", "end_s", "words"), WORDS)
def test_everybody_is_told_what_the_autopilot_says(name: str, begin_s: float, end_s: float, words: str) -> None:
    told = [look for look in replay(name).looks if begin_s <= look.time_s <= end_s]
    assert told
    for look in told:
        assert words in look.problems, look


def test_a_parameter_that_does_not_exist_is_known_at_once() -> None:
    """PARAM_ERROR came within a millisecond of the request."""
    (asked_s,) = [time_s for time_s, (name, error) in rows("A_params", "param_error") if name == "COM_POSCTL_NAVL" and error == 1]
    assert asked_s < 1.0
    params = replay("A_params").vehicle.parameters
    assert params.value("COM_OF_LOSS_T") == 1.0
    assert params.value("NAV_RCL_ACT") == 2.0


@pytest.mark.parametrize("name", [name for name in NAMES if "gps_loss" in name])
def test_a_position_without_satellites_is_not_believed_and_its_sigma_is_more_than_its_error(name: str) -> None:
    fixes = rows(name, "fix")
    (lost_s,) = [time_s for time_s, (kind, _) in fixes if kind < 3]
    (found_s,) = [time_s for time_s, (kind, _) in fixes if kind >= 3 and time_s > lost_s]
    errors = rows(name, "error")
    assert errors
    distrusted = [look.time_s for look in looks(name) if look.state is not None and not look.state.position_trusted]
    assert distrusted[0] - lost_s < LOOK_S
    assert distrusted[-1] > found_s + CONFIRM_S - LOOK_S
    ends = [look for look in looks(name) if look.time_s > found_s + 10.0]
    assert all(look.state is not None and look.state.position_trusted for look in ends)
    for time_s, (north_m, east_m, *_) in errors:
        states = [state for at_s, state in replay(name).states if at_s <= time_s]
        if states and lost_s + LOOK_S < time_s < found_s:
            assert states[-1].position_sigma_m > (north_m**2 + east_m**2) ** 0.5, time_s


@pytest.mark.parametrize("name", [name for name in NAMES if name[0] in "BE"])
def test_a_flight_with_satellites_is_believed_all_along(name: str) -> None:
    for look in looks(name):
        if look.state is not None and look.state.armed and look.state.in_air:
            assert look.state.position_trusted, look


def test_a_frame_that_jumps_by_99_m_is_another_epoch() -> None:
    (_, first), (jumped_s, second) = replay("D_gps_loss_20s_hover").changes(lambda state: state.epoch)
    assert (first, second) == (0, 1)
    assert jumped_s == pytest.approx(24.35, abs=LOOK_S)
    before = [state for time_s, state in replay("D_gps_loss_20s_hover").states if time_s < jumped_s]
    assert before[-1].epoch == 0
    assert before[-1].position_m[0] > 80.0
    after = next(state for time_s, state in replay("D_gps_loss_20s_hover").states if time_s >= jumped_s)
    assert after.position_m[0] < -10.0
