"""A vehicle that does not know where it is: it stays, holds, and lands for good."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import TrackConfig
from radron.agent.mission.stages import Mission
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.messages import Action, Stage
from support.flights.situations import CALM, OFFBOARD, SECOND, VEHICLE, at, surveying

BLIND = replace(OFFBOARD, position_trusted=False)


def test_without_a_position_it_stays_by_its_setpoints_and_then_holds() -> None:
    mission = surveying()
    mission.step(at(10.0, BLIND))
    mission.step(at(10.9, BLIND))
    assert mission.request is Request.OFFBOARD
    mission.step(at(11.0, BLIND))
    assert mission.request is Request.HOLD
    for tick in range(60):  # a requested hold is no takeover
        mission.step(at(11.0 + 0.05 * tick, replace(BLIND, mode=FlightMode.HOLD)))
    assert not mission.released
    mission.step(at(14.0, replace(VEHICLE, mode=FlightMode.HOLD)))
    assert (mission.stage, mission.request) == (Stage.SURVEY, Request.OFFBOARD)


def test_a_pilot_may_take_a_drone_that_does_not_know_where_it_is() -> None:
    mission = surveying()
    for tick in range(100):
        mission.step(at(10.0 + 0.05 * tick, replace(BLIND, mode=FlightMode.MANUAL)))
    assert mission.released


def test_near_the_ground_it_lands_for_good() -> None:
    mission = surveying()
    descending = replace(BLIND, mode=FlightMode.LAND, healthy=False)
    for tick in range(60):  # from 3 m, by an estimate that stays there
        mission.step(at(10.0 + 0.05 * tick, descending))
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)
    assert "near the ground" in mission.flight.landed_because
    mission.step(at(20.0, OFFBOARD))  # satellites are back, and it went back to offboard by itself
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)


HOLDING_BLIND = replace(BLIND, mode=FlightMode.HOLD)


@pytest.mark.parametrize(("low_s", "lands_s", "why"), [(99.0, 40.0, "for 30 s"), (20.0, 20.0, "battery")])
def test_a_position_that_stays_lost_is_not_held_for_ever(low_s, lands_s, why) -> None:
    mission, landing_s = surveying(), []
    for tick in range(700):
        now_s = 10.0 + 0.05 * tick
        mission.step(at(now_s, HOLDING_BLIND, battery_low=now_s >= low_s))
        landing_s += [now_s] if mission.stage is Stage.LANDING else []
    assert landing_s[0] == pytest.approx(lands_s, abs=0.11)
    assert mission.request is Request.LAND
    assert why in mission.flight.landed_because


def landing_without_a_position():
    """Since 40 s."""
    mission = surveying()
    for tick in range(620):
        mission.step(at(10.0 + 0.05 * tick, HOLDING_BLIND))
    assert mission.stage is Stage.LANDING
    return mission


def test_while_it_lands_for_want_of_a_position_it_cannot_be_sent_elsewhere() -> None:
    mission = landing_without_a_position()
    refused = mission.command(Action.RETURN, 41 * SECOND, at(41.0))
    assert refused is not None
    assert "position could not be trusted" in refused
    assert mission.stage is Stage.LANDING
    assert mission.command(Action.ABORT, 42 * SECOND, at(42.0)) is None


def test_once_its_position_is_back_an_operator_may_send_it_home() -> None:
    """Without a command it lands on. Before, it turned back to landing at once, unreported."""
    mission = landing_without_a_position()
    for second in (41.0, 42.0, 43.0):
        mission.step(at(second, replace(VEHICLE, mode=FlightMode.LAND)))
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)
    assert mission.command(Action.RETURN, 44 * SECOND, at(44.0)) is None
    mission.step(at(45.0))
    assert (mission.stage, mission.request, mission.flight.landed_because) == (Stage.RETURN, Request.OFFBOARD, "")


def test_near_the_ground_not_even_then() -> None:
    mission = landing_without_a_position()
    mission.step(at(41.0, replace(VEHICLE, mode=FlightMode.LAND, height_m=0.6)))
    assert mission.command(Action.RETURN, 44 * SECOND, at(44.0)) is not None


def test_a_takeoff_goes_on_through_a_jump_and_ends_when_the_position_is_confirmed() -> None:
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    climbing = replace(VEHICLE, mode=FlightMode.TAKEOFF, in_air=False, height_m=1.0, position_trusted=False)
    for tick in range(60):
        mission.step(at(5.0 + 0.05 * tick, climbing))
    assert (mission.stage, mission.request) == (Stage.TAKEOFF, Request.TAKEOFF)
