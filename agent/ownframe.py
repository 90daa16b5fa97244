"""Where one drone's own local frame lies in the mission frame, as its navigation needs it: at once, also after a jump."""

from __future__ import annotations

from agent.continuity import carried_on
from agent.frames.graph import FrameGraph
from agent.frames.transform import Transform, Vector3
from agent.vehicle.interface import VehicleState


class OwnFrame:
    """The newest transforms between the mission frame and the own local one.

    ``is_known``: whether they are those of the epoch last asked for. After a jump of the localisation the drone is still where it
    was: until the log has the new epoch's frame, one that continues its motion serves.
    """

    def __init__(self, drone: str, frames: FrameGraph) -> None:
        self._drone = drone
        self._frames = frames
        self._last: VehicleState | None = None
        self._carried: tuple[int, Transform] | None = None  # an epoch, and its frame by continuity
        self.is_known = False
        self.mission_from_local = self.local_from_mission = Transform()

    def follow(self, vehicle: VehicleState) -> None:
        """Take telemetry, each once."""
        last, self._last = self._last, vehicle
        if last is None or last.epoch == vehicle.epoch:
            return
        old = self._at(last.epoch)
        if old is not None:
            elapsed_s = (vehicle.stamp_ns - last.stamp_ns) * 1e-9
            before, after = (last.position_m, last.quaternion), (vehicle.position_m, vehicle.quaternion)
            self._carried = vehicle.epoch, carried_on(old, before, last.velocity_mps, after, elapsed_s)

    def locate(self, epoch: int) -> bool:
        """Bring the transforms up to date; False where the frame of this epoch is not known."""
        newest = self._at(epoch)
        self.is_known = newest is not None
        if newest is not None and newest is not self.mission_from_local:
            self.mission_from_local, self.local_from_mission = newest, newest.inverse()
        return self.is_known

    def sigma_m(self, vehicle: VehicleState) -> float:
        """1 sigma of where the vehicle is in the mission frame, horizontal distance: by the frame where that is estimated."""
        if self.mission_from_local.covariance is None:
            return vehicle.position_sigma_m
        return self.mission_from_local.sigmas_at(vehicle.position_m)[0]

    def in_mission(self, epoch: int, stamp_ns: int, position_m: Vector3) -> Vector3 | None:
        """A place of the local frame as it was at a stamp."""
        transform = self._frames.mission_from_local(self._drone, epoch, stamp_ns)
        return transform.apply_point(position_m) if transform is not None else None

    def _at(self, epoch: int) -> Transform | None:
        known = self._frames.mission_from_local(self._drone, epoch)
        if known is None and self._carried is not None and self._carried[0] == epoch:
            return self._carried[1]
        return known
