"""Members that poison the log, and that the others name."""

import msgspec
import numpy as np
import pytest

from radron.protocol.codes import Code
from radron.protocol.messages import Stage
from radron.sim.lockstep.flight import watched
from radron.sim.scenario import load_scenario, override

NAMING = (Code.EXPOSURES_LEFT_OUT, Code.MEASUREMENTS_LEFT_OUT)
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
            told.update((text.code, text.about) for text in pilot.problems if text.code in NAMING)
        return moment.time_s > UNTIL_S

    watched(scenario, 1, watch)
    return max(errors), tracks, told


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ({"for_s": 2.0, "lasts_s": 8.0, "burst": 26}, Code.EXPOSURES_LEFT_OUT),
        ({"lasts_s": 2.0}, Code.EXPOSURES_LEFT_OUT),
        ({"beside": False}, Code.MEASUREMENTS_LEFT_OUT),
        ({"beside": False, "counts": "many", "place": "elsewhere"}, Code.MEASUREMENTS_LEFT_OUT),
    ],
)
def test_poison_moves_no_track_and_its_sender_is_named(fault, named):
    error_m, tracks, told = flown(**fault)
    assert tracks
    assert error_m < 1.0  # without poison 0.4; with one camera of three left out 0.6
    assert {about for _, about in told} == {"d2"}
    assert named in {code for code, _ in told}
