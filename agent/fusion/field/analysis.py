"""From the sums to a report: fits of nothing and of contaminated ground, and the decision between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from radron.agent.config.estimators import FieldEstimatorConfig
from radron.agent.fusion.field.fit import Fitted, Problem
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.kernel import AnyDetector, KernelStore
from radron.agent.fusion.field.model import CountModel, Priors, Solution, of_drones
from radron.agent.fusion.field.positive import PositiveMap
from radron.agent.fusion.field.report import Blocks, contamination, total_of
from radron.agent.fusion.field.sums import Sums
from radron.agent.geometry import Array
from radron.agent.terrain.ground import Ground
from radron.protocol.contamination import Contamination, Finding

_NOTHING, _ANEW, _REFINED = 4, 6, 1  # steps of the fits of nothing and of the ground, and of its refinement
_MAP_ANEW, _SHAPED_ANEW = 6, 3  # steps of the map, and of the fit of its shape
GAIN: Final = 5.0  # of log evidence, for contamination


@dataclass(frozen=True, eq=False)
class Analysed:
    """A fit with its report. level: with the same prior everywhere, for totals and tests. blocks: with a prior of the shape of
    the map, for blocks. coefficients, activity: of the map without negative activity, (N,) Bq/m2.
    """

    level: Fitted
    blocks: Fitted
    coefficients: Array
    activity: Array
    contamination: Contamination


class Analysis:
    """Fits sums of one mission."""

    def __init__(self, grid: Grid, detector: AnyDetector, ground: Ground, nuclide: str, config: FieldEstimatorConfig) -> None:
        self._grid, self._detector, self._ground, self._nuclide = grid, detector, ground, nuclide
        self._config = config
        self._store = KernelStore(grid, detector)

    def anew(self, sums: Sums, position_sigma_m: Sequence[float]) -> Analysed:
        """Return a fit that begins without contamination. position_sigma_m: 1 sigma of each drone's horizontal position."""
        problem = self._problem(sums, position_sigma_m)
        clean = Solution.nothing(sums.counts.shape[1])
        nothing = problem.fitted(clean, _NOTHING)
        level = problem.fitted(problem.with_ground(clean), _ANEW)  # the fit of nothing has all counts in the background
        positive = PositiveMap(problem.model, level)
        coefficients = positive.fitted(positive.start(), _MAP_ANEW)
        shaped = problem.shaped(positive.activity(coefficients))
        blocks = shaped.fitted(shaped.with_ground(level.solution), _SHAPED_ANEW, shaped.rough)
        return self._analysed(problem, level, nothing.evidence, coefficients, shaped, blocks)

    def refined(self, before: Analysed, sums: Sums, position_sigma_m: Sequence[float]) -> Analysed:
        """Return the fit to more measurements, by a fixed number of steps from a fit."""
        problem = self._problem(sums, position_sigma_m)
        level = problem.fitted(before.level.solution, _REFINED, before.level.smoothness)
        nothing = problem.fitted(Solution.nothing(sums.counts.shape[1]), _NOTHING)
        shaped = problem.shaped(before.activity)
        blocks = shaped.fitted(before.blocks.solution, _REFINED, shaped.rough)
        return self._analysed(problem, level, nothing.evidence, before.coefficients, shaped, blocks)

    def _problem(self, sums: Sums, position_sigma_m: Sequence[float]) -> Problem:
        place = sums.place
        height = np.maximum(place[:, 2] - self._ground.heights_m(place[:, :2]), 0.3)
        model = CountModel(sums, height, self._store.of(sums, height), self._grid, self._detector)
        priors = Priors(self._config.background_sigma, of_drones(position_sigma_m), self._config.gain_sigma)
        return Problem(model, priors)

    def _analysed(
        self, problem: Problem, level: Fitted, none: float, coefficients: Array, shaped: Problem, blocks: Fitted
    ) -> Analysed:
        evidences = {Finding.NOTHING: 0.0, Finding.AREA: level.evidence - none}
        finding = Finding.AREA if evidences[Finding.AREA] > GAIN else Finding.NOTHING
        activity = PositiveMap(problem.model, level).activity(coefficients)
        total = total_of(level, problem.model)
        report = contamination(
            self._nuclide,
            finding,
            evidences,
            total,
            Blocks.of(blocks, shaped.model),
            np.maximum(shaped.model.activity(blocks.solution), 0.0),
            self._grid,
            self._ground,
        )
        return Analysed(level, blocks, coefficients, activity, report)
