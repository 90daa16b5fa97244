"""The messages of the emulated PX4: which, how often, and their contents."""

import asyncio
from collections import Counter

import numpy as np
import pymap3d
import pytest
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

from radron.sim.vehicle.px4.config import Datum, Px4Config
from radron.sim.vehicle.px4.fleet import VehicleReport
from radron.sim.world.localization import LocalizationTruth
from support.px4.emulated import Companion, Flight, new_fleet, position_target

ONBOARD = {
    "ATTITUDE": 100,
    "ATTITUDE_QUATERNION": 50,
    "GLOBAL_POSITION_INT": 50,
    "HIGHRES_IMU": 50,
    "LOCAL_POSITION_NED": 30,
    "ODOMETRY": 30,
    "SERVO_OUTPUT_RAW": 10,
    "VFR_HUD": 10,
    "ATTITUDE_TARGET": 10,
    "POSITION_TARGET_LOCAL_NED": 10,
    "TIMESYNC": 10,
    "DISTANCE_SENSOR": 10,
    "ALTITUDE": 10,
    "GPS_RAW_INT": 8,
    "SYS_STATUS": 5,
    "EXTENDED_SYS_STATE": 5,
    "HEARTBEAT": 1,
    "SYSTEM_TIME": 1,
    "SCALED_PRESSURE": 1,
    "ESTIMATOR_STATUS": 1,
    "MISSION_CURRENT": 1,
    "BATTERY_STATUS": 0.5,
    "HOME_POSITION": 0.5,
    "UNKNOWN_436": 0.5,  # CURRENT_MODE, which this dialect does not have
    "UNKNOWN_411": 0.33,  # CURRENT_EVENT_SEQUENCE
}


def test_the_onboard_and_the_ground_station_link_carry_their_messages_at_px4s_rates():
    async def fly():
        async with Flight(station=True) as flight:
            await flight.run(4.0)
            since_s = flight.fleet.time_s
            await flight.run(4.0)
            return [
                Counter(h.message.get_type() for h in link.heard(since_s=since_s + 1e-6))
                for link in (flight.companion, flight.station)
            ]

    onboard, station = asyncio.run(fly())
    assert set(onboard) == set(ONBOARD)
    for name, rate in ONBOARD.items():
        assert onboard[name] == pytest.approx(4.0 * rate, abs=1), name
    assert 400 < sum(onboard.values()) / 4.0 < 430
    assert station["LOCAL_POSITION_NED"] == station["ATTITUDE_TARGET"] == 200
    assert not {"SYSTEM_TIME", "TIMESYNC", "ODOMETRY", "HIGHRES_IMU"} & set(station)


def test_every_vehicle_has_its_own_system_id():
    async def fly():
        companions = [Companion() for _ in range(3)]
        fleet, _ = new_fleet([Px4Config(onboard=companion.address) for companion in companions])
        await fleet.start()
        for _ in range(100):
            fleet.step()
        for companion in companions:
            companion.listen(0.0)
        fleet.close()
        return [{heard.message.get_srcSystem() for heard in companion.heard()} for companion in companions]

    assert asyncio.run(fly()) == [{1}, {2}, {3}]


def test_intervals_are_changed_switched_off_and_set_back():
    async def count(flight, name):
        since_s = flight.fleet.time_s
        await flight.run(2.0)
        return len(flight.heard(name, since_s + 1e-6)) / 2.0

    async def fly():
        async with Flight() as flight:
            change = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            position, state = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
            assert await flight.ask(change, position, 20_000.0) == [0]
            assert await flight.ask(change, state, -1.0) == [0]
            assert await count(flight, "LOCAL_POSITION_NED") == pytest.approx(50, abs=1)
            assert await count(flight, "EXTENDED_SYS_STATE") == 0
            await flight.ask(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, position)
            assert flight.last("MESSAGE_INTERVAL").interval_us == 20_000
            assert await flight.ask(change, position, 0.0) == [0]
            assert await flight.ask(change, state, 0.0) == [0]
            assert await count(flight, "LOCAL_POSITION_NED") == pytest.approx(30, abs=1)
            assert await count(flight, "EXTENDED_SYS_STATE") == pytest.approx(5, abs=1)
            assert await flight.ask(change, 60_000.0, 0.0) == [mavlink.MAV_RESULT_DENIED]
            assert await flight.ask(change, mavlink.MAVLINK_MSG_ID_HEARTBEAT, 200_000.0) == [mavlink.MAV_RESULT_DENIED]
            assert await count(flight, "HEARTBEAT") == pytest.approx(1, abs=0.5)

    asyncio.run(fly())


def test_positions_agree_with_the_truth_in_every_frame():
    datum = Datum(latitude_deg=50.1, longitude_deg=14.4, altitude_m=300.0)

    def enu(place, altitude_mm):
        return pymap3d.geodetic2enu(*place, altitude_mm * 1e-3, datum.latitude_deg, datum.longitude_deg, datum.altitude_m)

    async def fly():
        async with Flight(places=[(30.0, -20.0, 0.0)], datum=datum) as flight:
            await flight.airborne(4.0)
            at = flight.position
            east, north, up = at - flight.origin()
            local = flight.last("LOCAL_POSITION_NED")
            assert (local.x, local.y, local.z) == pytest.approx((north, east, -up), abs=0.1)
            assert np.hypot(local.x, local.y) > 1.0  # its origin is not where it stood
            place = flight.last("GLOBAL_POSITION_INT")
            assert enu((place.lat * 1e-7, place.lon * 1e-7), place.alt) == pytest.approx(at, abs=0.1)
            assert flight.last("DISTANCE_SENSOR").current_distance == pytest.approx(100.0 * at[2], abs=5.0)
            await flight.ask(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN)
            origin = flight.last("GPS_GLOBAL_ORIGIN")
            where = enu((origin.latitude * 1e-7, origin.longitude * 1e-7), origin.altitude)
            assert where == pytest.approx(flight.origin(), abs=0.05)
            attitude, quaternion = flight.last("ATTITUDE"), flight.last("ATTITUDE_QUATERNION")
            assert attitude.yaw == pytest.approx(np.pi / 2.0, abs=0.01)  # heading east
            assert 2.0 * np.arctan2(quaternion.q4, quaternion.q1) == pytest.approx(np.pi / 2.0, abs=0.01)

    asyncio.run(fly())


def test_a_turned_local_frame_and_its_targets_belong_together():
    async def fly():
        async with Flight(frame_yaw_rad=[0.7]) as flight:
            await flight.airborne(4.0)
            start = flight.position
            local = flight.last("LOCAL_POSITION_NED")
            target = position_target((local.x + 10.0, local.y, local.z))  # to the local north
            await flight.offboard(target)
            await flight.run(12.0, lambda: flight.companion.send(target))
            moved = flight.position - start
            assert moved == pytest.approx([-10.0 * np.sin(0.7), 10.0 * np.cos(0.7), 0.0], abs=0.3)

    asyncio.run(fly())


def test_the_attitude_is_the_true_one_in_ned_and_frd():
    ned_from_enu = Rotation.from_matrix([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    flu_from_frd = Rotation.from_euler("x", 180.0, degrees=True)

    async def fly():
        async with Flight() as flight:
            await flight.airborne(4.0)
            local = flight.last("LOCAL_POSITION_NED")
            await flight.offboard(position_target((local.x + 20.0, local.y + 12.0, local.z), yaw=0.6))
            for _ in range(8):
                await flight.run(0.1)
                w, x, y, z = flight.motion.quaternion(0)
                right = ned_from_enu * Rotation.from_quat([x, y, z, w]) * flu_from_frd
                said, euler = flight.last("ATTITUDE_QUATERNION"), flight.last("ATTITUDE")
                found = Rotation.from_quat([said.q2, said.q3, said.q4, said.q1])
                # At 50 Hz, of the step before: up to 30 ms old, while it turns by 2 rad/s and tilts by 2 rad/s: 0.085 rad.
                assert (right * found.inv()).magnitude() < 0.09
                assert (
                    found * Rotation.from_euler("ZYX", [euler.yaw, euler.pitch, euler.roll]).inv()
                ).magnitude() < 0.06  # 20 ms apart
            assert right.magnitude() > 0.3
            assert np.hypot(euler.roll, euler.pitch) > 0.1

    asyncio.run(fly())


def test_home_altitude_wanders_in_flight_and_local_z_does_not():
    async def fly():
        async with Flight() as flight:
            await flight.airborne(3.0)
            await flight.run(8.0)  # comes to rest
            since_s = flight.fleet.time_s
            await flight.run(8.0)
            relative = [h.message.relative_alt * 1e-3 for h in flight.heard("GLOBAL_POSITION_INT", since_s)]
            z = [h.message.z for h in flight.heard("LOCAL_POSITION_NED", since_s)]
            assert np.ptp(z) < 0.1
            assert 0.5 < np.ptp(relative) < 2.5
            assert np.abs(np.diff(relative)).max() > 0.2  # jump

    asyncio.run(fly())


def test_estimates_err_as_a_real_px4s_do():
    async def fly():
        errors = []
        for seed in range(20):
            fleet, motion = new_fleet([Px4Config(onboard=("127.0.0.1", 9))] * 10, localization=LocalizationTruth(), seed=seed)
            fleet.step()
            local = [face._state.now.position_enu_m for face in fleet.faces]
            errors += (np.array(local) + fleet._frames.origin - motion.position_m).tolist()
        return np.array(errors)

    error = asyncio.run(fly())
    # 200 vehicles: the sample's deviations are within 15 % of the right ones.
    assert np.sqrt((error[:, :2] ** 2).sum(axis=1).mean()) == pytest.approx(0.25, rel=0.15)
    assert error[:, 2].std() == pytest.approx(np.hypot(0.2, 0.4), rel=0.15)


def test_the_battery_empties():
    async def fly():
        async with Flight() as flight:
            await flight.run(3.0)
            full = flight.last("BATTERY_STATUS")
            await flight.airborne(3.0)
            await flight.run(12.0)
            used = flight.last("BATTERY_STATUS")
            assert full.battery_remaining == 100
            assert used.current_consumed > 50
            assert used.battery_remaining < 100
            assert used.voltages[0] < full.voltages[0]
            assert used.voltages[4] == 65535

    asyncio.run(fly())


def test_the_report_says_what_the_vehicle_does():
    async def fly():
        async with Flight() as flight:
            await flight.airborne(3.0)
            return flight.report

    assert asyncio.run(fly()) == VehicleReport("hold", True, True, False, 0, 0, 0.0)
