"""Flight authority: takeover by a failsafe, a pilot or a ground station; a late heartbeat or a slow mode is no takeover."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import TrackConfig
from radron.agent.mission.authority import FAILSAFE_NS, STALE_NS, TAKEOVER_NS, UNFOLLOWED_NS
from radron.agent.mission.stages import Mission
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.messages import Action, Stage
from support.flights.situations import CALM, OFFBOARD, SECOND, VEHICLE, at, surveying, tracking


def test_gives_way_to_the_failsafe_but_not_to_a_late_heartbeat():
    mission = tracking()
    returning = replace(VEHICLE, mode=FlightMode.RETURN)
    mission.step(at(20.0, returning, has_hypothesis=True, last_cone_ns=20 * SECOND))
    mission.step(at(20.5, OFFBOARD, has_hypothesis=True, last_cone_ns=20 * SECOND))
    mission.step(at(21.0, returning, has_hypothesis=True, last_cone_ns=20 * SECOND))
    mission.step(at(22.0, returning, has_hypothesis=True, last_cone_ns=20 * SECOND))
    assert mission.stage is Stage.TRACK
    mission.step(at(21.0 + TAKEOVER_NS / SECOND + 0.1, returning, has_hypothesis=True, last_cone_ns=20 * SECOND))
    assert (mission.stage, mission.request) == (Stage.RETURN, Request.RELEASE)
    mission.step(at(60.0, replace(returning, armed=False, in_air=False)))
    assert (mission.stage, mission.request) == (Stage.LANDED, Request.STAY)  # ready for the next start


def test_a_failsafe_that_passes_is_not_a_takeover():
    mission = tracking()
    failsafe = replace(VEHICLE, mode=FlightMode.RETURN, healthy=False)
    for second in (20.0, 21.0, 22.0, 22.9):
        mission.step(at(second, failsafe, has_hypothesis=True, last_cone_ns=20 * SECOND))
    assert (mission.stage, mission.request) == (Stage.TRACK, Request.OFFBOARD)
    mission.step(at(20.0 + FAILSAFE_NS / SECOND + 0.1, failsafe, has_hypothesis=True, last_cone_ns=20 * SECOND))
    assert (mission.stage, mission.request) == (Stage.RETURN, Request.RELEASE)


def test_gives_way_to_a_human_pilot_until_told_to_resume():
    mission = tracking()
    manual = replace(VEHICLE, mode=FlightMode.MANUAL)
    for second in (20.0, 22.0):
        mission.step(at(second, manual, has_hypothesis=True, last_cone_ns=20 * SECOND))
    assert (mission.stage, mission.request) == (Stage.HOLD, Request.RELEASE)
    assert mission.command(Action.RESUME, 30 * SECOND, at(30.0)) is None
    assert (mission.stage, mission.request) == (Stage.TRACK, Request.OFFBOARD)


def held_by(mission, vehicle, *seconds):
    for second in seconds:
        mission.step(at(second, vehicle, has_hypothesis=True, last_cone_ns=20 * SECOND))
    return mission.stage, mission.request


def test_gives_way_to_a_hold_from_the_ground_station_but_waits_for_offboard():
    mission = surveying()
    hold = replace(VEHICLE, mode=FlightMode.HOLD)
    mission.step(at(3.0, hold))
    mission.step(at(9.0, hold))
    assert mission.request is Request.OFFBOARD  # not yet in offboard: goes on asking
    mission.step(at(10.0, OFFBOARD))
    assert held_by(mission, hold, 11.0, 13.0) == (Stage.HOLD, Request.RELEASE)


def test_a_hold_that_it_asked_for_itself_is_nobodys_takeover_but_one_that_stays_is():
    """For want of telemetry it asks for a hold; the heartbeat shows it when it has long asked for offboard again."""
    mission = tracking()
    held_by(mission, OFFBOARD, 12.0, 13.0)
    mission.unheard(int(13.1 * SECOND), holds=True)
    held_by(mission, OFFBOARD, 13.2, 13.9)  # as the last heartbeat showed it
    assert held_by(mission, VEHICLE, 14.0, 15.0, 15.8) == (Stage.TRACK, Request.OFFBOARD)
    assert held_by(mission, OFFBOARD, 15.9, 17.0) == (Stage.TRACK, Request.OFFBOARD)
    assert held_by(mission, VEHICLE, 18.0, 19.6) == (Stage.HOLD, Request.RELEASE)


def test_a_hold_that_it_asked_for_itself_may_take_long_to_leave():
    """On a link that loses most packets: the hold was asked for between two pieces of telemetry, and offboard is not heard."""
    mission = tracking()
    held_by(mission, OFFBOARD, 12.0, 13.0)
    mission.unheard(14 * SECOND, holds=True)
    hold = replace(VEHICLE, mode=FlightMode.HOLD)
    assert held_by(mission, hold, *range(15, 40)) == (Stage.TRACK, Request.OFFBOARD)
    manual = replace(VEHICLE, mode=FlightMode.MANUAL)
    assert held_by(mission, manual, 40.0, 42.0) == (Stage.HOLD, Request.RELEASE)


def test_a_takeover_during_takeoff_and_landing_is_not_fought():
    manual = replace(VEHICLE, mode=FlightMode.MANUAL)
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    assert held_by(mission, manual, 2.0, 4.0) == (Stage.HOLD, Request.RELEASE)
    mission = tracking()
    mission.command(Action.LAND, 11 * SECOND, at(11.0))
    assert held_by(mission, manual, 12.0, 14.0) == (Stage.LANDING, Request.RELEASE)


def test_who_is_disarmed_during_takeoff_is_not_armed_again():
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    grounded = replace(VEHICLE, mode=FlightMode.TAKEOFF, in_air=False)
    mission.step(at(2.0, replace(grounded, armed=False)))
    assert mission.request is Request.TAKEOFF
    mission.step(at(3.0, grounded))
    mission.step(at(4.0, replace(grounded, armed=False)))
    assert (mission.stage, mission.request) == (Stage.LANDED, Request.STAY)


# A real PX4's takeoff as reported: heartbeats come once a second, the landed state on a grid of its own.


def test_a_stale_hold_of_before_the_takeoff_is_not_its_end() -> None:
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    for at_s, mode, in_air in ((3.0, FlightMode.HOLD, False), (3.8, FlightMode.TAKEOFF, False), (8.0, FlightMode.TAKEOFF, False)):
        mission.step(at(at_s, replace(VEHICLE, mode=mode, in_air=in_air)))
        assert mission.stage is Stage.TAKEOFF
    mission.step(at(8.2, replace(VEHICLE, mode=FlightMode.TAKEOFF)))  # IN_AIR comes up to 0.8 s before the heartbeat's hold
    assert mission.stage is Stage.SURVEY


def test_a_takeoff_that_ends_below_the_floor_goes_on_by_setpoints() -> None:
    """The rangefinder says that it is at 1.4 m, the barometer 3 m. Both err: one at 1.48 m took itself for 1.5."""
    mission = Mission(TrackConfig(), floor_m=1.5)
    mission.command(Action.START, SECOND, CALM)
    for at_s, mode, height_m in ((5.0, FlightMode.HOLD, 1.4), (6.0, FlightMode.OFFBOARD, 1.4), (6.2, FlightMode.OFFBOARD, 1.6)):
        mission.step(at(at_s, replace(VEHICLE, mode=mode, height_m=height_m)))
        assert (mission.stage, mission.request) == (Stage.TAKEOFF, Request.OFFBOARD)
    mission.step(at(6.5, replace(OFFBOARD, height_m=1.8)))
    assert mission.stage is Stage.SURVEY


@pytest.mark.parametrize(
    ("height_m", "healthy", "stage"),
    [(0.5, False, Stage.LANDING), (1.4, False, Stage.TAKEOFF), (3.0, False, Stage.TRACK), (0.5, True, Stage.TRACK)],
)
@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RETURN])
def test_what_a_failsafe_has_brought_below_the_floor_does_not_fly_on_from_there(height_m, healthy, stage, mode) -> None:
    """Its link was gone for seconds: it went on to search at 0.5 m above ground. A real one lands at home in return mode."""
    mission = Mission(TrackConfig(), floor_m=1.5)
    mission.command(Action.START, SECOND, CALM)
    for at_s in (2.0, 10.0):
        mission.step(at(at_s, has_hypothesis=at_s > 2.0, last_cone_ns=10 * SECOND))
    sinking = replace(VEHICLE, mode=mode, healthy=healthy, height_m=height_m)
    mission.step(at(20.0, sinking, has_hypothesis=True, last_cone_ns=20 * SECOND))
    assert mission.stage is stage
    if stage is Stage.TAKEOFF:  # and goes on to sink, as no setpoints reach it
        mission.step(at(21.0, replace(sinking, height_m=0.7), has_hypothesis=True, last_cone_ns=20 * SECOND))
        assert mission.stage is Stage.LANDING


def test_a_failsafe_that_holds_before_it_goes_home_is_told_as_such() -> None:
    """No peer expected a held drone to return; and a drone held again by its pilot counted as down."""
    mission, low = tracking(), {"has_hypothesis": True, "last_cone_ns": 10 * SECOND}
    stages = []
    modes = [(20.0, FlightMode.HOLD), (24.0, FlightMode.HOLD), (26.0, FlightMode.RETURN), (28.0, FlightMode.HOLD),
             (40.0, FlightMode.RETURN), (44.0, FlightMode.RETURN), (60.0, FlightMode.LAND), (64.0, FlightMode.LAND),
             (65.0, FlightMode.MANUAL), (69.0, FlightMode.MANUAL)]  # fmt: skip
    for at_s, mode in modes:
        mission.step(at(at_s, replace(VEHICLE, mode=mode, healthy=False), **low))
        stages.append(mission.stage)
        assert mission.released is (at_s > 20.0)
    held, home, lands = Stage.HOLD, Stage.RETURN, Stage.LANDING
    assert stages == [Stage.TRACK, held, held, held, held, home, home, lands, lands, held]
    assert mission.command(Action.RESUME, 70 * SECOND, at(70.0, replace(VEHICLE, mode=FlightMode.HOLD), **low)) is None
    assert mission.stage is Stage.TRACK


@pytest.mark.parametrize("action", [Action.HOLD, Action.LAND])
def test_a_drone_brakes_by_setpoints_before_it_holds_or_lands(action) -> None:
    """Its autopilot would brake straight ahead, over 10 m from the speed of a search."""
    mission, fast = surveying(), replace(OFFBOARD, velocity_mps=(6.0, 0.0, 0.0))
    mission.command(action, 3 * SECOND, at(3.0, fast))
    asked = [mission.request]
    for at_s, vehicle in ((4.0, replace(fast, velocity_mps=(2.0, 0.0, 0.0))), (5.0, OFFBOARD), (6.0, OFFBOARD)):
        mission.step(at(at_s, vehicle))
        asked.append(mission.request)
        assert not mission.released
    assert asked == [*[Request.OFFBOARD] * 3, Request.HOLD if action is Action.HOLD else Request.LAND]


@pytest.mark.parametrize(("height_m", "stage"), [(0.5, Stage.LANDING), (1.4, Stage.TAKEOFF), (3.0, Stage.TRACK)])
def test_a_vehicle_that_sank_while_nothing_was_heard_of_it_does_not_search_near_the_ground(height_m, stage) -> None:
    """The first heartbeat after it still shows offboard."""
    mission, found = Mission(TrackConfig(), floor_m=1.5), {"has_hypothesis": True, "last_cone_ns": 20 * SECOND}
    mission.command(Action.START, SECOND, CALM)
    for at_s in (2.0, 10.0):
        mission.step(at(at_s, has_hypothesis=at_s > 2.0, last_cone_ns=10 * SECOND))
    mission.unheard(20 * SECOND, holds=True)
    mission.step(at(20.1, replace(OFFBOARD, height_m=height_m), **found))
    assert mission.stage is Stage.TRACK  # nothing new has been heard yet
    mission.step(at(20.2, replace(OFFBOARD, stamp_ns=20 * SECOND + SECOND // 5, height_m=height_m), **found))
    assert mission.stage is stage


def test_the_autopilots_way_from_takeoff_to_hold_is_nobodys_takeover() -> None:
    mission = surveying()
    for tick in range(80):
        mode = FlightMode.TAKEOFF if tick < 10 else FlightMode.HOLD
        mission.step(at(2.0 + 0.05 * tick, replace(VEHICLE, mode=mode)))
    assert (mission.stage, mission.released) == (Stage.SURVEY, False)


def test_a_heartbeat_of_before_the_stage_does_not_show_that_offboard_was_reached() -> None:
    mission = surveying()
    mission.step(at(2.0 + 0.5 * STALE_NS * 1e-9, OFFBOARD))  # of a hold that an operator had it leave a moment ago
    for tick in range(100):
        mission.step(at(3.0 + 0.05 * tick, VEHICLE))
    assert not mission.released
    for tick in range(20):
        mission.step(at(9.0 + 0.05 * tick, OFFBOARD))
    for tick in range(2 + int(TAKEOVER_NS / SECOND * 20)):
        mission.step(at(10.0 + 0.05 * tick, VEHICLE))
    assert mission.released


def test_a_drone_that_is_not_steered_is_told_whatever_the_cause() -> None:
    mission = surveying()
    mission.step(at(2.5, VEHICLE))
    assert mission.unsteered(int(2.6 * SECOND)) is None
    late_ns = int(2.5 * SECOND) + UNFOLLOWED_NS
    mission.step(at(late_ns / SECOND, VEHICLE))
    assert mission.unsteered(late_ns) == "not following its mission: the autopilot has been in hold, not in offboard, for 3 s"
    mission.step(at(14.5, VEHICLE))
    assert mission.unsteered(int(14.5 * SECOND)) is not None
    mission.step(at(15.0, OFFBOARD))
    assert mission.unsteered(int(15.0 * SECOND)) is None


def test_a_pilot_who_has_taken_over_is_what_is_told() -> None:
    mission = surveying()
    for tick in range(200):
        mode = FlightMode.OFFBOARD if tick < 60 else FlightMode.MANUAL
        mission.step(at(2.0 + 0.05 * tick, replace(VEHICLE, mode=mode)))
    assert mission.released
    told = mission.unsteered(12 * SECOND)
    assert told is not None
    assert "under the control of a human pilot" in told
    assert "manual" in told
