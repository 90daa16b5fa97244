"""Preflight: the heights at which the autopilots return without their agents."""

import pytest

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig, SafetyConfig
from radron.agent.preflight.layers import layers_finding


def mission(ceiling_m=30.0, slam=(), **safety):
    return MissionConfig(
        name="test",
        area=AreaConfig(polygon_m=((0.0, 0.0), (60.0, 0.0), (60.0, 40.0)), ceiling_m=ceiling_m),
        drones=tuple(DroneInMission(id=name, localization="slam" if name in slam else "exact") for name in ("d1", "d2", "d3")),
        safety=SafetyConfig(**safety),
    )


def test_each_drone_has_its_own():
    finding = layers_finding(mission(), "d2")
    assert (finding.verdict, finding.text) == ("ok", "14 m above its launch place; d1 10 m, d3 18 m")


def test_too_low_a_ceiling_leaves_no_room_for_them():
    finding = layers_finding(mission(ceiling_m=12.0), "d1")
    assert finding.verdict == "failed"
    assert "only 0.4 m between" in finding.text
    assert layers_finding(mission(ceiling_m=12.0, return_layer_m=0.0), "d1").verdict == "ok"  # as the mission wants


@pytest.mark.parametrize(("drone", "values"), [("d1", {"agent_lost": "land"}), ("d2", {"slam": ("d2",)})])
def test_who_does_not_return_needs_none(drone, values):
    assert layers_finding(mission(**values), drone) is None
