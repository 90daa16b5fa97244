"""No takeoff below a drone that flies past."""

import pytest
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.codec import encode
from radron.protocol.keys import key_of
from radron.protocol.messages import Pose, Stage, Status
from support.flights.one_pilot import MISSION, SECOND, START_NS, boot_of, command, messages, pilot, state

LATE = replace(MISSION, drones=(DroneInMission(id="d1"), DroneInMission(id="d2", origin_m=(30.0, 0.0, 0.0))))


def on_ground(now_ns):
    return state(now_ns, FlightMode.HOLD, position=(0.0, 0.0, 0.0), armed=False, in_air=False)


def hear(one, now_ns, place, velocity, stage=Stage.TRACK):
    """The partner at a place of the mission frame, above this drone's launch place or beside it."""
    pose = Pose(
        stamp_ns=now_ns,
        drone="d2",
        epoch=0,
        position_m=(place[0] - 30.0, place[1], 3.0),
        velocity_mps=(*velocity, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=0.1,
        yaw_sigma_rad=0.01,
    )
    status = Status(stamp_ns=now_ns, drone="d2", mission=LATE.mission_id, boot=boot_of("d2"), stage=stage)
    for message in (pose, status):
        one.receive(key_of("radron", message), encode(message), now_ns)


def asked_to_start(place, velocity, stage=Stage.TRACK):
    """A drone on the ground that gets the command to start at this moment."""
    one = pilot(mission=LATE)
    one.observe_vehicle(on_ground(START_NS))
    hear(one, START_NS, place, velocity, stage)
    one.step(START_NS)
    one.receive(*command(mission=LATE, drones=("d1",)), START_NS)
    return one


@pytest.mark.parametrize(
    ("place", "velocity"),
    [
        ((0.5, 1.0), (0.0, 0.0)),  # hovers above it
        ((7.0, 0.0), (-3.0, 0.0)),  # arrives as the rotors lift
        ((-9.0, 2.0), (5.0, 0.0)),
    ],
)
def test_a_start_below_a_drone_that_flies_past_is_refused_and_says_why(place, velocity):
    one = asked_to_start(place, velocity)
    assert one.stage is Stage.PREFLIGHT
    later_ns = START_NS + SECOND
    one.observe_vehicle(on_ground(later_ns))
    hear(one, later_ns, place, velocity)
    (status,) = messages(one.step(later_ns), Status)
    assert any("d2 flies past so near" in problem for problem in status.problems)


@pytest.mark.parametrize(
    ("place", "velocity", "stage"),
    [
        ((12.0, 0.0), (-3.0, 0.0), Stage.TRACK),  # far enough to make room
        ((5.0, 0.0), (3.0, 0.0), Stage.TRACK),  # flies away
        ((3.5, 0.0), (0.0, 0.0), Stage.TAKEOFF),  # rises beside it, as it stood
        ((3.5, 0.0), (0.0, 0.0), Stage.LANDING),
    ],
)
def test_others_do_not_hold_a_start_up(place, velocity, stage):
    assert asked_to_start(place, velocity, stage).stage is Stage.TAKEOFF


def test_who_lands_closely_beside_it_holds_a_start_up():
    """Its home was wrong by 5.6 m: 1.2 m apart."""
    assert asked_to_start((1.0, 1.0), (0.0, 0.0), Stage.LANDING).stage is Stage.PREFLIGHT


def test_once_the_other_has_passed_the_start_is_obeyed():
    one = asked_to_start((0.5, 1.0), (7.5, 0.0))
    later_ns = START_NS + SECOND
    one.observe_vehicle(on_ground(later_ns))
    hear(one, later_ns, (8.0, 1.0), (7.5, 0.0))
    one.receive(*command(mission=LATE, stamp_ns=later_ns, drones=("d1",)), later_ns)
    assert one.stage is Stage.TAKEOFF
