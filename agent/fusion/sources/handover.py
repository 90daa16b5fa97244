"""The estimator ``sources`` with a source that moves: when it is handed over to a track of ``bayes``, and when it is taken back.

A fit of sources at rest tells a source that moves as several along its way, each as strong as it was there on average. So a
track (``tracker``) goes along with the fit, of the nuclide of which most is counted. It supposes that there is one source of it,
at rest or moving; sources of other nuclides count as known. Of what was measured since the last moves, compare the log Bayes
factors, against background alone,

    M  given the track, each measurement predicted from those before it,
    R  given the sources at rest of the last moves, as fitted then, and refined by what was measured; whichever is more.

The track is ahead where it excludes that its source is at rest, P(at rest) <= ``_MOVES``, does without anything unknown in its
cameras' views, with which it could explain a lot away, and M - R is at least ``_GAIN``. Then, or where it is the first to find a
source, moves are made at once, at the next time of a refinement, and count what was measured; if it is ahead also from none: a
fit that has gone astray must not look like motion. Once the track has been ahead ``_AHEAD`` times, and not behind the fit (M < R)
at moves in between, the source is handed over. For sources at rest a fit that has been wrong is right after its next moves; one
that moves has gone on. R must not be of sources that came by the same measurements that they have to explain: where one is fast,
several at rest explain each part of its way well, afterwards. Where the swarm looks until then: ``looking``.

Once it is handed over the track is told first, and nothing of its nuclide besides: what was fitted of it were places along its
way. Sources of other nuclides are told as they were, and count as known. Nothing that is measured while it moves tells of sources
at rest.
Once it has been at rest for ``_KEPT_NS``, a new fit of what was measured meanwhile takes the track's place, if that finds the
same and nothing else was told; otherwise the track goes on. A track that is lost searches as ``bayes`` does, and after as long a
time sources at rest are fitted anew. A track is on the ground: where sources may be above it, there is none.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from shapely import Polygon

from agent.config.mission import MissionConfig
from agent.fusion.estimator import GridStep, Hypothesis, Outlook
from agent.fusion.observation import Observation
from agent.fusion.sources.estimator import SourcesAtRest
from agent.fusion.sources.fit import Fitted
from agent.fusion.sources.looking import doubted, led, looks
from agent.fusion.sources.solution import Solution
from agent.fusion.sources.state import SourcesState
from agent.fusion.sources.tracker import Track, Tracker
from protocol.entries import AnyEntry, Cone, Exposure

_HOLD_S = 0.25  # as of ``bayes``
_RECENT = 2  # moves that are remembered: agents that share an estimator, as in simulations, may differ by an observation

_MOVES, _MAY_MOVE, _RESTS = 0.01, 0.2, 0.99  # of P(at rest)
_GAIN, _AHEAD = 15.0, 2  # of log evidence since the last moves, and how often
_KEPT_NS = 30_000_000_000
_SAME_M = 1.5  # between a track at rest and the fit that takes its place
_BEFORE_NS = 60_000_000_000  # by which what was measured may precede a track that begins with it
_MORE = 2.0  # so many more photons have to be counted of another nuclide for the track to be of that one


class FollowingState(Struct, frozen=True, eq=False):
    """rest: the fit of sources at rest. track: beside it; None before anything was fitted. untracked: what was measured in the
    last ``_BEFORE_NS`` before the last moves, while there is no track.
    """

    rest: SourcesState = SourcesState()
    track: Track | None = None
    untracked: tuple[Observation, ...] = ()


class FollowingEstimator:
    """Sources at rest, or one that moves. A pure function of the observations and their grid steps."""

    name = "sources"
    reads: tuple[type[AnyEntry], ...] = (Cone, Exposure)
    grid_s: float | None
    hold_s = _HOLD_S

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """As ``SourcesAtRest``. The time grid is that of ``bayes``: a source that moves is elsewhere half a second later."""
        self.grid_s = mission.fusion.bayes.grid_s
        self._at_rest = SourcesAtRest(mission, area)
        self._telling = self._at_rest.telling
        self._mission, self._area = mission, area
        self._trackers: dict[int, Tracker] = {}
        self._recent: deque[tuple[FollowingState, int, FollowingState]] = deque(maxlen=_RECENT)

    def initial(self, start_ns: int | None) -> FollowingState:
        """Nothing measured; it does not depend on the mission's start."""
        return FollowingState()

    def step(self, state: FollowingState, step: GridStep, observations: Sequence[Observation]) -> FollowingState:
        """Fit what was measured before the step where it is time, then take the step's observations, also with the track.

        Moves are made also where what was measured since the last ones contradicts the fit.
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
        """The fits on average over the steps."""
        track = state.track
        tracking = 0 if track is None else self._tracker(track.nuclide).bayes.work(track.state, observations)
        return 8 + observations + len(state.rest.rows) // 10 + tracking

    def hypothesis(self, state: FollowingState, step: GridStep) -> Hypothesis | None:
        """As ``Telling``; of a source that moves the track, None while that searches."""
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
        """As ``SourcesAtRest``, led by the track's search (``looking``); that search, if a source that moves has been lost."""
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
        """As ``_moved``, remembered: when an observation of this very step comes late, the step is computed again from the same
        state.
        """
        for before, index, after in self._recent:
            if before is state and index == step.index:
                return after
        moved = self._moved(state, step, gain)
        self._recent.append((state, step.index, moved))
        return moved

    def _moved(self, state: FollowingState, step: GridStep, gain: float) -> FollowingState:
        """Moves of the fit, and what follows for the track by its ``gain``; while a source moves, whether it is taken back."""
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
        """The state after moves with the track beside its fit: the one before them, or a new one, with what was measured, if that
        was of another nuclide or did not know others.
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
        """With what was observed so far."""
        width_ns = step.end_ns - step.start_ns
        by_step: dict[int, list[Observation]] = {}
        for one in observations:
            by_step.setdefault(one.stamp_ns // width_ns, []).append(one)
        for index in sorted(by_step):
            track = self._tracked(track, GridStep(index, index * width_ns, (index + 1) * width_ns), by_step[index])
        return track

    def _most_counted(self, rest: SourcesState, track: Track | None, solution: Solution) -> int | None:
        """The nuclide of which most photons were counted; that of the track if that may move, or not many more are of another.
        None where there are only sources of nuclides that nobody knows.
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
        """With what was observed in a step."""
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
        """M - R of what was measured since the last moves (this module's docstring), with the fit of then alone where that is not
        enough to be ahead; below 0 where the track cannot be.
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
        """With a fit of what was measured at rest, if that finds the same, or since it was lost; otherwise the track goes on."""
        if track.kept_ns == 0 or step.start_ns - track.kept_ns < _KEPT_NS:
            return state
        rest = self._at_rest.moved(state.rest, step)
        if track.is_lost:
            return FollowingState(rest)
        if rest.fitted is None or not self._is_same(rest.fitted, track):
            return FollowingState(replace(state.rest, pending=()), replace(track, kept_ns=step.start_ns))
        return FollowingState(rest, replace(track, moves=False, kept_ns=0, ahead=0).marked(step.start_ns))

    def _is_same(self, fitted: Fitted, track: Track) -> bool:
        """Whether what was fitted is what the track tells, and known as well as it has to be."""
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
    """The track of a source that moves."""
    return state.track if state.track is not None and state.track.moves else None


def _is_first(state: FollowingState) -> bool:
    """Whether the track has found a source before any is told, and no moves have been made since."""
    return state.track is not None and not state.rest.x0_stamp_ns and state.track.mark is not None and state.track.mark.found


def _evidence(state: FollowingState) -> float:
    """Of the fit."""
    return -math.inf if state.rest.fitted is None else state.rest.fitted.evidence


def _of(solution: Solution, nuclide: int) -> Solution:
    return solution.only([k for k, n in enumerate(solution.nuclide) if n == nuclide])


def _without(solution: Solution, nuclide: int) -> Solution:
    return solution.only([k for k, n in enumerate(solution.nuclide) if n != nuclide])
