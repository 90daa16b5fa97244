"""Two drones, a and b, with frames known to the mission: the messages of b, and their reading by a."""

from math import hypot

from radron.agent.config.mission import AreaConfig, DroneInMission, MissionConfig
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.transform import Transform
from radron.agent.navigation.myself import Self
from radron.agent.navigation.neighbours import Neighbourhood
from radron.agent.navigation.peers.newest import Peers
from radron.protocol.entries import Sighting
from radron.protocol.messages import Plan, Pose, Status

SECOND = 1_000_000_000
MISSION = MissionConfig(
    name="test",
    area=AreaConfig(polygon_m=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0))),
    drones=(DroneInMission(id="a"), DroneInMission(id="b", origin_m=(10.0, 0.0, 0.0), yaw_deg=90.0)),
)


def pose(stamp_ns=0, sigma_m=0.1, epoch=0):
    return Pose(
        stamp_ns=stamp_ns,
        drone="b",
        epoch=epoch,
        position_m=(1.0, 0.0, 3.0),
        velocity_mps=(2.0, 0.0, 0.0),
        quaternion=(1.0, 0.0, 0.0, 0.0),
        position_sigma_m=sigma_m,
        yaw_sigma_rad=0.01,
    )


def plan(stamp_ns=0):
    places = ((1.0, 0.0, 3.0), (1.0, 4.0, 3.0))
    return Plan(stamp_ns=stamp_ns, drone="b", epoch=0, step_ns=SECOND, positions_m=places)


def status(stage):
    return Status(stamp_ns=0, drone="b", mission="0" * 16, boot="1" * 16, stage=stage)


def seen(*messages, now_ns=0, own_sigma_m=0.0):
    peers = Peers(["b"])
    for message in messages:
        assert peers.receive(message, now_ns) is None
    me = Self(now_ns, 0, own_sigma_m, Transform())
    return Neighbourhood(MISSION, FrameGraph.from_launch_layout(MISSION), "a").around(peers, me)


def sighting(seconds, place):
    """a, at the origin of its frame and 3 m above the ground, sees b at a place of that frame."""
    away = [part - own for part, own in zip(place, (0.0, 0.0, 3.0), strict=True)]
    range_m = hypot(*away)
    x, y, z = (part / range_m for part in away)
    return Sighting(
        stamp_ns=round(seconds * SECOND),
        drone="a",
        mission="0" * 16,
        boot="1" * 16,
        sequence=round(seconds * 100),
        epoch=0,
        target="b",
        position_m=(0.0, 0.0, 3.0),
        direction=(x, y, z),
        direction_sigma_rad=0.035,
        range_m=range_m,
        range_sigma_m=0.3,
    )
