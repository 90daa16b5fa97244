"""The state of the fit of sources at rest: measurements, the fit, and the times of both."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

from msgspec import Struct
from msgspec.structs import replace

from radron.agent.fusion.estimator import Outlook
from radron.agent.fusion.observation import ConeObservation, CountObservation, Observation
from radron.agent.fusion.sources.data import Cones, Rows
from radron.agent.fusion.sources.fit import Fitted
from radron.agent.fusion.sources.spectra import UnknownSpectrum


class SourcesState(Struct, frozen=True, eq=False):
    """pending: observations that no moves have used yet. rows, cones: the others. position_sigma_m: by drone, as last reported.
    refined, moved: numbers of the last past times of refinement and moves. unknown: spectra of the unknown nuclides of
    ``fitted``; changed: whether a source changed between known and unknown at the last moves. none: log evidence of no source.
    outlook: possible further sources at the last moves; None: no search for them. refinement: of this state, if there has been
    one since the moves.
    """

    pending: tuple[Observation, ...] = ()
    rows: Rows = Rows.none()
    cones: Cones = Cones.none()
    position_sigma_m: Mapping[str, float] = {}
    refined: int = 0
    moved: int = 0
    fitted: Fitted | None = None
    unknown: tuple[UnknownSpectrum, ...] = ()
    changed: bool = False
    none: float = 0.0
    outlook: Outlook | None = None
    x0_stamp_ns: int = 0
    refinement: Refinement | None = None

    def taken(self, observations: Sequence[Observation]) -> SourcesState:
        """Return the state with observations of a step, not used yet."""
        sigmas = {one.identity.drone: one.position_sigma_m for one in observations}
        return replace(self, pending=(*self.pending, *observations), position_sigma_m={**self.position_sigma_m, **sigmas})

    def summed(self, drones: dict[str, int]) -> SourcesState:
        """Return the state with no observation pending. ``drones``: their numbers."""
        counts = [one for one in self.pending if isinstance(one, CountObservation)]
        cones = [one for one in self.pending if isinstance(one, ConeObservation)]
        rows, cone_table = self.rows.plus(counts, drones), self.cones.plus(cones, drones)
        return replace(self, pending=(), rows=rows, cones=cone_table, refinement=None)

    def emptied(self) -> SourcesState:
        """Return the state without measurements and without a fit."""
        none = replace(self, pending=(), rows=Rows.none(), cones=Cones.none(), fitted=None)
        return replace(none, unknown=(), changed=False, outlook=None, refinement=None)


class Refinement:
    """The state after a refinement, computed at the first access."""

    def __init__(self, compute: Callable[[], SourcesState]) -> None:
        self._compute = compute

    @cached_property
    def state(self) -> SourcesState:
        """The refined state, the same at each access."""
        return self._compute()
