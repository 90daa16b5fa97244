"""Drones without links to each other, their agents then restarted in flight: they know of each other from before."""

from itertools import combinations
from math import dist

import pytest
from msgspec.structs import replace

from radron.protocol.messages import Stage
from radron.sim.faults.kinds import read_faults
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario
from radron.sim.scoring.moment import Moment

FREEZE_S, END_S = 30.0, 60.0


PUSHED = pytest.mark.xfail(strict=True, reason="open defect pushed-while-climbing: 2.5 m")


@pytest.mark.slow
@pytest.mark.parametrize("part_s", [22.0, pytest.param(31.0, marks=PUSHED)])  # before, and while none of them runs
def test_agents_that_are_all_restarted_while_nobody_hears_anybody_keep_apart(part_s) -> None:
    faults = (
        {"kind": "partition", "at_s": part_s, "groups": [["d1"], ["d2"], ["d3"]]},
        {"kind": "freeze", "at_s": FREEZE_S, "for_s": 2.9},  # of all: their watchdogs start them again
    )
    least_m, rejoined, stages = float("inf"), set[str](), set[Stage]()

    def watch(moment: Moment) -> bool:
        nonlocal least_m
        least_m = min(least_m, *(dist(one, other) for one, other in combinations(moment.position_m.tolist(), 2)))
        if moment.time_s > FREEZE_S + 3.0:
            for name, pilot in zip(("d1", "d2", "d3"), moment.pilots, strict=True):
                if pilot is not None and pilot.counters["rejoined"]:
                    rejoined.add(name)
                    stages.add(pilot.stage)
        return moment.time_s > END_S

    watched(replace(load_scenario("paper-demo"), fault=read_faults(list(faults), "test")), 3, watch)
    assert rejoined == {"d1", "d2", "d3"}
    assert Stage.SURVEY in stages
    assert least_m > 3.0
