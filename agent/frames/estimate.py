"""One keyframe after another: all drones' poses carried on, corrected, found anew where they are not known or contradicted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from agent.config import MissionConfig
from agent.frames.alignment import Alignment, align, evidence_of, views_of
from agent.frames.checkpoint import Checkpoint, Emission, Suspicion
from agent.frames.consistency import KEYFRAMES, Verdict, agreeing, tally, verdict, without
from agent.frames.drift import Drift
from agent.frames.graph import LAUNCH_EPOCH
from agent.frames.intake import Intake
from agent.frames.joint import NO_HEADINGS, Headings, Joint, corrected
from agent.frames.placement import Placement
from agent.frames.sightings import Array, Fixes, Ints, Sightings

_SPEED_MPS = 3.0  # at which a SLAM's drift with the distance is counted for sightings that are older than the keyframe
_MOST_VIEWS = 120  # sightings that an alignment looks at; of more every n-th
_FEWEST_VIEWS = 4
_SHARE = 0.35  # of the sightings that an alignment must explain: one of two others may lie
_WIDE = np.array([1e4, 1e4, 1e4, math.pi**2])  # m^2, rad^2: nothing known
_FIRM = 2  # keyframes in a row for which a frame is contradicted before anything is done
_PATIENCE = 5  # keyframes for which a contradicted frame is kept while no better place is found; fixes in a row that do not fit
_OUTSIDE = 16.3  # chi-square of three numbers: one in a thousand is above it
_RETRY = 3  # keyframes between attempts to find a frame again
_TOO_WIDE_M = 25.0  # sigma of a place that is as good as none
_MISSED_VAR = np.array([25.0**2, 25.0**2, 25.0**2, 0.0])


class Estimate:
    """Steps from checkpoint to checkpoint; keeps nothing itself."""

    def __init__(self, mission: MissionConfig, intake: Intake) -> None:
        self.names = [drone.id for drone in mission.drones]
        self.config = mission.frames
        self.drift = Drift(mission)
        self.intake = intake
        self.exact = [drone.localization == "exact" for drone in mission.drones]
        self.window = math.ceil(mission.frames.window_s / mission.frames.keyframe_s)

    def step(self, before: Checkpoint, index: int) -> Checkpoint:
        """The checkpoint after keyframe ``index``."""
        return _Keyframe(self, before, index).run()


class _Keyframe:
    """One keyframe while it is worked out."""

    def __init__(self, estimate: Estimate, before: Checkpoint, index: int) -> None:
        self.estimate, self.before, self.index = estimate, before, index
        self.intake, self.drift, self.config = estimate.intake, estimate.drift, estimate.config
        self.stamp_ns = index * self.intake.grid_ns
        self.members = list(before.members)
        self.emissions: list[Emission] = []
        self.seconds = 1e-9 * self.intake.grid_ns * (index - before.index if before.index >= 0 else 1)
        self.after_ns = self.stamp_ns - round(1e9 * self.seconds)
        self.joint = self._carried_on()
        self.tallies = before.tallies

    def run(self) -> Checkpoint:
        for drone in range(len(self.members)):
            self._launch(drone)
        self._correct()
        judged = verdict(self.tallies)
        self.quarrelling = {drone for pair in judged.quarrels() for drone in pair}
        self._judge(judged)
        for drone in range(len(self.members)):
            if drone not in self.joint.drones and self.index - self.members[drone].attempted >= _RETRY:
                self._find(drone)
        self._forgive()
        self._publish()
        return Checkpoint(self.index, self.joint, tuple(self.members), self.tallies, tuple(self.emissions))

    def _carried_on(self) -> Joint:
        """The estimate before, each drone moved on along its track."""
        joint = self.before.joint
        at, far = joint.at.copy(), joint.far.copy()
        for drone, track in enumerate(self.intake.tracks):
            reference = track.reference(self.stamp_ns)
            if reference is not None:
                at[drone], far[drone] = reference
        noise = np.zeros((len(joint.drones), 4))
        self.flown = np.maximum(far - joint.far, 0.0)  # metres of each drone since the last keyframe
        for row, drone in enumerate(joint.drones.tolist()):
            if not self.estimate.exact[drone]:
                noise[row] = self.drift.over(drone, self.seconds, self.flown[drone], self._adrift(drone))
                noise[row] += self.drift.over_jumps(self.intake.tracks[drone], self.after_ns, self.stamp_ns)
        return joint.moved(at, far, noise)

    def _launch(self, drone: int) -> None:
        """A drone begins where the layout puts it, if that says how it is turned."""
        track, member = self.intake.tracks[drone], self.members[drone]
        if member.launched or track.first_ns is None or track.first_ns > self.stamp_ns:
            return
        origin, variances, heading_known = self.drift.layout(drone)
        at_launch = track.segments[0].epoch == LAUNCH_EPOCH
        self.members[drone] = replace(member, launched=True, since=self.index, trusted=at_launch)
        if not at_launch or not heading_known:
            return
        yaw = self.drift.yaw_rad(drone)
        c, s = math.cos(yaw), math.sin(yaw)
        x, y, z = self.joint.at[drone]
        arm = np.array([c * x - s * y, s * x + c * y, z])
        jacobian = np.eye(4)
        jacobian[:3, 3] = -arm[1], arm[0], 0.0
        covariance = jacobian @ np.diag(variances) @ jacobian.T
        if not self.estimate.exact[drone]:
            covariance += np.diag(self.drift.over(drone, 0.0, self.joint.far[drone]))
        self.joint = self.joint.with_drone(drone, np.append(origin + arm, yaw), covariance)

    def _correct(self) -> None:
        """What was measured since the last keyframe."""
        slots = self.joint.slots()
        seen = self.intake.sightings(self.before.index + 1, self.index)
        seen = seen.take((slots[seen.observer] >= 0) & (slots[seen.target] >= 0))
        fixes = self.intake.fixes(self.before.index + 1, self.index)
        fixes = fixes.take(slots[fixes.drone] >= 0)
        result = corrected(self.joint, seen, self._older(seen), fixes, self._headings())
        self.joint = result.joint
        count = len(self.members)
        self.tallies = (*self.tallies, tally(count, seen, result.sightings))[-KEYFRAMES:]
        for drone, weight in zip(fixes.drone.tolist(), result.fixes.tolist(), strict=True):
            missed = 0 if weight > 0.5 else self.members[drone].missed + 1
            self.members[drone] = replace(self.members[drone], missed=missed)

    def _headings(self) -> Headings:
        rows = []
        for drone in self.joint.drones.tolist():
            var = self.drift.compass_var(drone, self.seconds)
            if var is not None and self.members[drone].trusted and not self._adrift(drone):
                rows.append((drone, self.drift.yaw_rad(drone), var))
        if not rows:
            return NO_HEADINGS
        drones, yaws, variances = zip(*rows, strict=True)
        return Headings(np.array(drones), np.array(yaws), np.array(variances))

    def _jumped(self, drone: int) -> bool:
        """Whether its localisation began anew since the launch: then nothing is known of what its heading goes by."""
        segments = self.intake.tracks[drone].segments
        return len(segments) > 1 and segments[1].stamp_ns <= self.stamp_ns

    def _adrift(self, drone: int) -> bool:
        """Whether a drone that followed satellites does so no more, as far as one can tell: it has no fixes, or began anew."""
        if not self.drift.follows_satellites(drone):
            return False
        return self._jumped(drone) or not self.intake.heard_of_satellites(drone, self.stamp_ns)

    def _older(self, seen: Sightings) -> Array:
        """(M,) m^2 of drift of the two drones between a sighting and the middle of the interval (``_placement``)."""
        seconds = np.abs(1e-9 * (self.stamp_ns - seen.stamp_ns) - 0.5 * self.seconds)
        older: Array = self.drift.since(seen.observer, seconds, _SPEED_MPS) + self.drift.since(seen.target, seconds, _SPEED_MPS)
        return older

    def _judge(self, judged: Verdict) -> None:
        """Find out whose frame is wrong, and place it anew by what the others see of it."""
        culprit = judged.culprit()
        confirmed = agreeing(self.tallies[-1])
        for drone in self.joint.drones.tolist():
            member = self.members[drone]
            if drone == culprit:
                self.members[drone] = replace(member, contradicted=member.contradicted + 1)
            else:
                sound = confirmed[drone] and not judged.disagree[drone].any()
                self.members[drone] = replace(member, contradicted=0, sound_ns=self.stamp_ns if sound else member.sound_ns)
            self._check_fixes(drone, judged)
        if culprit is not None and self.members[culprit].contradicted >= _FIRM and not self.estimate.exact[culprit]:
            others = [self.estimate.names[other] for other in np.flatnonzero(judged.disagree[culprit])]
            self._suspect(culprit, f"its frame contradicts the sightings between it and {_listed(others)}")
            self._replace(culprit)
            for drone, member in enumerate(self.members):  # now it is known who it was
                if member.suspicion is not None and member.suspicion.ambiguous:
                    self.members[drone] = replace(member, suspicion=None)
        elif culprit is None:
            for a, b in judged.quarrels():
                for one, other in ((a, b), (b, a)):
                    name = self.estimate.names[other]
                    reason = f"its frame and that of {name} contradict the sightings between them; one of the two is wrong"
                    self._suspect(one, reason, ambiguous=True)
        for drone in np.flatnonzero(judged.blind).tolist():
            if not judged.disagree[drone].any():
                self._suspect(drone, "its sightings of the others contradict where they are")

    def _check_fixes(self, drone: int, judged: Verdict) -> None:
        member = self.members[drone]
        if member.missed < _PATIENCE:
            return
        if judged.agree[drone].any():
            self._suspect(drone, "its fixes contradict the sightings between it and the others")
        else:  # nobody confirms where it is taken to be
            self.joint = self.joint.widened(drone, _MISSED_VAR)
            self._suspect(drone, "its fixes contradicted where it was taken to be; it is placed by them again")

    def _suspect(self, drone: int, reason: str, ambiguous: bool = False) -> None:
        suspicion = self.members[drone].suspicion
        if suspicion is not None and suspicion.lasting:
            return
        self.members[drone] = replace(self.members[drone], suspicion=Suspicion(reason, self.stamp_ns, ambiguous=ambiguous))

    def _forgive(self) -> None:
        """Who has not been contradicted for a while is believed again."""
        longest_ns = round(self.config.suspect_s * 1e9)
        for drone, member in enumerate(self.members):
            suspicion = member.suspicion
            if suspicion is not None and not suspicion.lasting and self.stamp_ns - suspicion.stamp_ns > longest_ns:
                self.members[drone] = replace(member, suspicion=None)

    def _replace(self, drone: int) -> None:
        """A contradicted drone: placed where the others' sightings have it, or, when they cannot tell for long, nowhere."""
        member = self.members[drone]
        first = max(self._keyframe_after(member.sound_ns), member.since, self.index - self.estimate.window)
        others = self.joint.without(drone)
        found = self._aligned(drone, others, first, by_claims=False)
        if found is not None:
            alignment, seen, fixes = found
            row = int(np.searchsorted(self.joint.drones, drone))
            if alignment.evidence - self._evidence(drone, others, seen, fixes, self.joint.pose[row]) < self.config.lead:
                found = None
        if found is None and member.contradicted < _PATIENCE:
            return
        self.joint = others
        self.tallies = tuple(without(one, drone) for one in self.tallies)
        self.members[drone] = replace(self.members[drone], trusted=False, since=first, contradicted=0, attempted=self.index)
        if found is None:
            self.members[drone] = replace(self.members[drone], lost_ns=member.sound_ns + 1)
            self._emit(drone, member.sound_ns + 1, None)
        else:
            self._insert(drone, *found)
            self._emit(drone, member.sound_ns + 1, self._placement(drone))

    def _find(self, drone: int) -> None:
        """A drone whose frame is not known: by all that was seen of it since it is not."""
        member = self.members[drone]
        if not member.launched:
            return
        first = max(member.since, self.index - self.estimate.window)
        found = self._found(drone, first)
        self.members[drone] = replace(self.members[drone], attempted=self.index)
        if found is None:
            return
        self._insert(drone, *found)
        if member.lost_ns is not None:
            self._emit(drone, member.lost_ns, self._placement(drone))
        self.members[drone] = replace(self.members[drone], sound_ns=self.stamp_ns, lost_ns=None)

    def _found(self, drone: int, first: int) -> tuple[Alignment, Sightings, Fixes] | None:
        """By those that agree with each other. Where two contradict each other, one of them is believed, namely the one by whom
        alone the drone was launched where the mission has it."""
        trusted = self.members[drone].trusted
        sides = sorted(self.quarrelling & set(self.joint.drones.tolist()))
        if not sides or not trusted:
            return self._aligned(drone, self.joint, first, by_claims=trusted)
        fitting = []
        for side in sides:
            others = self.joint
            for other in sides:
                others = others if other == side else others.without(other)
            found = self._aligned(drone, others, first, by_claims=True)
            if found is not None and self._launched_right(drone, found[0]):
                fitting.append(found)
        return fitting[0] if len(fitting) == 1 else None

    def _launched_right(self, drone: int, alignment: Alignment) -> bool:
        """Whether a pose has the origin of the drone's frame where the layout has it, as far as one can tell."""
        layout = self._layout_as_fix(drone)
        placement = Placement(alignment.pose, alignment.covariance, self.joint.at[drone])
        pose, covariance = placement.carried(layout.at[0])
        var = layout.var[0] + covariance.diagonal()[:3] + self.joint.covariance.diagonal().reshape(-1, 4)[:, :3].max(0)
        return bool(((pose[:3] - layout.place[0]) ** 2 / var).sum() < _OUTSIDE)

    def _keyframe_after(self, stamp_ns: int) -> int:
        return stamp_ns // self.intake.grid_ns + 1

    def _aligned(self, drone: int, others: Joint, first: int, by_claims: bool) -> tuple[Alignment, Sightings, Fixes] | None:
        """A drone's pose by sightings between it and ``others`` since keyframe ``first``, and by its own claims (layout, fixes)
        where these are trusted; None while that leaves it open."""
        slots = others.slots()
        seen = self.intake.sightings(first, self.index)
        of_it = (seen.observer == drone) & (slots[seen.target] >= 0) | (seen.target == drone) & (slots[seen.observer] >= 0)
        seen = seen.take(of_it)
        fixes = Fixes.empty()
        if by_claims:
            fixes = self.intake.fixes(first, self.index)
            fixes = Fixes.joined([self._layout_as_fix(drone), fixes.take(fixes.drone == drone)])
        if len(seen) + max(len(fixes) - 1, 0) < _FEWEST_VIEWS:
            return None
        alignment = align(views_of(drone, *self._views(drone, others, _thinned(seen), fixes)))
        if alignment is None or alignment.lead < self.config.lead or alignment.share < _SHARE:
            return None
        sigma = np.sqrt(alignment.covariance.diagonal())
        if sigma[:3].max() > self.config.aligned_sigma_m or sigma[3] > math.radians(self.config.aligned_yaw_deg):
            return None
        return alignment, seen, fixes

    def _views(
        self, drone: int, others: Joint, seen: Sightings, fixes: Fixes
    ) -> tuple[Sightings, Array, Array, Array, Fixes, Array]:
        """Arguments of ``views_of`` after the drone."""
        slots = others.slots()
        outward = seen.observer == drone
        ends = np.where(outward, seen.target, seen.observer)
        at_end = np.where(outward[:, None], seen.at_target, seen.at_observer)
        rows = slots[ends]
        pose = others.pose[rows].copy()
        c, s = np.cos(pose[:, 3]), np.sin(pose[:, 3])
        moved = at_end - others.at[ends]
        pose[:, 0] += c * moved[:, 0] - s * moved[:, 1]
        pose[:, 1] += s * moved[:, 0] + c * moved[:, 1]
        pose[:, 2] += moved[:, 2]
        diagonal = others.covariance.diagonal().reshape(-1, 4)[rows]
        place_var = diagonal[:, :3].mean(1) + 0.5 * diagonal[:, 3] * (moved[:, :2] ** 2).sum(1)
        return seen, pose, np.stack([place_var, diagonal[:, 3]], axis=1), others.at[drone], fixes, self._older(seen)

    def _evidence(self, drone: int, others: Joint, seen: Sightings, fixes: Fixes, pose: Array) -> float:
        return evidence_of(views_of(drone, *self._views(drone, others, _thinned(seen), fixes)), pose)

    def _layout_as_fix(self, drone: int) -> Fixes:
        """The place of the frame's origin in the layout, by what its track may have drifted since."""
        origin, variances, _ = self.drift.layout(drone)
        track = self.intake.tracks[drone]
        first_ns = track.first_ns
        assert first_ns is not None
        var = variances[:3] + self.drift.over(drone, 1e-9 * (self.stamp_ns - first_ns), float(self.joint.far[drone]))[:3]
        stamps: Ints = np.array([first_ns], dtype=np.int64)
        return Fixes(np.array([drone]), stamps, np.zeros((1, 3)), origin[None], var[None], np.ones(1))

    def _insert(self, drone: int, alignment: Alignment, seen: Sightings, fixes: Fixes) -> None:
        """Into the joint estimate, by the same data: so its errors and the others' are known to be the same ones."""
        wide = self.joint.with_drone(drone, alignment.pose, np.diag(_WIDE))
        doubt = self.joint.with_drone(drone, alignment.pose, alignment.covariance).covariance
        result = corrected(wide, seen, self._older(seen), fixes, doubt=doubt)
        # What it drifted since is common to all older sightings.
        age_s = float(np.mean(1e-9 * (self.stamp_ns - seen.stamp_ns))) if len(seen) else 0.0
        drifted = self.drift.over(drone, age_s, age_s * _SPEED_MPS)
        self.joint = result.joint.widened(drone, drifted)
        if len(fixes) and result.fixes[0] < 0.5 and self.members[drone].trusted and len(seen):  # the first one is the layout
            place = self.drift.layout(drone)[0]
            self.members[drone] = replace(
                self.members[drone],
                suspicion=Suspicion(
                    f"it was not launched where the mission has it ({_place(place)})", self.stamp_ns, lasting=True
                ),
            )

    def _placement(self, drone: int) -> Placement:
        """Where a drone's frame lies now. The joint estimate is about as good as if all sightings of the interval had been made
        together in its middle: by what the frame drifted since then, now is less certain."""
        row = int(np.searchsorted(self.joint.drones, drone))
        since = np.diag(self.drift.over(drone, 0.5 * self.seconds, 0.5 * self.flown[drone], self._adrift(drone)))
        return Placement(self.joint.pose[row].copy(), self.joint.block(row) + since, self.joint.at[drone].copy())

    def _emit(self, drone: int, from_ns: int, placement: Placement | None) -> None:
        self.emissions.append((drone, from_ns, placement))
        self.members[drone] = replace(self.members[drone], known=placement is not None)

    def _publish(self) -> None:
        """Each frame from now on."""
        told = {drone for drone, _, _ in self.emissions}
        for row, drone in enumerate(self.joint.drones.tolist()):
            if drone in told or self.estimate.exact[drone]:
                continue
            if self.joint.block(row).diagonal()[:3].max() > _TOO_WIDE_M**2:
                continue
            self._emit(drone, self.stamp_ns, self._placement(drone))


def _thinned(seen: Sightings) -> Sightings:
    stride = -(-len(seen) // _MOST_VIEWS)
    return seen.take(slice(None, None, stride)) if stride > 1 else seen


def _place(place: Array) -> str:
    return ", ".join(f"{axis:.0f}" for axis in place)


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
