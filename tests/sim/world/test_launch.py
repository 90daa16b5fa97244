"""Launch places: apart from each other, and found or refused after a bounded number of draws."""

import msgspec
import numpy as np
import pytest

from radron.agent.errors import ConfigError
from radron.sim.scenario import load_scenario, override
from radron.sim.world.launch import StartTruth, launch_places

MISSION = override(load_scenario("paper-demo"), {"drones": 8}).mission


@pytest.mark.parametrize("seed", range(20))
def test_the_smallest_square_that_is_allowed_has_places_for_all(seed):
    least = smallest()
    places = launch_places(StartTruth(scatter_m=least, centre_m=(5.0, -7.0)), MISSION, np.random.default_rng(seed))
    assert np.abs(places - [5.0, -7.0, 0.0]).max() <= least
    apart = np.hypot(*(places[:, None] - places[None])[..., :2].transpose(2, 0, 1))
    assert apart[~np.eye(8, dtype=bool)].min() > 2.0 * MISSION.limits.separation_m


def smallest():
    for scatter in np.arange(0.1, 30.0, 0.1):
        try:
            StartTruth(scatter_m=float(scatter)).check(MISSION, "here")
        except ConfigError:
            continue
        return float(scatter)
    raise AssertionError("nothing is allowed")


def test_no_room_is_an_error_and_not_an_endless_search(monkeypatch):
    monkeypatch.setattr("radron.sim.world.launch._ATTEMPTS", 2)
    with pytest.raises(ConfigError, match="no room for 8 drones"):
        launch_places(StartTruth(scatter_m=1.0), MISSION, np.random.default_rng(1))


def test_without_scatter_they_stand_on_their_launch_places():
    places = launch_places(StartTruth(), MISSION, np.random.default_rng(1))
    assert places[1].tolist() == [25.0, 2.0, 0.0]
    one = msgspec.structs.replace(MISSION, drones=MISSION.drones[:1])
    StartTruth(scatter_m=0.1).check(one, "here")  # a single drone has room anywhere
