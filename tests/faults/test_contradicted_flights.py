"""Slow spoofing of one of four drones, in a mission that takes all positions for exact."""

import msgspec
import numpy as np
import pytest

from radron.agent.mission.telling import LEFT_OUT
from radron.protocol.messages import Stage
from radron.sim.lockstep.flight import fly
from radron.sim.scenario import load_scenario, override

SPOOFED = {"kind": "spoofed", "target": "d2", "at_s": 40.0, "speed_mps": 1.0, "most_m": 9.0}


@pytest.mark.slow
def test_a_spoofed_drone_is_told_and_does_not_take_the_source_along():
    scenario = override(load_scenario("ideal-static-swarm"), {"drones": 4, "source.activity_bq": 9e9})
    scenario = msgspec.convert(msgspec.to_builtins(scenario) | {"fault": [SPOOFED]}, type(scenario))
    errors, told = [], {}

    def watch(moment):
        pilot = moment.pilots[0]
        if moment.time_s > 60.0 and pilot.stage is Stage.TRACK and pilot.hypothesis is not None:
            errors.append(float(np.linalg.norm(pilot.hypothesis.position[:2] - np.array(moment.source))))
        for text in pilot.problems:
            if LEFT_OUT in text:
                told.setdefault(text.partition(":")[0], moment.time_s)
        return moment.time_s > 110.0

    fly(scenario, 1, watch=watch)
    assert set(told) == {"d2"}
    assert told["d2"] < 70.0
    assert max(errors) < 1.0
