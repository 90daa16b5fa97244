"""Corrections by `doctor --write`: after any fault, the new value passes the check that found it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radron.agent.config.drone import DroneConfig, VehicleConfig, VisionConfig
from radron.agent.config.loading import convert
from radron.agent.config.mission import MissionConfig
from radron.agent.preflight.corrections import MOST_ATTEMPTS, Corrections
from radron.agent.vehicle.demands import demands_of
from radron.agent.vehicle.mavlink.messages import ParameterValue
from radron.agent.vehicle.parameters import FLOAT, INT32, value_of, wire_value
from radron.agent.vehicle.px4 import Px4Vehicle
from radron.agent.vehicle.rules import correction, rules_of

DRONES = [{"id": "d1", "origin_m": [5, 5, 0]}, {"id": "d2", "origin_m": [9, 5, 0]}]
AREA = {"polygon_m": [[0, 0], [60, 0], [60, 60], [0, 60]]}
BY_HAND = {"EKF2_HGT_REF"}  # depends on the sensors that the vehicle has


@dataclass(frozen=True)
class Kind:
    gnss: bool
    vision: bool


def mission(agent_lost: str = "return") -> MissionConfig:
    document = {"name": "yard", "drones": DRONES, "area": AREA, "safety": {"agent_lost": agent_lost}}
    return convert(document, MissionConfig, "mission.toml")


@pytest.mark.parametrize("kind", [Kind(True, False), Kind(True, True), Kind(False, True)])
@pytest.mark.parametrize("agent_lost", ["return", "land", "hold"])
@settings(max_examples=30)
@given(before=st.floats(-10.0, 1e7))
def test_a_correction_passes_the_check_that_failed(kind: Kind, agent_lost: str, before: float) -> None:
    vision = VisionConfig(address="127.0.0.1:1") if kind.vision else None
    drone, plan = DroneConfig(id="d2", vehicle=VehicleConfig(gnss=kind.gnss, vision=vision)), mission(agent_lost)
    demands = demands_of(plan, drone, sets=False)
    for rule in rules_of(demands):
        wanted = correction(rule.name, before, demands)
        if rule.name in BY_HAND:
            assert wanted is None
        else:
            assert wanted is not None
            assert rule.check(wanted, demands) is None


def test_the_autopilots_fence_lies_outside_the_agents() -> None:
    wanted = correction("GF_MAX_HOR_DIST", 0.0, demands_of(mission(), DroneConfig(id="d1"), sets=False))
    assert wanted == 128.0  # to the farthest corner 77.8 m, the margin 30 m, and 20 m


@pytest.mark.parametrize(("value", "kind"), [(3.0, INT32), (2_000_000.0, INT32), (10.5, FLOAT), (0.0, INT32)])
def test_a_value_survives_the_link(value: float, kind: int) -> None:
    assert value_of(ParameterValue("X", wire_value(value, kind), kind)) == value


@dataclass
class Deaf:
    """A vehicle that keeps a wrong value, in spite of any setting."""

    told: list[tuple[str, float]] = field(default_factory=list)

    @property
    def parameters(self) -> Deaf:
        return self

    def wrong(self) -> dict[str, float]:
        return {"COM_OF_LOSS_T": 5.0, "EKF2_HGT_REF": 0.0}

    def value(self, name: str) -> float:
        return self.wrong()[name]

    def set_parameter(self, name: str, value: float) -> bool:
        self.told.append((name, value))
        return True


def test_a_wrong_parameter_is_waited_for_while_it_may_still_be_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("radron.agent.preflight.corrections.AGAIN_S", 0.0)
    monkeypatch.setattr("radron.agent.preflight.corrections._ANSWER_S", 0.3)
    vehicle, corrections = Deaf(), Corrections(demands_of(mission(), DroneConfig(id="d1"), sets=False))
    assert corrections.tries("COM_OF_LOSS_T")
    assert not corrections.tries("EKF2_HGT_REF")  # only a person can choose

    async def set_all() -> None:
        setting = asyncio.create_task(corrections.run(cast(Px4Vehicle, vehicle)))
        while corrections.tries("COM_OF_LOSS_T"):
            await asyncio.sleep(0.02)
        setting.cancel()

    asyncio.run(set_all())
    assert vehicle.told == [("COM_OF_LOSS_T", 1.0)] * MOST_ATTEMPTS
    assert [change.taken for change in corrections.changes] == [False]
