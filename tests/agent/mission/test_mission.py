import pytest
from msgspec.structs import replace

from agent.config.mission import SurveyConfig, TrackConfig
from agent.mission.situation import Situation
from agent.mission.stages import UNSTEERED_NS, Mission
from agent.mission.takeover import FAILSAFE_NS, STALE_NS, TAKEOVER_NS
from agent.vehicle.interface import FlightMode, Request, VehicleState
from protocol.messages import Action, Stage

SECOND = 1_000_000_000
VEHICLE = VehicleState(
    stamp_ns=0,
    epoch=0,
    position_m=(0.0, 0.0, 3.0),
    velocity_mps=(0.0, 0.0, 0.0),
    quaternion=(1.0, 0.0, 0.0, 0.0),
    height_m=3.0,
    position_sigma_m=0.1,
    yaw_sigma_rad=0.01,
    mode=FlightMode.HOLD,
    armed=True,
    in_air=True,
    healthy=True,
)
CALM = Situation(now_ns=SECOND, vehicle=VEHICLE, has_hypothesis=False, last_cone_ns=0, at_home=False, problems=())
OFFBOARD = replace(VEHICLE, mode=FlightMode.OFFBOARD)


def at(seconds, vehicle=OFFBOARD, **values):
    return replace(CALM, now_ns=int(seconds * SECOND), vehicle=vehicle, **values)


def surveying(**track):
    mission = Mission(TrackConfig(**track))
    assert mission.command(Action.START, SECOND, CALM) is None
    mission.step(at(2.0, VEHICLE))
    assert mission.stage is Stage.SURVEY
    return mission


def tracking(**track):
    mission = surveying(**track)
    mission.step(at(10.0, has_hypothesis=True, last_cone_ns=10 * SECOND))
    assert mission.stage is Stage.TRACK
    return mission


def test_nobody_takes_off_without_a_command():
    mission = Mission(TrackConfig())
    for second in range(100):
        mission.step(at(second, VEHICLE, has_hypothesis=True))
    assert mission.stage is Stage.PREFLIGHT
    assert mission.request is Request.STAY


def test_start_is_refused_with_its_reason():
    mission = Mission(TrackConfig())
    refusal = mission.command(Action.START, SECOND, replace(CALM, problems=("no telemetry",)))
    assert refusal == "start refused: no telemetry"
    assert mission.stage is Stage.PREFLIGHT


def test_a_late_start_joins_the_mission_that_the_others_fly():
    mission = Mission(TrackConfig())
    assert mission.command(Action.START, 9 * SECOND, CALM, started_ns=2 * SECOND) is None
    assert mission.started_ns == 2 * SECOND


def test_takeoff_waits_for_the_autopilot_to_finish():
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    mission.step(at(2.0, replace(VEHICLE, mode=FlightMode.TAKEOFF, in_air=False)))
    assert (mission.stage, mission.request) == (Stage.TAKEOFF, Request.TAKEOFF)
    mission.step(at(8.0, VEHICLE))
    assert (mission.stage, mission.request) == (Stage.SURVEY, Request.OFFBOARD)


def test_from_the_survey_to_tracking_and_back_when_the_hypothesis_is_taken_back():
    mission = tracking()
    mission.step(at(11.0, has_hypothesis=False))
    assert mission.stage is Stage.SURVEY


def test_searches_again_without_cones_and_tracks_again_with_one():
    mission = tracking(no_cone_timeout_s=20.0)
    mission.step(at(29.9, has_hypothesis=True, last_cone_ns=10 * SECOND))
    assert mission.stage is Stage.TRACK
    mission.step(at(30.1, has_hypothesis=True, last_cone_ns=10 * SECOND))
    assert mission.stage is Stage.REACQUIRE
    mission.step(at(31.0, has_hypothesis=True, last_cone_ns=31 * SECOND))
    assert mission.stage is Stage.TRACK


def test_whoever_knows_how_sure_it_is_loses_the_source_by_that_and_not_for_want_of_cones():
    mission = tracking(no_cone_timeout_s=20.0, lost_rms_m=15.0)
    mission.step(at(500.0, has_hypothesis=True, last_cone_ns=10 * SECOND, rms_m=14.9))
    assert mission.stage is Stage.TRACK
    mission.step(at(501.0, has_hypothesis=True, last_cone_ns=501 * SECOND, rms_m=15.1))
    assert mission.stage is Stage.REACQUIRE
    mission.step(at(502.0, has_hypothesis=True, last_cone_ns=501 * SECOND, rms_m=14.0))
    assert mission.stage is Stage.REACQUIRE  # not lost and found in turns
    mission.step(at(503.0, has_hypothesis=True, last_cone_ns=501 * SECOND, rms_m=9.0))
    assert mission.stage is Stage.TRACK


@pytest.mark.parametrize(("then", "stage"), [("return", Stage.RETURN), ("continue", Stage.SURVEY)])
def test_when_nothing_is_found_it_does_as_configured(then, stage):
    mission = Mission(TrackConfig(), SurveyConfig(then=then))
    mission.command(Action.START, SECOND, CALM)
    mission.step(at(2.0, VEHICLE))
    mission.step(at(300.0))
    assert mission.stage is Stage.SURVEY
    mission.step(at(301.0, nothing_found=True))
    assert mission.stage is stage


def test_a_source_that_is_found_counts_more_than_that_nothing_was():
    mission = Mission(TrackConfig(), SurveyConfig())
    mission.command(Action.START, SECOND, CALM)
    mission.step(at(2.0, VEHICLE))
    mission.step(at(300.0, nothing_found=True, has_hypothesis=True))
    assert mission.stage is Stage.TRACK


def test_a_search_for_further_sources_goes_on_beside_one_that_is_found():
    mission = surveying()
    mission.step(at(10.0, has_hypothesis=True, searches_on=True))
    assert mission.stage is Stage.SURVEY
    mission.step(at(20.0, has_hypothesis=True))
    assert mission.stage is Stage.TRACK
    mission.step(at(40.0))
    assert mission.stage is Stage.SURVEY
    mission.step(at(41.0, has_hypothesis=True))  # it was gone for a moment
    assert mission.stage is Stage.TRACK


def test_a_look_at_what_may_move_neither_ends_the_search_nor_begins_the_tracking():
    mission = surveying(duration_s=60.0)
    mission.step(at(10.0, has_hypothesis=True, looks=True))
    assert mission.stage is Stage.TRACK
    assert mission.tracking_since_ns is None
    mission.step(at(20.0, has_hypothesis=True, searches_on=True))
    assert mission.stage is Stage.SURVEY
    assert mission.searched_s(32 * SECOND) == pytest.approx(30.0)
    mission.step(at(100.0, has_hypothesis=True, looks=True))
    mission.step(at(110.0, has_hypothesis=True))  # all of the area is covered meanwhile
    assert mission.stage is Stage.TRACK
    assert mission.tracking_since_ns == 110 * SECOND
    assert mission.searched_s(115 * SECOND) == 0.0


def test_it_begins_again_once_all_that_were_found_have_had_their_turns_and_ends_with_the_mission():
    mission = surveying(duration_s=60.0)
    mission.step(at(20.0, has_hypothesis=True))
    mission.step(at(50.0, has_hypothesis=True, searches_on=True))
    assert mission.stage is Stage.SURVEY
    mission.step(at(55.0, has_hypothesis=True))  # a further one is found: its turn comes at once
    assert mission.stage is Stage.TRACK
    mission.step(at(70.0, has_hypothesis=True, searches_on=True))
    assert mission.stage is Stage.SURVEY
    mission.step(at(81.0, has_hypothesis=True, searches_on=True))
    assert mission.stage is Stage.RETURN


def test_a_search_lasts_through_a_hold_and_begins_anew_after_a_source_was_tracked():
    mission = surveying()
    assert mission.searched_s(62 * SECOND) == pytest.approx(60.0)
    mission.command(Action.HOLD, 70 * SECOND, at(70.0))
    mission.command(Action.RESUME, 80 * SECOND, at(80.0))
    assert mission.searched_s(92 * SECOND) == pytest.approx(90.0)
    mission.step(at(100.0, has_hypothesis=True))
    assert mission.searched_s(110 * SECOND) == 0.0
    mission.step(at(120.0, has_hypothesis=False))
    assert mission.searched_s(130 * SECOND) == pytest.approx(10.0)


def test_a_given_hypothesis_is_never_lost():
    mission = Mission(TrackConfig(), can_lose=False)
    mission.command(Action.START, SECOND, CALM)
    mission.step(at(2.0, VEHICLE, has_hypothesis=True))
    mission.step(at(500.0, has_hypothesis=True))
    assert mission.stage is Stage.TRACK


def test_returns_lands_and_rests():
    mission = tracking(duration_s=60.0)
    mission.step(at(70.1, has_hypothesis=True, last_cone_ns=70 * SECOND))
    assert (mission.stage, mission.request) == (Stage.RETURN, Request.OFFBOARD)
    mission.step(at(80.0, at_home=True))
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)
    mission.step(at(95.0, replace(VEHICLE, armed=False, in_air=False)))
    assert (mission.stage, mission.request) == (Stage.LANDED, Request.STAY)


def test_hold_and_resume():
    mission = tracking()
    assert mission.command(Action.HOLD, 11 * SECOND, at(11.0)) is None
    mission.step(at(12.0, replace(VEHICLE, mode=FlightMode.HOLD), has_hypothesis=True))
    assert (mission.stage, mission.request) == (Stage.HOLD, Request.HOLD)
    assert mission.command(Action.RESUME, 13 * SECOND, at(13.0)) is None
    assert mission.stage is Stage.TRACK


@pytest.mark.parametrize("stage", ["takeoff", "return"])
def test_hold_from_takeoff_and_return(stage):
    mission = tracking() if stage == "return" else Mission(TrackConfig())
    first, then = (Action.RETURN, Stage.RETURN) if stage == "return" else (Action.START, Stage.SURVEY)
    assert mission.command(first, 12 * SECOND, at(12.0)) is None
    assert mission.command(Action.HOLD, 13 * SECOND, at(13.0)) is None
    assert mission.stage is Stage.HOLD
    assert mission.command(Action.RESUME, 14 * SECOND, at(14.0)) is None
    assert mission.stage is then


@pytest.mark.parametrize("action", [Action.RETURN, Action.LAND, Action.ABORT])
def test_from_hold_one_can_come_home(action):
    mission = tracking()
    mission.command(Action.HOLD, 11 * SECOND, at(11.0))
    assert mission.command(action, 12 * SECOND, at(12.0)) is None
    assert mission.stage in (Stage.RETURN, Stage.LANDING, Stage.ABORT)


def test_a_hold_ends_in_a_return_when_the_battery_is_low():
    mission = tracking()
    mission.command(Action.HOLD, 11 * SECOND, at(11.0))
    mission.step(at(60.0, VEHICLE))
    assert mission.stage is Stage.HOLD
    mission.step(at(61.0, VEHICLE, battery_low=True))
    assert (mission.stage, mission.request) == (Stage.RETURN, Request.OFFBOARD)


@pytest.mark.parametrize("holds", [False, True])
def test_a_revoked_drone_returns_at_once(holds):
    mission = tracking()
    if holds:
        mission.command(Action.HOLD, 11 * SECOND, at(11.0))
    mission.step(at(12.0, VEHICLE if holds else OFFBOARD, has_hypothesis=True, last_cone_ns=10 * SECOND, revoked=True))
    assert mission.stage is Stage.RETURN


def test_what_a_pilot_has_stopped_is_not_sent_home_by_the_agent():
    """A hold that somebody else has chosen: its end is the pilot's, or the autopilot's own failsafe."""
    mission = tracking()
    for tick in range(100):
        mission.step(at(11.0 + 0.05 * tick, OFFBOARD if tick < 50 else VEHICLE, has_hypothesis=True, last_cone_ns=10 * SECOND))
    assert mission.released
    mission.step(at(60.0, VEHICLE, battery_low=True))
    assert (mission.stage, mission.request) == (Stage.HOLD, Request.RELEASE)


def test_what_cannot_be_is_refused_with_a_reason():
    mission = Mission(TrackConfig())
    assert mission.command(Action.HOLD, SECOND, CALM) == "hold: not flying"
    mission = tracking()
    assert mission.command(Action.START, 2 * SECOND, CALM) == "start: already started"
    assert mission.command(Action.RESUME, 2 * SECOND, CALM) == "resume: not holding"
    mission.command(Action.ABORT, 3 * SECOND, CALM)
    assert mission.command(Action.RESUME, 4 * SECOND, CALM) == "resume: aborted"


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
    assert (mission.stage, mission.request) == (Stage.LANDED, Request.STAY)  # which gets it ready for the next start


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
    mission.hold_asked(int(13.1 * SECOND))
    held_by(mission, OFFBOARD, 13.2, 13.9)  # as the last heartbeat showed it
    assert held_by(mission, VEHICLE, 14.0, 15.0, 15.8) == (Stage.TRACK, Request.OFFBOARD)
    assert held_by(mission, OFFBOARD, 15.9, 17.0) == (Stage.TRACK, Request.OFFBOARD)
    assert held_by(mission, VEHICLE, 18.0, 19.6) == (Stage.HOLD, Request.RELEASE)


def test_a_hold_that_it_asked_for_itself_may_take_long_to_leave():
    """On a link that loses most packets: the hold was asked for between two pieces of telemetry, and offboard is not heard."""
    mission = tracking()
    held_by(mission, OFFBOARD, 12.0, 13.0)
    mission.hold_asked(14 * SECOND)
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


# What a real PX4 shows of its takeoff: heartbeats come once a second, the landed state on a grid of its own.


def test_a_stale_hold_of_before_the_takeoff_is_not_its_end() -> None:
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    for at_s, mode, in_air in ((3.0, FlightMode.HOLD, False), (3.8, FlightMode.TAKEOFF, False), (8.0, FlightMode.TAKEOFF, False)):
        mission.step(at(at_s, replace(VEHICLE, mode=mode, in_air=in_air)))
        assert mission.stage is Stage.TAKEOFF
    mission.step(at(8.2, replace(VEHICLE, mode=FlightMode.TAKEOFF)))  # IN_AIR comes up to 0.8 s before the heartbeat's hold
    assert mission.stage is Stage.SURVEY


def test_a_takeoff_that_ends_below_the_floor_goes_on_by_setpoints() -> None:
    """The autopilot goes by its barometer; the rangefinder says that it is at 1.4 m."""
    mission = Mission(TrackConfig(), floor_m=1.5)
    mission.command(Action.START, SECOND, CALM)
    for at_s, mode in ((5.0, FlightMode.HOLD), (6.0, FlightMode.OFFBOARD)):
        mission.step(at(at_s, replace(VEHICLE, mode=mode, height_m=1.4)))
        assert (mission.stage, mission.request) == (Stage.TAKEOFF, Request.OFFBOARD)
    mission.step(at(6.5, replace(OFFBOARD, height_m=1.6)))
    assert mission.stage is Stage.SURVEY


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
    late_ns = int(2.5 * SECOND) + UNSTEERED_NS
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


def test_after_a_landing_it_can_be_started_again() -> None:
    mission = tracking()
    mission.step(at(20.0, replace(OFFBOARD, armed=False, in_air=False)))
    assert mission.stage is Stage.LANDED
    ground = replace(VEHICLE, armed=False, in_air=False)
    assert mission.command(Action.START, 30 * SECOND, at(30.0, ground, problems=("low battery",))) == "start refused: low battery"
    assert mission.command(Action.START, 31 * SECOND, at(31.0, ground)) is None
    assert (mission.stage, mission.started_ns, mission.tracking_since_ns) == (Stage.TAKEOFF, 31 * SECOND, None)
    mission.step(at(31.1, ground))  # not armed yet: that is no landing
    assert mission.stage is Stage.TAKEOFF
    mission.step(at(40.0, VEHICLE))
    assert mission.stage is Stage.SURVEY
    assert mission.searched_s(41 * SECOND) == pytest.approx(1.0)


BLIND = replace(OFFBOARD, position_trusted=False)


def test_without_a_position_it_stays_by_its_setpoints_and_then_holds() -> None:
    mission = surveying()
    mission.step(at(10.0, BLIND))
    mission.step(at(10.9, BLIND))
    assert mission.request is Request.OFFBOARD
    mission.step(at(11.0, BLIND))
    assert mission.request is Request.HOLD
    for tick in range(60):  # hold, which was asked for, is nobody's takeover
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
    assert "near the ground" in mission.landed_because
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
    assert why in mission.landed_because


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
    """Unasked it lands on. Before, it turned back to landing at once, and told nobody."""
    mission = landing_without_a_position()
    for second in (41.0, 42.0, 43.0):
        mission.step(at(second, replace(VEHICLE, mode=FlightMode.LAND)))
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)
    assert mission.command(Action.RETURN, 44 * SECOND, at(44.0)) is None
    mission.step(at(45.0))
    assert (mission.stage, mission.request, mission.landed_because) == (Stage.RETURN, Request.OFFBOARD, "")


def test_near_the_ground_not_even_then() -> None:
    mission = landing_without_a_position()
    mission.step(at(41.0, replace(VEHICLE, mode=FlightMode.LAND, height_m=0.6)))
    assert mission.command(Action.RETURN, 44 * SECOND, at(44.0)) is not None


def test_a_return_that_gets_no_nearer_lands_where_it_is() -> None:
    mission = surveying()
    mission.command(Action.RETURN, 5 * SECOND, at(5.0))
    mission.step(at(30.0))
    assert mission.stage is Stage.RETURN
    mission.step(at(70.0, no_nearer=True))
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)
    assert "home" in mission.landed_because


def test_a_takeoff_goes_on_through_a_jump_and_ends_when_the_position_is_confirmed() -> None:
    mission = Mission(TrackConfig())
    mission.command(Action.START, SECOND, CALM)
    climbing = replace(VEHICLE, mode=FlightMode.TAKEOFF, in_air=False, height_m=1.0, position_trusted=False)
    for tick in range(60):
        mission.step(at(5.0 + 0.05 * tick, climbing))
    assert (mission.stage, mission.request) == (Stage.TAKEOFF, Request.TAKEOFF)
