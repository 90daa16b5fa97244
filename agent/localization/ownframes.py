"""Local frames of this drone in the mission frame, one for each epoch: by the log, by continuous motion, or as known before.

A jump of the localisation does not move the drone. Until the log gives the frame of the new epoch, the frame by continuous motion
is used (``radron.agent.localization.continuity``). After a restart of the agent, or if its log entries do not count any more, the
last known frame is used. The uncertainty of all of these grows with time.

A frame that the mission gives exactly is exact for the first epoch only (``radron.agent.localization.knownframe``). Later frames
are published together with the measurements (``carried``), so that all drones use the same ones.
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

_EPOCHS_KEPT = 8  # log entries of an epoch may be made some seconds after its end


class OwnFrames:
    """Local frames of one drone, by epoch; transforms are mission from local.

    is_estimated: the frames are estimated from the log, and not given by the mission. is_left_out: this drone's log entries do
        not count any more, so the log gives no frame. known: a frame given by the mission, over jumps.
    """

    def __init__(self, member: DroneInMission, frames: FrameGraph, drift: Drift) -> None:
        """``member``: this drone in the mission's launch layout; ``frames``: of all drones, by the log; ``drift``: growth of the
        uncertainty of a frame that the log does not give.
        """
        self.is_estimated = not member.is_exact
        self.is_left_out = False
        self.known = KnownFrame()
        self._drone, self._frames, self._drift = member.id, frames, drift
        self._continued: Untold | None = None  # frame by continuous motion since a jump
        self._kept: Untold | None = None  # frame from before a restart, or from before this drone's entries ceased to count
        self._carried: dict[int, CarriedFrame] = {}  # published frames of the last epochs

    def jump(self, epoch: int, last: VehicleState, vehicle: VehicleState, turning_rps: float | None, *, announced: bool) -> None:
        """Begin the epoch of ``vehicle``, the first telemetry after a jump.

        ``epoch``: the one before the jump; ``last``: its last telemetry, with the errors that the localisation states;
        ``turning_rps``: turn rate (rad/s) then, None if not known; ``announced``: the vehicle has reported the jump.
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
        """Process telemetry, after ``jump`` if it shows one. Return it with errors that include the alternative position
        hypothesis.
        """
        if self._continued is not None and not self._is_told(self._continued.epoch):
            self._continued = self._continued.drifted(self._drone, vehicle, self._drift)
        self._kept = self._kept_at(vehicle)
        self._tell_carried(vehicle)
        return self.known.stated(self.at(vehicle.epoch), vehicle)

    def left_out(self, vehicle: VehicleState | None) -> None:
        """Keep the last frame from now on, because this drone's log entries do not count any more. ``vehicle``: its newest
        telemetry, if any.
        """
        self.is_left_out = True
        if vehicle is not None:
            self._kept = self._kept_at(vehicle)

    def remember(self, kept: KeptFrame, vehicle: VehicleState | None) -> None:
        """Restore the frame stored before a restart of the agent, already checked to be plausible; ``vehicle``: the newest
        telemetry, if any.
        """
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
        """Return the frame of an epoch at a stamp of the log (UTC; None: now); None while it is not known."""
        known = self._frames.mission_from_local(self._drone, epoch, stamp_ns)
        if known is not None:
            return known
        untold = next((one for one in (self._continued, self._kept) if one is not None and one.epoch == epoch), None)
        return None if untold is None else untold.transform

    def undoubted(self, epoch: int) -> Transform | None:
        """Return the frame of an epoch, with a covariance that does not include an alternative position hypothesis; None while it
        is not known.
        """
        continued = self._continued
        if not self.is_estimated and continued is not None and continued.epoch == epoch:
            return continued.transform
        return self.at(epoch)

    def surest(self, epoch: int, stamp_ns: int, position_m: Vector3) -> tuple[Transform, float] | None:
        """Return the frame by the log alone that gives a place with the least uncertainty, and the 1 sigma (m) of that place.
        None until the log gives it.

        ``position_m``: the place in the local frame of ``epoch``, where the drone was at the stamp (UTC).
        """
        return self._frames.surest(self._drone, epoch, stamp_ns, position_m)

    def carried(self, epoch: int) -> CarriedFrame | None:
        """Return the frame of a recent epoch relative to the launch frame, as published with measurements, for a drone whose
        frame the mission gives exactly. None for the launch frame itself, and for an estimated frame.
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
        """Note the frame to be published with the measurements of this epoch, unless it is the launch frame. Its covariance
        includes an alternative position hypothesis.
        """
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
