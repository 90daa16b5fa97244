"""The mission in force: from the mission file, or uploaded by an operator since and kept in the state folder.

An uploaded mission replaces only the mission file of its time: after a change of that file by hand, the file counts again.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
from msgspec import Struct

from radron.agent.config.drone import DroneConfig
from radron.agent.config.loading import read_content
from radron.agent.config.mission import MissionConfig
from radron.agent.errors import ConfigError, RadronError
from radron.agent.mission.uploads import Origin
from radron.agent.outputs import write_durably
from radron.agent.pilot import Pilot
from radron.agent.shell.startable import check_for_drone
from radron.protocol.codes import Code
from radron.protocol.identity import utc
from radron.protocol.texts import CodedText


class _Kept(Struct, frozen=True, kw_only=True):
    """Content of the file. ``mission_id``: the uploaded mission's id, a check against flipped bits."""

    mission: MissionConfig
    mission_id: str
    origin: Origin


class InForce(Struct, frozen=True):
    """The mission that a drone flies, from its mission file or uploaded by an operator.

    ``origin``: of an uploaded mission; None: from the mission file. ``fault``: reason why an uploaded mission cannot be used,
    which prevents a start. ``notice``: for the operator.
    """

    mission: MissionConfig
    origin: Origin | None = None
    fault: CodedText | None = None
    notice: CodedText | None = None


def mission_path(drone: DroneConfig) -> Path | None:
    """Return the path of the file in which an uploaded mission is kept; None without a state folder."""
    return None if drone.state is None else Path(drone.state) / f"{drone.id}.mission.json"


def mission_in_force(drone: DroneConfig, filed: MissionConfig) -> InForce:
    """Return the uploaded mission if it replaces ``filed``, the mission in the mission file; else ``filed``.

    An uploaded mission that cannot be read or flown any more is reported as a fault, and the mission file counts: the drone then
    differs from the swarm, so that nothing starts by mistake, and still takes the next upload.
    """
    path = mission_path(drone)
    if path is None:
        return InForce(filed)
    try:
        kept = _decoded(path.read_bytes())
        if kept.origin.instead_of != filed.mission_id:
            text = f"its mission file was changed: it counts, not the mission {kept.mission_id} uploaded before"
            return InForce(filed, notice=CodedText(Code.MISSION_FILE_CHANGED, text))
        kept.mission.check(str(path))
        _check(kept.mission, drone, filed.swarm, str(path))
    except FileNotFoundError:
        return InForce(filed)
    except (OSError, msgspec.MsgspecError, RadronError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        text = f"the uploaded mission in {path} cannot be used ({reason}): upload it again, or remove that file"
        return InForce(filed, fault=CodedText(Code.UPLOAD_UNUSABLE, text))
    notice = CodedText(Code.MISSION_UPLOADED, f"its mission was uploaded by {described(kept.origin)}")
    return InForce(kept.mission, kept.origin, notice=notice)


def described(origin: Origin) -> str:
    """Return sender and time (UTC) of an uploaded mission as text."""
    return f"{origin.station}, {utc(origin.taken_ns):%Y-%m-%d %H:%M} UTC"


def keep(content: bytes, mission_id: str, drone: DroneConfig, swarm: str, origin: Origin) -> None:
    """Check an uploaded mission like a mission file, and store it in place of an earlier upload; after an error nothing is
    stored.

    Raises:
        RadronError: this drone cannot fly the mission; one line.
        OSError: the file cannot be written.
    """
    path = mission_path(drone)
    if path is None:
        raise ConfigError('no folder to keep it: give one in the drone file (state = "state")')
    mission = read_content(content, mission_id)
    _check(mission, drone, swarm, f"mission {mission_id}")
    write_durably(path, msgspec.json.encode(_Kept(mission=mission, mission_id=mission_id, origin=origin)))


def _check(mission: MissionConfig, drone: DroneConfig, swarm: str, where: str) -> None:
    """Check that this drone can fly a mission. Raises RadronError."""
    if mission.swarm != swarm:
        raise ConfigError(f"{where}: is for the swarm {mission.swarm!r}, and this is {swarm!r}")
    check_for_drone(mission, drone.id, where)
    Pilot(mission, drone, boot="0" * 16, nonce_key=b"")  # the only complete check of nuclide, estimator and survey


def _decoded(content: bytes) -> _Kept:
    try:
        kept = msgspec.json.decode(content, type=_Kept)
    except (UnicodeDecodeError, RecursionError) as error:
        raise msgspec.DecodeError(str(error)) from None
    if kept.mission.mission_id != kept.mission_id:
        raise msgspec.ValidationError("its content does not match its id")
    return kept
