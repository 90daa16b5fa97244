"""Honest drones beside a member that publishes false facts about itself: they keep their separation.

Its own separation is its own affair: a false fact may narrow its occupancy only as far as its poses allow.
"""

from itertools import combinations
from math import hypot, inf

import pytest
from msgspec.structs import replace

from radron.sim.faults.agents import Cut, Lie
from radron.sim.lockstep.flight import fly
from radron.sim.scenario import load_scenario, override

SEPARATION_M = 3.0
LIAR = 1  # place of d2
BESIDE_M = 5.0  # height above which one drone crosses another


@pytest.mark.parametrize("what", ["stage", "contacts", "home", "alternative"])
def test_honest_drones_keep_apart_beside_a_drone_with_a_false_report(what):
    """Two of them lose each other meanwhile; the liar has links to both, and could keep them on one circle."""
    lie, cut = Lie(at_s=14.0, target="d2", what=what), Cut(at_s=20.0, for_s=8.0, target="d1", peers="d3")
    scenario = override(load_scenario("stabilization"), {"drones": 3, "end.track_s": 30.0})
    least_m = inf

    def watch(moment):
        nonlocal least_m
        honest = [place for drone, place in enumerate(moment.position_m) if drone != LIAR and place[2] > 0.5]
        flat = ((hypot(*(one - other)[:2]), abs((one - other)[2])) for one, other in combinations(honest, 2))
        least_m = min([least_m, *(away_m for away_m, above_m in flat if above_m < BESIDE_M)])
        return False

    fly(replace(scenario, fault=(lie, cut)), seed=1, watch=watch)
    assert least_m >= SEPARATION_M
