"""The estimator ``sources``: what is fitted when, and what is told of it.

At the fixed times k ``moved_s`` sources may come and go in a fit with what was measured before. At k ``refined_s`` that fit is
refined with what has come since. Both happen with the first measurement from that time on, and so depend on nothing but the log.
A refinement begins with the last moves and nothing follows from it, so it is computed only where it is asked for: an agent that
catches up computes the moves and one refinement. The first source is the one that the swarm acts on: the strongest, until another
is twice as strong.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, partial

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from shapely import Polygon

from agent.config.mission import MissionConfig
from agent.detector.windows import Windows, candidates_of
from agent.errors import ConfigError
from agent.fusion.bayes.apparent import Sights
from agent.fusion.bayes.motion import ACTIVITY, BIASES, GAIN
from agent.fusion.bayes.motion import BIAS as ERRORS
from agent.fusion.estimator import GridStep, Hypothesis, Outlook
from agent.fusion.observation import ConeObservation, CountObservation, Observation
from agent.fusion.sources.candidates import Scan, grid_of, raised_grid
from agent.fusion.sources.counts import CountModel
from agent.fusion.sources.data import Cones, Rows
from agent.fusion.sources.directions import ConeModel
from agent.fusion.sources.fit import Fitted, Prior, Problem
from agent.fusion.sources.hiding import Hiding, Target
from agent.fusion.sources.misled import misled
from agent.fusion.sources.moves import Moves
from agent.fusion.sources.shades import KnownWalls
from agent.fusion.sources.solution import BIAS, Solution
from agent.fusion.sources.spectra import KNOWN, REFERENCE_BQ, UNKNOWN_AIR_PER_M, Spectra, UnknownSpectrum
from agent.fusion.sources.tracker import Track
from agent.fusion.sources.unknown import judged, only_told, only_unknown, settled
from agent.geometry import Array
from agent.motion.orbit import ring_radius_m
from agent.terrain.ground import Ground
from protocol.entries import AnyEntry, Cone, Exposure

_HOLD_S = 0.25  # as of ``bayes``
_LEAST_BIAS_M = 0.01
_STRONGER = 2.0  # so much stronger another source has to be to become the first one
_MARGIN_M = 10.0  # by which a source may lie outside of the area
_BACKGROUND_SIGMA, _SCALE_SIGMA, _SCATTER_SIGMA = 0.3, 0.03, 0.15
_BESIDE_M = 1.0  # by which a camera on the circle around a source may be farther out
_EXPECTED = 1.5  # sources
_REFINEMENTS = 3  # iterations
_RECENT = 2  # moves that are remembered: agents that share an estimator, as in simulations, may differ by an observation
_HIDDEN_M, _MOST_HIDDEN = 5.0, 900  # where a further source may hide


class SourcesState(Struct, frozen=True, eq=False):
    """pending: observations that no moves have used yet. rows, cones: the others. position_sigma_m: by drone, as last told.
    unknown: spectra of the nuclides of ``fitted`` that nobody knows.
    refined, moved: numbers of the last times of either kind that are past. none: log evidence of no source. hiding: where further
    ones may hide, at the last moves; None: nobody searches for them. refinement: of this state, if there has been one since the
    moves. track: beside the fit (``handover``); None before anything was fitted.
    """

    pending: tuple[Observation, ...] = ()
    rows: Rows = Rows.none()
    cones: Cones = Cones.none()
    position_sigma_m: Mapping[str, float] = {}
    refined: int = 0
    moved: int = 0
    fitted: Fitted | None = None
    unknown: tuple[UnknownSpectrum, ...] = ()
    none: float = 0.0
    hiding: Hiding | None = None
    x0_stamp_ns: int = 0
    refinement: Refinement | None = None
    track: Track | None = None


class Refinement:
    """The state after a refinement, computed when it is first asked for."""

    def __init__(self, compute: Callable[[], SourcesState]) -> None:
        self._compute = compute

    @cached_property
    def state(self) -> SourcesState:
        """The same for whoever asks."""
        return self._compute()


class SourcesEstimator:
    """Sources at rest. A pure function of the observations and their grid steps."""

    name = "sources"
    reads: tuple[type[AnyEntry], ...] = (Cone, Exposure)
    grid_s: float | None = None
    hold_s = _HOLD_S

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """``area``: in which sources are searched for, mission frame.

        Raises:
            ConfigError: a candidate of which it is not known what a camera counts; limits of activity in the wrong order.
        """
        self._config = mission.fusion.sources
        least_bq, most_bq = self._config.activity_bq
        if least_bq >= most_bq:
            raise ConfigError(f"fusion.sources.activity_bq: {least_bq:g} is not less than {most_bq:g}: the smaller one first")
        self._ground = Ground.from_config(mission)
        self._area = area
        outermost, fits = len(mission.drones) - 1, mission.encirclement.law == "smooth"
        self._circle_m = ring_radius_m(mission, 0, fits_hypothesis=False) + _BESIDE_M
        self._outermost_m = max(ring_radius_m(mission, outermost, fits) + _BESIDE_M, self._circle_m)
        self._spectra = Spectra.of(mission.nuclide if isinstance(mission.nuclide, tuple) else KNOWN)
        air_per_m = np.append(self._spectra.air_per_m, np.full(self._config.most + 1, UNKNOWN_AIR_PER_M))
        self._walls = KnownWalls(mission.buildings, air_per_m, self._ground)
        self._numbers = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._windows = Windows(candidates_of(mission.nuclide), mission.detection)
        self._refined_ns, self._moved_ns = round(self._config.refined_s * 1e9), round(self._config.moved_s * 1e9)
        self._height_m = mission.source_height_m
        self._raised = self._height_m[1] > self._height_m[0]
        self._places = raised_grid(area, *self._height_m)
        self._target = self._searched(mission)
        self._recent: deque[tuple[SourcesState, int, SourcesState]] = deque(maxlen=_RECENT)

    def initial(self, start_ns: int | None) -> SourcesState:
        """Nothing measured; it does not depend on the mission's start."""
        return SourcesState()

    def step(self, state: SourcesState, step: GridStep, observations: Sequence[Observation]) -> SourcesState:
        """Fit what was measured before the step where it is time, then take the step's observations."""
        refined, moved = step.start_ns // self._refined_ns, step.start_ns // self._moved_ns
        if moved > state.moved:
            state = replace(self._moved_once(state, step), refined=refined, moved=moved)
        elif refined > state.refined:
            before = replace(state, refinement=None)
            state = replace(state, refined=refined, refinement=Refinement(lambda: self._refined(before)))
        sigmas = {one.identity.drone: one.position_sigma_m for one in observations}
        return replace(
            state,
            pending=(*state.pending, *observations),
            position_sigma_m={**state.position_sigma_m, **sigmas},
        )

    def work(self, state: SourcesState, observations: int) -> int:
        """A fit costs up to a second, and steps are not split; on average over the steps."""
        return 40 + observations + len(state.rows) // 2

    def hypothesis(self, state: SourcesState, step: GridStep) -> Hypothesis | None:
        """The first source with those beside it in ``others``; None while its place is not known to ``declared_rms_m``."""
        if state.refinement is not None and state.x0_stamp_ns:
            state = state.refinement.state
        if state.x0_stamp_ns == 0 or state.fitted is None:
            return None
        told = [self._told(state, state.fitted, k, step) for k in range(len(state.fitted.solution))]
        known = [one for one in told if one.rms_m <= self._config.declared_rms_m]
        if not known:
            return None
        return replace(known[0], evidence=state.fitted.evidence - state.none, others=tuple(known[1:]))

    def outlook(self, state: SourcesState, step: GridStep) -> Outlook | None:
        """Where further sources may hide; None before the first measurements, and where the mission names no least activity."""
        if state.hiding is None or self._target is None:
            return None
        return state.hiding.outlook(self._target, self._spectra.nuclides)

    def _searched(self, mission: MissionConfig) -> Target | None:
        least_bq, height_m = mission.survey.least_activity_bq, mission.survey.height_m
        if least_bq is None:
            return None
        most_bq = max(self._config.activity_bq[1], least_bq)
        return Target(grid_of(self._area, _HIDDEN_M, _MOST_HIDDEN), least_bq / REFERENCE_BQ, most_bq / REFERENCE_BQ, height_m)

    def _moved_once(self, state: SourcesState, step: GridStep) -> SourcesState:
        """As ``_moved``, remembered: when an observation of this very step comes late, the step is computed again from the same
        state.
        """
        for before, index, after in self._recent:
            if before is state and index == step.index:
                return after
        moved = self._moved(state, step)
        self._recent.append((state, step.index, moved))
        return moved

    def _moved(self, state: SourcesState, step: GridStep) -> SourcesState:
        """With all measurements in a fit in which sources may come and go."""
        state = self._summed(state)
        if not len(state.rows):
            return state
        nothing = Solution.nothing(len(self._numbers), raised=self._raised)
        spectra, problem_of = self._spectra.plus(state.unknown), cache(partial(self._problem, state))
        start = nothing if state.fitted is None else state.fitted.solution
        if state.unknown:
            settling, spectra = settled(start, spectra, problem_of)
            start = settling.solution
        found = self._improved(state, problem_of(spectra), start, spectra)
        fitted, spectra = judged(found, spectra, problem_of)
        if fitted is not found:
            starts = fitted.solution, only_unknown(fitted.solution, spectra)
            each = [self._improved(state, problem_of(spectra), start, spectra) for start in starts]
            fitted = max(each, key=lambda one: one.evidence)
        fitted, spectra = only_told(fitted, spectra)
        problem = problem_of(spectra)
        hiding = None
        if self._target is not None:
            hiding = self._target.hiding(state.rows, problem.counts, spectra, self._ground, fitted, self._walls)
            if not all(self._is_located(fitted, k) for k in range(len(fitted.solution))):
                hiding = replace(hiding, left=hiding.left | hiding.glare)  # more measurements there would locate what is fitted
        fitted = misled(_strongest_first(fitted), problem, state.rows)
        return replace(
            state,
            fitted=fitted,
            unknown=spectra.unknown,
            none=problem.fitted(nothing, _REFINEMENTS).evidence,
            hiding=hiding,
            x0_stamp_ns=state.x0_stamp_ns or (step.start_ns if self._is_declared(fitted) else 0),
        )

    def _improved(self, state: SourcesState, problem: Problem, start: Solution, spectra: Spectra) -> Fitted:
        scan = Scan(state.rows, problem.counts, spectra, self._ground, self._places)
        return Moves(problem, scan, spectra, self._config.most, self._config.least_gain).improved(start, state.moved)

    def _refined(self, state: SourcesState) -> SourcesState:
        """With all measurements in the fit of the last moves, if there is one."""
        if state.fitted is None:
            return state
        start, state = state.fitted.solution, self._summed(state)
        problem = self._problem(state, self._spectra.plus(state.unknown))
        fitted = _strongest_first(problem.fitted(start, _REFINEMENTS))
        return replace(state, fitted=misled(fitted, problem, state.rows))

    def _summed(self, state: SourcesState) -> SourcesState:
        """With no observation pending."""
        counts = [one for one in state.pending if isinstance(one, CountObservation)]
        cones = [one for one in state.pending if isinstance(one, ConeObservation)]
        rows, cone_table = state.rows.plus(counts, self._numbers), state.cones.plus(cones, self._numbers)
        return replace(state, pending=(), rows=rows, cones=cone_table, refinement=None)

    def _problem(self, state: SourcesState, spectra: Spectra) -> Problem:
        drones = len(self._numbers)
        counts = CountModel(state.rows, spectra, self._ground, drones, self._walls)
        if state.fitted is not None:
            places = [state.fitted.sigma_of(k)[:2] for k in range(len(state.fitted.solution))]
            counts = counts.doubting(state.fitted.solution, np.array(places))
        directions = ConeModel(state.cones, spectra, self._ground, drones, self._windows, self._walls)
        return Problem(counts, directions, self._prior(state), len(spectra.nuclides))

    def _prior(self, state: SourcesState) -> Prior:
        """An autopilot's position sigma is that of the horizontal distance, so each axis has sigma / sqrt(2)."""
        bias = np.empty((len(self._numbers), BIAS))
        for drone, number in self._numbers.items():
            sigma_m = max(state.position_sigma_m.get(drone, 0.0) / math.sqrt(2.0), _LEAST_BIAS_M)
            bias[number] = sigma_m, sigma_m, self._config.gain_sigma
        west, south, east, north = self._area.bounds
        least, greatest = (math.log(bq / REFERENCE_BQ) for bq in self._config.activity_bq)
        return Prior(
            bias=bias,
            background=_BACKGROUND_SIGMA,
            scale=_SCALE_SIGMA,
            scatter=_SCATTER_SIGMA,
            low=np.array([west, south]) - _MARGIN_M,
            high=np.array([east, north]) + _MARGIN_M,
            log_activity=(least, greatest),
            area_m2=self._area.area,
            expected=_EXPECTED,
            height=self._height_m,
        )

    def _is_declared(self, fitted: Fitted) -> bool:
        return len(fitted.solution) > 0 and self._is_located(fitted, 0)

    def _is_located(self, fitted: Fitted, k: int) -> bool:
        return math.hypot(*fitted.sigma_of(k)[:2].tolist()) <= self._config.declared_rms_m

    def _told(self, state: SourcesState, fitted: Fitted, k: int, step: GridStep) -> Hypothesis:
        solution = fitted.solution
        mean, covariance = self._as_of_bayes(fitted, k)
        (x, y), height_m = solution.place[k].tolist(), solution.height_of(k)
        spectra = self._spectra.plus(state.unknown)
        relative = math.sqrt(float(covariance[ACTIVITY, ACTIVITY]) + self._config.area_sigma**2)
        lines_kev = spectra.lines_of(solution.nuclide[k])
        activity = math.exp(solution.log_activity[k]) * REFERENCE_BQ
        return Hypothesis(
            stamp_ns=step.middle_ns,
            position=np.array((x, y, self._ground.height_m(x, y) + height_m)),
            covariance=self._of_place(fitted, k),
            velocity=np.zeros(3),
            cones=len(state.cones),
            x0_stamp_ns=state.x0_stamp_ns,
            activity_bq=activity if lines_kev is None else None,
            activity_sigma_bq=activity * relative if lines_kev is None else None,
            sights=Sights(self._numbers, mean, covariance, self._ground, height_m),
            nuclide=spectra.name_of(solution.nuclide[k]),
            lines_kev=lines_kev,
            watched_s=self._watched_s(state.rows, solution.place[k]),
        )

    def _of_place(self, fitted: Fitted, k: int) -> Array:
        """(3, 3) covariance of the place of source k: J P J', with the height above the ground, where it is estimated, in P."""
        size = fitted.solution.size
        own = [size * k, size * k + 1, size * k + 3][: size - 1]
        jacobian = np.eye(3)[:, : size - 1]
        jacobian[2, :2] = self._ground.slope(*fitted.solution.place[k].tolist())
        result: Array = jacobian @ fitted.covariance[np.ix_(own, own)] @ jacobian.T
        return result

    def _watched_s(self, rows: Rows, place: Array) -> float:
        """Live time of all cameras near a source: on the circle and inside in full; farther out, up to the outermost ring of
        drones that do not hear each other, by the square of the distance.
        """
        away_m = np.hypot(*(rows.place[:, :2] - place).T)
        share = np.where(away_m < self._outermost_m, (self._circle_m / np.maximum(away_m, self._circle_m)) ** 2, 0.0)
        return float(rows.live_s @ share)

    def _as_of_bayes(self, fitted: Fitted, k: int) -> tuple[Array, Array]:
        """Mean and covariance of source k and the biases in the order of ``bayes``: x, y, velocity, log activity, and of each
        drone x, y, heading, sensitivity; velocity and headings are 0.
        """
        size = fitted.solution.size
        own = [size * k, size * k + 1, size * k + 2]
        theirs, first = [0, 1, ACTIVITY], size * len(fitted.solution) + 1
        for number in range(len(self._numbers)):
            own += [first + BIAS * number + part for part in range(BIAS)]
            theirs += [BIASES + ERRORS * number + part for part in (0, 1, GAIN)]
        whole = BIASES + ERRORS * len(self._numbers)
        mean, covariance = np.zeros(whole), np.zeros((whole, whole))
        mean[theirs] = fitted.solution.vector[own]
        covariance[np.ix_(theirs, theirs)] = fitted.covariance[np.ix_(own, own)]
        return mean, covariance


def _strongest_first(fitted: Fitted) -> Fitted:
    """The fit with another first source if that is much stronger than the first one."""
    solution = fitted.solution
    if len(solution) < 2:
        return fitted
    k = int(solution.log_activity.argmax())
    if k == 0 or solution.log_activity[k] < solution.log_activity[0] + math.log(_STRONGER):
        return fitted
    order = [k, *(other for other in range(len(solution)) if other != k)]
    size = solution.size
    numbers = [size * one + part for one in order for part in range(size)]
    numbers += range(size * len(solution), len(fitted.covariance))
    return replace(fitted, solution=solution.only(order), covariance=fitted.covariance[np.ix_(numbers, numbers)])
