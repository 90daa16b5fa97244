"""Typed messages; units are in the names, limits in ``units``.

World frames are ENU, body frames FLU (REP-103). Positions refer to the publisher's own local frame of the given ``epoch`` (a new
epoch begins at a jump of the localisation); only ``Estimate``, ``Frame``, and the home and alternative frame of a ``Pose`` refer
to the mission frame. Quaternions are (w, x, y,
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

from radron.protocol.checks import flaw_of_covariance, is_unit
from radron.protocol.contamination import Contamination
from radron.protocol.entries import AnyEntry, Cone, Coverage, Credential, Exposure, Fix, Retraction, Sighting, Signature
from radron.protocol.message import DroneMessage, StationMessage
from radron.protocol.revocations import Revocation, Revoked
from radron.protocol.spectrum import BINS, Line
from radron.protocol.texts import MAX_NOTICES, MAX_PROBLEMS, MAX_TEXT, Codes, Texts
from radron.protocol.units import (
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

_MAX_SPEED_MPS = 200.0
PART_BYTES = 256 * 1024  # of an uploaded mission, at most
MAX_PARTS = 12
MAX_SOURCES = 8  # of an estimate
MAX_EXCLUDED = 64  # nuclides of an estimate
MAX_ORDER_AGE_NS = 5_000_000_000  # of a command or an upload, from the operator's order to a drone's execution
Becquerels = Annotated[float, Meta(ge=0.0, le=1e18)]
DelayNs = Annotated[int, Meta(ge=-(2**62), le=2**62)]
SilenceNs = Annotated[int, Meta(ge=0, le=2**62)]


class Stage(StrEnum):
    """The stage of a drone's mission, from the checks before the flight to the landing."""

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
    """The action that an operator's command asks of a drone."""

    START = "start"
    HOLD = "hold"
    RESUME = "resume"
    RETURN = "return"
    LAND = "land"
    ABORT = "abort"


class Alternative(Struct, frozen=True, array_like=True):
    """The local frame by the other explanation of an unannounced jump: the transform mission <- local, as in ``Frame``."""

    translation_m: Position
    yaw_rad: Radians


class Pose(DroneMessage, frozen=True, kw_only=True):
    """A drone's position, velocity and attitude by its own localisation (satellites or SLAM).

    The position and the velocity refer to the drone's local frame of this ``epoch`` (a new epoch begins at a jump of the
    localisation); the quaternion (w, x, y, z) rotates from the body to the local frame. ``position_sigma_m`` and
    ``yaw_sigma_rad`` are 1-sigma errors. ``steered``: the vehicle follows its published plans; false while a pilot, a failsafe or
    the autopilot alone flies the vehicle. ``in_air``: false after the autopilot has detected the landing. ``stage``: of the
    drone's mission; left out in older records.

    ``silences_ns``, the table of contacts: the time without a pose of each other drone, up to this pose: since the last one, or,
    for a drone never heard that may fly, since it has been expected. With it both drones of a link know both directions.
    ``home_m``: where a return ends, with or without the agent, mission frame; left out while unknown. ``alternative``: of a drone
    with an exactly known frame, after a jump, until one explanation is left; its uncertainty includes the distance of the two.
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
    stage: Stage | UnsetType = UNSET
    silences_ns: Annotated[dict[DroneId, SilenceNs], Meta(max_length=64)] = field(default_factory=dict)
    home_m: Position | UnsetType = UNSET
    alternative: Alternative | UnsetType = UNSET

    def flaw(self) -> str | None:
        """Return an error text if the norm of the quaternion differs from 1; else None."""
        return None if is_unit(self.quaternion) else "its quaternion has no unit norm"


class Plan(DroneMessage, frozen=True, kw_only=True):
    """The positions at which a drone intends to be next: its predicted trajectory, for collision avoidance by the other drones.

    ``positions_m``: at ``stamp_ns``, then every ``step_ns``, in the drone's local frame of this ``epoch``.
    """

    epoch: Epoch
    step_ns: PlanStepNs
    positions_m: Annotated[tuple[Position, ...], Meta(min_length=1, max_length=64)]

    def flaw(self) -> str | None:
        """Return an error text if two successive positions imply a speed above 200 m/s; else None."""
        places = self.positions_m
        if len(places) > 1 and max(map(math.dist, places, places[1:])) > _MAX_SPEED_MPS * 1e-9 * self.step_ns:
            return "it jumps: two positions are further apart than 200 m/s allow"
        return None


class Frame(DroneMessage, frozen=True, kw_only=True):
    """A drone's estimate of the transform from its local frame to the common frame of the mission.

    The transform is a rotation by ``yaw_rad`` about the vertical axis, followed by the translation ``translation_m``.
    ``covariance``: the rows of the 4 x 4 error covariance matrix over (x m, y m, z m, yaw rad).
    """

    epoch: Epoch
    translation_m: Position
    yaw_rad: Radians
    covariance: Annotated[tuple[Variance, ...], Meta(min_length=16, max_length=16)]

    def flaw(self) -> str | None:
        """Return an error text if the 16 numbers are no valid covariance matrix; else None."""
        return flaw_of_covariance([self.covariance[row : row + 4] for row in (0, 4, 8, 12)])


class Source(Struct, frozen=True, kw_only=True):
    """One radioactive source as an estimator has located it, in the common frame of the mission.

    ``covariance_m2``: error covariance of the position (xx, xy, xz, yy, yz, zz). ``evidence``: natural logarithm of the
    likelihood ratio between the hypotheses "this source exists" and "no source". ``cones``: number of Compton cones assigned to
    this source. ``lines_kev``: for a source whose spectrum no candidate nuclide explains, the energies of its spectral lines in
    ascending order; such a source has neither nuclide nor activity.
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
    """A drone's estimate of all radioactive sources found so far, with the digest (hash) of the log from which it was computed.

    Two drones with equal digests have computed their estimates from equal log entries. ``sources``: the source that the swarm
    tracks comes first. ``excluded_bq``: by nuclide, the exclusion limit: the activity in becquerels above which further sources
    in the search area are excluded, except close to known sources that outshine them. A nuclide without such a limit is left out.
    Only estimators of several sources publish these limits. ``contamination``: the map of contaminated ground, of an estimator
    that makes one; with it there may be no sources.
    """

    mission: MissionId
    estimator: Identifier
    digest: Digest
    sources: Annotated[tuple[Source, ...], Meta(max_length=MAX_SOURCES)]  # the tracked source first
    excluded_bq: Annotated[dict[Nuclide, Becquerels], Meta(max_length=MAX_EXCLUDED)] | UnsetType = UNSET
    contamination: Contamination | UnsetType = UNSET

    def flaw(self) -> str | None:
        """Return an error text if the covariance of a source's position, or the map is not valid; else None."""
        for source in self.sources:
            xx, xy, xz, yy, yz, zz = source.covariance_m2
            flaw = flaw_of_covariance([(xx, xy, xz), (xy, yy, yz), (xz, yz, zz)])
            if flaw is not None:
                return flaw
        return None if self.contamination is UNSET else self.contamination.flaw()


class Recognised(Struct, frozen=True, array_like=True):
    """The nuclide that a camera has recognised in its own gamma spectrum.

    ``evidence``: natural logarithm of a likelihood ratio, of this nuclide to no nuclide or to any other nuclide, whichever is
    smaller.
    """

    nuclide: Nuclide
    evidence: Annotated[float, Meta(ge=0.0, le=1e9)]


class Reaction(StrEnum):
    """What a vehicle's autopilot does when its agent (the software on the onboard computer) no longer responds."""

    RETURN = "return"
    LAND = "land"
    HOLD = "hold"


class Failsafe(Struct, frozen=True, array_like=True):
    """The reaction that a vehicle has announced for the loss of its agent (the software on the onboard computer).

    ``height_m``: flight height of a return, in metres above the launch place; None for the other reactions.
    """

    reaction: Reaction
    height_m: Metres | None = None


class Ticket(Struct, frozen=True, array_like=True):
    """Proof that a command to a drone is recent and is executed only once: each drone issues tickets, and a command contains one.

    The station copies the ticket from the drone's newest status. ``nonce``: a random word of the drone, valid for
    ``MAX_ORDER_AGE_NS``. ``number``: a counter above the number of the last command that the drone executed.
    """

    nonce: Nonce
    number: CommandNumber


class Answer(Struct, frozen=True, array_like=True):
    """A drone's answer to the last mission that an operator has uploaded to the drone.

    ``stamp_ns``: time stamp of the upload. ``refused``: why the drone refuses the mission; empty if the drone adopts it.
    """

    stamp_ns: StampNs
    mission: MissionId
    refused: Text = ""


class Obeyed(Struct, frozen=True, array_like=True):
    """The last order that a drone has executed since its agent started.

    A drone publishes this record so that stations without a link to the ordering station learn of the order. ``order``: name of
    the action, or ``upload`` for a new mission. ``station``: the station that signed the order. ``stamp_ns``: time stamp of the
    order. ``number``: number of the order's ticket. ``signature``: the drone's signature of its whole status with this record in
    it.
    """

    order: Identifier
    station: Identifier
    stamp_ns: StampNs
    number: CommandNumber
    signature: Signature = b""


class Status(DroneMessage, frozen=True, kw_only=True):
    """What a drone reports about itself at least once a second: stage of its mission, counters, problems and the result of its
    search.

    Attributes:
        mission: identity of the mission that the drone flies.
        boot: random identity of the current run of the agent, new at every start.
        battery: charge, from 0 to 1; None: not known.
        counters: numbers of events since the start, by name.
        problems: conditions that need the operator, one line each.
        finding: result of the search once the search has ended; else empty.
        started_ns: in flight, the time stamp of the start command of the swarm's mission.
        notices: facts that an operator should know before a start, but that do not prevent the start: unencrypted links, or a
            certificate close to its end.
        delays_ns: for each drone received in the last 3 s, the smallest recent difference between the own clock at the arrival of
            a status and the time stamp in that status. The offset between two drones' clocks is half the difference of the two
            delays that the drones report of each other.
        ticket: must be in the next command to this drone.
        failsafe: announced reaction to the loss of the agent; None: not known, because the vehicle's own setting stays.
        upload: answer to an uploaded mission; None: no upload since the start of the agent.
        disowns: true if the drone has recently received messages under its own id that it did not send; else left out.
        obeyed: last executed order. An empty field is left out, so that readers of former versions can verify the other fields.
        codes: the codes of problems, finding and notices; left out without them.
        certificate: the drone's certificate (X.509, DER).
        signature: the drone's signature of all fields except ``obeyed``.
    """

    mission: MissionId
    boot: BootId
    stage: Stage
    battery: Probability | None = None
    counters: Annotated[dict[Annotated[str, Meta(max_length=64)], Count], Meta(max_length=64)] = field(default_factory=dict)
    problems: Annotated[tuple[Annotated[str, Meta(max_length=MAX_TEXT)], ...], Meta(max_length=MAX_PROBLEMS)] = ()
    finding: Annotated[str, Meta(max_length=MAX_TEXT)] = ""
    recognised: Recognised | None = None  # None: no nuclide stands out (yet)
    started_ns: StampNs | None = None
    notices: Annotated[tuple[Annotated[str, Meta(max_length=MAX_TEXT)], ...], Meta(max_length=MAX_NOTICES)] = ()
    delays_ns: Annotated[dict[DroneId, DelayNs], Meta(max_length=64)] = field(default_factory=dict)
    ticket: Ticket | None = None
    failsafe: Failsafe | None = None
    upload: Answer | None = None
    disowns: bool | UnsetType = UNSET
    obeyed: Obeyed | UnsetType = UNSET
    codes: Codes | UnsetType = UNSET
    certificate: Certificate = b""
    signature: Signature = b""

    def flaw(self) -> str | None:
        """Return an error text if the numbers of codes and texts differ; else None."""
        return None if self.codes is UNSET else self.codes.flaw(self.problems, self.finding, self.notices)

    @property
    def texts(self) -> Texts:
        """Problems, finding and notices, with their codes."""
        return Texts.read(self.problems, self.finding, self.notices, None if self.codes is UNSET else self.codes)


class Order(StationMessage, frozen=True, kw_only=True):
    """Base of the messages with which an operator orders drones: commands and uploads.

    ``to``: the addressed drones, each with its ticket. ``certificate``: the certificate issued to the station. ``signature``:
    made with the certificate's key over the message without its signature. Both are empty in a swarm without certificates.
    """

    mission: MissionId
    to: Annotated[dict[DroneId, Ticket], Meta(min_length=1, max_length=64)]
    certificate: Certificate = b""
    signature: Signature = b""


class Command(Order, frozen=True, kw_only=True):
    """An operator's command, such as start, hold or land, to drones that fly ``mission``."""

    action: Action


class Upload(Order, frozen=True, kw_only=True):
    """Announces a new ``mission`` to drones on the ground, which then fetch its content from the station.

    ``parts``: the BLAKE2b-256 hashes of the parts into which the station has split the content, in order.
    """

    parts: Annotated[tuple[PartHash, ...], Meta(min_length=1, max_length=MAX_PARTS)]


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
