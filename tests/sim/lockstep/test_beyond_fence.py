"""A source beyond the fence, where no drone may fly."""

import math
import re

import pytest

from radron.agent.config.beyond import bearing_beyond
from radron.sim import api


@pytest.mark.slow
def test_the_swarm_tells_the_direction_of_a_source_beyond_the_fence():
    """Drawn 10 to 60 m beyond the fence; without it in its prior the search took it for one at the area's edge."""
    flight = api.fly("beyond-fence", seed=1)
    trace, result = flight.trace, flight.result
    x, y = trace.source_m[-1, :2].tolist()
    true_deg = bearing_beyond(api.load("beyond-fence").mission.area, x, y)
    assert true_deg is not None
    told = re.search(r"source outside the fence, towards (\d{3}) degrees", result.finding)
    assert told is not None
    assert abs(math.remainder(float(told[1]) - true_deg, 360.0)) <= 20.0
    assert result.fence_breaches == 0
