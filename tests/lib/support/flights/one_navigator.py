"""The navigator of one drone, and its flight around a source as it believes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from radron.agent.config.drone import DroneConfig, ResponseConfig, VehicleConfig
from radron.agent.config.mission import EncirclementConfig, MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.navigation.home import KeptHome
from radron.agent.navigation.moment import Moment
from radron.agent.navigation.navigator import Navigator
from radron.agent.navigation.peers.newest import Peers
from radron.agent.navigation.surveying import InformedSearch, Prospect, Search
from radron.agent.vehicle.interface import FlightMode
from radron.protocol.messages import Stage
from support.flights.one_pilot import MISSION as ANY_MISSION
from support.flights.one_pilot import SECOND, START_NS, TICK_NS, own_pose, state

MISSION = replace(ANY_MISSION, encirclement=EncirclementConfig(nearest_m=5.0))
AT_ONCE = DroneConfig(id="d1", vehicle=VehicleConfig(response=ResponseConfig(lag_s=0.0)))
PLACE = np.array([25.0, 25.0, 0.0])


def hypothesis(stamp_ns: int, rms_m: float = 0.2, evidence: float | None = 20.0, velocity=(0.0, 0.0), place=PLACE, **values):
    covariance = np.diag([0.5 * rms_m**2, 0.5 * rms_m**2, 0.0])
    return Hypothesis(
        stamp_ns=stamp_ns,
        position=np.array(place),
        covariance=covariance,
        velocity=np.array([*velocity, 0.0]),
        cones=10,
        x0_stamp_ns=START_NS,
        evidence=evidence,
        activity_bq=3e9,
        **values,
    )


def nobody(_: int) -> tuple[str, ...]:
    """No drone that was never heard has measured."""
    return ()


def made(mission: MissionConfig = MISSION):
    """The navigator of the first drone, its own pose, and all frames."""
    frames = FrameGraph.from_launch_layout(mission)
    search = Search(mission, "d1", frames)
    own = own_pose("d1", frames)
    return Navigator(mission, AT_ONCE, own, frames, search, InformedSearch(mission, Prospect(lambda: None)), nobody), own, frames


def flown(
    believed,
    seconds: float = 40.0,
    mission: MissionConfig = MISSION,
    stage: Stage | Callable[[int], Stage] = Stage.TRACK,
    height_m: float = 3.0,
    peers: Peers | None = None,
    home_m=None,
):
    """Places (T, 3) in the mission frame of a vehicle that follows its setpoints exactly.

    believed: the hypothesis by the time. stage: one, or by the time. home_m: mission frame.
    """
    navigator, own, frames = made(mission)
    if home_m is not None:
        navigator.resume(KeptHome(home_m))
    mission_from_local = frames.mission_from_local("d1", 0)
    local = mission_from_local.inverse()
    position, velocity, places = local.apply_point((35.0, 25.0, height_m)), (0.0, 0.0, 0.0), []
    for tick in range(round(seconds * SECOND / TICK_NS)):
        now_ns = START_NS + tick * TICK_NS
        vehicle = own.take(replace(state(now_ns, FlightMode.OFFBOARD, position), velocity_mps=velocity))
        present = stage(now_ns) if callable(stage) else stage
        setpoint, _ = navigator.step(Moment(now_ns, present, START_NS, vehicle, believed(now_ns)), peers or Peers([]))
        position, velocity = setpoint.position_m, setpoint.velocity_mps
        places.append(mission_from_local.apply_point(position))
    return np.array(places)
