"""The tracker of a possibly moving source: ``bayes`` for one of the candidates, with its tables of ``spectra``.

The tracker reads the exposures' spectra in two channels, the energy bins of the nuclide's lines and the others. The tracker thus
covers every candidate of the fit, independent of the lines in the detector's windows. Its directional response is the mean over
all headings, and the source is on the ground.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from shapely import Polygon

from radron.agent.config.mission import MissionConfig
from radron.agent.detector.windows import Windows
from radron.agent.fusion.bayes.counts import TRACK_TEMPER, background_log_likelihood, fit_rate
from radron.agent.fusion.bayes.estimator import BayesEstimator
from radron.agent.fusion.bayes.motion import REST
from radron.agent.fusion.bayes.response import Channel, Response
from radron.agent.fusion.bayes.soil import BODY_SHARE, OTHER_SHARE, SoilChannel
from radron.agent.fusion.bayes.state import BayesState
from radron.agent.fusion.estimator import Hypothesis
from radron.agent.fusion.facing import MEAN_STEEPNESS
from radron.agent.fusion.observation import ConeObservation, CountObservation, Observation
from radron.agent.fusion.sources.bins import LEAST_MM2, pooled
from radron.agent.fusion.sources.counts import CountModel
from radron.agent.fusion.sources.data import UNTOLD_HITS, Rows
from radron.agent.fusion.sources.fit import Problem
from radron.agent.fusion.sources.hidden import HIDDEN
from radron.agent.fusion.sources.shades import KnownWalls
from radron.agent.fusion.sources.solution import Solution
from radron.agent.fusion.sources.spectra import Spectra, UnknownSpectrum
from radron.agent.geometry import Array, Vector3
from radron.agent.terrain.ground import Ground
from radron.protocol.spectrum import BINS, EDGES_KEV

_CLEAR_SIGMA = 0.05  # of the log rate of a source as fitted, by the model's error
_HIDDEN_SIGMA = 2.0  # and behind an unknown wall
_ITERATIONS = 6
_IN_VIEW = 0.5  # probability of a clear view
_LEAST_PS = 1e-6  # so that no count is impossible


class Mark(Struct, frozen=True):
    """The time of the last moves, or of the track's first source (``found``), with the track's evidence until then.

    waiting: earlier exposures that enter the evidence only with the drone's next exposure, by the time of their middle (ns) and
    place.
    """

    stamp_ns: int
    evidence: float
    waiting: frozenset[tuple[int, Vector3]] = frozenset()
    found: bool = False


class Track(Struct, frozen=True, eq=False):
    """The track of a source that may move (``handover``).

    nuclide: its index. state: of its tracker. begun_ns: start of the track. others: fitted sources of other nuclides, and
    unknown: spectra of the unknown nuclides among them. moves: whether it has been handed over; beside: the reports on the others
    then. kept_ns: time from which measurements are kept, as the source is at rest or lost; 0: they are not kept. mark: None
    without a tracked source; newest: observations that enter the evidence after the mark, each with the tracker's reading of it.
    ahead: number of times that the track has explained the measurements since the last moves better than the fit, without a lag
    in between. doubted_ns: first time of doubt whether a reported source is at rest; 0: there was no doubt.
    """

    nuclide: int
    state: BayesState
    others: Solution
    begun_ns: int
    unknown: tuple[UnknownSpectrum, ...] = ()
    moves: bool = False
    beside: tuple[Hypothesis, ...] = ()
    kept_ns: int = 0
    mark: Mark | None = None
    newest: tuple[tuple[Observation, Observation], ...] = ()
    ahead: int = 0
    doubted_ns: int = 0

    @property
    def is_lost(self) -> bool:
        """Whether no source is tracked."""
        return self.state.track is None

    @property
    def at_rest(self) -> float:
        """Probability that the source is at rest; NaN without a tracked source."""
        track = self.state.track
        return math.nan if track is None else float(track.weight[:, REST].sum() / track.weight.sum())

    @property
    def in_view(self) -> bool:
        """Whether the views of all cameras on the source seem clear of unknown walls."""
        track = self.state.track
        return track is not None and float((track.weight.sum(axis=1) @ track.hidden[..., 0]).min()) >= _IN_VIEW

    @property
    def counted(self) -> tuple[tuple[Observation, Observation], ...]:
        """The part of ``newest`` that has entered the evidence."""
        waiting = self._waiting
        return tuple(one for one in self.newest if not _is_of(waiting, one[0]))

    def marked(self, now_ns: int, *, found: bool = False) -> Track:
        """Return the track with a mark at this time, if a source is tracked."""
        if self.is_lost:
            return replace(self, mark=None, newest=(), ahead=0)
        waiting = self._waiting
        newest = tuple(one for one in self.newest if _is_of(waiting, one[0]))
        return replace(self, mark=Mark(now_ns, self.state.evidence, waiting, found), newest=newest)

    @property
    def _waiting(self) -> frozenset[tuple[int, Vector3]]:
        return frozenset((one.middle_ns, one.position) for one in self.state.waiting.values())


def _is_of(waiting: frozenset[tuple[int, Vector3]], observation: Observation) -> bool:
    return isinstance(observation, CountObservation) and (observation.middle_ns, observation.position) in waiting


class Apart(CountObservation, frozen=True, eq=False, kw_only=True):
    """An exposure with counts in the tracker's channels. beside: (2,) expected counts of sources of other nuclides."""

    beside: Array


class Tracker:
    """``bayes`` for a nuclide; it reads the observations converted by ``seen``."""

    def __init__(
        self, mission: MissionConfig, area: Polygon, spectra: Spectra, windows: Windows, walls: KnownWalls, nuclide: int
    ) -> None:
        """``windows``: energy windows in which the detector assigns coincidences to a line. ``nuclide``: index among the
        spectra's.
        """
        self._spectra, self._walls = spectra, walls
        self._bins = _bins(Windows((spectra.nuclides[nuclide],), mission.detection))
        self._lines = np.array([window.energy_kev for window in windows.each])
        of_lines = [
            spectra.cones(window.energy_kev, windows.reach_kev(place), window.unsure_kev)
            for place, window in enumerate(windows.each)
        ]
        self._own = [bool(pointing[nuclide] > 0.0) for pointing, _, _ in of_lines]
        area_mm2 = math.fsum(float(pointing[nuclide]) for pointing, _, _ in of_lines)
        cones_ps = math.fsum(cones_ps for (_, _, cones_ps), own in zip(of_lines, self._own, strict=True) if own)
        cones = Channel(max(area_mm2, LEAST_MM2), 1.0, 0.0, max(cones_ps, _LEAST_PS), 0.0)
        self._response = _response(spectra, nuclide, self._bins, cones)
        self._ground = Ground.from_config(mission)
        self._drones = {drone.id: number for number, drone in enumerate(mission.drones)}
        self.bayes = BayesEstimator(mission, area, self._response, _beside_of)

    def seen(self, observation: Observation, others: Solution, unknown: Sequence[UnknownSpectrum] = ()) -> Observation | None:
        """Return the observation as the tracker reads it; None if it carries no information on the nuclide.

        ``others``, ``unknown``: as in ``Track``.
        """
        if isinstance(observation, ConeObservation):
            return observation if self._own[int(np.abs(self._lines - observation.energy_kev).argmin())] else None
        if not observation.spectrum and observation.counts[0] >= UNTOLD_HITS:
            return None
        events = np.zeros(BINS)
        for one in observation.spectrum:
            events[one.place] = one.singles + one.coincidences
        partial, full = (pooled(events) @ self._bins).tolist()
        counts = np.array([partial + full, full, 0.0])  # split again by ``Response.apart``
        return Apart(**{**_fields(observation), "counts": counts}, beside=self._beside(observation, others, unknown))

    def evidence_at_rest(self, newest: Problem, solution: Solution, background: float) -> float:
        """Return the log Bayes factor of these measurements given sources at rest against background alone.

        The background has the strength of a track's; channels and cones are the track's, too. For each sum over exposures the
        view is clear, or it is hidden and any share of the photons passes.
        """
        model = newest.counts
        counts, expected, alone = (
            each @ self._bins for each in (model.counts, model.expected(solution).clear, model.background(solution))
        )
        none = self._response.background_ps * background * model.live_s[:, None]
        prior, variance = np.log([1.0 - HIDDEN, HIDDEN]), np.square([_CLEAR_SIGMA, _HIDDEN_SIGMA])
        total = newest.cones.log_likelihood(solution)
        for k, signal, b, h0 in zip(counts, np.maximum(expected - alone, _LEAST_PS), alone, none, strict=True):
            _, _, likelihood = fit_rate(k, np.stack((signal, signal)), b, variance, TRACK_TEMPER, _ITERATIONS)
            total += float(np.logaddexp(*(likelihood + prior)) - background_log_likelihood(k, h0, TRACK_TEMPER))
        return total

    def evidence_beside(self, seen: Iterable[Observation], background: float) -> float:
        """Return the log Bayes factor of the other sources against background alone; a track counts them as background."""
        total = 0.0
        for one in seen:
            if isinstance(one, Apart):
                counts, alone = self._response.apart(one.counts), self._response.background_ps * (background * one.live_time_s)
                known = background_log_likelihood(counts, alone + one.beside, TRACK_TEMPER)
                total += float(known - background_log_likelihood(counts, alone, TRACK_TEMPER))
        return total

    def _beside(self, observation: CountObservation, others: Solution, unknown: Sequence[UnknownSpectrum]) -> Array:
        """Return the (2,) expected counts of the others, as fitted, in a clear view."""
        if not len(others):
            return np.zeros(2)
        rows = Rows.single(observation, self._drones[observation.identity.drone])
        model = CountModel(rows, self._spectra.plus(unknown), self._ground, len(self._drones), self._walls)
        counts: Array = (model.expected(others).clear - model.background(others))[0] @ self._bins
        return np.maximum(counts, 0.0)


def _beside_of(observation: CountObservation) -> Array:
    return observation.beside if isinstance(observation, Apart) else np.zeros(2)


def _fields(observation: CountObservation) -> dict[str, Any]:
    return {name: getattr(observation, name) for name in CountObservation.__struct_fields__}


def _bins(windows: Windows) -> Array:
    """Return the (BINS, 2) assignment of energy bins to channels: bins without a line's window in their middle, and with one."""
    middle = (np.array(EDGES_KEV[1:]) + np.array(EDGES_KEV[:-1])) / 2.0
    full = np.array([windows.line_of(kev) is not None for kev in middle.tolist()])
    return np.column_stack((~full, full)).astype(np.float64)


def _response(spectra: Spectra, n: int, bins: Array, cones: Channel) -> Response:
    """Return a camera's response to nuclide n in the channels; areas in the tables are times photons per decay."""
    near, far, _, *of_soil = spectra.templates(0.0, 0.0)[n] @ bins
    direct = np.maximum(spectra.direct_templates(0.0)[n, 0] @ bins, LEAST_MM2)
    background_ps = np.maximum(spectra.background_ps(0.0) @ bins, _LEAST_PS)
    edge = spectra.facing(0.0)[n] @ bins / direct  # either way, the area's deficit towards the edge
    if of_soil:  # ``Response`` assigns this share of the photons scattered nearby over nothing to vehicle and mount
        near = direct + (near - direct) / BODY_SHARE
    rows = np.column_stack((direct, near / direct, far / direct, background_ps, edge))
    partial, full = (Channel(*row) for row in rows.tolist())
    soil = _soil(of_soil, far, background_ps) if of_soil else None
    return Response(spectra.nuclides[n], 1.0, float(spectra.air_per_m[n]), (partial, full), cones, soil)


def _soil(of_soil: list[Array], air: Array, background_ps: Array) -> tuple[SoilChannel, SoilChannel]:
    """Return the soil channels from H, I and J in the channels, the air's scatter, and the background; (2,) each."""
    near, steep, turned = of_soil
    turn = MEAN_STEEPNESS * turned / np.maximum(near + MEAN_STEEPNESS * steep, LEAST_MM2)
    rows = np.column_stack((near, steep, air, turn, (1.0 - OTHER_SHARE) * background_ps))
    partial, full = (SoilChannel(*row) for row in rows.tolist())
    return partial, full
