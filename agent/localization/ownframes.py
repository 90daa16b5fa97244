"""The own local frames, one for each epoch, in the mission frame: by the log, by continuity, or as known before.

A jump of the localisation does not move the drone. Until the log yields an estimate of the new epoch's frame, the frame that
continues the motion is used (``radron.agent.localization.continuity``). After a restart of the agent, or if none of its entries
counts any more, the frame known before is used. All of these drift. A frame that the mission gives exactly is known so for its
first epoch only (``radron.agent.localization.knownframe``). Later frames are published with their measurements (``carried``), so
that all drones place these alike.
"""

from __future__ import annotations

from radron.agent.config.mission import DroneInMission
from radron.agent.frames.carried import told
from radron.agent.frames.drift import Drift
from radron.agent.frames.graph import LAUNCH_EPOCH, FrameGraph
from radron.agent.frames.kept import KeptFrame
from radron.agent.frames.transform import Transform
from radron.agent.geometry import Vector3
from radron.agent.localization.continuity import carried_on
from radron.agent.localization.knownframe import KnownFrame
from radron.agent.localization.untold import Untold
from radron.agent.vehicle.interface import VehicleState
from radron.protocol.entries import CarriedFrame

_EPOCHS_KEPT = 8  # entries of an epoch may be made some seconds after it


class OwnFrames:
    """The local frames of one drone, by epoch; transforms are mission from local.

    ``is_estimated``: they are estimated from the log, and may jump. ``known``: what becomes of a frame that the mission knows
    exactly. ``is_left_out``: this drone's measurements count no more, so the log yields no frame.
    """

    def __init__(self, member: DroneInMission, frames: FrameGraph, drift: Drift) -> None:
        """``member``: this drone in the mission's launch layout; ``frames``: of all drones, by the log; ``drift``: of frames
        without an estimate by the log.
        """
        self.is_estimated = not member.is_exact
        self.is_left_out = False
        self.known = KnownFrame()
        self._drone, self._frames, self._drift = member.id, frames, drift
        self._continued: Untold | None = None  # by continuity
        self._kept: Untold | None = None  # from before a restart, or from before this drone was left out
        self._carried: dict[int, CarriedFrame] = {}  # of the last epochs

    def jump(self, epoch: int, last: VehicleState, vehicle: VehicleState, turning_rps: float | None, *, announced: bool) -> None:
        """Begin the epoch of ``vehicle``: it has flown on, whatever its localisation says. ``last``: of ``epoch``, as stated by
        the localisation; ``turning_rps``: by its telemetry before; ``announced``: by the localisation itself.
        """
        old = self.undoubted(epoch)
        if old is None:
            return
        frame: Transform | None
        if self.is_estimated:
            frame = carried_on(old, last, vehicle, turning_rps)
        else:
            frame = self.known.after_jump(old, last, vehicle, turning_rps, announced=announced)
        self._continued = None if frame is None else Untold(vehicle.epoch, frame, vehicle.stamp_ns)

    def take(self, vehicle: VehicleState) -> VehicleState:
        """Take telemetry, after the jump that it may show; returns it with the doubt of the frame in its errors."""
        if self._continued is not None and not self._is_told(self._continued.epoch):
            self._continued = self._continued.drifted(self._drone, vehicle, self._drift)
        self._kept = self._kept_at(vehicle)
        self._tell_carried(vehicle)
        return self.known.stated(self.at(vehicle.epoch), vehicle)

    def left_out(self, vehicle: VehicleState | None) -> None:
        """Continue with the last frame: this drone's measurements do not count any more. ``vehicle``: its newest telemetry, if
        any.
        """
        self.is_left_out = True
        if vehicle is not None:
            self._kept = self._kept_at(vehicle)

    def remember(self, kept: KeptFrame, vehicle: VehicleState | None) -> None:
        """Take the plausible frame stored before a restart; ``vehicle``: the newest telemetry, if any."""
        transform = kept.mission_from_local
        assert transform is not None  # plausible
        untold = Untold(kept.epoch, transform, kept.stamp_ns)
        if vehicle is not None:
            untold = untold.drifted(self._drone, vehicle, self._drift)
        if self.is_estimated:
            self._kept = untold
        elif kept.epoch != LAUNCH_EPOCH and (vehicle is None or vehicle.epoch == kept.epoch):
            self._continued = untold
            self.known.otherwise = None if kept.otherwise is None else kept.otherwise.mission_from_local

    def at(self, epoch: int, stamp_ns: int | None = None) -> Transform | None:
        """The frame of an epoch; ``stamp_ns``: as it was at that stamp of the log (UTC), None: now. None while it is not
        known.
        """
        known = self._frames.mission_from_local(self._drone, epoch, stamp_ns)
        if known is not None:
            return known
        untold = next((one for one in (self._continued, self._kept) if one is not None and one.epoch == epoch), None)
        return None if untold is None else untold.transform

    def undoubted(self, epoch: int) -> Transform | None:
        """Return the frame of an epoch without the doubt that the published covariance of a continued frame includes."""
        continued = self._continued
        if not self.is_estimated and continued is not None and continued.epoch == epoch:
            return continued.transform
        return self.at(epoch)

    def surest(self, epoch: int, stamp_ns: int, position_m: Vector3) -> tuple[Transform, float] | None:
        """Return the frame by the log alone in which a place is known best, and its 1 sigma (m); None until the log yields it."""
        return self._frames.surest(self._drone, epoch, stamp_ns, position_m)

    def carried(self, epoch: int) -> CarriedFrame | None:
        """Return the frame of a recent epoch in the launch frame, for a drone whose frame the mission gives exactly; None for the
        launch frame itself, and for an estimated one.
        """
        return self._carried.get(epoch)

    def _is_told(self, epoch: int) -> bool:
        return self._frames.mission_from_local(self._drone, epoch) is not None

    def _kept_at(self, vehicle: VehicleState) -> Untold | None:
        by_log = self._frames.mission_from_local(self._drone, vehicle.epoch) if self.is_left_out else None
        if by_log is not None:
            return Untold(vehicle.epoch, by_log, vehicle.stamp_ns)
        if self._kept is None or self._is_told(self._kept.epoch):
            return None
        return self._kept.drifted(self._drone, vehicle, self._drift)

    def _tell_carried(self, vehicle: VehicleState) -> None:
        """Note the frame to publish from now on, if it is not the launch frame, with the doubt in its covariance."""
        continued = self._continued
        if self.is_estimated or continued is None or continued.epoch != vehicle.epoch or vehicle.epoch in self._carried:
            return
        self._carried[vehicle.epoch] = told(self._launch.inverse() @ self.known.doubted(continued.transform, vehicle))
        while len(self._carried) > _EPOCHS_KEPT:
            del self._carried[next(iter(self._carried))]

    @property
    def _launch(self) -> Transform:
        launch = self._frames.mission_from_local(self._drone, LAUNCH_EPOCH)
        assert launch is not None  # the mission knows it
        return launch
