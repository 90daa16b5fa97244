"""Homes of lost peers, which a returning drone keeps clear of."""

from __future__ import annotations

import numpy as np
import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.frames.transform import Transform
from radron.agent.motion.reference import PeerState
from radron.agent.navigation.others.belief import PeerBelief
from radron.agent.navigation.unheard.agentless import Agentless
from radron.agent.navigation.unheard.homes import Homes
from radron.agent.navigation.unheard.viewer import Viewer

MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (100.0, 0.0), (100.0, 100.0), (0.0, 100.0))),
    drones=tuple(DroneInMission(id=name) for name in ("d1", "d2", "d3")),
)
HOME = (50.0, 50.0, 0.0)
STEP_S = 0.2


def is_kept(silent_s: float, height_m: float, climb_mps: float = 0.0, me: str = "d3", place=(30.0, 50.0, 3.0)) -> bool:
    """Whether a returning drone over the home of d2, in this height, keeps clear of it so long after the contact at ``place``."""
    heights_m = height_m + climb_mps * STEP_S * np.arange(21.0)
    ahead = np.column_stack((np.tile(HOME[:2], (21, 1)), heights_m))
    viewer = Viewer(round(silent_s * 1e9), 0, STEP_S, Transform(), lambda: ahead, lambda _: None, None, height_m, silent_s)
    returns = Agentless(MISSION).return_of("d2", PeerState(place), HOME, steered=True)
    homes = Homes(MISSION, me, {"d2": PeerBelief()})
    return bool(homes.coming_down("d2", HOME, viewer, [(0, returns)])) and len(homes.kept) == 1


def test_a_home_is_kept_clear_of_once_its_drone_can_be_there() -> None:
    """d2 climbs by 11 m in 7.5 s, and flies 20 m. Kept clear of at once, its home pushed a drone that climbed there to 1.3 m."""
    assert not is_kept(1.0, 3.0)
    assert not is_kept(5.9, 3.0)
    assert is_kept(6.1, 3.0)  # 10 s, at the end of the plan
    assert is_kept(1.0, 3.0, place=(52.0, 50.0, 3.0))  # a drone near its home does not climb first


def test_a_drone_that_climbs_out_of_the_way_in_time_stays() -> None:
    assert not is_kept(6.1, 11.0, climb_mps=2.0)  # at 18.8 m by then
    assert is_kept(6.1, 11.0)


@pytest.mark.parametrize(("me", "height_m", "expected"), [("d1", 10.0, True), ("d3", 18.0, False), ("d3", 12.0, True)])
def test_a_drone_in_a_higher_layer_passes_over_the_home(me, height_m, expected) -> None:
    assert is_kept(20.0, height_m, me=me) is expected
