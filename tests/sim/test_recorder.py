"""Every run ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from protocol.messages import Stage
from sim.frame import LocalFrames
from sim.recorder import Recorder
from sim.scenario import load_scenario, override


@pytest.mark.parametrize("stage", [Stage.RETURN, Stage.LANDING, Stage.SURVEY])
@pytest.mark.parametrize("duration_s", [60.0, 500.0])
def test_a_drone_that_never_lands_ends_no_run(stage, duration_s):
    scenario = override(load_scenario("demo"), {"mission.track.duration_s": duration_s, "end.search_s": 100.0, "drones": 1})
    belief = SimpleNamespace(position=np.zeros(3), covariance=np.eye(3))
    pilot = SimpleNamespace(stage=Stage.SURVEY, hypothesis=belief, listeners={})
    recorder = Recorder(scenario, [pilot], LocalFrames([((0.0, 0.0, 0.0), 0.0)]), 0.05)
    position, velocity = np.array([[0.0, 0.0, 3.0]]), np.zeros((1, 3))
    assert not recorder.sample(1.0, position, velocity, (0.0, 0.0))
    pilot.stage = stage
    longest_s = 100.0 + max(180.0, duration_s) + 300.0
    assert not recorder.sample(1.0 + longest_s, position, velocity, (0.0, 0.0))
    assert recorder.sample(1.05 + longest_s, position, velocity, (0.0, 0.0))
