"""One keyframe while it is worked out: the joint estimate, each drone's standing, and what is told of its frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from agent.config import MissionConfig
from agent.frames.checkpoint import Checkpoint, Emission, Suspicion
from agent.frames.drift import Drift
from agent.frames.intake import Intake
from agent.frames.joint import Joint
from agent.frames.placement import Placement
from agent.frames.sightings import Array, Sightings

SPEED_MPS = 3.0  # at which a SLAM's drift with the distance is counted for sightings that are older than the keyframe


class Setting:
    """What all keyframes of a mission have in common. exact: by drone. window: in keyframes."""

    def __init__(self, mission: MissionConfig, intake: Intake) -> None:
        self.names = [drone.id for drone in mission.drones]
        self.config = mission.frames
        self.drift = Drift(mission)
        self.intake = intake
        self.exact = [drone.is_exact for drone in mission.drones]
        self.window = math.ceil(mission.frames.window_s / mission.frames.keyframe_s)


class Keyframe:
    """Begins with the estimate before, each drone carried on along its own track.

    stamp_ns: of the keyframe; before: the index of the last one, -1 for none; seconds: since it. flown: (N,) metres of each drone
    since. joint, members, tallies, emissions: as in ``Checkpoint``, to be worked on.
    """

    def __init__(self, setting: Setting, before: Checkpoint, index: int) -> None:
        self.setting, self.before, self.index = setting, before.index, index
        self.intake, self.drift, self.config = setting.intake, setting.drift, setting.config
        self.stamp_ns = index * self.intake.grid_ns
        self.seconds = 1e-9 * self.intake.grid_ns * (index - before.index if before.index >= 0 else 1)
        self.members = list(before.members)
        self.tallies = before.tallies
        self.emissions: list[Emission] = []
        self.joint, self.flown = self._carried_on(before.joint)

    def checkpoint(self) -> Checkpoint:
        """What it has come to."""
        return Checkpoint(self.index, self.joint, tuple(self.members), self.tallies, tuple(self.emissions))

    def adrift(self, drone: int) -> bool:
        """Whether a drone that followed satellites does so no more, as far as one can tell: it has no fixes, or began anew."""
        if not self.drift.follows_satellites(drone):
            return False
        return self._jumped(drone) or not self.intake.heard_of_satellites(drone, self.stamp_ns)

    def older_var(self, seen: Sightings) -> Array:
        """(M,) m^2 of drift of the two drones between a sighting and the middle of the interval (``placement``)."""
        seconds = np.abs(1e-9 * (self.stamp_ns - seen.stamp_ns) - 0.5 * self.seconds)
        older: Array = self.drift.since(seen.observer, seconds, SPEED_MPS) + self.drift.since(seen.target, seconds, SPEED_MPS)
        return older

    def placement(self, drone: int) -> Placement:
        """Where a drone's frame lies now. The joint estimate is about as good as if all sightings of the interval had been made
        together in its middle: by what the frame drifted since then, now is less certain."""
        row = int(np.searchsorted(self.joint.drones, drone))
        since = np.diag(self.drift.over(drone, 0.5 * self.seconds, 0.5 * self.flown[drone], self.adrift(drone)))
        return Placement(self.joint.pose[row].copy(), self.joint.block(row) + since, self.joint.at[drone].copy())

    def emit(self, drone: int, from_ns: int, placement: Placement | None) -> None:
        """Tell where a drone's frame lies from a stamp on; None: nobody knows."""
        self.emissions.append((drone, from_ns, placement))
        self.members[drone] = replace(self.members[drone], known=placement is not None)

    def suspect(self, drone: int, reason: str, *, ambiguous: bool = False, lasting: bool = False) -> None:
        """Name a drone's frame as not to be believed; a lasting suspicion stays."""
        suspicion = self.members[drone].suspicion
        if lasting or suspicion is None or not suspicion.lasting:
            suspicion = Suspicion(reason, self.stamp_ns, lasting, ambiguous)
            self.members[drone] = replace(self.members[drone], suspicion=suspicion)

    def _carried_on(self, joint: Joint) -> tuple[Joint, Array]:
        at, far = joint.at.copy(), joint.far.copy()
        for drone, track in enumerate(self.intake.tracks):
            reference = track.reference(self.stamp_ns)
            if reference is not None:
                at[drone], far[drone] = reference
        noise = np.zeros((len(joint.drones), 4))
        flown = np.maximum(far - joint.far, 0.0)
        after_ns = self.stamp_ns - round(1e9 * self.seconds)
        for row, drone in enumerate(joint.drones.tolist()):
            if not self.setting.exact[drone]:
                noise[row] = self.drift.over(drone, self.seconds, flown[drone], self.adrift(drone))
                noise[row] += self.drift.over_jumps(self.intake.tracks[drone], after_ns, self.stamp_ns)
        return joint.moved(at, far, noise), flown

    def _jumped(self, drone: int) -> bool:
        """Whether its localisation began anew since the launch: then nothing is known of what its heading goes by."""
        segments = self.intake.tracks[drone].segments
        return len(segments) > 1 and segments[1].stamp_ns <= self.stamp_ns
