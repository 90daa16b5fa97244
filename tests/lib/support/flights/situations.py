"""Situations of one vehicle, and missions that have come so far, for tests of the stages."""

from msgspec.structs import replace

from radron.agent.config.mission import TrackConfig
from radron.agent.mission.situation import Situation
from radron.agent.mission.stages import Mission
from radron.agent.vehicle.interface import FlightMode, VehicleState
from radron.protocol.messages import Action, Stage

SECOND = 1_000_000_000
VEHICLE = VehicleState(
    stamp_ns=0,
    epoch=0,
    position_m=(0.0, 0.0, 3.0),
    velocity_mps=(0.0, 0.0, 0.0),
    quaternion=(1.0, 0.0, 0.0, 0.0),
    height_m=3.0,
    position_sigma_m=0.1,
    yaw_sigma_rad=0.01,
    mode=FlightMode.HOLD,
    armed=True,
    in_air=True,
    healthy=True,
)
CALM = Situation(now_ns=SECOND, vehicle=VEHICLE, has_hypothesis=False, last_cone_ns=0, at_home=False, problems=())
OFFBOARD = replace(VEHICLE, mode=FlightMode.OFFBOARD)


def at(seconds, vehicle=OFFBOARD, **values):
    return replace(CALM, now_ns=int(seconds * SECOND), vehicle=vehicle, **values)


def surveying(**track):
    mission = Mission(TrackConfig(**track))
    assert mission.command(Action.START, SECOND, CALM) is None
    mission.step(at(2.0, VEHICLE))
    assert mission.stage is Stage.SURVEY
    return mission


def tracking(**track):
    mission = surveying(**track)
    mission.step(at(10.0, has_hypothesis=True, last_cone_ns=10 * SECOND))
    assert mission.stage is Stage.TRACK
    return mission
