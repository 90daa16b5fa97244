"""Typed messages; units are in the names, limits in ``units``.

World frames are ENU, body frames FLU (REP-103). A position is given in the publisher's own local frame of the
given ``epoch`` (a new epoch begins where the localisation jumped); only ``Estimate`` and ``Frame`` speak of the mission
frame. Quaternions are (w, x, y, z), local from body. Times are integer nanoseconds UTC.

Two families:

- **log entries** (``Cone``, ``Exposure``, ``Sighting``, ``Fix``, ``Coverage``): raw observations that every agent keeps for the
  whole mission. They have an identity and are judged by their bytes alone, never by the receiver's clock.
- **news** (``Pose``, ``Plan``, ``Frame``, ``Estimate``, ``Status``, ``Command``): the newest replaces the older.
"""

from __future__ import annotations

import math
from enum import StrEnum
from itertools import pairwise
from typing import Annotated, NamedTuple

from msgspec import Meta, Struct

from protocol.checks import flaw_of_covariance, is_unit
from protocol.units import (
    BootId,
    Count,
    Covariance3,
    Digest,
    Direction,
    DroneId,
    DurationNs,
    Epoch,
    Identifier,
    KiloElectronvolt,
    Latitude,
    Longitude,
    Metres,
    MissionId,
    Nuclide,
    PlanStepNs,
    Position,
    PositiveMetres,
    Probability,
    Quaternion,
    Radians,
    Seconds,
    SensorSigmaMetres,
    SensorSigmaRadians,
    SeparationMm,
    SigmaRadians,
    StampNs,
    SwathMetres,
    Variance,
    Velocity,
)

_LONGEST_EXPOSURE_NS = 60_000_000_000
_FASTEST_MPS = 200.0


class Stage(StrEnum):
    """Where a drone is in its mission."""

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
    """What an operator can command."""

    START = "start"
    HOLD = "hold"
    RESUME = "resume"
    RETURN = "return"
    LAND = "land"
    ABORT = "abort"


class EntryId(NamedTuple):
    """Identity of a log entry; also its place in the order in which estimators read the log (within one mission)."""

    mission: str
    stamp_ns: int
    drone: str
    boot: str
    sequence: int


class Message(Struct, frozen=True, kw_only=True, tag_field="kind", tag=str.lower):
    """Base of everything that crosses a link."""

    stamp_ns: StampNs

    def flaw(self) -> str | None:
        """What in this message contradicts itself, though each field is in its range; None if nothing."""
        return None


class DroneMessage(Message, frozen=True, kw_only=True):
    """A message that a drone publishes under its own key."""

    drone: DroneId


class Entry(DroneMessage, frozen=True, kw_only=True):
    """Base of the log entries. ``boot`` changes at every start of the agent, ``sequence`` counts within one boot."""

    mission: MissionId
    boot: BootId
    sequence: Count
    signature: Annotated[bytes, Meta(max_length=128)] = b""  # reserved for the publisher's signature

    @property
    def entry_id(self) -> EntryId:
        """What tells this entry from every other."""
        return EntryId(self.mission, self.stamp_ns, self.drone, self.boot, self.sequence)


class ConeOrder(Struct, frozen=True, array_like=True):
    """One reading of a coincidence: which of its two clusters was the recoil electron.

    The source lies in a direction u with angle(u, axis) = theta; ``axis`` points from the absorbed photon to the
    recoil electron, in the publisher's local frame. ``sigma_rad``: 1-sigma width of the cone's surface (ARM).
    """

    axis: Direction
    theta_rad: Annotated[float, Meta(ge=0.0, le=3.1416)]
    sigma_rad: SensorSigmaRadians
    probability: Probability


class Cone(Entry, frozen=True, kw_only=True):
    """A Compton cone: direction only; its count lives in the exposure (paper, Sec. IV-A)."""

    epoch: Epoch
    apex_m: Position
    apex_sigma_m: PositiveMetres
    yaw_sigma_rad: SigmaRadians
    clock_sigma_m: PositiveMetres = 0.0  # of apex_sigma_m: what the drone's wrong clock makes of its motion
    orders: tuple[ConeOrder, ConeOrder]  # first: cluster 1 is the electron; second: cluster 2 is
    energies_kev: tuple[KiloElectronvolt, KiloElectronvolt]  # clusters 1 and 2
    energy_sigmas_kev: tuple[KiloElectronvolt, KiloElectronvolt]
    separation_mm: SeparationMm

    def flaw(self) -> str | None:
        """The axes must be unit vectors, and the probabilities those of two things of which at most one is true."""
        first, second = self.orders
        if not 0.0 < first.probability + second.probability < 1.000001:
            return "the probabilities of its orders add up to 0 or to more than 1"
        return None if is_unit(first.axis) and is_unit(second.axis) else "an axis is no unit vector"


class PoseSample(Struct, frozen=True, array_like=True):
    """The camera's carrier at ``stamp_ns + offset_ns`` of the message that holds it."""

    offset_ns: DurationNs
    position_m: Position
    quaternion: Quaternion


class Counts(Struct, frozen=True, array_like=True):
    """Events of one detector in an interval: all clusters, full-energy events, two-cluster coincidences."""

    hits: Count
    photopeak: Count
    coincidences: Count


class Exposure(Entry, frozen=True, kw_only=True):
    """Counts over [stamp_ns, end_ns); a drone's exposures neither overlap nor leave gaps, zeros included."""

    epoch: Epoch
    end_ns: StampNs
    live_time_s: Seconds
    counts: Counts
    poses: Annotated[tuple[PoseSample, ...], Meta(min_length=1, max_length=256)]  # 10 Hz or more
    position_sigma_m: PositiveMetres
    yaw_sigma_rad: SigmaRadians
    clock_sigma_m: PositiveMetres = 0.0  # of position_sigma_m: what the drone's wrong clock makes of its motion

    def flaw(self) -> str | None:
        """The interval, its live time and its poses must fit together."""
        duration_ns = self.end_ns - self.stamp_ns
        if duration_ns <= 0:
            return "it ends before it begins"
        if duration_ns > _LONGEST_EXPOSURE_NS:
            return "it is longer than a minute"
        if self.live_time_s > duration_ns * 1e-9 * 1.000001:
            return "its live time is longer than itself"
        if not all(before.offset_ns < after.offset_ns for before, after in pairwise(self.poses)):
            return "its poses are not in order of time"
        if self.poses[-1].offset_ns > duration_ns:
            return "a pose lies outside of it"
        return None if all(is_unit(pose.quaternion) for pose in self.poses) else "a quaternion has no unit norm"


class Sighting(Entry, frozen=True, kw_only=True):
    """Another drone as this one's sensors saw it: its direction (local frame), its range, or both.

    ``position_m``: where this drone was. A camera gives a direction, a radio a range; who it is they know from the blinking or
    the radio's name, and may be wrong.
    """

    epoch: Epoch
    target: DroneId
    position_m: Position
    direction: Direction | None = None
    direction_sigma_rad: SensorSigmaRadians | None = None
    range_m: PositiveMetres | None = None
    range_sigma_m: SensorSigmaMetres | None = None

    def flaw(self) -> str | None:
        """It is of somebody else, says something, and each thing comes with its error; the direction is a unit vector."""
        if self.target == self.drone:
            return "it is of the drone itself"
        if (self.range_m is None) != (self.range_sigma_m is None):
            return "of range and range_sigma one is missing"
        if (self.direction is None) != (self.direction_sigma_rad is None):
            return "of direction and direction_sigma one is missing"
        if self.direction is None:
            return "it has neither direction nor range" if self.range_m is None else None
        return None if is_unit(self.direction) else "its direction is no unit vector"


class Fix(Entry, frozen=True, kw_only=True):
    """Where a satellite receiver says that this drone was (WGS84, height above the ellipsoid) when its own localisation said
    ``position_m``. The sigmas are of the distance, horizontal and vertical, as the receiver tells them.
    """

    epoch: Epoch
    position_m: Position
    latitude_deg: Latitude
    longitude_deg: Longitude
    altitude_m: Metres
    horizontal_sigma_m: SensorSigmaMetres
    vertical_sigma_m: SensorSigmaMetres


class Coverage(Entry, frozen=True, kw_only=True):
    """A stretch of the survey that was flown: everything within ``swath_m / 2`` of the path is covered."""

    epoch: Epoch
    path_m: Annotated[tuple[tuple[Metres, Metres], ...], Meta(min_length=1, max_length=256)]
    swath_m: SwathMetres


class Pose(DroneMessage, frozen=True, kw_only=True):
    """Where a drone is, by its own localisation."""

    epoch: Epoch
    position_m: Position
    velocity_mps: Velocity
    quaternion: Quaternion
    position_sigma_m: PositiveMetres
    yaw_sigma_rad: SigmaRadians

    def flaw(self) -> str | None:
        """The quaternion must have unit norm."""
        return None if is_unit(self.quaternion) else "its quaternion has no unit norm"


class Plan(DroneMessage, frozen=True, kw_only=True):
    """The tracker's prediction: positions at stamp_ns, stamp_ns + step_ns, ..."""

    epoch: Epoch
    step_ns: PlanStepNs
    positions_m: Annotated[tuple[Position, ...], Meta(min_length=1, max_length=64)]

    def flaw(self) -> str | None:
        """No vehicle goes from one position to the next faster than 200 m/s."""
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
        """The covariance must be one."""
        return flaw_of_covariance([self.covariance[row : row + 4] for row in (0, 4, 8, 12)])


class Estimate(DroneMessage, frozen=True, kw_only=True):
    """The hypothesis (mission frame), and the digest of the log that it follows from.

    ``evidence``: natural logarithm of how much likelier the observations are with a source than by background alone.
    """

    mission: MissionId
    estimator: Identifier
    digest: Digest
    position_m: Position
    covariance_m2: Covariance3
    velocity_mps: Velocity = (0.0, 0.0, 0.0)
    activity_bq: Annotated[float, Meta(ge=0.0, le=1e18)] | None = None
    activity_sigma_bq: Annotated[float, Meta(ge=0.0, le=1e18)] | None = None
    evidence: Annotated[float, Meta(ge=-1e9, le=1e9)] | None = None
    cones: Count = 0

    def flaw(self) -> str | None:
        """The covariance must be one."""
        xx, xy, xz, yy, yz, zz = self.covariance_m2
        return flaw_of_covariance([(xx, xy, xz), (xy, yy, yz), (xz, yz, zz)])


class Recognised(Struct, frozen=True, array_like=True):
    """The nuclide that a camera's spectrum shows.

    ``evidence``: natural logarithm of how much likelier the spectrum is with that nuclide than without it, or with any other.
    """

    nuclide: Nuclide
    evidence: Annotated[float, Meta(ge=0.0, le=1e9)]


class Status(DroneMessage, frozen=True, kw_only=True):
    """What a drone is doing, what it counted, what is wrong with it, and what its search has ended with, if it has.

    ``delays_ns``: for each drone heard, the least difference of late between the own clock at the arrival of its status and the
    stamp in it. Two drones' clocks differ by half the difference of the two delays that they tell of each other.
    ``started_ns``: in flight, the stamp of the start command with which the swarm's mission began.
    """

    mission: MissionId
    boot: BootId
    stage: Stage
    battery: Probability | None = None
    counters: Annotated[dict[Annotated[str, Meta(max_length=64)], Count], Meta(max_length=64)] = {}
    problems: Annotated[tuple[Annotated[str, Meta(max_length=256)], ...], Meta(max_length=32)] = ()
    finding: Annotated[str, Meta(max_length=256)] = ""
    recognised: Recognised | None = None  # none: no nuclide stands out (yet)
    started_ns: StampNs | None = None
    delays_ns: Annotated[dict[DroneId, Annotated[int, Meta(ge=-(2**62), le=2**62)]], Meta(max_length=64)] = {}


class Command(Message, frozen=True, kw_only=True):
    """An operator's command; ``drones`` empty means the whole swarm."""

    station: Identifier
    mission: MissionId
    action: Action
    drones: Annotated[tuple[DroneId, ...], Meta(max_length=64)] = ()


AnyEntry = Cone | Exposure | Sighting | Fix | Coverage
AnyDroneMessage = AnyEntry | Pose | Plan | Frame | Estimate | Status
AnyMessage = AnyDroneMessage | Command

DRONE_KINDS: dict[str, type[AnyDroneMessage]] = {
    "cone": Cone,
    "exposure": Exposure,
    "sighting": Sighting,
    "fix": Fix,
    "coverage": Coverage,
    "pose": Pose,
    "plan": Plan,
    "frame": Frame,
    "estimate": Estimate,
    "status": Status,
}
KINDS: dict[str, type[AnyMessage]] = {**DRONE_KINDS, "command": Command}
