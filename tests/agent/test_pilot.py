"""The pilot by itself: what it says, what it refuses, and that nothing from outside can stop it."""

import random
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from agent.config import AreaConfig, DroneConfig, DroneInMission, MissionConfig
from agent.detector.readout import PixelHits, Readout
from agent.errors import ConfigError
from agent.pilot import Pilot
from agent.vehicle.interface import FlightMode, Request, VehicleState
from protocol.codec import decode, decode_from, encode
from protocol.keys import command_key, key_of
from protocol.messages import Action, Command, Exposure, Plan, Pose, Stage, Status

SECOND = 1_000_000_000
START_NS = 1_800_000_000 * SECOND
AREA = AreaConfig(polygon_m=((0.0, 0.0), (50.0, 0.0), (50.0, 50.0), (0.0, 50.0)))
MISSION = MissionConfig(
    name="test", area=AREA, drones=(DroneInMission(id="d1", origin_m=(5.0, 5.0, 0.0), yaw_deg=30.0), DroneInMission(id="d2"))
)
TICK_NS = SECOND // 20


def pilot(drone="d1", mission=MISSION):
    return Pilot(mission, DroneConfig(id=drone), boot="0" * 15 + drone[-1])


def state(now_ns, mode=FlightMode.HOLD, position=(0.0, 0.0, 3.0), **values):
    return replace(
        VehicleState(
            stamp_ns=now_ns,
            epoch=0,
            position_m=position,
            velocity_mps=(0.0, 0.0, 0.0),
            quaternion=(1.0, 0.0, 0.0, 0.0),
            height_m=position[2],
            position_sigma_m=0.1,
            yaw_sigma_rad=0.01,
            mode=mode,
            armed=True,
            in_air=True,
            healthy=True,
        ),
        **values,
    )


def command(action=Action.START, mission=MISSION, stamp_ns=START_NS, drones=()):
    message = Command(stamp_ns=stamp_ns, station="tester", mission=mission.mission_id, action=action, drones=drones)
    return command_key(mission.swarm, "tester"), encode(message)


def messages(step, kind):
    found = [decode_from(key, payload) for key, payload in step.publications]
    return [message for message in found if isinstance(message, kind)]


def started():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*command(), START_NS)
    one.step(START_NS)
    assert one.stage is Stage.SURVEY  # the vehicle is in the air and holds already
    return one


def test_a_drone_that_is_not_in_the_mission():
    with pytest.raises(ConfigError, match="drone 'd9' is not in the mission; its drones are d1, d2"):
        pilot("d9")


def test_reports_pose_at_10_hz_and_status_at_1_hz():
    one, poses, statuses = pilot(), 0, 0
    for tick in range(100):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns))
        step = one.step(now_ns)
        poses += len(messages(step, Pose))
        statuses += len(messages(step, Status))
        assert step.command.request is Request.STAY
    assert poses == 50
    assert statuses == 5


def test_status_says_what_stands_against_a_start():
    (status,) = messages(pilot().step(START_NS), Status)
    assert status.problems == ("no telemetry from the vehicle yet",)


def test_start_takes_off_and_then_surveys():
    one = pilot()
    grounded = state(START_NS, armed=False, in_air=False, position=(0.0, 0.0, 0.0))
    one.observe_vehicle(grounded)
    one.receive(*command(), START_NS)
    assert one.step(START_NS).command.request is Request.TAKEOFF
    one.observe_vehicle(state(START_NS + 5 * SECOND))
    step = one.step(START_NS + 5 * SECOND)
    assert step.command.request is Request.OFFBOARD
    assert step.command.setpoint is not None
    (plan,) = messages(step, Plan)
    assert plan.positions_m[0] == pytest.approx((0.0, 0.0, 3.0), abs=1e-6)  # where the vehicle is, in its own local frame


@pytest.mark.parametrize(
    ("refused", "counter"),
    [
        (command(stamp_ns=START_NS - 60 * SECOND), "dropped_command_too_old"),
        (command(mission=MissionConfig(name="other", area=AREA, drones=MISSION.drones)), "dropped_command_of_another_mission"),
        (command(Action.HOLD), "dropped_command_refused"),
    ],
)
def test_commands_that_are_not_obeyed(refused, counter):
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*refused, START_NS)
    assert one.stage is Stage.PREFLIGHT
    assert one.counters[counter] == 1


def test_a_command_to_others_is_not_for_me():
    one = pilot()
    one.observe_vehicle(state(START_NS))
    one.receive(*command(drones=("d2",)), START_NS)
    assert one.stage is Stage.PREFLIGHT


def test_differing_missions_refuse_to_start():
    one, other = pilot(), pilot("d2", MissionConfig(name="newer", area=AREA, drones=MISSION.drones))
    one.observe_vehicle(state(START_NS))
    for key, payload in other.step(START_NS).publications:
        one.receive(key, payload, START_NS)
    one.receive(*command(), START_NS)
    assert one.stage is Stage.PREFLIGHT
    (status,) = messages(one.step(START_NS), Status)
    assert "d2 has another mission file" in status.problems[0]


def test_two_agents_with_one_id_notice():
    one, twin = pilot(), Pilot(MISSION, DroneConfig(id="d1"), boot="f" * 16)
    one.observe_vehicle(state(START_NS))
    for key, payload in twin.step(START_NS).publications:
        one.receive(key, payload, START_NS)
    (status,) = messages(one.step(START_NS), Status)
    assert status.problems == ("another agent is running as d1",)


def test_exposures_follow_each_other_without_gaps():
    one, found = pilot(), []
    none = PixelHits(np.empty(0, np.int64), np.empty(0, np.uint16), np.empty(0, np.uint16))
    for tick in range(0, 200, 4):
        now_ns = START_NS + tick * TICK_NS
        one.observe_vehicle(state(now_ns, position=(tick * 0.1, 0.0, 3.0)))
        if tick:
            one.observe_detector(Readout(now_ns - 4 * TICK_NS, now_ns, START_NS, 0.2, none))
        found += messages(one.step(now_ns), Exposure)
    assert len(found) == 16
    assert all(before.end_ns == after.stamp_ns for before, after in pairwise(found))
    assert all(entry.live_time_s == pytest.approx((entry.end_ns - entry.stamp_ns) * 1e-9) for entry in found)
    assert [len(entry.poses) for entry in found] == [6] * 16
    assert found[3].poses[1].position_m[0] == pytest.approx((found[3].stamp_ns + SECOND // 10 - START_NS) / TICK_NS * 0.1)


def test_nothing_from_outside_stops_the_flight():
    one, rng = started(), random.Random(5)
    good = [publication for drone in ("d2",) for publication in pilot(drone).step(START_NS).publications]
    keys = [key for key, _ in good] + [key_of("radron", decode(good[0][1])), "radron/1/radron/d2/cone", "x", "radron/2/a/b/pose"]
    for number in range(2000):
        payload = bytearray(rng.choice(good)[1])
        for _ in range(rng.randrange(4)):
            payload[rng.randrange(len(payload))] = rng.randrange(256)
        if number % 3 == 0:
            payload = bytearray(rng.randbytes(rng.randrange(200)))
        one.receive(rng.choice(keys), bytes(payload), START_NS)
    now_ns = START_NS + TICK_NS
    one.observe_vehicle(state(now_ns, FlightMode.OFFBOARD))
    assert one.step(now_ns).command.setpoint is not None
    assert one.counters["rejected_malformed"] > 1000


def test_stale_and_foreign_news_is_counted_and_dropped():
    one, other = started(), pilot("d2")
    other.observe_vehicle(state(START_NS))
    publications = other.step(START_NS).publications
    for key, payload in publications:
        one.receive(key, payload, START_NS + 60 * SECOND)
    assert one.counters["dropped_stale"] == len(publications)
