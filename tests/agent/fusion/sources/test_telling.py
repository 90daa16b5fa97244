"""The choice of the fitted sources to publish."""

import numpy as np
import pytest
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.fusion.sources.estimator import SourcesAtRest
from radron.agent.fusion.sources.fit import Fitted
from radron.agent.fusion.sources.solution import Solution


@pytest.mark.parametrize(
    ("place_m", "log_activity", "located", "known"),
    [(0.3, 0.1, True, True), (0.3, 0.3, True, False), (3.0, 0.1, False, False)],
)
def test_a_source_is_told_once_both_its_place_and_its_activity_are_known(among, place_m, log_activity, located, known):
    mission = among.mission_of()
    telling = SourcesAtRest(mission, Polygon(mission.area.polygon_m)).telling
    solution = Solution((0,), np.array([(12.0, 20.0)]), np.array([1.0]), 0.0, np.zeros((2, 3)))
    covariance = np.eye(len(solution.vector)) * 1e-4
    fitted = Fitted(solution, 0.0, covariance, 0.0)
    assert telling.is_known(fitted, 0)
    covariance[[0, 1, 2], [0, 1, 2]] = place_m**2, place_m**2, log_activity**2
    fitted = replace(fitted, covariance=covariance)
    assert (telling.is_located(fitted, 0), telling.is_known(fitted, 0)) == (located, known)
    assert telling.is_declared(fitted) == known
