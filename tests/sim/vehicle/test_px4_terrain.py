"""The emulated PX4 over hills: it stands on them, measures its height above them, and lands on them."""

import asyncio

import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.sim.world.terrain import HillTruth, Terrain, TerrainTruth
from support.px4.emulated import Flight

HILL = Terrain(TerrainTruth(slope=(0.2, 0.0), hills=(HillTruth(centre_m=(0.0, 0.0), height_m=6.0, width_m=10.0),)))


@pytest.mark.slow
def test_it_takes_off_from_a_hill_and_lands_on_it():
    place = (5.0, 3.0, HILL.height_m(5.0, 3.0))

    async def run():
        async with Flight(places=[place], terrain=HILL) as flight:
            await flight.run(2.0)
            assert flight.position[2] == pytest.approx(place[2], abs=1e-6)
            await flight.airborne(5.0)
            await flight.run(3.0)
            height_m = flight.position[2] - HILL.height_m(*flight.position[:2])
            assert height_m == pytest.approx(5.0, abs=0.3)
            assert flight.last("DISTANCE_SENSOR").current_distance / 100.0 == pytest.approx(height_m, abs=0.05)
            assert await flight.ask(mavlink.MAV_CMD_NAV_LAND) == [0]
            await flight.until(lambda: not flight.report.armed, 40.0)
            assert flight.position[2] == pytest.approx(HILL.height_m(*flight.position[:2]), abs=0.05)

    asyncio.run(run())
