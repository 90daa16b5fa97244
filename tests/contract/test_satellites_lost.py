"""A mission's reaction to a real PX4 that lost its satellites. The recording ignores all requests: the test judges the agent's
requests and their times.
"""

from __future__ import annotations

from itertools import pairwise

import pytest

from radron.agent.config.mission import TrackConfig
from radron.agent.mission.situation import Situation
from radron.agent.mission.stages import Mission
from radron.agent.mission.transitions import Event
from radron.agent.vehicle.interface import Request, Setpoint, VehicleCommand
from radron.protocol.messages import Action, Stage
from support.px4.recorded import LOOK_S, Asked, Replay

SECOND = 1_000_000_000
SET_MODE, LAND = 176, 21
AUTO, OFFBOARD = 4, 6


class Flown:
    """A mission that surveys, its setpoints 3 m beside where it believes to be."""

    def __init__(self, name: str) -> None:
        self.mission = Mission(TrackConfig())
        self.stages: list[tuple[float, Stage]] = []
        self.requests: list[tuple[float, Request]] = []
        self._replay = Replay(name)
        self._replay.run(self._command)
        self.sent = self._replay.link.asked

    def _command(self, time_s: float) -> VehicleCommand:
        states, mission = self._replay.states, self.mission
        if not states:
            return VehicleCommand(Request.STAY)
        vehicle, now_ns = states[-1][1], round((1000.0 + time_s) * SECOND)
        situation = Situation(now_ns, vehicle, has_hypothesis=False, last_cone_ns=0, at_home=False)
        if mission.stage is Stage.PREFLIGHT:
            assert mission.command(Action.START, 1, situation) is None
            mission._apply(Event.SEARCHES, now_ns)
        mission.step(situation)
        self.stages.append((time_s, mission.stage))
        self.requests.append((time_s, mission.request))
        east_m, north_m, up_m = vehicle.position_m
        setpoint = Setpoint((east_m + 3.0, north_m, up_m), (0.0,) * 3, (0.0,) * 3, 0.0, 0.0)
        return VehicleCommand(mission.request, setpoint if mission.request is Request.OFFBOARD else None)

    def setpoints(self, begin_s: float, end_s: float = float("inf")) -> list[Asked]:
        return [one for one in self.sent if one.name == "SET_POSITION_TARGET_LOCAL_NED" and begin_s <= one.time_s <= end_s]

    def modes(self, begin_s: float) -> list[tuple[float, str]]:
        """The modes asked for."""
        found = []
        for one in self.sent:
            if one.time_s < begin_s or one.name != "COMMAND_LONG":
                continue
            number, parameters = one.fields["command"], one.fields["parameters"]
            if number == LAND:
                found.append((one.time_s, "land"))
            elif number == SET_MODE:
                found.append((one.time_s, {AUTO: "hold", OFFBOARD: "offboard"}[parameters[1]]))
        return found


def test_after_a_landing_that_was_not_noticed_nothing_moves_it_off_the_ground_again() -> None:
    """20 s without satellites from a hover: PX4 went back to offboard by itself, and flew to its old setpoint at 5 m/s."""
    lost_s, failsafe_s = 3.1, 9.2
    flown = Flown("D_gps_loss_20s_hover")
    assert flown.setpoints(0.0, lost_s)
    assert flown.setpoints(lost_s + 1.3) == []  # neither in the failsafe nor after the satellites are back
    first, *others = flown.modes(lost_s)
    assert first == (pytest.approx(lost_s + 1.0, abs=0.3), "hold")  # while PX4 still takes it
    assert "offboard" not in [mode for _, mode in others]
    landing_s = [time_s for time_s, mode in others if mode == "land"]
    assert landing_s[0] < failsafe_s + 3.0  # 3 m high
    between = [later - sooner for sooner, later in pairwise(landing_s) if later < 26.0]
    assert max(between) < 1.0  # again and again: what PX4 goes back to was never changed
    assert flown.stages[-1][1] is Stage.LANDING
    assert "position" in flown.mission.flight.landed_because


def test_a_landing_that_was_noticed_ends_the_mission() -> None:
    flown = Flown("D_gps_loss_20s_circling_r12_v3")
    assert flown.setpoints(9.4) == []
    assert next(mode for _, mode in flown.modes(8.2)) == "hold"
    assert flown.stages[-1][1] is Stage.LANDED
    assert "position" in flown.mission.flight.landed_because


def test_a_loss_of_two_seconds_is_stayed_out_and_then_forgotten() -> None:
    flown = Flown("D_gps_loss_2s_circling_r12_v3")
    lost_s, trusted_s = 8.1, 13.2
    assert flown.mission.stage is Stage.SURVEY
    assert flown.setpoints(lost_s + 1.3, trusted_s - LOOK_S) == []
    assert {mode for time_s, mode in flown.modes(lost_s) if time_s < trusted_s} == {"hold"}
    assert flown.setpoints(trusted_s + 0.3)
    assert not flown.mission.flight.landed_because


def test_a_loss_of_five_seconds_is_survived_where_it_is_certainly_high_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """PX4 descended for two seconds from 3.1 m, and reported it for 2.0 s."""
    name, lost_s, trusted_s = "D_gps_loss_5s_circling_r12_v3", 8.1, 17.5
    high = Flown(name)
    assert high.mission.stage is Stage.SURVEY
    assert high.setpoints(lost_s + 1.3, trusted_s - LOOK_S) == []
    assert {mode for time_s, mode in high.modes(lost_s) if time_s < trusted_s} == {"hold"}
    assert high.setpoints(trusted_s + 0.3)
    assert not any("not in offboard" in (high.mission.unsteered(round(time_s * SECOND)) or "") for time_s, _ in high.stages)
    monkeypatch.setattr("radron.agent.mission.positionloss.NEAR_GROUND_M", 1.5)
    low = Flown(name)
    assert low.mission.stage is Stage.LANDING
    assert low.setpoints(lost_s + 1.3) == []
