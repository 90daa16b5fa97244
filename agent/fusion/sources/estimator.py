"""The fit of sources at rest, and its schedule.

At the fixed times k ``moved_s``, sources may come and go in a fit to all earlier measurements. At k ``refined_s``, later
measurements refine that fit. Both happen with the first measurement from that time on, and so depend on nothing but the log. A
refinement begins with the last moves, and no later state depends on it; so it is computed only on demand. An agent that catches
up computes the moves and one refinement. The swarm acts on the first source: the strongest, until another is twice as strong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial

import numpy as np
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.detector.windows import Windows, candidates_of
from radron.agent.errors import ConfigError
from radron.agent.fusion.bayes.response import REFERENCE_BQ
from radron.agent.fusion.estimator import GridStep, Outlook
from radron.agent.fusion.observation import Observation
from radron.agent.fusion.sources.candidates import Scan, grid_of, raised_grid, spacing_m
from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import Cones, Rows
from radron.agent.fusion.sources.directions import ConeModel
from radron.agent.fusion.sources.fit import Fitted, Prior, Problem
from radron.agent.fusion.sources.hiding import Target
from radron.agent.fusion.sources.misled import misled
from radron.agent.fusion.sources.moves import Moves
from radron.agent.fusion.sources.shades import KnownWalls
from radron.agent.fusion.sources.solution import BIAS, Solution
from radron.agent.fusion.sources.spectra import KNOWN, UNKNOWN_AIR_PER_M, Spectra
from radron.agent.fusion.sources.state import Refinement, SourcesState
from radron.agent.fusion.sources.telling import Telling
from radron.agent.fusion.sources.unknown import judged, only_told, only_unknown, settled
from radron.agent.terrain.ground import Ground

_LEAST_BIAS_M = 0.01
_STRONGER = 2.0  # ratio of activities from which another source becomes the first
_MARGIN_M = 10.0  # limit of a source's distance outside of the area
_BACKGROUND_SIGMA, _SCALE_SIGMA, _SCATTER_SIGMA = 0.3, 0.03, 0.15
_EXPECTED = 1.5  # sources
_REFINEMENTS = 3  # iterations
_HIDDEN_M, _MOST_HIDDEN = 5.0, 900  # grid of the search for further sources


class SourcesAtRest:
    """Fits sources at rest. A pure function of the observations and their grid steps.

    spectra, windows, walls, ground: the model of the world. raised: whether sources may be above the ground. telling: reports of
    the fitted sources.
    """

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """``area``: search area of the sources, mission frame.

        Raises:
            ConfigError: a candidate without known spectrum; limits of activity in the wrong order.
        """
        self._config = mission.fusion.sources
        least_bq, most_bq = self._config.activity_bq
        if least_bq >= most_bq:
            raise ConfigError(f"fusion.sources.activity_bq: {least_bq:g} is not less than {most_bq:g}: the smaller one first")
        self.ground = Ground.from_config(mission)
        self._area = area
        self.spectra = Spectra.of(mission.nuclide if isinstance(mission.nuclide, tuple) else KNOWN, mission.fusion.ground)
        air_per_m = np.append(self.spectra.air_per_m, np.full(self._config.most + 1, UNKNOWN_AIR_PER_M))
        self.walls = KnownWalls(mission.buildings, air_per_m, self.ground)
        self._numbers = {drone.id: number for number, drone in enumerate(mission.drones)}
        self.windows = Windows(candidates_of(mission.nuclide), mission.detection)
        self._refined_ns, self._moved_ns = round(self._config.refined_s * 1e9), round(self._config.moved_s * 1e9)
        self._height_m = mission.source_height_m
        self.raised = self._height_m[1] > self._height_m[0]
        self._places = raised_grid(area, *self._height_m)
        self._target = self._searched(mission)
        self.telling = Telling(mission, self.spectra, self.ground, self._numbers)

    def due(self, step: GridStep) -> tuple[int, int]:
        """Return the numbers of the last times of refinements and of moves until the step, as in the state."""
        return step.start_ns // self._refined_ns, step.start_ns // self._moved_ns

    def to_refine(self, state: SourcesState) -> SourcesState:
        """Return the state with a refinement by all measurements, computed on demand."""
        before = replace(state, refinement=None)
        return replace(state, refinement=Refinement(lambda: self._refined(before)))

    def problem(self, state: SourcesState) -> Problem:
        """Return the problem that judges the state's fit, given all of its measurements but the pending ones."""
        return self._problem(state, self.spectra.plus(state.unknown))

    def problem_of(self, state: SourcesState, observations: Sequence[Observation]) -> Problem | None:
        """Return the problem given these observations alone; None if they hold no counts."""
        pending = tuple(observations)
        newest = replace(state, rows=Rows.none(), cones=Cones.none(), pending=pending).summed(self._numbers)
        return self.problem(newest) if len(newest.rows) else None

    def _searched(self, mission: MissionConfig) -> Target | None:
        least_bq, height_m = mission.survey.least_activity_bq, mission.survey.height_m
        if least_bq is None:
            return None
        most_bq = max(self._config.activity_bq[1], least_bq)
        places = grid_of(self._area, _HIDDEN_M, _MOST_HIDDEN)
        cell_m = spacing_m(self._area, _HIDDEN_M, _MOST_HIDDEN)
        return Target(places, cell_m, least_bq / REFERENCE_BQ, most_bq / REFERENCE_BQ, height_m)

    def moved(self, state: SourcesState, step: GridStep) -> SourcesState:
        """Return the state with all measurements in a fit in which sources may come and go."""
        state = state.summed(self._numbers)
        if not len(state.rows):
            return state
        nothing = Solution.nothing(len(self._numbers), raised=self.raised, over_soil=self.spectra.soil is not None)
        spectra, problem_of = self.spectra.plus(state.unknown), cache(partial(self._problem, state))
        start = nothing if state.fitted is None else state.fitted.solution
        if state.unknown:
            settling, spectra = settled(start, spectra, problem_of)
            start = settling.solution
        moves = self._moves(state, problem_of(spectra), spectra)
        found = (
            moves.anew(start, only_unknown(start, spectra), state.moved) if state.changed else moves.improved(start, state.moved)
        )
        fitted, spectra = judged(found, spectra, problem_of)
        changed = fitted is not found
        if changed:  # the next moves begin anew; now this would be a second search in one step
            fitted = self._moves(state, problem_of(spectra), spectra).pruned(fitted)
        fitted, spectra = only_told(fitted, spectra)
        problem = problem_of(spectra)
        outlook = None if self._target is None else self._outlook(state.rows, self._target, problem, spectra, fitted)
        fitted = misled(_strongest_first(fitted), problem, state.rows)
        return replace(
            state,
            fitted=fitted,
            unknown=spectra.unknown,
            changed=changed,
            none=problem.fitted(nothing, _REFINEMENTS).evidence,
            outlook=outlook,
            x0_stamp_ns=state.x0_stamp_ns or (step.start_ns if self.telling.is_declared(fitted) else 0),
        )

    def _outlook(self, rows: Rows, target: Target, problem: Problem, spectra: Spectra, fitted: Fitted) -> Outlook:
        """Return the sources that the rows do not exclude, beside the fitted ones."""
        hiding = target.hiding(rows, problem.counts, spectra, self.ground, fitted, self.walls)
        if not all(self.telling.is_located(fitted, k) for k in range(len(fitted.solution))):
            hiding = replace(hiding, left=hiding.left | hiding.glare)  # more measurements there would locate the fitted sources
        return hiding.outlook(target, self.spectra.nuclides)

    def _moves(self, state: SourcesState, problem: Problem, spectra: Spectra) -> Moves:
        scan = Scan(state.rows, problem.counts, spectra, self.ground, self._places)
        return Moves(problem, scan, spectra, self._config.most, self._config.least_gain)

    def _refined(self, state: SourcesState) -> SourcesState:
        """Return the state with all measurements in the fit of the last moves, if there is one."""
        if state.fitted is None:
            return state
        start, state = state.fitted.solution, state.summed(self._numbers)
        problem = self.problem(state)
        fitted = _strongest_first(problem.fitted(start, _REFINEMENTS))
        return replace(state, fitted=misled(fitted, problem, state.rows))

    def _problem(self, state: SourcesState, spectra: Spectra) -> Problem:
        drones = len(self._numbers)
        counts = CountModel(state.rows, spectra, self.ground, drones, self.walls)
        if state.fitted is not None:
            places = [state.fitted.sigma_of(k)[:2] for k in range(len(state.fitted.solution))]
            counts = counts.doubting(state.fitted.solution, np.array(places))
        directions = ConeModel(state.cones, spectra, self.ground, drones, self.windows, self.walls)
        return Problem(counts, directions, self._prior(state), len(spectra.nuclides))

    def _prior(self, state: SourcesState) -> Prior:
        """Return the prior. An autopilot's position sigma is horizontal (2D), so each axis has sigma / sqrt(2)."""
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


def _strongest_first(fitted: Fitted) -> Fitted:
    """Return the fit with another first source if this other source is much stronger."""
    solution = fitted.solution
    if len(solution) < 2:
        return fitted
    k = int(solution.log_activity.argmax())
    if k == 0 or solution.log_activity[k] < solution.log_activity[0] + math.log(_STRONGER):
        return fitted
    order = [k, *(other for other in range(len(solution)) if other != k)]
    size = solution.size
    numbers = [size * one + part for one in order for part in range(size)]
    numbers += range(solution.of_sources, len(fitted.covariance))
    return replace(fitted, solution=solution.only(order), covariance=fitted.covariance[np.ix_(numbers, numbers)])
