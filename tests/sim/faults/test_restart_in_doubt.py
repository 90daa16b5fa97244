"""A drone after an unannounced jump of its localisation, its agent then killed and restarted: its position stays uncertain."""

from itertools import combinations
from math import dist

import pytest
from msgspec.structs import replace

from radron.agent.mission.stages import STRANDED_S
from radron.protocol.messages import Stage
from radron.sim.faults.kinds import read_faults
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario
from radron.sim.scoring.moment import Moment

JUMP_S, KILL_S, BACK_S = 12.0, 13.0, 15.0
END_S = BACK_S + STRANDED_S + 1.0
FAULTS = (
    {"kind": "position-jump", "at_s": JUMP_S, "jump_m": 20.0, "target": "d2"},
    {"kind": "kill", "at_s": KILL_S, "for_s": BACK_S - KILL_S, "target": "d2"},
)


@pytest.mark.slow
def test_after_a_restart_it_is_kept_clear_of_in_both_places_and_returns() -> None:
    least_m, places, stages = float("inf"), list[int](), list[Stage]()

    def watch(moment: Moment) -> bool:
        nonlocal least_m
        first, second, _ = moment.pilots
        least_m = min(least_m, *(dist(one, other) for one, other in combinations(moment.position_m.tolist(), 2)))
        if second is not None:
            stages.append(second.stage)
        if first is not None and first.reckoning is not None and moment.time_s > BACK_S + 1.0:
            places.append(sum(other.id == "d2" for other in first.reckoning.others))
        return moment.time_s > END_S

    watched(replace(load_scenario("paper-demo"), fault=read_faults(list(FAULTS), "test")), 1, watch)
    assert min(places) == 2
    assert stages[-1] is Stage.RETURN
    assert least_m > 3.0
