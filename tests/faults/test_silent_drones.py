"""Drones that are not heard or steered any more, while the others fly on: cut off by the radio, without an agent, taken over.

Separation is the true one; under faults 2.5 m are kept, else 3 m. Mostly the hypothesis is given: then the flight is cheap.
"""

import numpy as np
import pytest
from msgspec.structs import replace

from protocol.messages import Stage
from sim.faults.agents import Kill, Partition
from sim.faults.machines import Takeover
from sim.lockstep import fly
from sim.scenario import load_scenario, override

LEAST_M = 2.5


def circling(drones, *faults, until_s=60.0, **values):
    """A swarm around a given place, with these faults."""
    scenario = override(load_scenario("stabilization"), {"drones": drones, "end.track_s": until_s} | values)
    return replace(scenario, fault=faults)


def found(drones, *faults, scenario="ideal-static-swarm", until_s=60.0):
    """A swarm that searches for its source, with these faults."""
    return replace(override(load_scenario(scenario), {"drones": drones, "end.track_s": until_s}), fault=faults)


def split(at_s, for_s, *groups):
    return Partition(at_s=at_s, for_s=for_s, groups=tuple(tuple(group.split()) for group in groups))


def test_the_others_keep_clear_of_the_way_home_of_a_vehicle_whose_agent_is_gone():
    """It climbs, crosses the circle and comes down in its middle: 0.9 m from another one where they took it for stopped."""
    flight = fly(circling(3, Kill(at_s=23.7, target="d2"), until_s=25.0), seed=1)
    assert flight.result.min_separation_m >= LEAST_M


@pytest.mark.slow
@pytest.mark.parametrize("drone", ["d1", "d2", "d3"])
@pytest.mark.parametrize("seed", [2, *(pytest.param(seed, marks=pytest.mark.long) for seed in (3, 4))])
def test_wherever_an_agent_ends(seed, drone):
    flight = fly(circling(3 + 2 * (seed % 2), Kill(at_s=18.0 + 3.0 * seed, target=drone), until_s=60.0), seed=seed)
    assert flight.result.min_separation_m >= LEAST_M


@pytest.mark.slow
@pytest.mark.parametrize(
    "groups", [("d1 d3", "d2 d4 d5"), ("d1 d2", "d3 d4 d5"), ("d4 d5", "d1 d2 d3"), ("d1", "d2", "d3", "d4", "d5")]
)
def test_two_sides_that_do_not_hear_each_other_circle_apart_and_come_together_again(groups):
    """Five at 12 m: 0.3 m apart where both sides stay on one circle."""
    flight = fly(circling(5, split(23.7, 25.0, *groups), until_s=75.0), seed=1)
    assert flight.result.min_separation_m >= LEAST_M
    assert set(flight.trace.stage[-1]) == {Stage.TRACK}
    away = np.hypot(*np.moveaxis(flight.trace.position_m[-50:, :, :2] - (60.0, 50.0), -1, 0))  # the centre has moved meanwhile
    assert np.median(away, axis=0) == pytest.approx(np.full(5, 12.0), abs=1.0)  # in the last 10 s


@pytest.mark.slow
@pytest.mark.parametrize("groups", [("d1 d2", "d3"), ("d1", "d2 d3"), ("d1", "d2", "d3")])
@pytest.mark.parametrize("at_s", [4.0, 25.0])
def test_both_sides_find_and_keep_the_source(at_s, groups):
    """In the search and around the source."""
    flight = fly(found(3, split(at_s, 30.0, *groups)), seed=2)
    assert flight.result.min_separation_m >= LEAST_M
    assert not flight.result.lost
    assert flight.result.error_median_m < 1.0
    assert flight.result.fence_breaches == 0


@pytest.mark.slow
@pytest.mark.parametrize(("policy", "stage"), [("keep", Stage.TRACK), ("hold", Stage.TRACK), ("return", Stage.RETURN)])
def test_a_drone_that_hears_no_other_does_what_the_mission_says(policy, stage):
    flight = fly(circling(3, split(20.0, 200.0, "d1 d2", "d3"), until_s=32.0, **{"mission.safety.alone": policy}), seed=1)
    assert flight.result.min_separation_m >= LEAST_M
    assert (flight.trace.stage[-1] == [Stage.TRACK, Stage.TRACK, stage]).all()
    moved_m = float(np.hypot(*(flight.trace.position_m[-1, 2, :2] - flight.trace.position_m[-8, 2, :2])))
    assert policy == "return" or (moved_m < 1.0) is (policy == "hold")


@pytest.mark.slow
@pytest.mark.parametrize("down_s", [5.0, 20.0])
def test_an_agent_that_is_there_again_goes_on_if_its_vehicle_flies(down_s):
    """It hovers and climbs, or comes down over its launch place; in its failsafe."""
    flight = fly(circling(3, Kill(at_s=23.7, for_s=down_s, target="d2"), until_s=40.0), seed=1)
    time_s, stage = flight.trace.time_s, flight.trace.stage[:, 1]
    assert (stage[time_s > 23.7 + down_s + 15.0] == Stage.TRACK).all()
    assert flight.result.min_separation_m >= LEAST_M


@pytest.mark.slow
def test_one_whose_vehicle_has_landed_stays_on_the_ground():
    flight = fly(circling(3, Kill(at_s=23.7, for_s=50.0, target="d2"), until_s=85.0), seed=1)
    assert flight.trace.stage[-1, 1] in (Stage.PREFLIGHT, Stage.LANDED)  # the agent is there again since 73.7 s
    assert flight.trace.position_m[-1, 1, 2] < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["hold", "manual", "return", "land"])
@pytest.mark.parametrize(("drone", "seed"), [("d2", 1), pytest.param("d1", 2, marks=pytest.mark.long)])
def test_the_others_keep_clear_of_a_drone_that_a_pilot_takes_over(drone, seed, mode):
    """It stops on the circle: the next one came to 1.1 m, as it believed that drone's last plan."""
    flight = fly(circling(5, Takeover(at_s=25.0, for_s=12.0, target=drone, mode=mode), until_s=42.0), seed=seed)
    assert flight.result.min_separation_m >= LEAST_M
