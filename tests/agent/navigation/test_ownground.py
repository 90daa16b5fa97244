"""Heights above the ground by the rangefinder."""

import numpy as np
import pytest
from msgspec.structs import replace

from radron.agent.navigation.moment import Moment
from radron.agent.navigation.peers.newest import Peers
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Stage
from support.flights.one_navigator import MISSION, made
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, state

FLOOR_M, CEILING_M = 1.5, 6.0


def heights(off_m=0.0, wanted_m=3.0, drift_m=0.0):
    """The last heights of a searching vehicle that stays that far above its setpoints; ``drift_m``: final error of its own
    height, positive if too high.
    """
    area = replace(MISSION.area, floor_m=FLOOR_M, ceiling_m=CEILING_M)
    mission = replace(MISSION, area=area, survey=replace(MISSION.survey, height_m=wanted_m))
    navigator, own, frames = made(mission)
    (x, y, z), velocity, found = frames.mission_from_local("d1", 0).inverse().apply_point((35.0, 25.0, wanted_m)), (0.0,) * 3, []
    ticks = round(15.0 * SECOND / TICK_NS)
    for tick in range(ticks):
        now_ns, drifted_m = START_NS + tick * TICK_NS, drift_m * min(1.5 * tick / ticks, 1.0)
        seen = replace(state(now_ns, FlightMode.OFFBOARD, (x, y, z + drifted_m)), velocity_mps=velocity, height_m=z)
        vehicle = own.take(seen)
        setpoint, _ = navigator.step(Moment(now_ns, Stage.SURVEY, START_NS, vehicle, None), Peers([]))
        (x, y, z), velocity = setpoint.position_m, setpoint.velocity_mps
        z += off_m - drifted_m
        found.append(z)
    return np.array(found[-40:])


def test_who_keeps_its_distance_from_floor_and_ceiling_flies_as_high_as_it_is_told():
    assert heights(-0.3) == pytest.approx(np.full(40, 2.7), abs=0.05)


@pytest.mark.parametrize(("off_m", "wanted_m"), [(-0.8, 2.2), (0.8, 5.3)], ids=["floor", "ceiling"])
def test_who_comes_near_floor_or_ceiling_by_its_rangefinder_is_told_to_keep_off(off_m, wanted_m):
    """An autopilot whose climb rate was wrong flew a second below the floor, against a command to fly 1.3 m above it."""
    found = heights(off_m, wanted_m)
    assert found.min() > FLOOR_M + 0.1
    assert found.max() < CEILING_M - 0.1


@pytest.mark.parametrize(("wanted_m", "drift_m"), [(2.2, -2.0), (5.3, 2.0)], ids=["floor", "ceiling"])
def test_floor_and_ceiling_stay_where_they_are_while_the_autopilots_height_drifts(wanted_m, drift_m):
    """Floor and ceiling drifted along: a drone could not descend to its height any more, and flew too high by the drift."""
    assert heights(wanted_m=wanted_m, drift_m=drift_m) == pytest.approx(np.full(40, wanted_m), abs=0.25)
