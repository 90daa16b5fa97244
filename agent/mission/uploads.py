"""A mission that an operator uploads to a drone on the ground: whether it is taken over, and the answer in the status.

The pilot judges sender and time. Its shell then fetches the content, checks and keeps it, and begins anew with it: a pilot never
changes its mission. Meanwhile it refuses a start; if the shell fails, the drone keeps its mission.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec import Struct

from radron.agent.mission.problems import TELEMETRY_AGE_NS
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.messages import Answer, Stage, Status, Upload
from radron.protocol.stages import ON_GROUND
from radron.protocol.texts import MAX_TEXT, CodedText


class Origin(Struct, frozen=True, kw_only=True):
    """The origin of an uploaded mission: the station, its certificate (DER; empty in a swarm without), the time by the drone's
    clock (UTC), and the id of the mission in the drone's mission file, which it replaces.
    """

    station: str
    certificate: bytes = b""
    taken_ns: int
    instead_of: str


class Ground(Struct, frozen=True):
    """The conditions for taking a mission over: time, own stage and vehicle, and the newest statuses of the others."""

    now_ns: int
    stage: Stage
    vehicle: VehicleState | None
    others: Mapping[str, Status]


class Uploads:
    """The uploads to one drone. ``taking``: the mission that the shell is to fetch, or None. ``answer``: to the last upload."""

    def __init__(self, mission_id: str) -> None:
        """``mission_id``: of the mission in force."""
        self._mission_id = mission_id
        self.taking: Upload | None = None
        self.answer: Answer | None = None

    def judge(self, upload: Upload, ground: Ground) -> str | None:
        """Take an operator's upload, or refuse it. Returns why, or None."""
        refused = self._refusal(upload, ground)
        if self.taking is None:  # else the answer belongs to the upload in progress
            self._tell(upload, refused or "")
        if refused is None:
            self.taking = upload
        return refused

    def decline(self, reason: str) -> None:
        """Decline the upload in progress: the drone keeps its mission."""
        if self.taking is not None:
            self._tell(self.taking, reason)
            self.taking = None

    @property
    def obstacle(self) -> CodedText | None:
        """Why no flight can begin now."""
        if self.taking is None:
            return None
        return CodedText(Code.UPLOAD_RUNNING, f"it takes over the mission {self.taking.mission} from {self.taking.station}")

    def _refusal(self, upload: Upload, ground: Ground) -> str | None:
        if self.taking is not None:
            return f"it is taking over the mission {self.taking.mission} from {self.taking.station}"
        if upload.mission == self._mission_id:
            return "it has this mission already"
        if ground.stage not in ON_GROUND:
            return f"its mission has begun ({ground.stage})"
        vehicle = ground.vehicle
        if vehicle is None or ground.now_ns - vehicle.stamp_ns > TELEMETRY_AGE_NS:
            return "no telemetry tells whether its vehicle is disarmed"
        if vehicle.armed or vehicle.in_air:
            return "its vehicle is armed"
        flying = [f"{name} ({status.stage})" for name, status in sorted(ground.others.items()) if status.stage not in ON_GROUND]
        return f"others fly the present mission: {', '.join(flying)}" if flying else None

    def _tell(self, upload: Upload, refused: str) -> None:
        self.answer = Answer(upload.stamp_ns, upload.mission, refused[:MAX_TEXT])
