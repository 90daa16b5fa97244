"""Manual override: its effect on the mission and on the autopilot's commands, and the operator's options afterwards."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import TrackConfig
from radron.agent.mission.authority import TOUCHDOWN_NS
from radron.agent.mission.stages import Mission
from radron.agent.navigation.home import KeptHome
from radron.agent.vehicle.grounded import STILL_NS
from radron.agent.vehicle.interface import FlightMode, Request
from radron.agent.vehicle.requests import Act, Requests, Seen
from radron.protocol.messages import Action, Stage
from support.flights.situations import SECOND, VEHICLE, at, tracking


class Flight:
    """A mission and the commands to its autopilot, at 20 Hz, with a heartbeat a second."""

    def __init__(self, mission: Mission, since_s: float = 11.0) -> None:
        self.mission, self.now_s = mission, since_s
        self._requests = Requests()
        self.vehicle = VEHICLE

    def run(self, until_s: float, mode: FlightMode, *, believed_armed: bool | None = None, **vehicle: object) -> list[Act]:
        """The commands given while the autopilot is in that mode. ``believed_armed``: other than it reports."""
        acts = []
        while self.now_s < until_s - 1e-9:
            self.vehicle = shown = replace(VEHICLE, stamp_ns=int(self.now_s * SECOND), mode=mode, **vehicle)
            if believed_armed is not None:
                shown = replace(shown, armed=believed_armed, in_air=believed_armed)
            self.mission.step(at(self.now_s, shown, has_hypothesis=True, last_cone_ns=int(self.now_s * SECOND)))
            failsafe, beaten_s = not shown.healthy, float(int(self.now_s))
            seen = Seen(
                mode, self.vehicle.armed, self.vehicle.in_air, failsafe, beaten_s, FlightMode.OFFBOARD if failsafe else None
            )
            act = self._requests.step(self.now_s, self.mission.request, seen, True, True)
            acts += [act] if act is not None else []
            self.now_s = round(self.now_s + 0.05, 2)
        return acts

    def command(self, action: Action) -> str | None:
        """Why it is refused; None where it is not."""
        return self.mission.command(action, int(self.now_s * SECOND), at(self.now_s, self.vehicle, has_hypothesis=True))


def tracked() -> Flight:
    flight = Flight(tracking())
    flight.run(15.0, FlightMode.OFFBOARD)
    return flight


def landing() -> Flight:
    """Told to land at 15 s, and seen to do so from 16 to 20 s."""
    flight = tracked()
    assert flight.command(Action.LAND) is None
    flight.run(16.0, FlightMode.OFFBOARD)
    flight.run(20.0, FlightMode.LAND)
    return flight


def test_a_pilots_hold_during_a_landing_is_a_takeover() -> None:
    """The status stayed "landing" for good, and neither hold nor resume nor land had an effect."""
    flight = landing()
    assert flight.run(30.0, FlightMode.HOLD) == []
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    told = flight.mission.unsteered(30 * SECOND)
    assert told is not None
    assert "under the control of a human pilot" in told
    assert flight.command(Action.LAND) is None
    assert flight.run(31.0, FlightMode.HOLD) == [Act.LAND]


def test_a_hold_that_the_autopilot_shows_after_touchdown_is_nobodys_takeover() -> None:
    """A PX4 does, disarmed; that is believed 2.2 s later, and 5 s later on a roof."""
    flight = landing()
    flight.run(20.0 + STILL_NS / SECOND + 1.0, FlightMode.HOLD, believed_armed=True, armed=False, in_air=False)
    assert (flight.mission.stage, flight.mission.released) == (Stage.LANDING, False)
    flight.run(flight.now_s + 0.1, FlightMode.HOLD, armed=False, in_air=False)
    assert flight.mission.stage is Stage.LANDED


def test_what_an_operator_commands_once_more_is_sent_once_more() -> None:
    """A pilot's hold does not count as a takeover yet: the request to the autopilot is the same."""
    flight = landing()
    assert flight.run(22.0, FlightMode.HOLD) == []
    assert flight.command(Action.LAND) is None
    assert flight.run(22.5, FlightMode.HOLD) == [Act.LAND]
    assert flight.run(25.0, FlightMode.LAND) == []
    assert (flight.mission.stage, flight.mission.request) == (Stage.LANDING, Request.LAND)
    flight.run(25.1 + TOUCHDOWN_NS / SECOND, FlightMode.HOLD)  # and once more by the pilot
    assert flight.mission.released


def test_but_not_against_a_pilot_at_the_sticks() -> None:
    flight = landing()
    assert flight.run(21.0, FlightMode.MANUAL) == []
    assert flight.command(Action.LAND) is None
    assert flight.run(25.0, FlightMode.MANUAL) == []
    assert flight.mission.released


@pytest.mark.parametrize("action", [Action.LAND, Action.HOLD, Action.RETURN, Action.ABORT])
def test_one_that_was_not_armed_has_landed_once_it_is_to_do_something_else(action: Action) -> None:
    """The drone on the ground was reported as flying, and refused to start until its agent was restarted."""
    flight, ground = Flight(Mission(TrackConfig(), floor_m=1.5), 1.0), {"armed": False, "in_air": False, "height_m": 0.0}
    flight.vehicle = replace(VEHICLE, armed=False, in_air=False, height_m=0.0)
    assert flight.command(Action.START) is None
    assert flight.run(5.0, FlightMode.HOLD, **ground) == [Act.ARM] * 3
    assert flight.mission.stage is Stage.TAKEOFF
    assert flight.command(action) is None
    assert flight.run(6.0, FlightMode.HOLD, **ground) == []
    assert flight.mission.stage is Stage.LANDED
    assert flight.command(Action.START) is None
    assert flight.run(7.0, FlightMode.HOLD, **ground) == [Act.ARM]


@pytest.mark.parametrize("action", [Action.RETURN, Action.RESUME])
def test_a_reason_to_land_does_not_outlive_a_takeover(action: Action) -> None:
    """Minutes after the satellites were back, with the vehicle held by its pilot, it refused: "it lands"."""
    flight = tracked()
    flight.run(46.5, FlightMode.HOLD, position_trusted=False)
    assert flight.mission.stage is Stage.LANDING
    flight.run(50.0, FlightMode.LAND, position_trusted=False)
    flight.run(56.0, FlightMode.MANUAL, position_trusted=False)
    assert flight.mission.released
    assert str(flight.command(action)).startswith(f"{action}: it lands: its position could not be trusted")
    flight.run(60.0, FlightMode.HOLD)
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    assert flight.command(action) is None
    assert (flight.mission.request, flight.mission.flight.landed_because) == (Request.OFFBOARD, "")


@pytest.mark.parametrize("action", [Action.RETURN, Action.RESUME])
def test_a_position_that_is_lost_during_a_takeover_counts_after_it(action: Action) -> None:
    flight = tracked()
    flight.run(20.0, FlightMode.MANUAL)
    flight.run(30.0, FlightMode.MANUAL, position_trusted=False)
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    assert flight.command(action) is None
    assert flight.mission.request is Request.HOLD


@pytest.mark.parametrize("action", [Action.LAND, Action.ABORT])
def test_an_abort_that_a_pilot_takes_over_is_told_as_what_the_pilot_does_and_may_be_commanded_again(action: Action) -> None:
    """The abort was reported for good; and left in hold afterwards, the drone refused even to land."""
    flight = tracked()
    assert flight.command(Action.ABORT) is None
    flight.run(17.0, FlightMode.LAND)
    assert flight.command(Action.LAND) == "land: aborted"
    flight.run(22.0, FlightMode.MANUAL)
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    flight.run(30.0, FlightMode.HOLD)
    others = (Action.HOLD, Action.RETURN, Action.RESUME)
    assert [flight.command(other) for other in others] == [f"{other}: aborted" for other in others]
    kept = flight.mission.memory("m", KeptHome(), 30 * SECOND)
    assert kept is not None
    restarted = Mission(TrackConfig())
    restarted.rejoin(kept, flight.vehicle, 30 * SECOND)
    assert restarted.command(Action.RETURN, 31 * SECOND, at(31.0)) == "return: aborted"
    assert flight.command(action) is None
    assert flight.run(31.0, FlightMode.HOLD) == [Act.LAND]
    flight.run(40.0, FlightMode.LAND)
    assert [flight.command(other) for other in others] == [f"{other}: aborted" for other in others]
    flight.run(40.1, FlightMode.HOLD, armed=False, in_air=False)
    assert flight.command(Action.START) is None
    assert flight.run(40.2, FlightMode.HOLD, armed=False, in_air=False) == [Act.ARM]
    assert flight.command(Action.LAND) is None


def rising() -> Flight:
    """Brought to 1.3 m by a failsafe, it rises by setpoints from 21 to 22 s."""
    mission = Mission(TrackConfig(), floor_m=1.5)
    mission.command(Action.START, SECOND, at(1.0))
    flight = Flight(mission, 2.0)
    flight.run(3.0, FlightMode.HOLD)
    flight.run(20.0, FlightMode.OFFBOARD)
    flight.run(21.0, FlightMode.RETURN, healthy=False, height_m=1.3)
    flight.run(22.0, FlightMode.OFFBOARD, height_m=1.3)
    assert (mission.stage, mission.request) == (Stage.TAKEOFF, Request.OFFBOARD)
    return flight


def test_a_pilots_hold_while_it_rises_by_setpoints_is_a_takeover() -> None:
    """The takeover was not reported, and a return commanded by an operator had no effect."""
    flight = rising()
    flight.run(23.0, FlightMode.HOLD, height_m=1.4)
    assert not flight.mission.released
    flight.run(26.0, FlightMode.HOLD, height_m=1.4)
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    assert flight.mission.unsteered(26 * SECOND) is not None
    assert flight.command(Action.RETURN) is None
    assert flight.run(26.1, FlightMode.HOLD, height_m=1.4) == [Act.OFFBOARD]


def test_nor_does_a_pilots_hold_get_lost_when_it_has_risen() -> None:
    flight = rising()
    flight.run(22.1, FlightMode.OFFBOARD, height_m=1.8)
    assert flight.mission.stage is Stage.TRACK
    assert flight.run(23.9, FlightMode.HOLD) == []
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)


def test_a_hold_after_the_autopilots_takeoff_is_its_own_also_after_a_restart() -> None:
    mission = Mission(TrackConfig(), floor_m=1.5)
    mission.command(Action.START, SECOND, at(1.0))
    kept, climbing = mission.memory("m", KeptHome(), 2 * SECOND), replace(VEHICLE, mode=FlightMode.TAKEOFF, height_m=1.0)
    assert kept is not None
    restarted = Mission(TrackConfig(), floor_m=1.5)
    restarted.rejoin(kept, climbing, 3 * SECOND)
    flight = Flight(restarted, 3.0)
    flight.run(4.0, FlightMode.TAKEOFF, height_m=1.0)
    flight.run(8.0, FlightMode.HOLD, height_m=1.4)
    assert (restarted.stage, restarted.released) == (Stage.TAKEOFF, False)
    assert restarted.unsteered(8 * SECOND) is not None


@pytest.mark.parametrize("mode", [FlightMode.RETURN, FlightMode.LAND])
@pytest.mark.parametrize("action", [Action.RETURN, None])
def test_resume_leads_to_what_a_pilot_has_interrupted_in_whatever_mode(action: Action | None, mode: FlightMode) -> None:
    """After a return interrupted by the pilot's own return, and then a hold, the drone searched again."""
    flight = tracked()
    if action is not None:
        assert flight.command(action) is None
        flight.run(18.0, FlightMode.OFFBOARD)
    interrupted = flight.mission.stage
    flight.run(25.0, mode)
    flight.run(30.0, FlightMode.HOLD)
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    kept = flight.mission.memory("m", KeptHome(), 30 * SECOND)
    assert kept is not None
    restarted = Mission(TrackConfig())
    restarted.rejoin(kept, flight.vehicle, 30 * SECOND)
    for mission in (flight.mission, restarted):
        assert mission.command(Action.RESUME, 30 * SECOND, at(30.0, flight.vehicle)) is None
        assert mission.stage is interrupted


def test_a_pilots_own_return_is_not_what_resume_leads_to_after_a_restart() -> None:
    flight = tracked()
    flight.run(25.0, FlightMode.RETURN)
    kept = flight.mission.memory("m", KeptHome(), 25 * SECOND)
    assert kept is not None
    assert (kept.stage, kept.resume) == (Stage.RETURN, Stage.TRACK)
    restarted = Mission(TrackConfig())
    restarted.rejoin(kept, flight.vehicle, 25 * SECOND)
    assert (restarted.stage, restarted.flight.resume) == (Stage.RETURN, Stage.TRACK)


@pytest.mark.parametrize(("action", "follows"), [(Action.RETURN, Stage.RETURN), (Action.RESUME, Stage.TRACK)])
def test_below_the_floor_it_rises_before_it_does_what_is_commanded(action: Action, follows: Stage) -> None:
    flight = rising()
    flight.run(30.0, FlightMode.MANUAL, height_m=0.6)
    assert (flight.mission.stage, flight.mission.released) == (Stage.HOLD, True)
    assert flight.command(action) is None
    assert flight.run(31.0, FlightMode.MANUAL, height_m=0.6) == [Act.OFFBOARD]
    flight.run(33.0, FlightMode.OFFBOARD, height_m=1.2)
    assert (flight.mission.stage, flight.mission.request) == (Stage.TAKEOFF, Request.OFFBOARD)
    kept = flight.mission.memory("m", KeptHome(), 33 * SECOND)
    assert kept is not None
    restarted = Mission(TrackConfig(), floor_m=1.5)
    restarted.rejoin(kept, flight.vehicle, 33 * SECOND)
    for mission in (flight.mission, restarted):
        mission.step(at(33.1, replace(flight.vehicle, height_m=1.8), has_hypothesis=True, last_cone_ns=33 * SECOND))
        assert (mission.stage, mission.request) == (follows, Request.OFFBOARD)


def test_a_return_that_is_commanded_in_a_pilots_return_is_flown_by_the_agent() -> None:
    """The age of the takeover that the command had ended counted on, and released the vehicle again in the next step."""
    flight = tracked()
    flight.run(20.0, FlightMode.RETURN)
    assert (flight.mission.stage, flight.mission.released) == (Stage.RETURN, True)
    assert flight.command(Action.RETURN) is None
    assert Act.OFFBOARD in flight.run(21.0, FlightMode.RETURN)
    assert not flight.mission.released
    flight.run(25.0, FlightMode.OFFBOARD)
    assert (flight.mission.stage, flight.mission.request) == (Stage.RETURN, Request.OFFBOARD)
