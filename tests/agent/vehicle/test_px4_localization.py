"""The driver with an emulated PX4 that uses vision, satellites, and one after the other."""

from __future__ import annotations

import asyncio
from contextlib import AsyncExitStack
from math import dist, hypot

import msgspec
import pytest

from radron.agent.config.mission import DatumConfig
from radron.agent.vehicle.interface import FlightMode, GnssFix
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.localizers import EventTruth, VehicleTruth
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.streams import streams
from support.px4.sky import STAY, STEP_S, TAKEOFF, UTC_NS, Sky, hover, ready, sky
from support.sensors.line_server import LineServer, line_server

BY_VISION = {"EKF2_EV_CTRL": 11, "EKF2_GPS_CTRL": 0, "EKF2_HGT_REF": 3, "EKF2_NOAID_TOUT": 1_000_000}
BY_VISION |= {"COM_OBL_RC_ACT": 4, "NAV_RCL_ACT": 3}
DATUM = DatumConfig(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
POSE_S = 0.03
RESTS_MPS = 0.2


def localized(vehicle: VehicleTruth) -> MovingFrames:
    truth = LocalizationTruth(vehicles={"d1": vehicle})
    return MovingFrames(truth, ["d1"], [((0.0, 0.0, 0.0), 0.0)], DATUM, STEP_S, streams(3, 1))


class Seeing:
    """Send the poses of the vehicle's SLAM to all listeners."""

    def __init__(self, flight: Sky, server: LineServer) -> None:
        self._flight, self._server = flight, server
        self.silent = False
        self._told_s = 0.0

    def tell(self) -> None:
        now_s = self._flight.fleet.time_s
        if now_s - self._told_s < POSE_S or self.silent:
            return
        self._told_s = now_s
        assert self._flight.slam is not None
        self._server.send(msgspec.json.encode(self._flight.slam.pose(0, UTC_NS + round(now_s * 1e9))) + b"\n")


async def seeing(stack: AsyncExitStack, frames: MovingFrames, **parameters: float) -> tuple[Sky, Seeing]:
    """A vehicle with a SLAM."""
    server = await stack.enter_async_context(line_server())
    gnss = bool(parameters.get("EKF2_GPS_CTRL", 7))
    flight = await stack.enter_async_context(
        sky(parameters, frames=frames, gnss=gnss, vision={"address": server.address}),
    )
    flight.speed = 4
    eyes = Seeing(flight, server)
    flight.each = eyes.tell
    return flight, eyes


async def airborne(flight: Sky) -> None:
    """Take off, and come to rest: PX4 holds before it has reached the height, and rises another metre."""
    await ready(flight)
    await flight.fly(TAKEOFF, lambda: flight.state.in_air and flight.state.mode is FlightMode.HOLD, timeout_s=30.0)
    await flight.fly(TAKEOFF, lambda: hypot(*flight.state.velocity_mps) < RESTS_MPS)


@pytest.mark.slow
def test_without_satellites_it_flies_by_the_slam_and_comes_down_where_that_stops() -> None:
    async def scenario() -> None:
        async with AsyncExitStack() as stack:
            flight, eyes = await seeing(stack, localized(VehicleTruth(kind="slam", yaw_deg=180.0)), **BY_VISION)
            eyes.silent = True
            await flight.connect()
            await flight.fly(STAY, lambda: any("no pose" in text or "no link" in text for text in flight.vehicle.problems))
            findings = {finding.name: finding.verdict for finding in await flight.vehicle.findings()}
            assert (findings["vision"], findings["launch place"]) == ("not yet", "not yet")
            eyes.silent = False
            await flight.fly(STAY, lambda: bool(flight.states) and flight.state.healthy and not flight.vehicle.problems)
            assert {finding.verdict for finding in await flight.vehicle.findings()} == {"ok"}
            await flight.fly(TAKEOFF, lambda: flight.state.in_air and flight.state.mode is FlightMode.HOLD, timeout_s=30.0)
            there = hover(6.0, -3.0, 5.0)
            await flight.fly(there, lambda: dist(flight.state.position_m, (6.0, -3.0, 5.0)) < 0.7)
            assert flight.state.epoch == 0
            assert flight.slam is not None
            seen = flight.slam.pose(0, 0)["position_m"]  # its map begins where it was launched: that of the drone, too
            assert isinstance(seen, list)
            assert dist(seen, flight.state.position_m) < 0.7
            eyes.silent = True
            await flight.fly(there, lambda: flight.vehicle.problems != () and "no local position" in flight.vehicle.problems[0])
            assert flight.fleet.reports()[0].mode == "descend"
            assert flight.fleet.reports()[0].failsafe
            eyes.silent = False
            await flight.fly(there, lambda: flight.state.mode is FlightMode.OFFBOARD and flight.state.healthy)

    asyncio.run(scenario())


@pytest.mark.slow
def test_a_frame_that_jumps_is_another_epoch_and_the_vehicle_stays_where_it_is() -> None:
    async def scenario() -> None:
        jump = EventTruth(at_s=1.0, jump_m=15.0, turn_deg=30.0)
        async with AsyncExitStack() as stack:
            flight, _ = await seeing(stack, localized(VehicleTruth(kind="slam", events=(jump,))), **BY_VISION)
            await airborne(flight)
            place, before = flight.true_position_m, flight.state
            flight.fleet.begin()
            first = len(flight.states)
            await flight.fly(TAKEOFF, lambda: flight.state.epoch == 1)
            assert dist(flight.state.position_m, before.position_m) > 3.0  # 15 m of the map, turned about its beginning
            for state in flight.states[first:]:  # no state of the new frame goes for one of the old
                assert (dist(state.position_m, before.position_m) > 3.0) is (state.epoch == 1)
            await flight.wait(2.0, TAKEOFF)
            assert flight.state.epoch == 1
            assert dist(flight.true_position_m, place) < 1.0
            launch = flight.vehicle.launch
            assert launch is not None
            assert launch.epoch == 1

    asyncio.run(scenario())


@pytest.mark.slow
def test_fixes_come_once_a_second_until_satellites_are_lost_which_is_another_epoch() -> None:
    async def scenario() -> None:
        lost = EventTruth(at_s=4.0, switch_to="slam", jump_m=2.0)
        frames = localized(VehicleTruth(kind="rtk", events=(lost,)))
        async with AsyncExitStack() as stack:
            flight, _ = await seeing(stack, frames, EKF2_EV_CTRL=11)
            fixes: list[GnssFix] = []
            flight.vehicle.on_fix(fixes.append)
            await airborne(flight)
            assert len(fixes) >= 2
            fix = fixes[-1]
            assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((DATUM.latitude_deg, DATUM.longitude_deg), abs=1e-5)
            assert 486.0 < fix.altitude_m < 495.0
            assert fix.horizontal_sigma_m == pytest.approx(frames.receiver[0].reported_horizontal_m, abs=1e-3)  # type: ignore[union-attr]
            flight.fleet.begin()
            await flight.fly(TAKEOFF, lambda: flight.state.epoch == 1, timeout_s=15.0)
            count = len(fixes)
            await flight.wait(5.0, TAKEOFF)
            assert len(fixes) <= count + 1  # the last one was still under way
            assert flight.state.epoch == 1
            assert flight.vehicle.problems == ()

    asyncio.run(scenario())


@pytest.mark.slow
def test_an_agent_restarted_in_flight_without_satellites_goes_on_in_the_same_frame_and_epoch() -> None:
    async def scenario() -> None:
        jump = EventTruth(at_s=0.5, jump_m=15.0)
        async with AsyncExitStack() as stack:
            patient = BY_VISION | {"EKF2_NOAID_TOUT": 5_000_000}  # an agent that is gone passes on no poses
            flight, _ = await seeing(stack, localized(VehicleTruth(kind="slam", events=(jump,))), **patient)
            await airborne(flight)
            flight.fleet.begin()
            await flight.fly(TAKEOFF, lambda: flight.state.epoch == 1)
            await flight.wait(1.0, TAKEOFF)
            place, launch = flight.state.position_m, flight.vehicle.launch
            flight.speed = 1
            await flight.vehicle.close()
            flight.new_vehicle(launch)
            await flight.connect()
            await flight.fly(STAY, lambda: bool(flight.states))
            assert flight.state.epoch == 1
            assert dist(flight.state.position_m, place) < 1.0
            assert flight.state.in_air
            assert flight.vehicle.launch == launch

    asyncio.run(scenario())
