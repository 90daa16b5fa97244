"""The estimator ``sources`` with a moving source: handover to a track of ``bayes``, and return to a fit at rest.

A fit of sources at rest represents a moving source by several along its way. Each is as strong as the source was there on
average. So a track (``tracker``) runs beside the fit, for the nuclide with the most counts. The track assumes one source of this
nuclide, at rest or moving; sources of other nuclides count as known. For the measurements since the last moves, compare the log
Bayes factors, against background alone,

    M  given the track, each measurement predicted from the earlier ones,
    R  given the sources at rest of the last moves, as fitted then, and refined by these measurements; the larger of both.

The track is ahead if all of these hold:

- P(at rest) <= ``_MOVES``: the track excludes a source at rest;
- its cameras' views are clear of unknown walls, with which the track could explain a lot away;
- M - R is at least ``_GAIN``.

Then, or if the track is the first to find a source, moves with these measurements follow at the next time of a refinement. A
track ahead also causes moves that begin without sources: a fit that has gone astray must not look like motion. After ``_AHEAD``
times ahead without a lag behind the fit (M < R) at moves in between, the source is handed over. For sources at rest, a wrong fit
is right after its next moves; a moving source has gone on. R must not be of sources fitted to the very measurements that they
have to explain. Afterwards several sources at rest explain each part of a fast source's way well. For the swarm's search until
then, see ``looking``.

After the handover the track is reported first, without other sources of its nuclide: their fitted places were places along its
way. Sources of other nuclides keep their report and count as known. Measurements during the motion tell nothing of sources at
rest.

A track at rest for ``_KEPT_NS`` is replaced by a new fit of the measurements since then. Condition: the fit finds the same source
alone, and no other source was reported; otherwise the track continues. A lost track searches as ``bayes`` does; after
``_KEPT_NS``, sources at rest are fitted anew. A track is on the ground: with sources above the ground, there is no track.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import GridStep, Hypothesis, Outlook
from radron.agent.fusion.observation import Observation
from radron.agent.fusion.sources.estimator import SourcesAtRest
from radron.agent.fusion.sources.fit import Fitted
from radron.agent.fusion.sources.looking import doubted, led, looks
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.state import SourcesState
from radron.agent.fusion.sources.tracker import Track, Tracker
from radron.protocol.entries import AnyEntry, Cone, Exposure

_HOLD_S = 0.25  # as of ``bayes``
_RECENT = 2  # kept moves: agents that share an estimator, as in simulations, may differ by an observation

_MOVES, _MAY_MOVE, _RESTS = 0.01, 0.2, 0.99  # of P(at rest)
_GAIN, _AHEAD = 15.0, 2  # of log evidence since the last moves, and how often
_KEPT_NS = 30_000_000_000
_SAME_M = 1.5  # between a track at rest and the fit that takes its place
_BEFORE_NS = 60_000_000_000  # limit of the age of measurements with which a track begins
_MORE = 2.0  # ratio of counted photons from which the track changes to another nuclide


class FollowingState(Struct, frozen=True, eq=False):
    """rest: the fit of sources at rest. track: the track beside it; None before the first fit. untracked: measurements of the
    last ``_BEFORE_NS`` before the last moves, while there is no track.
    """

    rest: SourcesState = SourcesState()
    track: Track | None = None
    untracked: tuple[Observation, ...] = ()


class FollowingEstimator:
    """Sources at rest, or one moving source. A pure function of the observations and their grid steps."""

    name = "sources"
    reads: tuple[type[AnyEntry], ...] = (Cone, Exposure)
    grid_s: float | None
    hold_s = _HOLD_S

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """As ``SourcesAtRest``. The time grid is that of ``bayes``: a moving source is elsewhere half a second later."""
        self.grid_s = mission.fusion.bayes.grid_s
        self._at_rest = SourcesAtRest(mission, area)
        self._telling = self._at_rest.telling
        self._mission, self._area = mission, area
        self._trackers: dict[int, Tracker] = {}
        self._recent: deque[tuple[FollowingState, int, FollowingState]] = deque(maxlen=_RECENT)

    def initial(self, start_ns: int | None) -> FollowingState:
        """Return the state without measurements; it does not depend on the mission's start."""
        return FollowingState()

    def step(self, state: FollowingState, step: GridStep, observations: Sequence[Observation]) -> FollowingState:
        """Fit the measurements before the step where a fit is due, then add the step's observations, also to the track.

        Moves are also made early if the measurements since the last moves contradict the fit.
        """
        rest = state.rest
        refined, moved = self._at_rest.due(step)
        gain = self._gain(state) if refined > rest.refined or moved > rest.moved else -math.inf
        if moved > rest.moved or gain >= _GAIN or (refined > rest.refined and _is_first(state)):
            state = self._moved_once(state, step, gain)
            rest = replace(state.rest, refined=refined, moved=moved)
        elif refined > rest.refined:
            rest = replace(self._at_rest.to_refine(rest), refined=refined)
        rest, track = rest.taken(observations), state.track
        if track is None:
            return FollowingState(rest, untracked=state.untracked)
        track = self._tracked(track, step, observations)
        if track.moves and (track.is_lost or (track.at_rest >= _RESTS and not track.beside)):
            track = replace(track, kept_ns=track.kept_ns or step.end_ns)
        elif track.moves:
            rest, track = replace(rest, pending=()), replace(track, kept_ns=0)
        return FollowingState(rest, doubted(track, step.start_ns) if rest.x0_stamp_ns else track)

    def work(self, state: FollowingState, observations: int) -> int:
        """Return the work of a step: the fits on average over the steps."""
        track = state.track
        tracking = 0 if track is None else self._tracker(track.nuclide).bayes.work(track.state, observations)
        return 8 + observations + len(state.rest.rows) // 10 + tracking

    def hypothesis(self, state: FollowingState, step: GridStep) -> Hypothesis | None:
        """Return the hypothesis of ``Telling``; for a moving source the track's, None while the track searches."""
        track = _moving(state)
        if track is None:
            told = self._telling.hypothesis(state.rest, step)
            if told is None or state.track is None or not looks(state.track, step):
                return told
            return replace(told, look=self._tracker(state.track.nuclide).bayes.hypothesis(state.track.state, step))
        told = self._tracker(track.nuclide).bayes.hypothesis(track.state, step)
        if told is None:
            return None
        others = tuple(replace(other, stamp_ns=step.middle_ns) for other in track.beside)
        nuclide = self._at_rest.spectra.nuclides[track.nuclide]
        return replace(told, nuclide=nuclide, x0_stamp_ns=state.rest.x0_stamp_ns or told.x0_stamp_ns, others=others)

    def outlook(self, state: FollowingState, step: GridStep) -> Outlook | None:
        """Return the outlook of ``SourcesAtRest``, led by the track's search (``looking``); that search alone for a lost moving
        source.
        """
        rest, track = state.rest, state.track
        if track is None:
            return rest.outlook
        bayes, nuclide = self._tracker(track.nuclide).bayes, self._at_rest.spectra.nuclides[track.nuclide]
        if track.moves:
            return bayes.outlook(track.state, step)
        first = self._telling.hypothesis(rest, step)
        told = [] if first is None else [one.nuclide or "" for one in (first, *first.others)]
        return led(rest.outlook, told, track, bayes, nuclide, step)

    def _moved_once(self, state: FollowingState, step: GridStep, gain: float) -> FollowingState:
        """Return the result of ``_moved``, cached. A late observation of this very step causes another computation of the step
        from the same state.
        """
        for before, index, after in self._recent:
            if before is state and index == step.index:
                return after
        moved = self._moved(state, step, gain)
        self._recent.append((state, step.index, moved))
        return moved

    def _moved(self, state: FollowingState, step: GridStep, gain: float) -> FollowingState:
        """Return the state after moves of the fit, the track updated by ``gain``; for a moving source, the test of a return."""
        if (track := _moving(state)) is not None:
            return self._taken_back(state, track, step)
        before = 0 if state.track is None else state.track.ahead
        ahead = before + 1 if gain >= _GAIN else before if gain > 0.0 else 0
        if ahead == _AHEAD:
            return self._handed_over(state, step)
        after = self._with_track(state, self._at_rest.moved(state.rest, step), step)
        if ahead > before:  # a fit that has gone astray must not look like motion
            from_none = replace(state.rest, fitted=None, unknown=())
            after = max(after, self._with_track(state, self._at_rest.moved(from_none, step), step), key=_evidence)
        track = after.track
        if track is None:
            return after
        if state.track is not None and track.begun_ns == state.track.begun_ns:
            track = replace(track, ahead=ahead)
        return replace(after, track=track.marked(step.start_ns))

    def _with_track(self, before: FollowingState, rest: SourcesState, step: GridStep) -> FollowingState:
        """Return the state after moves with the track beside its fit: the track before the moves, or a new one.

        A new track, begun with the measurements, replaces a track of another nuclide or with too few known others.
        """
        observed = (*before.untracked, *before.rest.pending)
        untracked = FollowingState(rest, untracked=tuple(one for one in observed if step.start_ns - one.stamp_ns < _BEFORE_NS))
        if rest.fitted is None or not len(rest.fitted.solution) or self._at_rest.raised:
            return untracked
        solution, track = rest.fitted.solution, before.track
        nuclide = self._most_counted(rest, track, solution)
        if nuclide is None:
            return untracked
        others = _without(solution, nuclide)
        if track is None or track.nuclide != nuclide or len(others) > len(track.others):
            track = Track(nuclide, self._tracker(nuclide).bayes.initial(None), others, step.start_ns, rest.unknown)
            track = self._begun(track, observed, step)
            if before.track is not None and before.track.nuclide == nuclide:
                track = replace(track, doubted_ns=before.track.doubted_ns)
        return FollowingState(rest, replace(track, others=others, unknown=rest.unknown))

    def _begun(self, track: Track, observations: Sequence[Observation], step: GridStep) -> Track:
        """Return the track with the observations so far."""
        width_ns = step.end_ns - step.start_ns
        by_step: dict[int, list[Observation]] = {}
        for one in observations:
            by_step.setdefault(one.stamp_ns // width_ns, []).append(one)
        for index in sorted(by_step):
            track = self._tracked(track, GridStep(index, index * width_ns, (index + 1) * width_ns), by_step[index])
        return track

    def _most_counted(self, rest: SourcesState, track: Track | None, solution: Solution) -> int | None:
        """Return the nuclide with the most counted photons. The track's own is kept if its source may move, or without a clear
        lead of another.

        None if there are only sources of unknown nuclides.
        """
        held = -1 if track is None else track.nuclide
        if track is not None and held in solution.nuclide and track.at_rest < _MAY_MOVE:
            return held
        known = [n for n in sorted(set(solution.nuclide)) if n < len(self._at_rest.spectra.nuclides)]
        if not known:
            return None
        model = self._at_rest.problem(rest).counts
        nothing = float(model.background(solution).sum())
        counted = {n: float(model.expected(_of(solution, n)).clear.sum()) - nothing for n in known}
        most = max(counted, key=counted.__getitem__)
        return held if _MORE * counted.get(held, -1.0) > counted[most] else most

    def _tracked(self, track: Track, step: GridStep, observations: Sequence[Observation]) -> Track:
        """Return the track with the observations of a step."""
        tracker = self._tracker(track.nuclide)
        pairs = [(one, seen) for one in observations if (seen := tracker.seen(one, track.others, track.unknown)) is not None]
        if not pairs:
            return track
        before, after = track.state, tracker.bayes.step(track.state, step, [seen for _, seen in pairs])
        track = replace(track, state=after)
        if before.track is None or after.track is None or track.moves:
            return replace(track, newest=()).marked(step.end_ns, found=True)
        return replace(track, newest=(*track.newest, *pairs))

    def _gain(self, state: FollowingState) -> float:
        """Return M - R of the measurements since the last moves (see the module); below 0 if the track cannot be ahead.

        A gain below ``_GAIN`` against the fit of the last moves alone is returned as it is, without a refined fit.
        """
        rest, track = state.rest, state.track
        if track is None or track.moves or track.mark is None or rest.fitted is None:
            return -math.inf
        if not track.at_rest <= _MOVES or not track.in_view:
            return -math.inf
        counted = track.counted
        newest = self._at_rest.problem_of(rest, [one for one, _ in counted])
        if newest is None:
            return -math.inf
        tracker, background = self._tracker(track.nuclide), track.state.background
        moving = track.state.evidence - track.mark.evidence
        moving += tracker.evidence_beside((seen for _, seen in counted), background)
        gain = moving - tracker.evidence_at_rest(newest, rest.fitted.solution, background)
        if gain < _GAIN:
            return gain
        refined = self._at_rest.to_refine(rest).refinement
        assert refined is not None
        assert refined.state.fitted is not None
        return min(gain, moving - tracker.evidence_at_rest(newest, refined.state.fitted.solution, background))

    def _handed_over(self, state: FollowingState, step: GridStep) -> FollowingState:
        rest, track = state.rest, state.track
        assert rest.fitted is not None
        assert track is not None
        solution = rest.fitted.solution
        kept = [k for k, n in enumerate(solution.nuclide) if n != track.nuclide and self._telling.is_known(rest.fitted, k)]
        beside = tuple(self._telling.told(rest, rest.fitted, k, step.middle_ns) for k in kept)
        return FollowingState(rest.emptied(), replace(track, moves=True, beside=beside, others=solution.only(kept)))

    def _taken_back(self, state: FollowingState, track: Track, step: GridStep) -> FollowingState:
        """Return to a fit of the measurements at rest, if it finds the same source or the track was lost; otherwise keep the
        track.
        """
        if track.kept_ns == 0 or step.start_ns - track.kept_ns < _KEPT_NS:
            return state
        rest = self._at_rest.moved(state.rest, step)
        if track.is_lost:
            return FollowingState(rest)
        if rest.fitted is None or not self._is_same(rest.fitted, track):
            return FollowingState(replace(state.rest, pending=()), replace(track, kept_ns=step.start_ns))
        return FollowingState(rest, replace(track, moves=False, kept_ns=0, ahead=0).marked(step.start_ns))

    def _is_same(self, fitted: Fitted, track: Track) -> bool:
        """Return whether the fit agrees with the track, and is declared."""
        if track.state.track is None or fitted.solution.nuclide != (track.nuclide,) or not self._telling.is_declared(fitted):
            return False
        off = fitted.solution.place[0] - track.state.track.moments()[0][:2]
        return bool(np.hypot(*off) <= _SAME_M)

    def _tracker(self, nuclide: int) -> Tracker:
        if nuclide not in self._trackers:
            known = self._at_rest
            self._trackers[nuclide] = Tracker(self._mission, self._area, known.spectra, known.windows, known.walls, nuclide)
        return self._trackers[nuclide]


def _moving(state: FollowingState) -> Track | None:
    """Return the track of a moving source; None without one."""
    return state.track if state.track is not None and state.track.moves else None


def _is_first(state: FollowingState) -> bool:
    """Return whether the track has found a source before any report, without moves since."""
    return state.track is not None and not state.rest.x0_stamp_ns and state.track.mark is not None and state.track.mark.found


def _evidence(state: FollowingState) -> float:
    """Return the log evidence of the fit."""
    return -math.inf if state.rest.fitted is None else state.rest.fitted.evidence


def _of(solution: Solution, nuclide: int) -> Solution:
    return solution.only([k for k, n in enumerate(solution.nuclide) if n == nuclide])


def _without(solution: Solution, nuclide: int) -> Solution:
    return solution.only([k for k, n in enumerate(solution.nuclide) if n != nuclide])
