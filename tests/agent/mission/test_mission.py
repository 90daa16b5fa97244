"""The stages of a mission, from the start command to the landing."""

from math import inf

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import TrackConfig
from radron.agent.config.survey import SurveyConfig
from radron.agent.mission.stages import ROOMLESS_S, STRANDED_S, Mission
from radron.agent.mission.transitions import Event
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.unheard.agentless import Agentless
from radron.agent.navigation.unheard.contact import SILENT_NS
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.messages import Action, Stage
from support.flights.one_pilot import MISSION
from support.flights.situations import CALM, OFFBOARD, SECOND, VEHICLE, at, surveying, tracking


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
    assert mission.command(Action.START, 2 * SECOND, at(9.0, VEHICLE)) is None
    assert (mission.flight.started_ns, mission.flight.since_ns) == (2 * SECOND, 9 * SECOND)


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
    mission.step(at(41.0, has_hypothesis=True))  # gone for a moment
    assert mission.stage is Stage.TRACK


def test_a_look_at_what_may_move_neither_ends_the_search_nor_begins_the_tracking():
    mission = surveying(duration_s=60.0)
    mission.step(at(10.0, has_hypothesis=True, looks=True))
    assert mission.stage is Stage.TRACK
    assert mission.flight.tracking_since_ns is None
    mission.step(at(20.0, has_hypothesis=True, searches_on=True))
    assert mission.stage is Stage.SURVEY
    assert mission.flight.searched_s(32 * SECOND) == pytest.approx(30.0)
    mission.step(at(100.0, has_hypothesis=True, looks=True))
    mission.step(at(110.0, has_hypothesis=True))  # all of the area is covered meanwhile
    assert mission.stage is Stage.TRACK
    assert mission.flight.tracking_since_ns == 110 * SECOND
    assert mission.flight.searched_s(115 * SECOND) == 0.0


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
    assert mission.flight.searched_s(62 * SECOND) == pytest.approx(60.0)
    mission.command(Action.HOLD, 70 * SECOND, at(70.0))
    mission.command(Action.RESUME, 80 * SECOND, at(80.0))
    assert mission.flight.searched_s(92 * SECOND) == pytest.approx(90.0)
    mission.step(at(100.0, has_hypothesis=True))
    assert mission.flight.searched_s(110 * SECOND) == 0.0
    mission.step(at(120.0, has_hypothesis=False))
    assert mission.flight.searched_s(130 * SECOND) == pytest.approx(10.0)


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


def test_it_takes_part_from_the_takeoff_to_a_hold_and_again_from_then_on():
    mission = tracking()
    assert mission.flight.took_part_ns == SECOND
    mission.command(Action.HOLD, 12 * SECOND, at(12.0))
    mission.command(Action.RESUME, 20 * SECOND, at(20.0))
    mission.step(at(21.0, has_hypothesis=True))
    assert (mission.stage, mission.flight.took_part_ns) == (Stage.TRACK, 20 * SECOND)


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


def after(*, holds, **happens):
    """A mission that tracked, or held, when this happened."""
    mission = tracking()
    if holds:
        mission.command(Action.HOLD, 11 * SECOND, at(11.0))
    mission.step(at(12.0, VEHICLE if holds else OFFBOARD, has_hypothesis=True, last_cone_ns=10 * SECOND, **happens))
    return mission


@pytest.mark.parametrize("holds", [False, True])
def test_a_battery_that_does_not_last_for_the_way_home_ends_the_flight_where_it_is(holds):
    mission = after(battery_spent=True, holds=holds)
    assert (mission.stage, mission.flight.landed_because) == (Stage.LANDING, Event.SPENT)
    assert mission.command(Action.RETURN, 13 * SECOND, at(13.0)) is None
    mission.step(at(14.0, battery_spent=True))
    assert mission.stage is Stage.RETURN  # the operator insists


@pytest.mark.parametrize("holds", [False, True])
def test_a_revoked_drone_returns_at_once(holds):
    mission = after(revoked=True, holds=holds)
    assert mission.stage is Stage.RETURN


def test_what_a_pilot_has_stopped_is_not_sent_home_by_the_agent():
    """A hold not commanded by the agent: its end is the pilot's, or the autopilot's own failsafe."""
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


def test_after_a_landing_it_can_be_started_again() -> None:
    mission = tracking()
    mission.step(at(20.0, replace(OFFBOARD, armed=False, in_air=False)))
    assert mission.stage is Stage.LANDED
    ground = replace(VEHICLE, armed=False, in_air=False)
    assert mission.command(Action.START, 30 * SECOND, at(30.0, ground, problems=("low battery",))) == "start refused: low battery"
    assert mission.command(Action.START, 31 * SECOND, at(31.0, ground)) is None
    assert (mission.stage, mission.flight.started_ns, mission.flight.tracking_since_ns) == (Stage.TAKEOFF, 31 * SECOND, None)
    mission.step(at(31.1, ground))  # not armed yet: that is no landing
    assert mission.stage is Stage.TAKEOFF
    mission.step(at(40.0, VEHICLE))
    assert mission.stage is Stage.SURVEY
    assert mission.flight.searched_s(41 * SECOND) == pytest.approx(1.0)


def test_what_ended_the_flight_before_does_not_end_the_next_one() -> None:
    """A drone that had returned alone, and was started again, returned at once where no peer was heard."""
    mission = surveying()
    for at_s in (10.0, 16.0):
        mission.step(at(at_s, stranded_s=STRANDED_S))
    assert mission.stage is Stage.RETURN
    mission.step(at(30.0, replace(VEHICLE, armed=False, in_air=False)))
    mission.command(Action.START, 40 * SECOND, at(40.0, VEHICLE))
    for at_s, stage in ((41.0, Stage.SURVEY), (42.0, Stage.SURVEY), (46.0, Stage.SURVEY), (48.0, Stage.RETURN)):
        mission.step(at(at_s, VEHICLE if at_s < 42.0 else OFFBOARD, stranded_s=STRANDED_S))
        assert mission.stage is stage


def test_a_return_that_gets_no_nearer_lands_where_it_is() -> None:
    mission = surveying()
    mission.command(Action.RETURN, 5 * SECOND, at(5.0))
    mission.step(at(30.0))
    assert mission.stage is Stage.RETURN
    mission.step(at(70.0, no_nearer=True))
    assert (mission.stage, mission.request) == (Stage.LANDING, Request.LAND)
    assert "home" in mission.flight.landed_because


@pytest.mark.parametrize("stranded_s", [ROOMLESS_S, STRANDED_S])
def test_one_that_is_stranded_returns_after_that_time_unless_it_was_not_for_a_moment(stranded_s):
    mission = tracking()
    for at_s, lasts in ((11.0, True), (12.0, False), (13.0, True), (13.0 + stranded_s, True)):
        mission.step(
            at(at_s, OFFBOARD, has_hypothesis=True, last_cone_ns=round(at_s) * SECOND, stranded_s=stranded_s if lasts else inf)
        )
        assert mission.stage is Stage.TRACK
    mission.step(at(13.1 + stranded_s, OFFBOARD, has_hypothesis=True, stranded_s=stranded_s))
    assert mission.stage is Stage.RETURN


def test_one_without_room_leaves_no_later_than_its_vehicle_would_without_its_agent():
    """That long the others keep clear of its stopping place: 7.7 m beside it, a peer expected it 42 m away."""
    course = Agentless(MISSION).course("d1", PeerState((20.0, 20.0, 3.0)), Stage.TRACK, (5.0, 5.0, 0.0))
    noticed_s = 1.5 * SILENT_NS * 1e-9  # that it is not heard, by the plans and statuses of the others
    climbing_s = (course.cruise_m - 3.0) / MISSION.limits.climb_mps
    assert noticed_s + ROOMLESS_S + climbing_s < course.leaves_s
