"""Safety is judged by its definition, without tolerance."""

import numpy as np
import pytest

from radron.agent.config.mission import AreaConfig
from radron.protocol.messages import Stage
from radron.sim.scoring.safety import Safety

AREA = AreaConfig(polygon_m=((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)), fence_margin_m=5.0, floor_m=1.5, ceiling_m=10.0)


def judged(*ticks, stage=Stage.SURVEY):
    safety = Safety(AREA)
    for places in ticks:
        safety.sample(np.array(places, dtype=np.float64), [stage] * len(places))
    return safety


def test_separation_is_horizontal_and_counts_climbs_and_landings():
    above = [(5.0, 5.0, 3.0), (9.0, 5.0, 9.0)]
    climbing = [(5.0, 5.0, 0.6), (8.5, 5.0, 3.0)]
    on_the_ground = [(5.0, 5.0, 0.4), (5.5, 5.0, 3.0)]
    assert judged(above, stage=Stage.TAKEOFF).least_separation_m() == 4.0
    assert judged(above, climbing, on_the_ground, stage=Stage.LANDING).least_separation_m() == 3.5
    assert judged(on_the_ground).least_separation_m() is None
    assert judged([(5.0, 5.0, 3.0)]).least_separation_m() is None


INSIDE, OUTSIDE, HIGH, LOW = (5.0, 5.0, 3.0), (25.1, 5.0, 3.0), (5.0, 5.0, 10.1), (5.0, 5.0, 1.4)


@pytest.mark.parametrize(
    ("track", "stage", "breaches"),
    [
        ([INSIDE, OUTSIDE, OUTSIDE, INSIDE, OUTSIDE], Stage.SURVEY, 2),
        ([OUTSIDE, OUTSIDE], Stage.RETURN, 1),
        ([(25.1, 5.0, 0.4)], Stage.LANDING, 0),
        ([INSIDE, HIGH, INSIDE], Stage.TAKEOFF, 1),
        ([INSIDE, LOW], Stage.SURVEY, 1),
        ([INSIDE, LOW], Stage.TRACK, 1),
        ([INSIDE, LOW], Stage.REACQUIRE, 1),
        ([INSIDE, LOW], Stage.LANDING, 0),
    ],
)
def test_breaches(track, stage, breaches):
    assert judged(*([place] for place in track), stage=stage).fence_breaches() == breaches
