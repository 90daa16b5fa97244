"""Pose of this drone, now and in the last seconds, with the epoch of its telemetry, and the transform to the mission frame.

It is the only owner of these, so that all of them change together when the localisation jumps.
"""

from __future__ import annotations

from collections import Counter
from math import hypot, isfinite

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.drift import Drift
from radron.agent.frames.graph import FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Vector3, yaw_of
from radron.agent.localization.clocks import Clocks
from radron.agent.localization.history import PoseHistory
from radron.agent.localization.jumps import JumpDetector
from radron.agent.localization.ownframes import OwnFrames
from radron.agent.localization.resting import Resting
from radron.agent.motion.reference import PeerState
from radron.agent.vehicle.grounded import Grounded
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.codes import Code
from radron.protocol.entries import CarriedFrame, Entry, Sighting
from radron.protocol.texts import CodedText

FARTHEST_M, _FASTEST_MPS = 1e5, 200.0  # the largest coordinate, and velocity, that a message can carry
_NORM_ERROR = 0.01  # tolerance for the norm of a quaternion: far more than rounding in single precision
_UNKNOWN_HEADING_DEG = 90.0  # a heading with a larger 1 sigma counts as unknown


class LocalFrame(Struct, frozen=True):
    """Transform between this drone's local frame and the mission frame, in both directions."""

    mission_from_local: Transform
    local_from_mission: Transform


class Whereabouts(Struct, frozen=True):
    """Position estimate of this drone in the mission frame: position (m) with the 1 sigma of the horizontal position, and heading
    of its body (rad, from east) with its 1 sigma.
    """

    place_m: Vector3
    sigma_m: float
    yaw_rad: float
    yaw_sigma_rad: float


class OwnPose:
    """Present and past poses of one drone, in its local frame and in the mission frame.

    history: telemetry of the last seconds, each message with its epoch; only this class adds to it.
    is_unplaced: the heading of the local frame in the mission frame is not known yet, because this drone has neither seen another
        drone nor been seen by one.
    utc: conversion of own time to the own clock.
    """

    def __init__(
        self,
        member: DroneInMission,
        frames: FrameGraph,
        clocks: Clocks,
        counters: Counter[str],
        speed_mps: float,
        drift: Drift,
        epoch_offset: int = 0,
    ) -> None:
        """Begin without telemetry.

        Args:
            member: this drone in the mission's launch layout.
            frames: the local frames of all drones as estimated from the log.
            clocks: the error of the own clock.
            counters: counts of dropped telemetry.
            speed_mps: maximum speed of the vehicles of this swarm.
            drift: growth of the uncertainty of a frame that the log does not give.
            epoch_offset: number of epochs that the agent before a restart had added to the vehicle's count.
        """
        self._drone = member.id
        self._clocks, self._counters, self.utc = clocks, counters, clocks.utc
        self.history = PoseHistory()
        self._frames = OwnFrames(member, frames, drift)
        self.is_unplaced = self._frames.is_estimated and member.yaw_sigma_deg > _UNKNOWN_HEADING_DEG
        self._jumps = JumpDetector(speed_mps, epoch_offset, from_launch=member.is_exact)
        self._grounded, self._resting = Grounded(), Resting()
        self._stated: VehicleState | None = None  # the newest telemetry, with the errors that the localisation states
        self._known: LocalFrame | None = None  # the last known frame, kept with its inverse

    def take(self, state: VehicleState) -> VehicleState | None:
        """Process telemetry. Return it with its epoch, and with the position error that a wrong own clock causes for the others.

        None for telemetry that is not newer than the newest, not finite, or out of range; it is counted and dropped.
        """
        last = self.vehicle
        if not _plausible(state):
            self._counters["telemetry_implausible"] += 1
            return None
        if last is not None and state.stamp_ns <= last.stamp_ns:
            self._counters["telemetry_older_than_known"] += 1
            return None
        before, self._stated = self._stated, state
        jumps = self._jumps.jumps
        vehicle = self._grounded.take(self._jumps.take(state))
        vehicle = self._with_clock_error(self._resting.take(vehicle, reports_down=not (state.armed or state.in_air)))
        if last is not None and before is not None and last.epoch != vehicle.epoch:
            announced = self._jumps.jumps == jumps
            self._frames.jump(last.epoch, before, vehicle, self.history.turning_rps, announced=announced)
        vehicle = self._frames.take(vehicle)
        self.history.add(vehicle)
        return vehicle

    def take_entry(self, entry: Entry) -> None:
        """Process a new log entry: with a sighting by or of this drone, the heading of its frame can be known."""
        if isinstance(entry, Sighting) and self._drone in (entry.drone, entry.target):
            self.is_unplaced = False

    def left_out(self) -> None:
        """Keep the last frame from now on: this drone's log entries do not count any more, so the log gives no frame."""
        self._frames.left_out(self.vehicle)

    @property
    def tells_frame(self) -> bool:
        """Whether the other drones know this drone's frame only from what it adds to the log: the frame is estimated, or, after a
        jump out of the frame given by the mission, published with poses while the position is trusted.
        """
        vehicle = self.vehicle
        return self._frames.is_estimated or (
            vehicle is not None and vehicle.position_trusted and self._frames.carried(vehicle.epoch) is not None
        )

    @property
    def is_lost(self) -> bool:
        """Whether this drone does not know its frame, and never will, because its log entries do not count any more."""
        return self._frames.is_left_out and self.frame is None

    @property
    def is_displaced(self) -> bool:
        """Whether the position in the mission frame is lost, although the mission gives the frame exactly: the localisation has
        jumped in a gap of the telemetry, or while the agent was down.
        """
        return not self._frames.is_estimated and self.vehicle is not None and self.frame is None

    @property
    def kept_frame(self) -> KeptFrame | None:
        """The present frame, and that of the alternative position hypothesis, to be stored for an agent restarted in flight; None
        if not known, or given by the mission.
        """
        vehicle = self.vehicle
        if vehicle is None:
            return None
        return KeptFrame.of(vehicle.epoch, vehicle.stamp_ns, self._frames.undoubted(vehicle.epoch), self.otherwise)

    def remember(self, kept: KeptFrame) -> None:
        """Restore the frame stored before a restart of the agent, already checked to be plausible. It applies to its epoch until
        the log gives that frame; until then its uncertainty grows. An alternative position hypothesis is restored with it.
        """
        self.is_unplaced = False
        self._frames.remember(kept, self.vehicle)

    @property
    def vehicle(self) -> VehicleState | None:
        """The newest telemetry; None before the first."""
        return self.history.newest

    @property
    def epoch_offset(self) -> int:
        """Number of epochs added to the vehicle's own count."""
        return self._jumps.offset

    @property
    def frame(self) -> LocalFrame | None:
        """Transforms between the local frame of the present epoch and the mission frame; None while not known."""
        vehicle = self.vehicle
        newest = self._frames.at(vehicle.epoch) if vehicle is not None else None
        if newest is None:
            return None
        if self._known is None or newest is not self._known.mission_from_local:
            self._known = LocalFrame(newest, newest.inverse())
        return self._known

    @property
    def sigma_m(self) -> float:
        """1 sigma (m) of the horizontal position in the mission frame; of an estimated frame by its covariance.

        While the present frame is not known, the last known one counts. 0 before any telemetry.
        """
        vehicle, frame = self.vehicle, self.frame or self._known
        if vehicle is None:
            return 0.0
        return vehicle.position_sigma_m if frame is None else self._sigma_m(vehicle, frame.mission_from_local)

    def _sigma_m(self, vehicle: VehicleState, mission_from_local: Transform) -> float:
        if mission_from_local.covariance is None:
            return vehicle.position_sigma_m
        by_frame_m = mission_from_local.sigmas_at(vehicle.position_m)[0]
        doubted = self.otherwise is not None or not vehicle.position_trusted
        return max(by_frame_m, vehicle.position_sigma_m) if doubted else by_frame_m

    @property
    def whereabouts(self) -> Whereabouts | None:
        """Position and heading in the mission frame, with their 1 sigma; None while not known."""
        vehicle, frame = self.vehicle, self.frame
        if vehicle is None or frame is None:
            return None
        transform = frame.mission_from_local
        place_m, sigma_m = transform.apply_point(vehicle.position_m), self._sigma_m(vehicle, transform)
        yaw_rad = yaw_of(vehicle.quaternion) + transform.yaw_rad
        return Whereabouts(place_m, sigma_m, yaw_rad, max(transform.yaw_sigma_rad, vehicle.yaw_sigma_rad))

    @property
    def otherwise(self) -> Transform | None:
        """The local frame (mission from local) by the alternative position hypothesis, that the localisation is right after its
        unannounced jump; None without one.
        """
        return self._frames.known.otherwise

    @property
    def doubt_m(self) -> float:
        """Distance (m) between the two possible positions of this drone after an unannounced jump; 0 without an alternative."""
        vehicle = self.vehicle
        return 0.0 if vehicle is None else self._frames.known.doubt_m(self._frames.at(vehicle.epoch), vehicle)

    def elsewhere(self) -> tuple[int, int] | None:
        """Return the stamps between which the localisation may have been wrong before an unannounced jump. Each jump is reported
        once; None without a new one.
        """
        told_once, self._frames.known.elsewhere = self._frames.known.elsewhere, None
        return told_once

    def carried(self, epoch: int) -> CarriedFrame | None:
        """Return the frame of a recent epoch relative to the launch frame, as published with measurements, for a drone whose
        frame the mission gives exactly. None for the launch frame itself, and for an estimated frame.
        """
        return self._frames.carried(epoch)

    def in_mission(self, epoch: int, stamp_ns: int, position_m: Vector3) -> Vector3 | None:
        """Convert a place where this drone was at a stamp of the log (UTC), from the local frame of ``epoch`` to the mission
        frame. The log counts before the frame by continuous motion; None if neither gives it.
        """
        known = self.surest(epoch, stamp_ns, position_m)
        transform = self._frames.at(epoch, stamp_ns) if known is None else None
        return known[0] if known is not None else transform.apply_point(position_m) if transform is not None else None

    def surest(self, epoch: int, stamp_ns: int, position_m: Vector3) -> tuple[Vector3, float] | None:
        """Convert a place where this drone was at a stamp of the log (UTC), from the local frame of ``epoch`` to the mission
        frame, by the log alone. Return it with its 1 sigma (m); None until the log gives it.
        """
        known = self._frames.surest(epoch, stamp_ns, position_m)
        return (known[0].apply_point(position_m), known[1]) if known is not None else None

    def motion_at(self, stamp_ns: int) -> PeerState | None:
        """Return position and velocity of this drone at a recent stamp (own time), mission frame; None if not known."""
        span_ns, state = self.history.span_ns, self.history.at(stamp_ns)
        if state is None or span_ns is None or stamp_ns < span_ns[0]:
            return None
        frame = self._frames.at(state.epoch, self.utc.of(state.stamp_ns))
        if frame is None:
            return None
        return PeerState(frame.apply_point(state.position_m), frame.rotate_direction(state.velocity_mps))

    def problems(self, now_ns: int) -> tuple[CodedText, ...]:
        """Return the problems for the operator by implausible telemetry: unannounced jumps, an alternative position hypothesis,
        false reports of a landing, motion on the ground.
        """
        doubt_m = self.doubt_m
        text = f"it may be {doubt_m:.0f} m from where it believes to be: its localisation has jumped"
        doubted = CodedText(Code.POSITION_DOUBTFUL, text) if doubt_m else None
        told = (self._jumps.problem(now_ns), doubted, self._grounded.problem(now_ns), self._resting.problem())
        return tuple(text for text in told if text is not None)

    def _with_clock_error(self, state: VehicleState) -> VehicleState:
        clock_m = self._clocks.sigma_m(hypot(*state.velocity_mps))
        return state if clock_m == 0.0 else replace(state, clock_sigma_m=clock_m)


def _plausible(state: VehicleState) -> bool:
    """Whether telemetry is usable: all numbers are finite, and small enough for a message."""
    sigmas = state.position_sigma_m + state.yaw_sigma_rad
    if not isfinite(sigmas + state.height_m) or sigmas < 0.0 or not abs(hypot(*state.quaternion) - 1.0) < _NORM_ERROR:
        return False
    within = all(-FARTHEST_M < value < FARTHEST_M for value in state.position_m)
    return within and all(-_FASTEST_MPS <= value <= _FASTEST_MPS for value in state.velocity_mps)
