"""The estimator ``field``, and the schedule of its fits.

At k ``REFITTED_S`` a fit begins anew, by all earlier measurements; at k ``REFINED_S`` later measurements refine it by a fixed
number of steps. Both happen with the first measurement from that time on, so they depend on nothing but the log. A refinement
begins with the last fit, and no later state depends on it: it is computed on demand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Final

from msgspec import Struct
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.fusion.estimator import GridStep, Hypothesis, Outlook
from radron.agent.fusion.field.analysis import Analysed, Analysis
from radron.agent.fusion.field.detectors import detector_of
from radron.agent.fusion.field.grid import Grid
from radron.agent.fusion.field.sums import Sums, rows_of
from radron.agent.fusion.observation import CountObservation, Observation
from radron.agent.terrain.ground import Ground
from radron.protocol.contamination import Contamination
from radron.protocol.entries import AnyEntry, Exposure

REFITTED_S: Final = 10.0
REFINED_S: Final = 5.0
_NS: Final = 1_000_000_000


class FieldState(Struct, frozen=True, eq=False):
    """pending: observations since the last fit. sums: the others. position_sigma_m: by drone, as last reported. reference_ns: end
    of the reference hover (UTC). refitted, refined: numbers of the last past times of both. analysed: the last fit; None before
    it. refinement: of this state, if there has been one since the fit.
    """

    sums: Sums
    pending: tuple[CountObservation, ...] = ()
    position_sigma_m: Mapping[str, float] = {}
    reference_ns: int = 0
    refitted: int = 0
    refined: int = 0
    analysed: Analysed | None = None
    refinement: Refinement | None = None

    @property
    def newest(self) -> Analysed | None:
        """The newest fit: the last refinement's, or the last one that began anew."""
        return self.analysed if self.refinement is None else self.refinement.analysed


class Refinement:
    """A refined fit, computed at the first access."""

    def __init__(self, compute: Callable[[], Analysed]) -> None:
        self._compute = compute

    @cached_property
    def analysed(self) -> Analysed:
        """The refined fit, the same at each access."""
        return self._compute()


class FieldEstimator:
    """Contaminated ground of one nuclide. A pure function of the observations and their grid steps."""

    name = "field"
    reads: tuple[type[AnyEntry], ...] = (Exposure,)
    grid_s: float | None = None
    hold_s = 0.25

    def __init__(self, mission: MissionConfig, area: Polygon) -> None:
        """``area``: the mission's area, mission frame.

        Raises:
            ConfigError: the drones have different detectors, the tables of counts lack the nuclide, or the mission names several.
        """
        self._config = mission.fusion.field
        self._ground = Ground.from_config(mission)
        self._detector = detector_of(mission)
        self._numbers = {drone.id: number for number, drone in enumerate(mission.drones)}
        self._analysis = Analysis(Grid.around(area), self._detector, self._ground, mission.named(), self._config)

    def initial(self, start_ns: int | None) -> FieldState:
        """Return the state without measurements."""
        reference_ns = 0 if start_ns is None else start_ns + round(self._config.reference_s * _NS)
        return FieldState(Sums.none(len(self._detector.background_ps)), reference_ns=reference_ns)

    def step(self, state: FieldState, step: GridStep, observations: Sequence[Observation]) -> FieldState:
        """Fit the measurements before the step where a fit is due, then add the step's observations."""
        refitted, refined = step.start_ns // round(REFITTED_S * _NS), step.start_ns // round(REFINED_S * _NS)
        if refitted > state.refitted:
            state = replace(self._refitted(state), refitted=refitted, refined=refined)
        elif refined > state.refined:
            before = replace(state, refinement=None)
            refinement = None if state.analysed is None else Refinement(lambda: self._refined(before))
            state = replace(state, refinement=refinement, refined=refined)
        counted = tuple(one for one in observations if isinstance(one, CountObservation) and self._detector.fits(one))
        sigmas = {one.identity.drone: one.position_sigma_m for one in counted}
        return replace(state, pending=(*state.pending, *counted), position_sigma_m={**state.position_sigma_m, **sigmas})

    def _summed(self, state: FieldState) -> Sums:
        rows = rows_of(state.pending, self._numbers, self._height_m, self._detector.counted, state.reference_ns)
        return state.sums.plus(rows)

    def _height_m(self, observation: CountObservation) -> float:
        x, y, z = observation.position
        return z - self._ground.height_m(x, y)

    def _refitted(self, state: FieldState) -> FieldState:
        sums = self._summed(state)
        state = replace(state, sums=sums, pending=(), refinement=None)
        if not len(sums):
            return state
        return replace(state, analysed=self._analysis.anew(sums, self._sigmas(state)))

    def _refined(self, state: FieldState) -> Analysed:
        assert state.analysed is not None
        return self._analysis.refined(state.analysed, self._summed(state), self._sigmas(state))

    def _sigmas(self, state: FieldState) -> list[float]:
        return [state.position_sigma_m.get(drone, 0.0) for drone in self._numbers]

    def work(self, state: FieldState, observations: int) -> int:
        """Return the work of a step: the fits on average over the steps."""
        return 8 + observations + len(state.sums) // 2

    def contamination(self, state: FieldState, step: GridStep) -> Contamination | None:
        """Return the map of the newest fit; None before the first."""
        return None if state.newest is None else state.newest.contamination

    def hypothesis(self, state: FieldState, step: GridStep) -> Hypothesis | None:
        """Return None: this estimator maps ground, and locates no source that the drones could fly to."""
        return None

    def outlook(self, state: FieldState, step: GridStep) -> Outlook | None:
        """Return None: contaminated ground is surveyed in lanes."""
        return None
