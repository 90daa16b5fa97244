"""MAVSDK accepts the emulated PX4: it connects, and flies it through its ordinary plugins."""

import asyncio
import contextlib
import socket

import numpy as np
import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync, PositionNedYaw, VelocityNedYaw
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

from radron.sim.vehicle.px4.config import Px4Config
from support.px4.emulated import STEP_S, new_fleet

FASTER = 4  # the vehicle's time than the wall's


async def run(fleet):
    """As the world process does, in real time."""
    loop = asyncio.get_running_loop()
    due_s = loop.time()
    while True:
        for _ in range(FASTER):
            fleet.step()
        due_s += STEP_S
        await asyncio.sleep(max(0.0, due_s - loop.time()))


@contextlib.asynccontextmanager
async def connected():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    fleet, motion = new_fleet([Px4Config(onboard=("127.0.0.1", port))])
    await fleet.start()
    flying = asyncio.create_task(run(fleet))
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    try:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        vehicle = await mavsdk.first_autopilot(10.0)
        assert vehicle is not None
        yield vehicle, fleet, motion
    finally:
        flying.cancel()
        fleet.close()
        mavsdk.destroy()


async def first(stream, condition, limit_s=20.0):
    """The first value of a telemetry stream for which the condition holds."""

    async def search():
        async for value in stream:
            if condition(value):
                return value

    return await asyncio.wait_for(search(), limit_s)


@pytest.mark.slow
def test_mavsdk_flies_a_mission_through_its_plugins():
    async def fly():
        async with connected() as (vehicle, fleet, motion):
            telemetry, action, offboard = TelemetryAsync(vehicle), ActionAsync(vehicle), OffboardAsync(vehicle)
            parameters = ParamAsync(vehicle)
            assert await first(telemetry.subscribe_health_all_ok(), bool)
            await first(telemetry.subscribe_health(), lambda health: health.is_armable)

            assert await parameters.get_param_int("NAV_RCL_ACT") == 2
            await parameters.set_param_float("RTL_RETURN_ALT", 6.0)
            assert await parameters.get_param_float("RTL_RETURN_ALT") == 6.0
            await action.set_takeoff_altitude(3.0)
            assert await action.get_takeoff_altitude() == 3.0
            origin = await telemetry.get_gps_global_origin()
            assert origin.latitude_deg == pytest.approx(47.3977, abs=0.01)

            await action.arm()
            await action.takeoff()
            await first(telemetry.subscribe_landed_state(), lambda state: state.name == "IN_AIR")
            assert motion.position_m[0, 2] > 2.0  # a takeoff ends NAV_MC_ALT_RAD below

            start = (await telemetry.position_velocity_ned()).position
            setpoint = PositionNedYaw(start.north_m + 8.0, start.east_m, start.down_m, 90.0)
            await offboard.set_position_velocity_ned(setpoint, VelocityNedYaw(0.0, 0.0, 0.0, 90.0))
            await offboard.start()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode.name == "OFFBOARD")
            await first(telemetry.subscribe_position_velocity_ned(), lambda found: found.position.north_m > start.north_m + 7.5)
            assert motion.position_m[0, 1] == pytest.approx(7.6, abs=0.6)
            assert np.cos(motion.yaw_rad[0]) > 0.99
            assert fleet.reports()[0].setpoints > 10

            await offboard.stop()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode.name == "HOLD")
            await action.return_to_launch()
            await first(telemetry.subscribe_armed(), lambda armed: not armed, 30.0)
            assert np.hypot(*motion.position_m[0, :2]) < 0.5
            assert motion.position_m[0, 2] == 0.0

    asyncio.run(fly())
