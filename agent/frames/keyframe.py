"""Working state of one keyframe: the joint estimate, each drone's status, and the published frames."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from radron.agent.config.mission import MissionConfig
from radron.agent.frames.checkpoint import Checkpoint, Emission, Suspicion
from radron.agent.frames.drift import Drift
from radron.agent.frames.intake import Intake
from radron.agent.frames.joint import Joint
from radron.agent.frames.leads import leads_m
from radron.agent.frames.placement import Placement
from radron.agent.frames.residuals import Fixes, Sightings
from radron.agent.geometry import Array

_SLIDE_MPS = 1.0  # of a track that slides: spoofed, or by a SLAM that has lost its way
SPEED_MPS = 3.0  # assumed speed for the distance-dependent SLAM drift of sightings that are older than the keyframe


class Setting:
    """The settings of a mission that every keyframe (time of a frame estimate) needs.

    exact: for each drone, whether its localisation is exact. window: number of keyframes from which an unknown frame is found.
    """

    def __init__(self, mission: MissionConfig, intake: Intake) -> None:
        self.names = [drone.id for drone in mission.drones]
        self.config = mission.frames
        self.drift = Drift(mission)
        self.intake = intake
        self.exact = [drone.is_exact for drone in mission.drones]
        self.window = math.ceil(mission.frames.window_s / mission.frames.keyframe_s)


class Keyframe:
    """The working state while the frames are estimated for one keyframe (time of an estimate).

    It begins with the previous estimate, in which each drone is predicted along its own track. stamp_ns: time of the keyframe;
    before:
    index of the previous keyframe, -1 if there is none; seconds: time since then. flown: (N,) metres flown by each of the N
    drones since then. fixes: F satellite positions since then; leads_m: (F,) metres by which they run ahead of their drones'
    tracks (``leads``). joint, members, tallies, emissions: as in ``Checkpoint``, updated in place. drifted: (N,) m^2 of each
    horizontal axis, by which each track may have drifted since then.
    """

    def __init__(self, setting: Setting, before: Checkpoint, index: int) -> None:
        self.setting, self.before, self.index = setting, before.index, index
        self.intake, self.drift, self.config = setting.intake, setting.drift, setting.config
        self.stamp_ns = index * self.intake.grid_ns
        self.seconds = 1e-9 * self.intake.grid_ns * (index - before.index if before.index >= 0 else 1)
        self.members = list(before.members)
        self.tallies = before.tallies
        self.emissions: list[Emission] = []
        self.fixes, self.leads_m, led_m = self._led(before.joint)
        self.joint, self.flown, self.drifted = self._predicted(before.joint, led_m)

    def checkpoint(self) -> Checkpoint:
        """Return the state of the frame estimate after this keyframe, from which the next keyframe is computed."""
        return Checkpoint(self.index, self.joint, tuple(self.members), self.tallies, tuple(self.emissions))

    def adrift(self, drone: int) -> bool:
        """Return whether a drone that used satellites has probably lost them: it publishes no positions by them, or it has
        jumped.
        """
        if not self.drift.follows_satellites(drone):
            return False
        return self._jumped(drone) or not self.intake.has_recent_fix(drone, self.stamp_ns)

    def slides(self, drone: int) -> bool:
        """Return whether a drone's track slides (moves away slowly, by a spoofed receiver or a lost SLAM).

        A track that did so not long ago, or whose satellite positions still disagree, also counts.
        """
        member = self.members[drone]
        if member.slid_ns is None:
            return False
        is_elsewhere = member.missed > 0 and self.intake.has_recent_fix(drone, self.stamp_ns)
        return is_elsewhere or self.stamp_ns - member.slid_ns <= round(self.config.suspect_s * 1e9)

    def older_var(self, seen: Sightings) -> Array:
        """Return the variance (M,) in m^2 of the vector between the two drones of each of M sightings, apart from the sensor's
        error.

        It comes from the drones' drift between the sighting and the middle of the interval (see ``placement``), and from their
        clocks.
        """
        seconds = np.abs(1e-9 * (self.stamp_ns - seen.stamp_ns) - 0.5 * self.seconds)
        older: Array = self.drift.since(seen.observer, seconds, SPEED_MPS) + self.drift.since(seen.target, seconds, SPEED_MPS)
        return older + seen.clock_var

    def placement(self, drone: int) -> Placement:
        """Return the present estimate of a drone's frame in the mission frame.

        The joint estimate is about as good as if all sightings of the interval had been made in its middle, so half an interval
        of drift is added for the present time.
        """
        row = int(np.searchsorted(self.joint.drones, drone))
        since = np.diag(self.drift.over(drone, 0.5 * self.seconds, 0.5 * self.flown[drone], self.adrift(drone)))
        return Placement(self.joint.pose[row].copy(), self.joint.block(row) + since, self.joint.at[drone].copy())

    def emit(self, drone: int, from_ns: int, placement: Placement | None) -> None:
        """Publish a drone's frame as valid from a time stamp (ns) on; a placement of None means that the frame is unknown."""
        self.emissions.append((drone, from_ns, placement))
        self.members[drone] = replace(self.members[drone], known=placement is not None)

    def suspect(self, drone: int, reason: str, *, ambiguous: bool = False, lasting: bool = False) -> None:
        """Mark a drone's frame as not trusted, with the reason; a lasting suspicion is never cleared."""
        suspicion = self.members[drone].suspicion
        if lasting or suspicion is None or not suspicion.lasting:
            suspicion = Suspicion(reason, self.stamp_ns, lasting, ambiguous)
            self.members[drone] = replace(self.members[drone], suspicion=suspicion)

    def clear(self, drone: int) -> None:
        """Trust a drone's frame again, unless its suspicion is one that is never cleared."""
        suspicion = self.members[drone].suspicion
        if suspicion is not None and not suspicion.lasting:
            self.members[drone] = replace(self.members[drone], suspicion=None)

    def _led(self, joint: Joint) -> tuple[Fixes, Array, Array]:
        """The fixes since the previous keyframe, and the metres (F,) by which they lead their drones' tracks; and (N,) the
        largest lead over each drone's track in this interval or the previous one: its frame may have moved as far since.
        """
        fixes = self.intake.fixes(self.index - self.setting.window, self.index)
        leads = np.zeros(len(fixes))
        for row, drone in enumerate(joint.drones.tolist()):
            if self.drift.follows_satellites(drone):
                begin_ns = self.intake.tracks[drone].epoch_ns(self.stamp_ns)
                mine = np.flatnonzero((fixes.drone == drone) & (fixes.stamp_ns >= begin_ns))
                yaw_sigma_rad = math.sqrt(joint.block(row)[3, 3])
                leads[mine] = leads_m(fixes.take(mine), joint.pose[row, 3], yaw_sigma_rad)
        led_m, late = np.zeros(len(self.members)), fixes.stamp_ns > self.stamp_ns - round(2e9 * self.seconds)
        np.maximum.at(led_m, fixes.drone[late], leads[late])
        new = fixes.stamp_ns > self.before * self.intake.grid_ns
        return fixes.take(new), leads[new], led_m

    def _predicted(self, joint: Joint, led_m: Array) -> tuple[Joint, Array, Array]:
        at, far = joint.at.copy(), joint.far.copy()
        for drone, track in enumerate(self.intake.tracks):
            reference = track.reference(self.stamp_ns)
            if reference is not None:
                at[drone], far[drone] = reference
        noise, loose = np.zeros((len(joint.drones), 4)), np.zeros(len(joint.drones))
        flown = np.maximum(far - joint.far, 0.0)
        after_ns = self.stamp_ns - round(1e9 * self.seconds)
        for row, drone in enumerate(joint.drones.tolist()):
            if not self.setting.exact[drone]:
                noise[row] = self.drift.over(drone, self.seconds, flown[drone], self.adrift(drone))
                slide_m = _SLIDE_MPS * self.seconds if self.slides(drone) else 0.0
                loose[row] = led_m[drone] ** 2 + slide_m**2
            noise[row] += self.drift.over_jumps(self.intake.tracks[drone], after_ns, self.stamp_ns)  # of an exact one, too
        # The displacement by a slide is no drift: it must not widen the gate that detects the slide.
        drifted = np.zeros(len(self.members))
        drifted[joint.drones] = noise[:, :2].mean(1)
        noise[:, :2] += loose[:, None]
        return joint.moved(at, far, noise), flown, drifted

    def _jumped(self, drone: int) -> bool:
        """Whether its localisation has restarted since the launch: the reference of its heading is then unknown."""
        segments = self.intake.tracks[drone].segments
        return len(segments) > 1 and segments[1].stamp_ns <= self.stamp_ns


def listed(names: list[str]) -> str:
    """Return names as in a sentence: "d1, d2 and d3"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
