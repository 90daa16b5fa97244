"""Error messages of the driver for faults of the vehicle or its link."""

import asyncio
import time

import pytest

from radron.sim.vehicle.px4.config import Faults
from support.px4.sky import STAY, TAKEOFF, ready, sky


@pytest.mark.slow
def test_a_lost_link_is_told_within_three_seconds_and_comes_back() -> None:
    async def scenario() -> None:
        async with sky() as flight:
            await ready(flight)
            flight.speed = 1
            flight.face.cut_links(3.5)
            begun_s = time.monotonic()
            await flight.fly(STAY, lambda: any("lost" in problem for problem in flight.vehicle.problems))
            assert time.monotonic() - begun_s < 3.0
            found = {finding.name: finding.verdict for finding in await flight.vehicle.findings()}
            assert found["autopilot"] == "failed"
            assert found["parameters"] == "not yet"  # a parameter without an answer now is not unknown to it
            assert not [name for name in found if name.isupper()]
            count = len(flight.states)
            await flight.fly(STAY, lambda: len(flight.states) > count and flight.state.healthy and not flight.vehicle.problems)

    asyncio.run(scenario())


def test_a_vehicle_that_is_never_healthy_says_why_and_is_not_armed() -> None:
    async def scenario() -> None:
        async with sky(faults=Faults(unhealthy="Accel 0 uncalibrated")) as flight:
            await flight.connect()
            await flight.fly(STAY, lambda: bool(flight.states))
            assert not flight.state.healthy
            assert any("not ready to arm" in problem for problem in flight.vehicle.problems)
            await flight.fly(TAKEOFF, lambda: any("refuses to arm" in problem for problem in flight.vehicle.problems))
            await flight.insist(TAKEOFF)
            assert not flight.state.armed
            assert "not yet" in {finding.verdict for finding in await flight.vehicle.findings()}

    asyncio.run(scenario())


def test_a_vehicle_with_px4s_own_defaults_is_told_what_to_set() -> None:
    async def scenario() -> None:
        async with sky({"COM_OBL_RC_ACT": 0, "GF_MAX_HOR_DIST": 0.0, "RTL_RETURN_ALT": 80.0}) as flight:
            await flight.connect()
            await flight.fly(STAY, lambda: len(flight.vehicle.problems) == 3 and flight.state.healthy)
            text = " ".join(flight.vehicle.problems)
            for name in ("COM_OBL_RC_ACT", "GF_MAX_HOR_DIST", "RTL_RETURN_ALT"):
                assert f"parameter {name} is " in text

    asyncio.run(scenario())
