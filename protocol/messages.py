"""Typed messages; units are in the names, limits in ``units``.

World frames are ENU, body frames FLU (REP-103). Positions refer to the publisher's own local frame of the given ``epoch`` (a new
epoch begins at a jump of the localisation); only ``Estimate`` and ``Frame`` refer to the mission frame. Quaternions are (w, x, y,
z), local from body. Times are integer nanoseconds UTC.

Two families:

- **log entries** (``entries``): raw observations that every agent keeps for the whole mission.
- **news** (``Pose``, ``Plan``, ``Frame``, ``Estimate``, ``Status``, ``Command``, ``Upload``; ``Revoked`` and ``Revocation``, in
  ``revocations``): the newest message replaces the older messages.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Annotated

from msgspec import UNSET, Meta, Struct, UnsetType, field

from protocol.checks import flaw_of_covariance, is_unit
from protocol.entries import SIGNATURE_BYTES, AnyEntry, Cone, Coverage, Credential, Exposure, Fix, Retraction, Sighting
from protocol.message import DroneMessage, StationMessage
from protocol.revocations import Revocation, Revoked
from protocol.spectrum import BINS, Line
from protocol.units import (
    BootId,
    Certificate,
    CommandNumber,
    Count,
    Covariance3,
    Digest,
    DroneId,
    Epoch,
    Identifier,
    Metres,
    MissionId,
    Nonce,
    Nuclide,
    PartHash,
    PlanStepNs,
    Position,
    PositiveMetres,
    Probability,
    Quaternion,
    Radians,
    SigmaRadians,
    StampNs,
    Text,
    Variance,
    Velocity,
)

_FASTEST_MPS = 200.0
PART_BYTES = 256 * 1024  # of an uploaded mission, at most
MOST_PARTS = 12
MOST_SOURCES = 8  # of an estimate
MOST_EXCLUDED = 64  # nuclides of an estimate
MAX_ORDER_AGE_NS = 5_000_000_000  # of a command or an upload, from the operator's order to a drone's execution
Becquerels = Annotated[float, Meta(ge=0.0, le=1e18)]
DelayNs = Annotated[int, Meta(ge=-(2**62), le=2**62)]
Signature = Annotated[bytes, Meta(max_length=SIGNATURE_BYTES)]


class Stage(StrEnum):
    """Stage of a drone's mission."""

    PREFLIGHT = "preflight"
    TAKEOFF = "takeoff"
    SURVEY = "survey"
    TRACK = "track"
    REACQUIRE = "reacquire"
    HOLD = "hold"
    RETURN = "return"
    LANDING = "landing"
    LANDED = "landed"
    ABORT = "abort"


class Action(StrEnum):
    """Commands of an operator."""

    START = "start"
    HOLD = "hold"
    RESUME = "resume"
    RETURN = "return"
    LAND = "land"
    ABORT = "abort"


class Pose(DroneMessage, frozen=True, kw_only=True):
    """Pose of a drone by its own localisation.

    ``steered``: its vehicle follows its published plans; false while a pilot, a failsafe or the autopilot alone flies it.
    ``in_air``: false after its autopilot has detected the landing.
    """

    epoch: Epoch
    position_m: Position
    velocity_mps: Velocity
    quaternion: Quaternion
    position_sigma_m: PositiveMetres
    yaw_sigma_rad: SigmaRadians
    clock_sigma_m: PositiveMetres = 0.0  # part of position_sigma_m that the drone's clock error causes by its motion
    steered: bool = True
    in_air: bool = True

    def flaw(self) -> str | None:
        """The quaternion must have unit norm."""
        return None if is_unit(self.quaternion) else "its quaternion has no unit norm"


class Plan(DroneMessage, frozen=True, kw_only=True):
    """The tracker's prediction: positions at stamp_ns, stamp_ns + step_ns, ...

    ``unheard``: drones possibly in the air without a link to this drone: the plan accounts for none of their messages. Left out
    if empty.
    """

    epoch: Epoch
    step_ns: PlanStepNs
    positions_m: Annotated[tuple[Position, ...], Meta(min_length=1, max_length=64)]
    unheard: Annotated[tuple[DroneId, ...], Meta(max_length=64)] | UnsetType = UNSET

    def flaw(self) -> str | None:
        """No two successive positions may imply a speed above 200 m/s."""
        places = self.positions_m
        if len(places) > 1 and max(map(math.dist, places, places[1:])) > _FASTEST_MPS * 1e-9 * self.step_ns:
            return "it jumps: two positions are further apart than 200 m/s allow"
        return None


class Frame(DroneMessage, frozen=True, kw_only=True):
    """The drone's derived transform mission <- local: yaw about up, then translation.

    ``covariance``: rows of the 4 x 4 matrix over (x m, y m, z m, yaw rad).
    """

    epoch: Epoch
    translation_m: Position
    yaw_rad: Radians
    covariance: Annotated[tuple[Variance, ...], Meta(min_length=16, max_length=16)]

    def flaw(self) -> str | None:
        """The covariance must be valid."""
        return flaw_of_covariance([self.covariance[row : row + 4] for row in (0, 4, 8, 12)])


class Source(Struct, frozen=True, kw_only=True):
    """One estimated source (mission frame).

    ``evidence``: natural logarithm of the likelihood ratio of this source to no source. ``lines_kev``: line energies in the
    spectrum of an unknown source, ascending: no candidate nuclide explains its spectrum, and it has neither nuclide nor activity.
    """

    position_m: Position
    covariance_m2: Covariance3
    velocity_mps: Velocity = (0.0, 0.0, 0.0)
    nuclide: Nuclide | None = None
    activity_bq: Becquerels | None = None
    activity_sigma_bq: Becquerels | None = None
    evidence: Annotated[float, Meta(ge=-1e9, le=1e9)] | None = None
    cones: Count = 0
    lines_kev: Annotated[tuple[Line, ...], Meta(max_length=BINS)] | UnsetType = UNSET


class Estimate(DroneMessage, frozen=True, kw_only=True):
    """The hypothesis: all known sources, and the digest of the log from which they were computed.

    ``excluded_bq``: exclusion limit by nuclide: the activity above which further sources are excluded in the area, except where
    known sources outshine them. Nuclides without an exclusion limit are left out. Only from estimators of several sources.
    """

    mission: MissionId
    estimator: Identifier
    digest: Digest
    sources: Annotated[tuple[Source, ...], Meta(min_length=1, max_length=MOST_SOURCES)]  # the tracked source first
    excluded_bq: Annotated[dict[Nuclide, Becquerels], Meta(max_length=MOST_EXCLUDED)] | UnsetType = UNSET

    def flaw(self) -> str | None:
        """The covariances must be valid."""
        for source in self.sources:
            xx, xy, xz, yy, yz, zz = source.covariance_m2
            flaw = flaw_of_covariance([(xx, xy, xz), (xy, yy, yz), (xz, yz, zz)])
            if flaw is not None:
                return flaw
        return None


class Recognised(Struct, frozen=True, array_like=True):
    """The nuclide recognised in a camera's spectrum.

    ``evidence``: natural logarithm of the likelihood ratio of this nuclide to none or to any other, the smaller of both.
    """

    nuclide: Nuclide
    evidence: Annotated[float, Meta(ge=0.0, le=1e9)]


class Reaction(StrEnum):
    """The reaction of a vehicle to the loss of its agent."""

    RETURN = "return"
    LAND = "land"
    HOLD = "hold"


class Failsafe(Struct, frozen=True, array_like=True):
    """The announced reaction of the vehicle's failsafe; ``height_m``: of a return, above the launch place."""

    reaction: Reaction
    height_m: Metres | None = None


class Ticket(Struct, frozen=True, array_like=True):
    """The freshness data of a command to a drone, from the drone's newest status at the time of the command.

    ``nonce``: valid for ``MAX_ORDER_AGE_NS``; ``number``: above the number of the last executed command.
    """

    nonce: Nonce
    number: CommandNumber


class Answer(Struct, frozen=True, array_like=True):
    """A drone's answer to the last uploaded mission.

    ``stamp_ns``: of the upload; ``refused``: reason of the refusal, empty while the drone adopts the mission.
    """

    stamp_ns: StampNs
    mission: MissionId
    refused: Text = ""


class Obeyed(Struct, frozen=True, array_like=True):
    """A drone's last executed order since its agent's start, for stations without a link to the ordering station.

    ``order``: name of the action, or ``upload``; ``station``: the signing station; ``stamp_ns``: of the order; ``number``: of its
    ticket. ``signature``: by the drone, of the whole status with this order in it.
    """

    order: Identifier
    station: Identifier
    stamp_ns: StampNs
    number: CommandNumber
    signature: Signature = b""


class Status(DroneMessage, frozen=True, kw_only=True):
    """A drone's stage, counters, problems, and the result of its search, if it has ended.

    ``delays_ns``: for each drone received in the last 3 s, the minimum of the recent differences between the own clock at the
    arrival of its status and the status's stamp. The offset of two drones' clocks is half the difference of the two delays that
    they report of each other. ``started_ns``: in flight, the stamp of the start command of the swarm's mission. ``ticket``: for
    the next command. ``failsafe``: None: not known, as the vehicle's own setting stays. ``notices``: facts for the operator
    before a start that do not prevent it: unencrypted links, a certificate close to its end. ``disowns``: true if the drone has
    recently received news under its own id that it did not send; else left out. ``upload``: the answer to an upload since the
    agent's start; None: no upload. ``signature``: by the drone, as of a command, of all fields except ``obeyed``. An empty
    ``obeyed`` is left out, so that readers without this field can verify the rest.
    """

    mission: MissionId
    boot: BootId
    stage: Stage
    battery: Probability | None = None
    counters: Annotated[dict[Annotated[str, Meta(max_length=64)], Count], Meta(max_length=64)] = field(default_factory=dict)
    problems: Annotated[tuple[Annotated[str, Meta(max_length=256)], ...], Meta(max_length=32)] = ()
    finding: Annotated[str, Meta(max_length=256)] = ""
    recognised: Recognised | None = None  # None: no nuclide stands out (yet)
    started_ns: StampNs | None = None
    notices: Annotated[tuple[Annotated[str, Meta(max_length=256)], ...], Meta(max_length=8)] = ()
    delays_ns: Annotated[dict[DroneId, DelayNs], Meta(max_length=64)] = field(default_factory=dict)
    ticket: Ticket | None = None
    failsafe: Failsafe | None = None
    upload: Answer | None = None
    disowns: bool | UnsetType = UNSET
    obeyed: Obeyed | UnsetType = UNSET
    certificate: Certificate = b""
    signature: Signature = b""


class Order(StationMessage, frozen=True, kw_only=True):
    """Base of an operator's orders to the drones in ``to``.

    ``signature``: of the message without its signature, by the key of ``certificate``, which is issued to the station. Both are
    empty in a swarm without certificates.
    """

    mission: MissionId
    to: Annotated[dict[DroneId, Ticket], Meta(min_length=1, max_length=64)]
    certificate: Certificate = b""
    signature: Signature = b""


class Command(Order, frozen=True, kw_only=True):
    """An operator's command to drones that fly ``mission``."""

    action: Action


class Upload(Order, frozen=True, kw_only=True):
    """A new ``mission`` for drones on the ground, which fetch its content from the station in ``parts`` with these hashes."""

    parts: Annotated[tuple[PartHash, ...], Meta(min_length=1, max_length=MOST_PARTS)]


AnyDroneMessage = Credential | AnyEntry | Retraction | Pose | Plan | Frame | Estimate | Status | Revoked
AnyOrder = Command | Upload
AnyMessage = AnyDroneMessage | AnyOrder | Revocation

DRONE_KINDS: dict[str, type[AnyDroneMessage]] = {
    "credential": Credential,
    "cone": Cone,
    "exposure": Exposure,
    "sighting": Sighting,
    "fix": Fix,
    "coverage": Coverage,
    "retraction": Retraction,
    "pose": Pose,
    "plan": Plan,
    "frame": Frame,
    "estimate": Estimate,
    "status": Status,
    "revoked": Revoked,
}
STATION_KINDS: dict[str, type[AnyOrder | Revocation]] = {"command": Command, "upload": Upload, "revocation": Revocation}
KINDS: dict[str, type[AnyMessage]] = {**DRONE_KINDS, **STATION_KINDS}
