"""Messages of one drone to a station; its frame is turned against the mission's."""

from __future__ import annotations

from radron.agent.config.mission import DroneInMission, MissionConfig
from radron.protocol.codec import encode
from radron.protocol.entries import Counts, Exposure, PoseSample
from radron.protocol.keys import key_of
from radron.protocol.message import Message
from radron.protocol.messages import Pose
from radron.station.picture.picture import Picture

NOW_NS = 1_800_000_000_000_000_000
D1 = DroneInMission(id="d1", origin_m=(10.0, 20.0, 1.0), yaw_deg=90.0)
POSE = Pose(
    stamp_ns=NOW_NS,
    drone="d1",
    epoch=0,
    position_m=(3.0, 0.0, 2.0),
    velocity_mps=(0.0, 2.0, 1.0),
    quaternion=(1.0, 0.0, 0.0, 0.0),
    position_sigma_m=0.3,
    yaw_sigma_rad=0.01,
)
PLACE_M = (10.0, 23.0, 3.0)  # of this pose in the mission frame
SPEED_MPS = 2.0  # over the ground


def exposure(mission: MissionConfig, number: int, lasts_s: float, counts: Counts, **changes: object) -> Exposure:
    """An exposure in a gapless row from ``NOW_NS`` on; ``number``: of it."""
    lasts_ns = round(lasts_s * 1e9)
    given = {
        "stamp_ns": NOW_NS + number * lasts_ns,
        "end_ns": NOW_NS + (number + 1) * lasts_ns,
        "drone": "d1",
        "mission": mission.mission_id,
        "boot": "0" * 16,
        "sequence": number,
        "epoch": 0,
        "live_time_s": lasts_s,
        "counts": counts,
        "poses": (PoseSample(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),),
        "position_sigma_m": 0.1,
        "yaw_sigma_rad": 0.01,
    }
    return Exposure(**{**given, **changes})  # type: ignore[arg-type]


def give(picture: Picture, mission: MissionConfig, *messages: Message, now_ns: int = NOW_NS) -> None:
    """Have it hear these."""
    for message in messages:
        picture.receive(key_of(mission.swarm, message), encode(message), now_ns)
