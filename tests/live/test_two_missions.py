"""Two missions in a row on the same vehicles, by agents that are not restarted in between."""

from __future__ import annotations

import asyncio
from math import dist
from pathlib import Path

import pytest

from radron.agent.flight.replay import replay
from radron.sim.live.course import Course
from radron.sim.live.places import Places
from radron.sim.live.swarm import READY_S, live_swarm
from radron.sim.live.view import View
from radron.sim.live.worldlink import Order
from radron.sim.px4test.witness import Moment, Witness
from radron.sim.result import RunResult
from radron.sim.scenario import load_scenario, override

SEED = 2
AGAIN_S = 60.0  # a landing may be noticed late
HOME_M = 3.0


@pytest.mark.slow
def test_a_second_mission_is_flown_as_the_first_without_a_restart(tmp_path: Path) -> None:
    scenario = override(load_scenario("paper-demo"), {"drones": 2, "mission.track.duration_s": 12.0})
    results: list[RunResult] = []
    ends: list[Moment] = []

    async def course() -> tuple[bool, list[tuple[float, float, float]]]:
        async with live_swarm(scenario, SEED, tmp_path, Places.here(2), View()) as swarm:
            operator = swarm.operator
            witness = Witness(operator)
            for patience_s in (READY_S, AGAIN_S):
                await operator.get_ready(patience_s)
                results.append((await Course(swarm.scenario, SEED, operator).mission_flown()).result)
                ends.append(witness.now)
            operator.world.order(Order.CAMERAS_OFF)
            agreed = await operator.until(operator.observer.agreed, 15.0)
            assert [swarm.agents.exit_code(drone) for drone in ("d1", "d2")] == [None] * 2
            return agreed, [drone.origin_m for drone in swarm.scenario.mission.drones]

    agreed, launched = asyncio.run(course())
    assert agreed
    for result, end in zip(results, ends, strict=True):
        assert result.time_to_x0_s is not None
        assert not result.lost
        assert result.tracking_time_s > 6.0  # of 12 s, and its stage is seen by its status, once a second
        assert result.error_median_m is not None
        assert result.error_median_m < 3.0
        assert result.fence_breaches == 0
        assert result.min_separation_m is not None
        assert result.min_separation_m > 2.0  # separation 3 m by estimated positions, less their errors
        assert not any(end.armed)
        for place, launch in zip(end.position.tolist(), launched, strict=True):
            assert dist(place[:2], launch[:2]) < HOME_M
    replayed = replay(tmp_path / "agents" / "d1" / "flight")
    assert replayed.identical, replayed.first
