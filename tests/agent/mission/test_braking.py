"""The way to a hold, steered clear of the others."""

import pytest
from msgspec.structs import replace

from radron.agent.mission.authority import TAKEOVER_NS
from radron.agent.vehicle.interface import FlightMode, Request
from radron.protocol.messages import Action, Stage
from support.flights.situations import CALM, OFFBOARD, SECOND, VEHICLE, at, tracking

MOVING = replace(OFFBOARD, velocity_mps=(3.0, 0.0, 0.0))


def held(vehicle, after_s, now=None, slow_s=0.0):
    """The request to an autopilot so long after a hold was commanded in flight; ``now``: the vehicle then, and for the last
    ``slow_s``.
    """
    mission = tracking()
    assert mission.command(Action.HOLD, 20 * SECOND, at(20.0, vehicle)) is None
    mission.step(at(20.0 + after_s - slow_s, now or vehicle))
    mission.step(at(20.0 + after_s, now or vehicle))
    assert (mission.stage, mission.released) == (Stage.HOLD, False)
    return mission.request


def test_a_drone_that_is_told_to_hold_brakes_by_its_own_setpoints():
    assert held(MOVING, 1.0) is Request.OFFBOARD
    assert held(MOVING, 2.0, OFFBOARD, slow_s=0.7) is Request.OFFBOARD  # slow, and still leaning against its way
    assert held(MOVING, 2.0, OFFBOARD, slow_s=0.9) is Request.HOLD  # at rest
    assert held(OFFBOARD, 0.05) is Request.HOLD
    assert held(MOVING, 5.1) is Request.HOLD  # never came to rest


@pytest.mark.parametrize("changes", [{"mode": FlightMode.HOLD}, {"mode": FlightMode.MANUAL}, {"position_trusted": False}])
def test_but_not_where_something_else_flies_it_or_it_does_not_know_where_it_is(changes):
    assert held(replace(MOVING, **changes), 0.05) is Request.HOLD


def test_once_held_it_stays_held():
    mission = tracking()
    mission.command(Action.HOLD, 20 * SECOND, at(20.0, MOVING))
    for now_s, vehicle in (
        (20.5, MOVING),
        (20.6, OFFBOARD),
        (21.0, OFFBOARD),
        (21.41, OFFBOARD),
        (21.5, replace(VEHICLE, velocity_mps=(1.0, 0.0, 0.0))),
        (22.0, MOVING),
    ):
        mission.step(at(now_s, vehicle))
        assert mission.request is (Request.OFFBOARD if now_s < 21.1 else Request.HOLD)
    mission.step(at(22.0 + 2 * TAKEOVER_NS / SECOND, VEHICLE))
    assert not mission.released
    assert mission.command(Action.RESUME, 30 * SECOND, replace(CALM, now_ns=30 * SECOND)) is None
    assert mission.stage is Stage.TRACK
