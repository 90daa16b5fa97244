"""The estimator ``field``, and the schedule of its fits.

At k ``REFITTED_S`` a fit begins anew, by all earlier measurements; at k ``REFINED_S`` later measurements refine it by a fixed
number of steps. Both happen with the first measurement from that time on, so they depend on nothing but the log. No later
fit depends on the result of an earlier one, except a refinement on the last fit that began anew: all are computed on demand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Final

import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.linalg import LinAlgError
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import GridStep, Hypothesis, Outlook
from radron.agent.fusion.field.analysis import Analysed, Analysis
from radron.agent.fusion.field.detectors import detector_of
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.sums import MAX_SUMS, Sums, rows_of
from radron.agent.fusion.observation import CountObservation, Observation
from radron.agent.terrain.ground import Ground
from radron.protocol.contamination import Contamination
from radron.protocol.entries import AnyEntry, Exposure

REFITTED_S: Final = 10.0
REFINED_S: Final = 5.0
MIN_HEIGHT_M: Final = 1.0  # below it the kernels are not tabulated: a drone that starts or lands
MAX_OFF_M: Final = 150.0  # from the area
_NS: Final = 1_000_000_000


class Fit:
    """A fit, computed at the first access; a replay over many times of fits costs the last one alone."""

    def __init__(self, compute: Callable[[], Analysed | None]) -> None:
        self._compute = compute

    @cached_property
    def analysed(self) -> Analysed | None:
        """The fit, the same at each access; None if the counts cannot be fitted."""
        return self._compute()


class FieldState(Struct, frozen=True, eq=False):
    """pending: observations since the last fit. sums: the others. position_sigma_m: by drone, as last reported. start_ns: of the
    mission (UTC). refitted, refined: numbers of the last past times of both. fit: the last one that began anew; None before it.
    refinement: of that fit, if there has been one since.
    """

    sums: Sums
    pending: tuple[CountObservation, ...] = ()
    position_sigma_m: Mapping[str, float] = {}
    start_ns: int = 0
    refitted: int = 0
    refined: int = 0
    fit: Fit | None = None
    refinement: Fit | None = None

    @property
    def newest(self) -> Analysed | None:
        """The newest fit: the last refinement's, or the last one that began anew."""
        newest = self.refinement or self.fit
        return None if newest is None else newest.analysed


class FieldEstimator:
    """Contaminated ground of one nuclide. A pure function of the observations and their grid steps."""

    name = "field"
    reads: tuple[type[AnyEntry], ...] = (Exposure,)
    grid_s: float | None = None
    hold_s = 0.25

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """``area``: the mission's area, mission frame. ``failed``: number of fits that failed, on which no result depends.

        Raises:
            ConfigError: as of ``detector_of``.
        """
        config = mission.fusion.field
        self._ground = Ground.from_config(mission)
        self._detector = detector_of(mission)
        self._numbers = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._analysis = Analysis(Grid.around(area), self._detector, self._ground, mission.named(), config)
        self._around = area.buffer(MAX_OFF_M)
        shapely.prepare(self._around)
        self.failed = 0

    def initial(self, start_ns: int | None) -> FieldState:
        """Return the state without measurements."""
        return FieldState(Sums.none(len(self._detector.background_ps)), start_ns=start_ns or 0)

    def step(self, state: FieldState, step: GridStep, observations: Sequence[Observation]) -> FieldState:
        """Let the measurements before the step be fitted where a fit is due, then add the step's observations."""
        refitted, refined = step.start_ns // round(REFITTED_S * _NS), step.start_ns // round(REFINED_S * _NS)
        if refitted > state.refitted:
            state = replace(self._refitted(state), refitted=refitted, refined=refined)
        elif refined > state.refined:
            state = replace(state, refinement=self._refinement(state), refined=refined)
        counted = [one for one in observations if isinstance(one, CountObservation) and self._counts(state, one)]
        sigmas = {one.identity.drone: one.position_sigma_m for one in counted}
        return replace(state, pending=(*state.pending, *counted), position_sigma_m={**state.position_sigma_m, **sigmas})

    def _counts(self, state: FieldState, observation: CountObservation) -> bool:
        """Whether the counts are of this ground: during the mission, by a fitting detector in flight, above or near the area."""
        if observation.middle_ns < state.start_ns or not self._detector.fits(observation):
            return False
        x, y, _ = observation.position
        return self._height_m(observation) >= MIN_HEIGHT_M and bool(shapely.contains_xy(self._around, x, y))

    def _summed(self, state: FieldState) -> Sums:
        return state.sums.plus(rows_of(state.pending, self._numbers, self._height_m, self._detector.counted))

    def _height_m(self, observation: CountObservation) -> float:
        x, y, z = observation.position
        return z - self._ground.height_m(x, y)

    def _refitted(self, state: FieldState) -> FieldState:
        sums, sigmas = self._summed(state), self._sigmas(state)
        state = replace(state, sums=sums, pending=(), refinement=None)
        if not len(sums):
            return state
        return replace(state, fit=Fit(lambda: self._tried(lambda: self._analysis.anew(sums.limited(), sigmas))))

    def _refinement(self, state: FieldState) -> Fit | None:
        fit = state.fit
        if fit is None:
            return None

        def refined() -> Analysed | None:
            before = fit.analysed
            if before is None:
                return None
            sums = self._summed(state).limited()
            return self._tried(lambda: self._analysis.refined(before, sums, self._sigmas(state))) or before

        return Fit(refined)

    def _tried(self, fit: Callable[[], Analysed]) -> Analysed | None:
        """Return the fit; None, and count it, if its numbers are out of range: absurd counts of a peer do not stop the flight."""
        try:
            found = fit()
        except (LinAlgError, ValueError):
            found = None
        if found is not None and found.contamination.flaw() is None:
            return found
        self.failed += 1
        return None

    def _sigmas(self, state: FieldState) -> list[float]:
        return [state.position_sigma_m.get(drone, 0.0) for drone in self._numbers]

    def work(self, state: FieldState, observations: int) -> int:
        """Return the work of a step: the fits on average over the steps."""
        return 8 + observations + min(len(state.sums), MAX_SUMS) // 2

    def contamination(self, state: FieldState, step: GridStep) -> Contamination | None:
        """Return the map of the newest fit; None before the first, and if the counts cannot be fitted."""
        newest = state.newest
        return None if newest is None else newest.contamination

    def hypothesis(self, state: FieldState, step: GridStep) -> Hypothesis | None:
        """Return None: this estimator maps ground, and locates no source that the drones could fly to."""
        return None

    def outlook(self, state: FieldState, step: GridStep) -> Outlook | None:
        """Return None: contaminated ground is surveyed in lanes."""
        return None
