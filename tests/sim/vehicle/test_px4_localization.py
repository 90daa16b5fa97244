"""The emulated PX4 with satellites and vision: its frame, its resets, and its behaviour without either."""

import asyncio
from math import cos, degrees, dist, nan, pi, sin

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from radron.agent.config.mission import DatumConfig
from radron.sim.world.localization import LocalizationTruth
from radron.sim.world.localizers import EventTruth, VehicleTruth
from radron.sim.world.movingframes import MovingFrames
from radron.sim.world.streams import streams
from support.px4.emulated import Flight, int_bits, param_set

STEP_S = 0.01
BY_VISION = {"EKF2_EV_CTRL": 9, "EKF2_GPS_CTRL": 0, "EKF2_NOAID_TOUT": 1_000_000}
DATUM = DatumConfig(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)


def fly(scenario, **options):
    async def run():
        async with Flight(**options) as flight:
            await scenario(flight)

    asyncio.run(run())


def localized(**truth):
    vehicle = VehicleTruth(**truth)
    everything = LocalizationTruth(vehicles={"d1": vehicle})
    return MovingFrames(everything, ["d1"], [((0.0, 0.0, 0.0), 0.0)], DATUM, STEP_S, streams(3, 1))


class Slam:
    """Tells the vehicle's true pose in a frame of its own, 20 times a second, until it is silenced."""

    def __init__(self, flight, origin_m=(3.0, -4.0, 0.0), yaw_rad=2.0):
        self._flight = flight
        self.origin_m, self.yaw_rad = np.array(origin_m), yaw_rad
        self.resets = 0
        self.silent = False

    def local(self, world):
        x, y, z = np.array(world) - self.origin_m
        return np.array([cos(self.yaw_rad) * x + sin(self.yaw_rad) * y, -sin(self.yaw_rad) * x + cos(self.yaw_rad) * y, z])

    def tell(self):
        if self.silent:
            return
        x, y, z = self.local(self._flight.position)
        yaw = pi / 2 - (self._flight.motion.yaw_rad[0] - self.yaw_rad)
        attitude = [cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)]
        unknown = [nan] * 6
        self._flight.companion.send(
            mavlink.MAVLink_odometry_message(
                int(self._flight.fleet.time_s * 1e6), mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_BODY_FRD, y, x, -z,
                attitude, *unknown, [nan] * 21, [nan] * 21, self.resets, mavlink.MAV_ESTIMATOR_TYPE_VISION, 0,
            )
        )  # fmt: skip

    def error_m(self):
        """Error of the vehicle's published position."""
        message = self._flight.last("LOCAL_POSITION_NED")
        return dist((message.y, message.x, -message.z), self.local(self._flight.position))


async def airborne(flight, slam):
    await flight.run(5.5, slam.tell)
    flight.companion.send(param_set("MIS_TAKEOFF_ALT", 5.0))
    await flight.run(0.05, slam.tell)
    await flight.ask(mavlink.MAV_CMD_NAV_TAKEOFF)
    assert await flight.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0) == [0]
    await flight.until(lambda: flight.report.mode == "hold" and flight.report.in_air, 30.0, slam.tell)
    await flight.run(3.0, slam.tell)


def test_by_vision_it_knows_its_place_in_the_visions_frame_and_none_on_the_globe():
    async def scenario(flight):
        await flight.run(5.5)
        assert not flight.heard("LOCAL_POSITION_NED")
        assert await flight.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0, 0.0) == [1]
        slam = Slam(flight)
        await flight.run(2.0, slam.tell)
        assert slam.error_m() < 0.02
        attitude = flight.last("ATTITUDE")
        assert sin(attitude.yaw - (pi / 2 - flight.motion.yaw_rad[0] + slam.yaw_rad)) == pytest.approx(0.0, abs=0.02)
        for name in ("GPS_GLOBAL_ORIGIN", "HOME_POSITION", "GLOBAL_POSITION_INT"):
            assert not flight.heard(name), name
        assert flight.last("GPS_RAW_INT").fix_type == 0
        flags = flight.last("ESTIMATOR_STATUS").flags
        assert flags & mavlink.ESTIMATOR_POS_HORIZ_REL
        assert not flags & mavlink.ESTIMATOR_POS_HORIZ_ABS
        await airborne(flight, slam)
        assert slam.error_m() < 0.05
        assert await flight.ask(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == [1]  # home unknown
        assert flight.report.mode == "hold"

    fly(scenario, parameters=BY_VISION)


def test_a_vision_that_says_that_it_jumped_resets_the_vehicle_at_once_and_one_that_does_not_within_a_second():
    async def scenario(flight):
        slam = Slam(flight)
        await airborne(flight, slam)
        for announced in (True, False):
            before, place = flight.last("ODOMETRY").reset_counter, flight.position
            slam.origin_m = slam.origin_m + np.array((12.0, 9.0, 0.0))
            slam.yaw_rad += 0.3
            slam.resets += announced
            await flight.run(0.3, slam.tell)
            assert (flight.last("ODOMETRY").reset_counter == before + 1) is announced
            took_s = await flight.until(lambda was=before: flight.last("ODOMETRY").reset_counter == was + 1, 2.0, slam.tell)
            assert announced or 0.5 < took_s < 1.0
            await flight.run(0.2, slam.tell)
            assert slam.error_m() < 0.05
            assert dist(flight.position, place) < 0.3  # holds its place, with other coordinates now

    fly(scenario, parameters=BY_VISION)


def test_a_vehicle_whose_vision_stops_drifts_and_then_comes_down():
    async def scenario(flight):
        slam = Slam(flight)
        await airborne(flight, slam)
        slam.silent = True
        await flight.run(0.8, slam.tell)
        assert flight.report.mode == "hold"
        assert 0.02 < slam.error_m() < 0.5
        await flight.run(0.5, slam.tell)
        assert (flight.report.mode, flight.report.failsafe) == ("descend", True)
        silent_s = flight.fleet.time_s
        await flight.run(1.0, slam.tell)
        assert not flight.heard("LOCAL_POSITION_NED", silent_s)
        slam.silent = False
        await flight.run(0.5, slam.tell)
        assert (flight.report.mode, flight.report.failsafe) == ("hold", False)
        assert slam.error_m() < 0.1
        assert flight.last("ODOMETRY").reset_counter >= 2

    fly(scenario, parameters=BY_VISION)


def test_stamps_of_the_companion_are_mapped_by_timesync():
    """A pose of 0.2 s ago is compared with where the vehicle was then, whatever the companion's clock shows."""

    async def scenario(flight):
        slam = Slam(flight)
        ahead_us = 1_767_225_600_000_000
        late_s = 0.2
        path = []

        def answer_and_tell():
            for heard in flight.heard("TIMESYNC", flight.fleet.time_s - 0.011):
                if heard.message.tc1 == 0:
                    now_ns = int(flight.fleet.time_s * 1e9) + ahead_us * 1000
                    flight.companion.send(mavlink.MAVLink_timesync_message(now_ns, heard.message.ts1))
            path.append((flight.fleet.time_s, flight.position, float(flight.motion.yaw_rad[0])))
            time_s, place, heading = min(path, key=lambda was: abs(was[0] - flight.fleet.time_s + late_s))
            x, y, z = slam.local(place)
            yaw = pi / 2 - (heading - slam.yaw_rad)
            flight.companion.send(
                mavlink.MAVLink_odometry_message(
                    int(time_s * 1e6) + ahead_us, mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_BODY_FRD, y, x, -z,
                    [cos(yaw / 2), 0.0, 0.0, sin(yaw / 2)], *[nan] * 6, [nan] * 21, [nan] * 21, 0, 2, 0,
                )
            )  # fmt: skip

        slam.tell = answer_and_tell
        await airborne(flight, slam)
        assert slam.error_m() < 0.05

    fly(scenario, parameters=BY_VISION)


def test_a_receiver_says_what_the_scenarios_receiver_says_and_none_where_there_is_none():
    frames = localized(kind="gnss")

    async def scenario(flight):
        await flight.run(6.0)
        fix = flight.last("GPS_RAW_INT")
        receiver = frames.receiver[0]
        assert fix.fix_type == 3
        assert fix.h_acc == pytest.approx(receiver.reported_horizontal_m * 1e3, abs=1.0)
        north_m = (fix.lat * 1e-7 - DATUM.latitude_deg) * 111_195.0
        east_m = (fix.lon * 1e-7 - DATUM.longitude_deg) * 111_195.0 * cos(DATUM.latitude_deg * pi / 180.0)
        assert (east_m, north_m) == pytest.approx(receiver.error_m[:2], abs=1.0)  # 0.2 m white, and 1 s of wandering
        assert fix.alt_ellipsoid * 1e-3 == pytest.approx(DATUM.altitude_m + receiver.error_m[2], abs=1.0)
        times = {heard.message.time_usec for heard in flight.heard("GPS_RAW_INT") if heard.message.fix_type == 3}
        assert len(times) in (6, 7)  # a fix a second, published eight times
        assert flight.heard("GPS_GLOBAL_ORIGIN")
        receiver.lost = True
        await flight.run(0.3)
        assert flight.last("GPS_RAW_INT").fix_type == 0

    fly(scenario, localized=frames)


def test_a_localisation_that_jumps_takes_the_vehicle_along_and_counts():
    event = EventTruth(at_s=1.0, jump_m=15.0)
    frames = localized(kind="rtk", events=(event,))

    async def scenario(flight):
        await flight.airborne()
        before, place = flight.last("LOCAL_POSITION_NED"), flight.position
        count = flight.last("ODOMETRY").reset_counter
        flight.fleet.begin()
        await flight.run(1.5)
        after = flight.last("LOCAL_POSITION_NED")
        assert dist((after.x, after.y), (before.x, before.y)) == pytest.approx(15.0, abs=0.5)
        assert flight.last("ODOMETRY").reset_counter == count + 1
        await flight.run(2.0)
        assert dist(flight.position, place) < 0.5  # hold: PX4's own modes know of resets

    fly(scenario, localized=frames)


def test_when_satellites_are_lost_the_vision_leads_on():
    event = EventTruth(at_s=1.0, switch_to="slam", jump_m=3.0, turn_deg=20.0)
    frames = localized(kind="gnss", events=(event,))

    class Following(Slam):
        """The SLAM with the scenario's frame."""

        def tell(self):
            self.origin_m, self.yaw_rad = frames.origin[0].copy(), float(frames.yaw_rad[0])
            self.resets = frames.epoch[0]
            super().tell()

    async def scenario(flight):
        slam = Following(flight)
        await airborne(flight, slam)
        flight.fleet.begin()
        count = flight.last("ODOMETRY").reset_counter
        await flight.run(0.9, slam.tell)
        assert flight.last("ODOMETRY").reset_counter == count
        await flight.run(1.0, slam.tell)
        assert flight.last("GPS_RAW_INT").fix_type == 0
        assert flight.last("ODOMETRY").reset_counter == count + 1
        assert slam.error_m() < 0.2
        assert abs(degrees(float(frames.yaw_rad[0]))) == pytest.approx(20.0, abs=1.0)
        slam.silent = True
        await flight.run(6.0, slam.tell)
        assert flight.report.mode == "descend"

    fly(scenario, parameters={"EKF2_EV_CTRL": 9}, localized=frames)


def test_parameters_are_taken_as_they_are_set():
    async def scenario(flight):
        flight.companion.send(param_set("EKF2_EV_CTRL", int_bits(9), kind=6))
        await flight.run(0.1)
        assert flight.fleet.faces[0].vision.wanted

    fly(scenario)
