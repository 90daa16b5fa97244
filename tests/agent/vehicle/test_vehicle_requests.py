"""Fulfilment of requests: by the heartbeat, not by acknowledgements, and never against a pilot."""

from math import inf

import pytest
from msgspec.structs import replace

from radron.agent.vehicle.interface import FlightMode, Request
from radron.agent.vehicle.requests import BLIND_S, REPEAT_S, Act, Requests, Seen

ON_GROUND = Seen(FlightMode.HOLD, armed=False, in_air=False, failsafe=False, heartbeat_s=0.0)
FLYING = Seen(FlightMode.HOLD, armed=True, in_air=True, failsafe=False, heartbeat_s=0.0)


class Desk:
    """Steps the requests at 20 Hz, with a heartbeat in every ``beat_s``."""

    def __init__(self, seen: Seen, beat_s: float = 0.2) -> None:
        self.requests = Requests()
        self.seen = self._shown = seen
        self.now_s = 100.0
        self.beat_s, self._beaten_s = beat_s, 99.0  # inf: no heartbeat arrives any more

    def run(self, request: Request, seconds: float, streaming: bool = True, altitude_set: bool = True) -> list[Act]:
        acts = []
        for _ in range(round(seconds * 20)):
            self.now_s += 0.05
            if self.now_s - self._beaten_s >= self.beat_s:
                self._beaten_s = self.now_s
                self._shown = replace(self.seen, heartbeat_s=self.now_s)
            act = self.requests.step(self.now_s, request, self._shown, streaming, altitude_set)
            if act is not None:
                acts.append(act)
        return acts


def test_takeoff_sets_the_altitude_then_arms_then_takes_off() -> None:
    desk = Desk(ON_GROUND)
    assert desk.run(Request.TAKEOFF, 0.5, altitude_set=False) == [Act.SET_TAKEOFF_ALTITUDE]
    assert desk.run(Request.TAKEOFF, 0.5) == [Act.ARM]
    desk.seen = replace(ON_GROUND, armed=True)
    assert desk.run(Request.TAKEOFF, 1.0) == [Act.TAKE_OFF]
    desk.seen = replace(ON_GROUND, armed=True, mode=FlightMode.TAKEOFF)
    assert desk.run(Request.TAKEOFF, 5.0) == []
    desk.seen = FLYING
    assert desk.run(Request.TAKEOFF, 5.0) == []


def test_arming_that_is_denied_is_tried_again() -> None:
    assert Desk(ON_GROUND).run(Request.TAKEOFF, 4.0 * REPEAT_S) == [Act.ARM] * 4


def test_a_vehicle_that_was_disarmed_is_not_armed_again_by_the_same_request() -> None:
    desk = Desk(replace(ON_GROUND, armed=True, mode=FlightMode.TAKEOFF))
    desk.run(Request.TAKEOFF, 1.0)
    desk.seen = ON_GROUND
    assert desk.run(Request.TAKEOFF, 5.0) == []


def test_nor_is_one_that_showed_itself_armed_right_after_the_command() -> None:
    desk = Desk(ON_GROUND, beat_s=1.0)
    assert desk.run(Request.TAKEOFF, 1.0, altitude_set=False) == [Act.SET_TAKEOFF_ALTITUDE]
    desk.seen = replace(ON_GROUND, armed=True)
    assert desk.run(Request.TAKEOFF, 0.1)[0] is Act.ARM  # a heartbeat right after it, too soon to count as its effect
    desk.seen = ON_GROUND
    assert Act.ARM not in desk.run(Request.TAKEOFF, 5.0)


def test_offboard_is_asked_for_once_setpoints_stream_and_again_until_the_heartbeat_shows_it() -> None:
    desk = Desk(FLYING)
    assert desk.run(Request.OFFBOARD, 1.0, streaming=False) == []
    assert desk.run(Request.OFFBOARD, 2.0 * REPEAT_S) == [Act.OFFBOARD] * 2
    desk.seen = replace(FLYING, mode=FlightMode.OFFBOARD)
    assert desk.run(Request.OFFBOARD, 5.0) == []


@pytest.mark.parametrize(("request_", "act"), [(Request.HOLD, Act.HOLD), (Request.LAND, Act.LAND)])
def test_what_ends_offboard_is_sent_again_at_once_until_it_is_acknowledged(request_, act) -> None:
    """A packet that was lost left the vehicle without setpoints for 1.5 s: PX4 returned instead. Not for long: a human pilot may
    take over meanwhile, which a heartbeat shows only when no command has been sent for a moment.
    """
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    assert desk.run(request_, 0.65) == [act] * 3
    desk.requests.acked()
    assert desk.run(request_, 1.2) == []
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    assert len(desk.run(request_, 1.4)) <= 6
    desk.seen = replace(FLYING, mode=FlightMode.MANUAL)
    assert desk.run(request_, 1.1) == []
    assert desk.run(request_, 5.0) == []


def test_offboard_is_not_asked_for_on_the_ground() -> None:
    assert Desk(ON_GROUND).run(Request.OFFBOARD, 3.0) == []
    assert Desk(replace(ON_GROUND, armed=True)).run(Request.OFFBOARD, 3.0) == []


def test_an_offboard_loss_failsafe_is_left_to_end_by_itself() -> None:
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD))
    desk.run(Request.OFFBOARD, 1.0)
    desk.seen = replace(FLYING, mode=FlightMode.RETURN, failsafe=True)
    assert desk.run(Request.OFFBOARD, 5.0) == []
    desk.seen = replace(FLYING, mode=FlightMode.OFFBOARD)
    assert desk.run(Request.OFFBOARD, 1.0) == []


@pytest.mark.parametrize("mode", [FlightMode.HOLD, FlightMode.RETURN])
def test_an_operator_ends_a_failsafe_that_lasts_but_only_once(mode: FlightMode) -> None:
    """For want of a ground station or battery, or at the fence: it ends only by a mode that is chosen."""
    failsafe = replace(FLYING, mode=mode, failsafe=True, intended=FlightMode.OFFBOARD)
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    desk.run(Request.OFFBOARD, 3.0)
    desk.seen = failsafe
    assert desk.run(Request.OFFBOARD, 4.0) == []
    assert desk.run(Request.RELEASE, 2.0) == []
    assert desk.run(Request.OFFBOARD, 0.3, streaming=False) == []
    assert desk.run(Request.OFFBOARD, 0.5) == [Act.OFFBOARD] * 2  # nothing acknowledges it
    desk.requests.acked()
    assert desk.run(Request.OFFBOARD, 10.0) == []  # refused
    desk.run(Request.RELEASE, 1.0)
    assert 2 <= len(desk.run(Request.OFFBOARD, 10.0)) <= 4  # unheard
    desk.run(Request.RELEASE, 1.0)
    desk.seen = replace(FLYING, mode=FlightMode.OFFBOARD)
    desk.run(Request.OFFBOARD, 3.0)
    desk.seen = failsafe
    assert desk.run(Request.OFFBOARD, 10.0) == []  # the next one is not the operator's any more


def test_an_operators_landing_does_not_end_a_failsafe_for_what_follows() -> None:
    failsafe = replace(FLYING, mode=FlightMode.RETURN, failsafe=True, intended=FlightMode.OFFBOARD)
    desk = Desk(failsafe)
    desk.run(Request.RELEASE, 1.0)
    assert Act.LAND in desk.run(Request.LAND, 1.0)
    assert desk.run(Request.OFFBOARD, 5.0) == []


def test_a_mode_that_somebody_else_chose_stays() -> None:
    for beat_s in (0.2, 1.0):
        desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s)
        desk.run(Request.OFFBOARD, 3.0)
        desk.seen = replace(FLYING, mode=FlightMode.MANUAL)
        assert desk.run(Request.OFFBOARD, 10.0) == []
        desk.seen = FLYING
        assert desk.run(Request.OFFBOARD, 10.0) == []


def test_a_pilot_who_takes_over_before_offboard_was_reached_keeps_the_vehicle() -> None:
    desk = Desk(FLYING)
    assert desk.run(Request.OFFBOARD, 1.0) == [Act.OFFBOARD]
    desk.seen = replace(FLYING, mode=FlightMode.MANUAL)
    assert len(desk.run(Request.OFFBOARD, 10.0)) <= 1  # requested before the heartbeat with the pilot's mode


def test_a_new_request_is_carried_out_at_once_and_from_any_mode() -> None:
    desk = Desk(replace(FLYING, mode=FlightMode.MANUAL))
    assert desk.run(Request.HOLD, 0.05) == [Act.HOLD]
    assert desk.run(Request.LAND, 0.05) == [Act.LAND]
    assert desk.run(Request.RETURN, 0.05) == [Act.RETURN]


def test_a_human_pilot_keeps_the_vehicle_until_the_takeover_has_been_seen() -> None:
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD))
    desk.run(Request.OFFBOARD, 1.0)
    desk.seen = replace(FLYING, mode=FlightMode.MANUAL)
    assert desk.run(Request.OFFBOARD, 0.5) == []
    assert desk.run(Request.HOLD, 10.0) == []  # wanted for lack of telemetry: the mode is not checked yet
    assert desk.run(Request.OFFBOARD, 10.0) == []
    assert desk.run(Request.RELEASE, 1.0) == []
    assert desk.run(Request.LAND, 0.05) == [Act.LAND]  # wanted by an operator, aware of the manual override


@pytest.mark.parametrize("gap_s", [1.2, 10.0])
def test_a_human_pilot_who_took_over_in_or_after_a_gap_in_telemetry_keeps_the_vehicle(gap_s: float) -> None:
    """The hold requested meanwhile resets the requests' knowledge of the mode."""
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    desk.run(Request.OFFBOARD, 3.0)
    desk.beat_s = inf
    assert Act.HOLD in desk.run(Request.HOLD, gap_s)
    assert desk.run(Request.OFFBOARD, 0.3) == []
    desk.seen, desk.beat_s = replace(FLYING, mode=FlightMode.MANUAL), 1.0
    assert desk.run(Request.OFFBOARD, 10.0) == []
    assert desk.run(Request.RELEASE, 1.0) == []
    assert Act.OFFBOARD in desk.run(Request.OFFBOARD, 2.0)  # an operator's command


def test_a_human_pilot_keeps_the_vehicle_although_the_first_heartbeat_comes_with_a_command() -> None:
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    desk.run(Request.OFFBOARD, 3.0)
    desk.beat_s = inf
    assert desk.run(Request.HOLD, 0.05) == [Act.HOLD]
    desk.seen, desk.beat_s = replace(FLYING, mode=FlightMode.MANUAL), 0.0
    desk.run(Request.HOLD, 0.05)
    desk.beat_s = 1.0
    assert desk.run(Request.LAND, 10.0) == []


@pytest.mark.parametrize(("request_", "act"), [(Request.HOLD, Act.HOLD), (Request.LAND, Act.LAND)])
def test_a_vehicle_that_is_not_heard_is_commanded_for_a_moment_only(request_, act) -> None:
    """A pilot in manual override lost the vehicle again every 1.5 s. Once heard again, it is commanded again."""
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    desk.run(Request.OFFBOARD, 3.0)
    desk.beat_s = inf
    desk.run(Request.OFFBOARD, 1.0)
    assert len(desk.run(request_, BLIND_S)) >= 6  # lost packets: until PX4 must have noticed that no setpoints come
    assert desk.run(request_, 30.0) == []
    desk.seen, desk.beat_s = replace(FLYING, mode=FlightMode.RETURN, failsafe=True, intended=FlightMode.OFFBOARD), 1.0
    assert act in desk.run(request_, 1.0)


def test_a_human_pilot_keeps_the_vehicle_in_a_failsafe_too() -> None:
    desk = Desk(FLYING)
    desk.run(Request.HOLD, 1.0)
    desk.seen = replace(FLYING, mode=FlightMode.MANUAL, failsafe=True)
    assert desk.run(Request.HOLD, 10.0) == []


def test_a_heartbeat_from_before_the_request_does_not_count_as_its_success() -> None:
    desk = Desk(replace(FLYING, mode=FlightMode.OFFBOARD), beat_s=1.0)
    desk.run(Request.OFFBOARD, 2.0)
    assert desk.run(Request.HOLD, 0.1) == [Act.HOLD]
    assert desk.run(Request.OFFBOARD, 0.1) == []  # the heartbeat still shows offboard
    desk.seen = FLYING  # but the hold came through
    assert Act.OFFBOARD in desk.run(Request.OFFBOARD, 3.0)


def test_nothing_is_asked_for_when_released_staying_or_disarmed() -> None:
    assert Desk(FLYING).run(Request.RELEASE, 3.0) == []
    assert Desk(FLYING).run(Request.STAY, 3.0) == []
    for request in (Request.HOLD, Request.RETURN, Request.LAND):
        assert Desk(ON_GROUND).run(request, 3.0) == []


def test_a_vehicle_that_stands_in_offboard_is_brought_to_hold() -> None:
    """A real PX4 goes back to offboard after a landing, and does not let itself be armed there."""
    standing = replace(ON_GROUND, mode=FlightMode.OFFBOARD)
    assert set(Desk(standing).run(Request.STAY, 3.0)) == {Act.HOLD}
    desk = Desk(standing)
    assert set(desk.run(Request.TAKEOFF, 1.0)) == {Act.HOLD}
    desk.seen = ON_GROUND
    assert desk.run(Request.TAKEOFF, 1.0) == [Act.ARM]
    assert Desk(replace(standing, armed=True)).run(Request.STAY, 3.0) == []


def test_the_autopilots_own_way_from_takeoff_to_hold_leaves_the_request_alone() -> None:
    """A stale heartbeat says hold, the next ones takeoff, then hold again: no mode was chosen by anyone."""
    for beat_s in (0.2, 1.0):
        desk = Desk(FLYING, beat_s)
        desk.run(Request.OFFBOARD, 2.0)
        desk.seen = replace(FLYING, mode=FlightMode.TAKEOFF)
        desk.run(Request.OFFBOARD, 3.0)
        desk.seen = FLYING
        assert Act.OFFBOARD in desk.run(Request.OFFBOARD, 2.0 * REPEAT_S)


def test_in_a_failsafe_what_it_goes_back_to_is_changed() -> None:
    """Descend shows as land; PX4 would go back to offboard by itself."""
    falling = replace(FLYING, mode=FlightMode.LAND, failsafe=True, intended=FlightMode.OFFBOARD)
    desk = Desk(falling, beat_s=1.0)
    acts = desk.run(Request.LAND, 4.0)
    assert set(acts) == {Act.LAND}
    assert len(acts) >= 8
    desk.seen = replace(falling, intended=FlightMode.LAND)
    desk.run(Request.LAND, 1.0)
    assert desk.run(Request.LAND, 3.0) == []
    desk.seen = replace(FLYING, mode=FlightMode.HOLD)  # before the request came through it went elsewhere
    assert Act.LAND in desk.run(Request.LAND, 3.0)


def test_one_heartbeat_that_says_disarmed_does_not_end_a_request() -> None:
    """Faulty or forged: the next heartbeat says otherwise, and the autopilot is asked again. A vehicle that stays disarmed is
    left alone.
    """
    steered = replace(FLYING, mode=FlightMode.OFFBOARD)
    desk = Desk(steered, beat_s=1.0)
    desk.run(Request.OFFBOARD, 3.0)
    assert Act.RETURN in desk.run(Request.RETURN, 2.0)
    for _ in range(3):
        desk.seen = ON_GROUND
        desk.run(Request.RETURN, 1.0)
        desk.seen = steered
        assert Act.RETURN in desk.run(Request.RETURN, 2.0)
    desk.seen = ON_GROUND
    desk.run(Request.RETURN, 4.0)
    desk.seen = steered
    assert desk.run(Request.RETURN, 4.0) == []


def test_disarming_is_asked_for_on_the_ground_alone() -> None:
    stands = replace(ON_GROUND, armed=True, mode=FlightMode.LAND)
    desk = Desk(stands)
    assert desk.run(Request.DISARM, 2.0 * REPEAT_S) == [Act.DISARM] * 2
    desk.seen = ON_GROUND
    assert desk.run(Request.DISARM, 5.0) == []
    assert Desk(FLYING).run(Request.DISARM, 5.0) == []
