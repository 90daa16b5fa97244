"""Members that poison the log, and that the others name."""

import msgspec
import numpy as np
import pytest

from radron.agent.mission.telling import LEFT_OUT, MISEXPOSED
from radron.protocol.messages import Stage
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario, override

AT_S, UNTIL_S = 14.0, 24.0  # the source is tracked from 8 s on


def flown(**fault):
    """Error of the estimates of the others, whether they have tracked throughout, and their reports on d2."""
    scenario = override(load_scenario("ideal-static-swarm"), {"drones": 3, "mission.fusion.estimator": "bayes"})
    entry = {"kind": "poisoned", "target": "d2", "at_s": AT_S} | fault
    scenario = msgspec.convert(msgspec.to_builtins(scenario) | {"fault": [entry]}, type(scenario))
    errors, told, tracks = [], set(), True

    def watch(moment):
        nonlocal tracks
        for drone in (0, 2) if moment.time_s > AT_S else ():
            pilot = moment.pilots[drone]
            tracks = tracks and pilot.stage is Stage.TRACK and pilot.hypothesis is not None
            if pilot.hypothesis is not None:
                errors.append(float(np.linalg.norm(pilot.hypothesis.position[:2] - np.array(moment.source))))
            told.update(text for text in pilot.problems if LEFT_OUT in text or MISEXPOSED in text)
        return moment.time_s > UNTIL_S

    watched(scenario, 1, watch)
    return max(errors), tracks, told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ({"for_s": 2.0, "lasts_s": 8.0, "burst": 26}, "d2: its exposures are too long"),
        ({"lasts_s": 2.0}, "d2: its exposures overlap"),
        ({"beside": False}, f"d2: {LEFT_OUT}"),
        ({"beside": False, "counts": "many", "place": "elsewhere"}, f"d2: {LEFT_OUT}"),
    ],
)
def test_poison_moves_no_track_and_its_sender_is_named(fault, named):
    error_m, tracks, told = flown(**fault)
    assert tracks
    assert error_m < 1.0  # without poison 0.4; with one camera of three left out 0.6
    assert {text.partition(":")[0] for text in told} == {"d2"}
    assert any(text.startswith(named) for text in told)
